"""Areas that a regulatory element gives a meaning: no stopping, no parking, detection, bus stop.

The polygon says where, the regulatory element what holds there, the lanelet for whom; a stop line
says where to wait. A polygon of which a part is missing has no effect on a planner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from percept.hdmap.check.area import is_polygon, polygons_of
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue, Primitive
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["BUS_STOP_AREA", "DETECTION_AREA", "NO_PARKING_AREA", "NO_STOPPING_AREA"]

_REGULATION: Primitive = "regulatory element"
_ROAD = "road"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Codes:
    """What can be wrong with a kind of area and its regulatory elements.

    The kind is both the polygon's `type` and the regulatory element's `subtype`.
    """

    kind: str
    not_referred: IssueCode
    polygon_count: IssueCode
    polygon_type: IssueCode
    no_lanelet: IssueCode
    other_lanelet: IssueCode

    @property
    def all(self) -> tuple[IssueCode, ...]:
        return (
            self.not_referred,
            self.polygon_count,
            self.polygon_type,
            self.no_lanelet,
            self.other_lanelet,
        )


def _codes(kind: str, rule: str, prefix: str, lanelet_numbers: tuple[int, int]) -> _Codes:
    """Return the codes of a kind of area; the numbers of those about lanelets differ."""
    add = f"Add a regulatory element of subtype {kind} that refers to it"
    one = f"Let it refer to one polygon of type {kind}, and make one for each further area"
    road = "Let the road lanelets that it holds for refer to it, and no others"
    unused, foreign = (f"{prefix}-{number:03d}" for number in lanelet_numbers)
    return _Codes(
        kind=kind,
        not_referred=IssueCode(f"{prefix}-001", rule, "Error", "polygon", add),
        polygon_count=IssueCode(f"{prefix}-002", rule, "Error", _REGULATION, one),
        polygon_type=IssueCode(f"{prefix}-003", rule, "Error", _REGULATION, one),
        no_lanelet=IssueCode(unused, rule, "Error", _REGULATION, road),
        other_lanelet=IssueCode(foreign, rule, "Error", _REGULATION, road),
    )


def _unreferred(checked: CheckedMap, kind: str, code: IssueCode) -> Iterator[MapIssue]:
    """Yield polygons that no regulatory element of their kind refers to."""
    for polygon in polygons_of(checked, kind):
        if not checked.is_referred(polygon, by=kind):
            yield code.at(polygon, f"is of type {kind}, but no regulatory element refers to it")


def _find_areas(checked: CheckedMap, codes: _Codes) -> Iterator[MapIssue]:
    """Yield what is wrong with a kind of area in any case, whether it has stop lines or not."""
    yield from _unreferred(checked, codes.kind, codes.not_referred)
    for rule in checked.rules_of(codes.kind):
        yield from _about_polygon(checked, rule, codes)
        yield from _about_lanelets(checked, rule, codes)


def _about_polygon(
    checked: CheckedMap, rule: RegulatoryElement, codes: _Codes
) -> Iterator[MapIssue]:
    polygons = [i for i in checked.ways_in(rule, "refers") if is_polygon(checked, i)]
    if len(polygons) != 1:
        yield codes.polygon_count.at(rule.rule_id, f"refers to {len(polygons)} polygons, not one")
    elif (kind := checked.way_tags(polygons[0]).get("type")) != codes.kind:
        what = f"refers to polygon {polygons[0]}, which is {_typed(kind)}, not {codes.kind}"
        yield codes.polygon_type.at(rule.rule_id, what)


def _about_lanelets(
    checked: CheckedMap, rule: RegulatoryElement, codes: _Codes
) -> Iterator[MapIssue]:
    lanelets = checked.lanelets_under(rule.rule_id)
    others = [i for i in lanelets if checked.hd_map.lanelets[i].subtype != _ROAD]
    if not lanelets:
        yield codes.no_lanelet.at(rule.rule_id, "is referred to by no road lanelet")
    elif others:
        names = ", ".join(map(str, others))
        what = f"is referred to by lanelets that are no roads: {names}"
        yield codes.other_lanelet.at(rule.rule_id, what)


def _typed(kind: str | None) -> str:
    return f"of type {kind}" if kind else "without a type"


_DETECTION = "mapping.area.detection_area"
_DETECTION_CODES = _codes("detection_area", _DETECTION, "Area.DetectionArea", (5, 6))
_DETECTION_LINE = IssueCode(
    "Area.DetectionArea-004",
    _DETECTION,
    "Error",
    _REGULATION,
    "Give it one ref_line, the stop line at which to wait",
)


def _find_detection(checked: CheckedMap) -> Iterator[MapIssue]:
    yield from _find_areas(checked, _DETECTION_CODES)
    for rule in checked.rules_of(_DETECTION_CODES.kind):
        lines = checked.ways_in(rule, "ref_line")
        types = [checked.way_tags(line).get("type") for line in lines]
        if len(lines) != 1:
            yield _DETECTION_LINE.at(rule.rule_id, f"has {len(lines)} ref_lines, not one")
        elif types[0] != "stop_line":
            what = f"has ref_line {lines[0]}, which is {_typed(types[0])}, not stop_line"
            yield _DETECTION_LINE.at(rule.rule_id, what)


DETECTION_AREA = Rule(
    name=_DETECTION,
    looks_for="Detection areas that no road lanelet obeys, or without one stop line to wait at",
    codes=(*_DETECTION_CODES.all, _DETECTION_LINE),
    requirements=("vm-06-05",),
    find=_find_detection,
)

_STOPPING = "mapping.area.no_stopping_area"
_STOPPING_CODES = _codes("no_stopping_area", _STOPPING, "Area.NoStoppingArea", (6, 7))
_STOPPING_LINES = IssueCode(
    "Area.NoStoppingArea-004",
    _STOPPING,
    "Error",
    _REGULATION,
    "Give it at most one ref_line, the stop line at which to wait",
)
_STOPPING_LINE_TYPE = IssueCode(
    "Area.NoStoppingArea-005",
    _STOPPING,
    "Error",
    _REGULATION,
    "Let the ref_line be a line string of type stop_line",
)


def _find_stopping(checked: CheckedMap) -> Iterator[MapIssue]:
    yield from _find_areas(checked, _STOPPING_CODES)
    for rule in checked.rules_of(_STOPPING_CODES.kind):
        lines = checked.ways_in(rule, "ref_line")
        types = [checked.way_tags(line).get("type") for line in lines]
        if len(lines) > 1:
            yield _STOPPING_LINES.at(rule.rule_id, f"has {len(lines)} ref_lines")
        elif lines and types[0] != "stop_line":
            what = f"has ref_line {lines[0]}, which is {_typed(types[0])}, not stop_line"
            yield _STOPPING_LINE_TYPE.at(rule.rule_id, what)


NO_STOPPING_AREA = Rule(
    name=_STOPPING,
    looks_for="Areas of no stopping that no road lanelet obeys, or with a wrong stop line",
    codes=(*_STOPPING_CODES.all, _STOPPING_LINES, _STOPPING_LINE_TYPE),
    requirements=("vm-06-04",),
    find=_find_stopping,
)

_PARKING = "mapping.area.no_parking_area"
_PARKING_CODES = _codes("no_parking_area", _PARKING, "Area.NoParkingArea", (4, 5))


def _find_parking(checked: CheckedMap) -> Iterator[MapIssue]:
    yield from _find_areas(checked, _PARKING_CODES)


NO_PARKING_AREA = Rule(
    name=_PARKING,
    looks_for="Areas of no parking that no road lanelet obeys",
    codes=_PARKING_CODES.all,
    requirements=("vm-06-02",),
    find=_find_parking,
)

_BUS_STOP = "mapping.area.missing_regulatory_elements_for_bus_stop_areas"
_BUS_STOP_UNREFERRED = IssueCode(
    "Area.MissingRegulatoryElementsForBusStopAreas-001",
    _BUS_STOP,
    "Error",
    "polygon",
    "Add a regulatory element of subtype bus_stop_area that refers to it",
)


def _find_bus_stop(checked: CheckedMap) -> Iterator[MapIssue]:
    yield from _unreferred(checked, "bus_stop_area", _BUS_STOP_UNREFERRED)


BUS_STOP_AREA = Rule(
    name=_BUS_STOP,
    looks_for="Bus stop areas that no regulatory element refers to",
    codes=(_BUS_STOP_UNREFERRED,),
    requirements=("vm-06-06",),
    find=_find_bus_stop,
)
