"""Regulatory elements whose members lie far apart: more than one place is meant by one rule."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.elements import Member, RegulatoryElement

__all__ = ["far_apart"]

_LARGEST_EXTENT_M = 200.0


def far_apart(checked: CheckedMap, rule: RegulatoryElement, code: IssueCode) -> Iterator[MapIssue]:
    """Yield one issue if the box about all members, seen from above, has a diagonal over 200 m.

    Args:
        checked: The map.
        rule: The regulatory element; members that the map lacks do not count.
        code: What to report it as.
    """
    points = [part for member in rule.members if len(part := _points_of(checked, member))]
    if not points:
        return
    extent_m = float(np.hypot(*np.ptp(np.concatenate(points)[:, :2], axis=0)))
    if extent_m > _LARGEST_EXTENT_M:
        what = f"has members {extent_m:.0f} m apart, more than {_LARGEST_EXTENT_M:.0f} m"
        yield code.at(rule.rule_id, what)


def _points_of(checked: CheckedMap, member: Member) -> NDArray[np.float64]:
    """Return the points (K, 3) of a member; none of one that the map lacks."""
    hd_map = checked.hd_map
    if member.kind == "way" and member.ref in hd_map.line_strings:
        return hd_map.points_of(member.ref)
    lanelet = hd_map.lanelets.get(member.ref)
    if member.kind == "relation" and lanelet is not None:
        return np.concatenate([lanelet.left_map, lanelet.right_map])
    if member.kind == "node" and member.ref in hd_map.point_tags:
        return hd_map.points.xyz_map[hd_map.points.rows(np.array([member.ref]))]
    return np.empty((0, 3))
