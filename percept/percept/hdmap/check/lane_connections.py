"""Rules on which kinds of lanelets may lie beside each other and follow each other."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue, listed
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import Lanelet
from percept.hdmap.routing import Neighbour, Passage

__all__ = [
    "LATERAL_SUBTYPE_CONNECTION",
    "LONGITUDINAL_SUBTYPE_CONNECTION",
    "PEDESTRIAN_LANE",
    "ROAD_SHOULDER",
]

_LENGTHWISE = "mapping.lane.longitudinal_subtype_connection"
_CROSSING_FOLLOWED = IssueCode(
    "Lane.LongitudinalSubtypeConnection-001", _LENGTHWISE, "Error", "lanelet",
    "Draw the whole way as one lanelet",
)  # fmt: skip
_OTHER_SUBTYPE = IssueCode(
    "Lane.LongitudinalSubtypeConnection-002", _LENGTHWISE, "Error", "lanelet",
    "Give lanelets that follow each other one subtype",
)  # fmt: skip

_SIDEWAYS = "mapping.lane.lateral_subtype_connection"
_NOT_BESIDE_ROADS = IssueCode(
    "Lane.LateralSubtypeConnection-001", _SIDEWAYS, "Error", "lanelet",
    "Correct the subtypes, or give each of the two a border of its own",
)  # fmt: skip

_SHOULDER = "mapping.lane.road_shoulder"
_LONELY_SHOULDER = IssueCode(
    "Lane.RoadShoulder-001", _SHOULDER, "Error", "lanelet",
    "Let it share a border with the lane beside it",
)  # fmt: skip
_SHOULDER_EDGE = IssueCode(
    "Lane.RoadShoulder-003", _SHOULDER, "Error", "linestring",
    "Set its type to road_border, or draw the lanelet on its other side",
)  # fmt: skip

_FOOT = "mapping.lane.pedestrian_lane"
_LONELY_FOOT = IssueCode(
    "Lane.PedestrianLane-001", _FOOT, "Error", "lanelet",
    "Let it share a border with the road beside it",
)  # fmt: skip
_FOOT_BESIDE_OTHER = IssueCode(
    "Lane.PedestrianLane-002", _FOOT, "Error", "lanelet",
    "Let it lie beside a lanelet of subtype road",
)  # fmt: skip
_FOOT_EDGE = IssueCode(
    "Lane.PedestrianLane-003", _FOOT, "Error", "linestring",
    "Set its type to road_border, or draw the lanelet on its other side",
)  # fmt: skip

_CROSSINGS = ("crosswalk", "walkway")
# No subtype means road.
_FOR_VEHICLES = ("", "road", "road_shoulder", "pedestrian_lane", "bicycle_lane")
# The other subtypes of Lanelet2. Of a word that it does not know nothing is said.
_NOT_FOR_VEHICLES = (
    "highway", "play_street", "emergency_lane", "exit",
    "walkway", "shared_walkway", "crosswalk", "stairs",
)  # fmt: skip


def _longitudinal_subtype_connection(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        following = _following(checked, lanelet)
        if not following:
            continue
        if lanelet.subtype in _CROSSINGS:
            yield _CROSSING_FOLLOWED.at(
                lanelet_id, f"is a {lanelet.subtype} and lanelet {listed(following)} follows it"
            )
            continue
        others = [i for i in following if checked.hd_map.lanelets[i].subtype != lanelet.subtype]
        if others:
            yield _OTHER_SUBTYPE.at(
                lanelet_id,
                f"of subtype '{lanelet.subtype}' is followed by lanelet {listed(others)} of "
                f"subtype '{checked.hd_map.lanelets[others[0]].subtype}'",
            )


def _following(checked: CheckedMap, lanelet: Lanelet) -> list[int]:
    """Return what follows a lanelet; people walk ways in both directions."""
    walked = checked.footways.following.get(Passage(lanelet.lanelet_id), ())
    following = {passage.lanelet_id for passage in walked}
    return sorted(following.union(checked.routing.following_ids(lanelet.lanelet_id)))


def _lateral_subtype_connection(checked: CheckedMap) -> Iterator[MapIssue]:
    lanelets = checked.hd_map.lanelets
    for lanelet in checked.lanelets_of(*_FOR_VEHICLES):
        left, right = _beside(checked, lanelet)
        for other_id in sorted({beside.lanelet_id for beside in (*left, *right)}):
            if lanelets[other_id].subtype in _NOT_FOR_VEHICLES:
                yield _NOT_BESIDE_ROADS.at(
                    lanelet.lanelet_id,
                    f"of subtype '{lanelet.subtype or 'road'}' shares a border with lanelet "
                    f"{other_id} of subtype '{lanelets[other_id].subtype}'",
                )


def _road_shoulder(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet in checked.lanelets_of("road_shoulder"):
        left, right = _beside(checked, lanelet)
        if not left and not right:
            yield _LONELY_SHOULDER.at(
                lanelet.lanelet_id, "is a road shoulder with no lanelet beside it"
            )
        else:
            yield from _open_edges(checked, lanelet, _SHOULDER_EDGE)


def _pedestrian_lane(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet in checked.lanelets_of("pedestrian_lane"):
        left, right = _beside(checked, lanelet)
        if not left and not right:
            yield _LONELY_FOOT.at(
                lanelet.lanelet_id, "is a pedestrian lane with no lanelet beside it"
            )
            continue
        if bool(left) != bool(right):
            others = [beside.lanelet_id for beside in (*left, *right)]
            subtypes = [checked.hd_map.lanelets[i].subtype for i in others]
            if "road" not in subtypes:
                yield _FOOT_BESIDE_OTHER.at(
                    lanelet.lanelet_id,
                    f"is a pedestrian lane with lanelet {listed(others)} of subtype "
                    f"'{subtypes[0]}' beside it and no road",
                )
        yield from _open_edges(checked, lanelet, _FOOT_EDGE)


def _open_edges(checked: CheckedMap, lanelet: Lanelet, code: IssueCode) -> Iterator[MapIssue]:
    """Yield border lines with nothing on their other side that are no edge of the road."""
    sides = zip(_beside(checked, lanelet), (lanelet.left_ids, lanelet.right_ids), strict=True)
    for others, border_ids in sides:
        for border_id in () if others else border_ids:
            kind = checked.way_tags(border_id).get("type", "")
            if kind != "road_border":
                yield code.at(
                    border_id,
                    f"of type '{kind}' bounds lanelet {lanelet.lanelet_id} ({lanelet.subtype}) "
                    "where nothing lies beside it",
                )


def _beside(
    checked: CheckedMap, lanelet: Lanelet
) -> tuple[tuple[Neighbour, ...], tuple[Neighbour, ...]]:
    """Return what of the same direction shares the left border, and the right one."""
    left, right = (
        tuple(beside for beside in side[lanelet.lanelet_id] if not beside.opposite)
        for side in (checked.routing.left, checked.routing.right)
    )
    return left, right


LONGITUDINAL_SUBTYPE_CONNECTION = Rule(
    name=_LENGTHWISE,
    looks_for="Crosswalks and walkways that go on in another lanelet, and changes of subtype",
    codes=(_CROSSING_FOLLOWED, _OTHER_SUBTYPE),
    find=_longitudinal_subtype_connection,
)
LATERAL_SUBTYPE_CONNECTION = Rule(
    name=_SIDEWAYS,
    looks_for="Lanes for vehicles that share a border with what vehicles may not use",
    codes=(_NOT_BESIDE_ROADS,),
    find=_lateral_subtype_connection,
)
ROAD_SHOULDER = Rule(
    name=_SHOULDER,
    looks_for="Road shoulders beside nothing, or whose open side is no road border",
    codes=(_LONELY_SHOULDER, _SHOULDER_EDGE),
    requirements=("vm-01-15",),
    find=_road_shoulder,
)
PEDESTRIAN_LANE = Rule(
    name=_FOOT,
    looks_for="Pedestrian lanes beside no road, or whose open side is no road border",
    codes=(_LONELY_FOOT, _FOOT_BESIDE_OTHER, _FOOT_EDGE),
    find=_pedestrian_lane,
)
