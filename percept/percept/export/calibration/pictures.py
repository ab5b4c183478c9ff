"""The pictures of calibration reports, in one place: (H, W, 3) uint8 BGR each."""

from __future__ import annotations

from percept.export.calibration.cloud_pictures import cloud_in_image, clouds_from_above, clouds_zoom
from percept.export.calibration.corner_pictures import (
    board_overlay,
    contact_sheet,
    coverage_map,
    heat_map,
    residual_quiver,
)

__all__ = [
    "board_overlay",
    "cloud_in_image",
    "clouds_from_above",
    "clouds_zoom",
    "contact_sheet",
    "coverage_map",
    "heat_map",
    "residual_quiver",
]
