"""Who may use a lanelet, and in which direction, by its tags.

As Lanelet2's generic traffic rules: tags `participant:...` decide; without any the subtype does.
Signs that forbid somebody to enter (a rule of a country) are not read.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["may_pass", "may_pass_in_reverse", "truth"]

# What a subtype admits, by Lanelet2's table of subtypes; a prefix admits all that it begins.
_EVERYBODY = ("pedestrian", "bicycle", "vehicle")
_SUBTYPES: Mapping[str, tuple[str, ...]] = {
    "": ("vehicle",),
    "road": ("vehicle", "bicycle"),
    "highway": ("vehicle",),
    "bicycle_lane": ("bicycle",),
    "play_street": _EVERYBODY,
    "emergency_lane": ("vehicle:emergency",),
    "bus_lane": ("vehicle:emergency", "vehicle:bus", "vehicle:taxi"),
    "exit": _EVERYBODY,
    "walkway": ("pedestrian",),
    "crosswalk": ("pedestrian",),
    "stairs": ("pedestrian",),
    "shared_walkway": ("pedestrian", "bicycle"),
}
_YES = ("yes", "true", "1")
_NO = ("no", "false", "0")


def may_pass(tags: Mapping[str, str], participant: str) -> bool:
    """Return whether a lanelet admits a participant, such as `vehicle` or `vehicle:bus`."""
    if any(key.startswith("participant") for key in tags):
        return _override(tags, "participant", participant) is True
    admitted = _SUBTYPES.get(tags.get("subtype", ""), ())
    return any(participant.startswith(word) for word in admitted)


def may_pass_in_reverse(tags: Mapping[str, str], participant: str) -> bool:
    """Return whether a lanelet is driven against its direction: it is not one-way.

    Without a tag lanelets are one-way but for pedestrians.
    """
    said = truth(tags.get("one_way"))
    if said is not None:
        return not said
    if any(key.startswith("one_way") for key in tags):
        return _override(tags, "one_way", participant) is False
    return participant == "pedestrian"


def truth(word: str | None) -> bool | None:
    """Return what a tag's word says; None where it says neither yes nor no."""
    if word is None or word.lower() not in (*_YES, *_NO):
        return None
    return word.lower() in _YES


def _override(tags: Mapping[str, str], prefix: str, participant: str) -> bool | None:
    """Return what `prefix:participant`, or the nearest tag above it, says."""
    key = f"{prefix}:{participant}"
    above = [name for name in tags if name.startswith(prefix) and key.startswith(name)]
    return truth(tags[max(above, key=len)]) if above else None
