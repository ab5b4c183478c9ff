"""The rule that lanelets side by side share the line between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from percept.hdmap.check.checked_map import CheckedMap, sound
from percept.hdmap.check.issue import IssueCode, MapIssue, listed
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import Lanelet

__all__ = ["BORDER_SHARING"]

_NAME = "mapping.lane.border_sharing"
_BESIDE_ONE = IssueCode(
    "Lane.BorderSharing-001", _NAME, "Error", "lanelet",
    "Draw one line string between the two and make it a border of both",
)  # fmt: skip
_BESIDE_SHORTER = IssueCode(
    "Lane.BorderSharing-002", _NAME, "Error", "lanelet",
    "Divide it where the others are divided, and let each pair share the line string between",
)  # fmt: skip

# A lanelet is widened by this share of its width; a border that then lies in it is next to it.
_WIDENED_BY = 0.05
# Lanelets that lie on each other by more than this are meant to: two directions on one lane.
_LARGEST_OVERLAP = 0.05
# Where people cross, they share no border with what vehicles use (lateral_subtype_connection).
_CROSSING = ("crosswalk", "walkway")


def _border_sharing(checked: CheckedMap) -> Iterator[MapIssue]:
    beside = {
        lanelet_id: set(_unshared_beside(checked, lanelet))
        for lanelet_id, lanelet in checked.hd_map.lanelets.items()
    }
    for lanelet_id, others in beside.items():
        shorter = []
        for other_id in sorted(others):
            if lanelet_id in beside[other_id]:
                yield _BESIDE_ONE.at(
                    lanelet_id, f"lies beside lanelet {other_id} and shares no border with it"
                )
            else:
                shorter.append(other_id)
        if shorter:
            yield _BESIDE_SHORTER.at(
                lanelet_id, f"lies beside lanelet {listed(shorter)} and shares no border with it"
            )


def _unshared_beside(checked: CheckedMap, lanelet: Lanelet) -> Iterator[int]:
    """Yield lanelets with a border that lies wholly along a lanelet and is not shared with it."""
    ground = checked.lanelet_ground(lanelet.lanelet_id)
    # Mitred: the corners of the lanelet stay corners.
    widened = sound(ground.buffer(_widening_m(lanelet), join_style="mitre"))
    crossing, related = lanelet.subtype in _CROSSING, _related(checked, lanelet)
    others = [
        other_id
        for other_id in checked.lanelets_near(widened)
        if other_id not in related
        and (checked.hd_map.lanelets[other_id].subtype in _CROSSING) == crossing
    ]
    beside = [
        i for i, along in zip(others, _lie_along(checked, widened, others), strict=True) if along
    ]
    overlaps = _overlaps(checked, widened, beside)
    yield from (i for i, share in zip(beside, overlaps, strict=True) if share <= _LARGEST_OVERLAP)


def _lie_along(
    checked: CheckedMap, widened: BaseGeometry, others: Sequence[int]
) -> NDArray[np.bool_]:
    """Return which lanelets have a border that lies wholly in a widened one."""
    shapely.prepare(widened)
    borders = np.array([checked.borders(i) for i in others], dtype=object).reshape(-1, 2)
    inside: NDArray[np.bool_] = shapely.covers(widened, borders).any(axis=1)
    return inside


def _overlaps(
    checked: CheckedMap, widened: BaseGeometry, others: Sequence[int]
) -> NDArray[np.float64]:
    """Return the share that lanelets and a widened one have in common of what they cover."""
    grounds = np.array([checked.lanelet_ground(i) for i in others], dtype=object)
    common = shapely.area(shapely.intersection(widened, grounds))
    shares: NDArray[np.float64] = common / (widened.area + shapely.area(grounds) - common)
    return shares


def _widening_m(lanelet: Lanelet) -> float:
    """Return a share of the mean of the widths at a lanelet's two ends."""
    across = lanelet.left_map[[0, -1], :2] - lanelet.right_map[[0, -1], :2]
    return _WIDENED_BY * float(np.hypot(*across.T).mean())


def _related(checked: CheckedMap, lanelet: Lanelet) -> set[int]:
    """Return a lanelet, what shares a border with it, what follows, and what leads to it."""
    routing, identity = checked.routing, lanelet.lanelet_id
    sides = (*routing.left[identity], *routing.right[identity])
    ends = (*routing.following_ids(identity), *routing.previous_ids(identity))
    return {identity, *ends, *(beside.lanelet_id for beside in sides)}


BORDER_SHARING = Rule(
    name=_NAME,
    looks_for="Lanelets side by side that do not share the line between them",
    codes=(_BESIDE_ONE, _BESIDE_SHORTER),
    requirements=("vm-01-03", "vm-01-04"),
    find=_border_sharing,
)
