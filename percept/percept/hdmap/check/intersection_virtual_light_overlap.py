"""Virtual traffic lights whose ways, from start line to end line, overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_virtual_light import coordinated_lights
from percept.hdmap.check.intersection_virtual_light_section import (
    Track,
    end_line_on,
    lanelets_below,
    path_between,
)
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["VIRTUAL_LIGHT_OVERLAP"]

_NAME = "mapping.intersection.virtual_traffic_light_section_overlap"
_OVERLAP = IssueCode(
    "Intersection.VirtualTrafficLightSectionOverlap-001",
    _NAME,
    "Error",
    "regulatory element",
    "Place the end_line of one before the start_line of the next",
)


@dataclass(frozen=True, slots=True)
class _Section:
    """A way through a virtual traffic light.

    Attributes:
        rule: The virtual traffic light.
        start: Its start line.
        end: The end line of this way; None where there is none.
        path: Lanelets from that of the start line to one that the light is for.
    """

    rule: RegulatoryElement
    start: int
    end: int | None
    path: tuple[int, ...]


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    sections = {
        rule.rule_id: list(_sections(checked, rule)) for rule in coordinated_lights(checked)
    }
    for own in (section for of_rule in sections.values() for section in of_rule):
        for rule_id in sorted(_lights_near(checked, own) & sections.keys()):
            for other in sections[rule_id] if rule_id != own.rule.rule_id else ():
                if _overlap(checked, own, other):
                    what = f"on its way to lanelet {own.path[-1]} overlaps"
                    way = f"virtual traffic light {rule_id} on that to lanelet {other.path[-1]}"
                    yield _OVERLAP.at(own.rule.rule_id, f"{what} {way}")


def _sections(checked: CheckedMap, rule: RegulatoryElement) -> Iterator[_Section]:
    starts = checked.ways_in(rule, "start_line")
    line = checked.line(starts[0]) if starts else None
    if line is None:
        return
    lanelets = lanelets_below(checked, line)
    for target in checked.lanelets_under(rule.rule_id):
        path = path_between(checked, lanelets, target)
        if path:
            yield _Section(rule, starts[0], end_line_on(checked, rule, target), path)


def _lights_near(checked: CheckedMap, section: _Section) -> set[int]:
    """Return regulatory elements of the lanelets in the box about a section."""
    ground = shapely.union_all([checked.lanelet_ground(lanelet) for lanelet in section.path])
    near = (checked.hd_map.lanelets[i] for i in checked.lanelets_near(ground))
    return {rule for lanelet in near for rule in lanelet.rule_ids}


def _overlap(checked: CheckedMap, own: _Section, other: _Section) -> bool:
    """Return whether one section begins before the other one ends on the same way.

    Of a single shared lanelet the lines decide: the one that ends there may do so before the
    other begins.
    """
    shared = _shared(own.path, other.path)
    if len(shared) != 1:
        return len(shared) > 1
    first, second = (own, other) if own.path[-1] == shared[0] else (other, own)
    end = None if first.end is None else checked.line(first.end)
    start = checked.line(second.start)
    if end is None or start is None:
        return False
    track = Track.along(checked, shared)
    return bool((track.place(end) > track.place(start)).any())


def _shared(one: Sequence[int], other: Sequence[int]) -> Sequence[int]:
    """Return the lanelets that two ways share, if both together are one way without forks.

    One lies all in the other, or the end of one is the beginning of the other.
    """
    for inner, outer in ((one, other), (other, one)):
        if any(outer[i : i + len(inner)] == inner for i in range(len(outer) - len(inner) + 1)):
            return inner
    for first, second in ((one, other), (other, one)):
        for length in range(min(len(one), len(other)), 0, -1):
            if first[-length:] == second[:length]:
                return first[-length:]
    return ()


VIRTUAL_LIGHT_OVERLAP = Rule(
    name=_NAME,
    looks_for="Virtual traffic lights that begin before the one before them ends",
    codes=(_OVERLAP,),
    requirements=("vm-03-18",),
    find=_find,
)
