"""All paint that one image shows, and where it was looked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import GroundCoverage, PaintObservation, Sight
from percept.core.rig import CameraSensor
from percept.lanes.bars import find_bars_across
from percept.lanes.birdseye import BirdsEye, BirdsEyeGrid
from percept.lanes.ground import GroundSurface
from percept.lanes.paint_config import PaintConfig
from percept.lanes.strokes import find_strokes
from percept.lanes.visibility import ground_coverage

__all__ = ["observe_paint"]

_F64 = NDArray[np.float64]
_Mask = Callable[[NDArray[np.uint8]], NDArray[np.float32]]


def observe_paint(
    image: NDArray[np.uint8],
    camera: CameraSensor,
    *,
    stamp_ns: int,
    ground: GroundSurface,
    occluders: _F64 | Sequence[Sequence[float]] = (),
    config: PaintConfig | None = None,
    paint_mask: _Mask | None = None,
) -> PaintObservation:
    """Find the paint in an image.

    Args:
        image: (H, W, 3) uint8 BGR, as it was recorded.
        camera: Its lens and place.
        stamp_ns: Time of the image.
        ground: The road's surface in the vehicle's frame.
        occluders: (M, 7) boxes of what may hide the road, in the vehicle's frame.
        config: Settings; None takes the defaults.
        paint_mask: Takes the image and returns how likely each pixel is a line of paint (H, W)
            float32 0..1, as a network does. It takes the place of contrast in finding lines; bars
            across the road and colours are still found in the image.

    Raises:
        ConfigError: If the camera's place on the vehicle is not known.
        GeometryError: If the intrinsics make no camera.
    """
    config = config or PaintConfig()
    view = BirdsEye(camera, ground, BirdsEyeGrid.ahead_of(camera, config))
    warped = view.image(image)
    boxes = np.array(occluders, dtype=np.float64).reshape(-1, 7)
    coverage = ground_coverage(view, warped, boxes, config)
    mask = None if paint_mask is None else _warped_mask(paint_mask(image), view)
    strokes = find_strokes(view, warped, config, mask)
    keep = coverage.at(strokes.points_m[:, :2]) == Sight.SEEN
    seen = view.seen & ~_occluded(coverage, view.grid)
    bars, extents, spreads = find_bars_across(view, warped, seen, config)
    return PaintObservation(
        stamp_ns=stamp_ns,
        sensor=camera.name,
        frame_id=_base_of(camera),
        strokes_m=strokes.points_m[keep],
        direction_rad=strokes.direction_rad[keep],
        width_m=strokes.width_m[keep],
        sd_m=strokes.sd_m[keep],
        yellow=strokes.yellow[keep],
        strength=strokes.strength[keep],
        step_m=config.step_m,
        bars_m=bars,
        bar_width_m=extents,
        bar_sd_m=spreads,
        coverage=coverage,
        notes=ground.notes,
    )


def _warped_mask(mask: NDArray[np.float32], view: BirdsEye) -> NDArray[np.uint8]:
    return view.image(np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8))


def _occluded(coverage: GroundCoverage, grid: BirdsEyeGrid) -> NDArray[np.bool_]:
    """Return which cells (rows, columns) of a grid are occluded."""
    sizes = (grid.along_m / coverage.cell_m, grid.across_m / coverage.cell_m)
    places = [
        np.minimum(((np.arange(count) + 0.5) * size).astype(np.intp), last - 1)
        for count, size, last in zip(grid.shape, sizes, coverage.sights.shape, strict=True)
    ]
    return np.asarray(coverage.sights[np.ix_(places[0], places[1])] == Sight.OCCLUDED, bool)


def _base_of(camera: CameraSensor) -> str:
    return "" if camera.T_base_sensor is None else camera.T_base_sensor.target
