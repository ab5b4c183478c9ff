"""When a detection run is good, doubtful or bad: all limits in one place.

A frame is a scan or an image.

| limit | verdict |
|---|---|
| no frame could be judged | bad |
| anything in the log could not be read or decoded | doubtful |
| heights of the ground plane spread more than 0.10 m between the first scans | doubtful |
| a height that was given is more than 0.3 m from the ground that the scans show | doubtful |
| less than 5 % or more than 95 % of all points are ground | doubtful |
| more than a tenth of the merged scans lack a LiDAR | doubtful |
| not one object in the whole run | doubtful |
| an image could not be used | doubtful |
| a network found nothing in the whole run | doubtful |
| at least 20 boxes of a camera whose lens and place are known, and not one got a place | doubtful |

Those of tracks are in `percept.cli.track.verdict`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from percept.cli.track.verdict import TrackFacts, track_doubts
from percept.core.results import Verdict

__all__ = ["CameraFacts", "RunFacts", "judge"]

_LARGEST_HEIGHT_SPREAD_M = 0.10
_LARGEST_HEIGHT_ERROR_M = 0.3
_GROUND_SHARE = (0.05, 0.95)
_LARGEST_MISSING_SHARE = 0.1
_LEAST_BOXES_WITHOUT_PLACES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFacts:
    """What the verdict rests on.

    Attributes:
        frames: Frames that were judged.
        objects: Boxes.
        points: Points of all frames.
        ground_points: Points taken for ground.
        losses: What could not be read or decoded, by reason.
        missing: Merged scans without one of the LiDARs, by topic.
        height_errors_m: Height that was given less the height that the first scans show, by
            stream; only where one was given and the ground was found.
        height_spread_m: Spread of the estimated height, by stream; only where it was estimated.
    """

    frames: int
    objects: int
    points: int
    ground_points: int
    losses: Mapping[str, int] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    height_errors_m: Mapping[str, float] = field(default_factory=dict)
    height_spread_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFacts:
    """What the verdict on the camera half rests on.

    Attributes:
        images: Images that models were to look at, by camera.
        unusable: How many of them could not be used, by camera.
        boxes: Boxes of each model over all cameras.
        without_places: Boxes of the cameras whose lens and place among the sensors are known and
            of which not one box got a place, by camera.
        losses: What could not be read or decoded, by reason.
    """

    images: Mapping[str, int]
    unusable: Mapping[str, int] = field(default_factory=dict)
    boxes: Mapping[str, int] = field(default_factory=dict)
    without_places: Mapping[str, int] = field(default_factory=dict)
    losses: Mapping[str, int] = field(default_factory=dict)

    @property
    def looked_at(self) -> int:
        """Images that could be used."""
        return sum(self.images.values()) - sum(self.unusable.values())


def judge(
    scans: RunFacts | None,
    cameras: CameraFacts | None = None,
    tracks: TrackFacts | None = None,
) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict of a run, its reasons, and advice.

    Args:
        scans: The LiDAR half, or None where it was not to run.
        cameras: The camera half, or None where it was not to run.
        tracks: What happened over time, or None where nothing was tracked.
    """
    doubts: list[str] = []
    advice: list[str] = []
    judged = 0 if scans is None else scans.frames
    looked_at = 0 if cameras is None else cameras.looked_at
    if not judged and not looked_at:
        return Verdict.BAD, (_nothing(scans, cameras),), ("Look with `percept inspect`",)
    losses = {**(scans.losses if scans else {}), **(cameras.losses if cameras else {})}
    if losses:
        lost = ", ".join(f"{count} x {reason}" for reason, count in losses.items())
        doubts.append(f"the log could not be read in full: {lost}")
        advice.append("Save a sound copy with `percept inspect LOG --recover OUT`")
    if scans is not None:
        _add_scan_doubts(scans, doubts, advice)
    if cameras is not None:
        _add_camera_doubts(cameras, doubts, advice)
    if tracks is not None:
        over_time, advised = track_doubts(tracks)
        doubts += over_time
        advice += advised
    if doubts:
        return Verdict.DOUBTFUL, tuple(doubts), tuple(dict.fromkeys(advice))
    parts = [f"{judged} scans were judged"] * bool(judged)
    parts += [f"{looked_at} images were looked at"] * bool(looked_at)
    return (
        Verdict.GOOD,
        (f"the log was read in full, and {' and '.join(parts)} without a doubt",),
        (),
    )


def _nothing(scans: RunFacts | None, cameras: CameraFacts | None) -> str:
    if scans is not None or cameras is None:
        return "no scan could be judged"
    if not cameras.images:
        return "no image in this part of the log"
    return "no image could be used"


def _add_scan_doubts(facts: RunFacts, doubts: list[str], advice: list[str]) -> None:
    heights = _height_doubts(facts)
    if heights:
        doubts += heights
        advice.append("Give the right --sensor-height or a rig, or leave it to be measured")
    if not facts.frames:
        doubts.append("no scan could be judged")
        return
    doubts += _ground_doubts(facts)
    for topic, count in facts.missing.items():
        if count > _LARGEST_MISSING_SHARE * facts.frames:
            doubts.append(f"{count} of {facts.frames} merged scans lack {topic}")
            advice.append("See its gaps with `percept inspect`, or use --lidars separate")
    if facts.objects == 0:
        doubts.append(f"not one object in {facts.frames} scans")
        advice.append("Look at the ground and the clusters with `percept view`")


def _add_camera_doubts(facts: CameraFacts, doubts: list[str], advice: list[str]) -> None:
    for camera, count in facts.unusable.items():
        if count:
            doubts.append(f"{count} of {facts.images[camera]} images of {camera} cannot be used")
            advice.append("See why in the report, under what was left out")
    for model, count in facts.boxes.items():
        if not count:
            doubts.append(f"'{model}' found nothing in {facts.looked_at} images")
            advice.append("Check the network's --pixels, --layout and --score")
    for camera, count in facts.without_places.items():
        if count >= _LEAST_BOXES_WITHOUT_PLACES:
            doubts.append(f"not one of {count} boxes of {camera} got a place in space")
            advice.append("Check stamps with `percept inspect`, lens and rig with `calib check`")


def _ground_doubts(facts: RunFacts) -> list[str]:
    share = facts.ground_points / max(facts.points, 1)
    if _GROUND_SHARE[0] <= share <= _GROUND_SHARE[1]:
        return []
    return [f"{share:.0%} of the points were taken for ground"]


def _height_doubts(facts: RunFacts) -> list[str]:
    given = [
        f"the height given for '{name}' is {abs(error_m):.2f} m "
        f"{'above' if error_m > 0 else 'below'} what the scans show"
        for name, error_m in facts.height_errors_m.items()
        if abs(error_m) > _LARGEST_HEIGHT_ERROR_M
    ]
    found = [
        f"the height of '{name}' is uncertain (spread {spread_m:.2f} m)"
        for name, spread_m in facts.height_spread_m.items()
        if spread_m > _LARGEST_HEIGHT_SPREAD_M
    ]
    return given + found
