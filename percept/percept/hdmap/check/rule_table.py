"""The rules in the order in which they are checked. A new rule is a line here, nothing else."""

from __future__ import annotations

from percept.hdmap.check.area_buffer_zone import BUFFER_ZONE
from percept.hdmap.check.area_regulation import (
    BUS_STOP_AREA,
    DETECTION_AREA,
    NO_PARKING_AREA,
    NO_STOPPING_AREA,
)
from percept.hdmap.check.crosswalks import (
    CROSSWALK_DETAILS,
    CROSSWALK_MISSING_REGULATORY_ELEMENTS,
    CROSSWALK_SAFETY_ATTRIBUTES,
)
from percept.hdmap.check.intersection_area import (
    DANGLING_REFERENCE,
    INTERSECTION_AREA_SEGMENTS,
    INTERSECTION_AREA_TAGGING,
    INTERSECTION_AREA_VALIDITY,
)
from percept.hdmap.check.intersection_lanelet import (
    LANELET_BORDER_TYPE,
    LANELET_DIVISION,
    TURN_DIRECTION_TAGGING,
)
from percept.hdmap.check.intersection_right_of_way import (
    RIGHT_OF_WAY_WITH_VIRTUAL_LIGHTS,
    RIGHT_OF_WAY_WITHOUT_LIGHTS,
)
from percept.hdmap.check.intersection_right_of_way_lights import RIGHT_OF_WAY_WITH_LIGHTS
from percept.hdmap.check.intersection_road_marking import ROAD_MARKINGS
from percept.hdmap.check.intersection_turn_signal import TURN_SIGNAL_DISTANCE
from percept.hdmap.check.intersection_virtual_light import VIRTUAL_LIGHT_DETAILS
from percept.hdmap.check.intersection_virtual_light_order import VIRTUAL_LIGHT_ORDER
from percept.hdmap.check.intersection_virtual_light_overlap import VIRTUAL_LIGHT_OVERLAP
from percept.hdmap.check.lane_attributes import (
    LANE_CHANGE_ATTRIBUTE,
    LOCAL_COORDINATES_DECLARATION,
    ROAD_LANELET_ATTRIBUTE,
    SPEED_LIMIT_VALIDITY,
)
from percept.hdmap.check.lane_borders import BORDER_SHARING
from percept.hdmap.check.lane_connections import (
    LATERAL_SUBTYPE_CONNECTION,
    LONGITUDINAL_SUBTYPE_CONNECTION,
    PEDESTRIAN_LANE,
    ROAD_SHOULDER,
)
from percept.hdmap.check.lane_shapes import CENTERLINE_GEOMETRY, LANELET_GEOMETRY
from percept.hdmap.check.rule import Rule, RuleNotImplemented
from percept.hdmap.check.stop_lines import (
    STOP_LINE_MISSING_REGULATORY_ELEMENTS,
    TRAFFIC_SIGN_DETAILS,
)
from percept.hdmap.check.traffic_light import (
    BODY_HEIGHT,
    LIGHT_BULBS,
    MISSING_REFERRERS,
    MISSING_REGULATORY_ELEMENTS,
)
from percept.hdmap.check.traffic_light_details import TRAFFIC_LIGHT_DETAILS
from percept.hdmap.check.traffic_light_facing import TRAFFIC_LIGHT_FACING
from percept.hdmap.check.walkways import WALKWAY_INTERSECTION

__all__ = ["NOT_IMPLEMENTED", "RULES"]

RULES: tuple[Rule, ...] = (
    LOCAL_COORDINATES_DECLARATION,
    LANELET_GEOMETRY,
    CENTERLINE_GEOMETRY,
    BORDER_SHARING,
    LANE_CHANGE_ATTRIBUTE,
    LATERAL_SUBTYPE_CONNECTION,
    LONGITUDINAL_SUBTYPE_CONNECTION,
    ROAD_LANELET_ATTRIBUTE,
    SPEED_LIMIT_VALIDITY,
    ROAD_SHOULDER,
    PEDESTRIAN_LANE,
    WALKWAY_INTERSECTION,
    STOP_LINE_MISSING_REGULATORY_ELEMENTS,
    TRAFFIC_SIGN_DETAILS,
    CROSSWALK_MISSING_REGULATORY_ELEMENTS,
    CROSSWALK_DETAILS,
    CROSSWALK_SAFETY_ATTRIBUTES,
    MISSING_REGULATORY_ELEMENTS,
    MISSING_REFERRERS,
    TRAFFIC_LIGHT_DETAILS,
    TRAFFIC_LIGHT_FACING,
    BODY_HEIGHT,
    LIGHT_BULBS,
    INTERSECTION_AREA_VALIDITY,
    INTERSECTION_AREA_SEGMENTS,
    DANGLING_REFERENCE,
    INTERSECTION_AREA_TAGGING,
    TURN_DIRECTION_TAGGING,
    LANELET_BORDER_TYPE,
    LANELET_DIVISION,
    TURN_SIGNAL_DISTANCE,
    RIGHT_OF_WAY_WITH_LIGHTS,
    RIGHT_OF_WAY_WITHOUT_LIGHTS,
    ROAD_MARKINGS,
    VIRTUAL_LIGHT_DETAILS,
    RIGHT_OF_WAY_WITH_VIRTUAL_LIGHTS,
    VIRTUAL_LIGHT_ORDER,
    VIRTUAL_LIGHT_OVERLAP,
    BUFFER_ZONE,
    NO_PARKING_AREA,
    NO_STOPPING_AREA,
    DETECTION_AREA,
    BUS_STOP_AREA,
)

_GIVEN_UP = "the validator that the numbers are of has given them up"
NOT_IMPLEMENTED: tuple[RuleNotImplemented, ...] = (
    RuleNotImplemented("mapping.lane.road_shoulder", ("Lane.RoadShoulder-002",), _GIVEN_UP),
    RuleNotImplemented(
        "mapping.crosswalk.regulatory_element_details",
        tuple(f"Crosswalk.RegulatoryElementDetails-{number}" for number in ("004", "005", "008")),
        _GIVEN_UP,
    ),
)
