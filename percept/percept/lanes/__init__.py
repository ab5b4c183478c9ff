"""Lane perception: paint on the road in images and in the intensity of LiDARs."""

from percept.lanes.config import LaneConfig
from percept.lanes.detector import detect_lanes
from percept.lanes.ground import GroundSurface, flat_ground
from percept.lanes.ground_image import ground_from_image
from percept.lanes.ground_points import ground_from_points
from percept.lanes.intensity import observe_intensity
from percept.lanes.observe import observe_paint
from percept.lanes.paint_config import PaintConfig
from percept.lanes.radius import lane_radius

__all__ = [
    "GroundSurface",
    "LaneConfig",
    "PaintConfig",
    "detect_lanes",
    "flat_ground",
    "ground_from_image",
    "ground_from_points",
    "lane_radius",
    "observe_intensity",
    "observe_paint",
]
