"""Settings of the comparison of road and map, each with the reason for its default."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["ValidationConfig"]


def _metres(default: float) -> float:
    value: float = Field(default=default, gt=0, allow_inf_nan=False)
    return value


class ValidationConfig(Settings):
    """What counts as a difference between road and map.

    Attributes:
        tolerance_m: A line is moved where it lies further off than this and than 3 sd; lines of
            good maps are within 0.2 m.
        stop_line_tolerance_m: The same of stop lines along the lane: the road ahead is known
            less well along than across.
        global_offset_m: An offset common to nearly all of a drive is a finding from here on.
        gate_m: Paint further from a line of the map than this is another line: a third of a
            lane's width.
        stop_line_gate_m: The same of stop lines along the lane.
        shortest_m: No finding about a line is shorter, unless the line itself is.
        looks: A place is observed when so many looks saw it.
        line_range_m: Strokes and lines further away are not used: 0.25 deg of yaw are 0.09 m
            across the road here.
        stop_line_range_m: The same of stop lines: 0.25 deg of pitch are 0.4 m along the road
            here.
        pass_gap_s: A drive that comes back after so long makes another visit.
        window_m: The shift of the poses against the map is judged over so much of the way.
        pose_sd_m: How far poses usually lie from the map across the road.
        duty_missing: Below this share of what shows of other lines nothing was painted.
        colour_share: So many of the votes for a colour decide.
        least_confidence: Findings below are counted and not reported.
    """

    tolerance_m: float = _metres(0.3)
    stop_line_tolerance_m: float = _metres(0.5)
    global_offset_m: float = _metres(0.2)
    gate_m: float = _metres(1.0)
    stop_line_gate_m: float = _metres(4.0)
    shortest_m: float = _metres(8.0)
    looks: int = Field(default=3, ge=1)
    line_range_m: float = _metres(20.0)
    stop_line_range_m: float = _metres(12.0)
    pass_gap_s: float = _metres(60.0)
    window_m: float = _metres(20.0)
    pose_sd_m: float = _metres(0.5)
    duty_missing: float = Field(default=0.2, gt=0, lt=1)
    colour_share: float = Field(default=0.8, gt=0.5, le=1)
    least_confidence: float = Field(default=0.3, ge=0, le=1)
