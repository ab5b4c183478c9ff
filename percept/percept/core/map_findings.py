"""Where a map and the road disagree, and what a person decided about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from percept.core.polyline import along_m, points_at

__all__ = ["Decision", "Discrepancy", "Kind", "Look", "Status"]

_F64 = NDArray[np.float64]


class Kind(StrEnum):
    """In what way map and road disagree.

    `..._missing` and `missing_on_road`: the map has it, the road does not. `..._missing_in_map`:
    the road has it, the map does not.
    """

    MISSING_ON_ROAD = "missing_on_road"
    MISSING_IN_MAP = "missing_in_map"
    MOVED = "moved"
    TYPE = "type"
    COLOUR = "colour"
    STOP_LINE_MISSING = "stop_line_missing"
    STOP_LINE_MISSING_IN_MAP = "stop_line_missing_in_map"
    STOP_LINE_MOVED = "stop_line_moved"
    LANE_WIDTH = "lane_width"
    TRAFFIC_LIGHT_MISSING = "traffic_light_missing"
    TRAFFIC_LIGHT_MISSING_IN_MAP = "traffic_light_missing_in_map"
    GLOBAL_OFFSET = "global_offset"


class Status(StrEnum):
    """What a person says of a finding."""

    OPEN = "open"
    CONFIRMED = "confirmed"
    REJECTED = "rejected"
    UNSURE = "unsure"


@dataclass(frozen=True, slots=True)
class Look:
    """A moment at which a finding can be seen: evidence is cut from it.

    Attributes:
        drive: Number of the drive, from 0.
        sensor: Name of the camera or LiDAR.
        stamp_ns: Time of the look.
        range_m: Distance from the vehicle to the place.
    """

    drive: int
    sensor: str
    stamp_ns: int
    range_m: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy:
    """One finding.

    Attributes:
        finding_id: Stable over runs for one finding at one place: kind, element and place.
        kind: In what way map and road disagree.
        map_element_id: The line string or light; 0 where the map has none.
        along_m: From the start of the element to the start of the stretch; 0 without an element.
        offset_m: How far the road's paint lies left (+) or right (-) of the map's, in the
            direction of the element's points; for stop lines along the lane, + beyond it; for a
            lane's width the road's minus the map's. NaN where it means nothing.
        length_m: Length of the stretch.
        sd_m: Spread of `offset_m`; NaN where it means nothing.
        observations: Looks at the place.
        visits: Drives (or passes of one) that saw it.
        confidence: 0..1, how sure it is that map and road disagree here.
        expected: What the map says, in words.
        observed: What was seen, in words.
        points_map: (K, 3) float64 what was seen, in the map frame; for what is missing on the
            road the stretch of the map.
        points_expected_map: (K, 3) float64 what the map says there; (0, 3) if nothing.
        looks: Where it is seen best, the best first.
        status: What a person said.
    """

    finding_id: str
    kind: Kind
    map_element_id: int
    along_m: float
    offset_m: float
    length_m: float
    sd_m: float
    observations: int
    visits: int
    confidence: float
    expected: str
    observed: str
    points_map: _F64
    points_expected_map: _F64
    looks: tuple[Look, ...] = ()
    status: Status = Status.OPEN

    @property
    def middle_map(self) -> _F64:
        """(3,) float64 half way along what was seen, or what the map says; NaN without points."""
        points = self.points_map if len(self.points_map) else self.points_expected_map
        if not len(points):
            return np.full(3, np.nan)
        middle: _F64 = points_at(points, along_m(points)[-1:] / 2)[0]
        return middle


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What a person decided about a finding, with enough of it to know it again in another run.

    Attributes:
        finding_id: The finding's.
        status: Confirmed, rejected or unsure.
        comment: In the person's words.
        kind: Of the finding.
        map_element_id: Of the finding.
        along_m: Of the finding.
        length_m: Of the finding.
        x_m: Middle of the finding in the map frame.
        y_m: The same.
        offset_m: Of the finding: one that has moved on since is another finding.
    """

    finding_id: str
    status: Status
    comment: str
    kind: Kind
    map_element_id: int
    along_m: float
    length_m: float
    x_m: float
    y_m: float
    offset_m: float
