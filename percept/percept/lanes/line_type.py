"""Solid, dashed or double: the type of a line, and the width of its paint."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.lines import PaintLine
from percept.lanes.road_grid import RoadGrid

__all__ = ["LineStrip", "line_strip", "line_type", "pair_of"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_HALF_M = 0.6
_MIDDLE_M = 0.3  # a pair lies within it
_SHARP_M = 0.035  # footprint of a pixel across, up to which two lines of a pair can be told
_PAIR_APART_M = (0.16, 0.5)
_DIP = 0.7  # between the lines of a pair, of the lower of both
_LEAST = 0.1  # contrast of a line of a pair
_PAINTED = 0.5  # of the line's usual contrast
_SOLID_RUN_M = 8.0  # longer than the dash of any marking
_GAP_M = 1.5
_BLUR_ALONG_M = 1.5  # road that a row of pixels shows, up to which gaps can be told


@dataclass(frozen=True, slots=True, eq=False)
class LineStrip:
    """Contrast of a line against the road beside it, straightened along the line.

    Attributes:
        offset_m: (columns,) float64 to the left of the line, falling.
        x_m: (rows,) float64 along the road.
        contrast: (rows, columns) float32.
        sharp: (rows,) bool where a pair can be told from one line: a pixel is small against
            the gap. To the side of the camera its height counts, not its width.
        inside: (rows,) bool where the image shows the line.
    """

    offset_m: _F64
    x_m: _F64
    contrast: _F32
    sharp: NDArray[np.bool_]
    inside: NDArray[np.bool_]


def line_strip(line: PaintLine, values: _F32, grid: RoadGrid) -> LineStrip:
    """Cut the strip of a line out of values (rows, columns) on the grid.

    The strip ends with the last paint, or where a row of pixels shows too much road.
    """
    reach = np.sqrt(_BLUR_ALONG_M * grid.focal_px[1] * grid.eye_m[2]) + float(grid.eye_m[0])
    rows = int(np.searchsorted(grid.x_m, min(reach, line.x_m[-1]), side="right"))
    half = grid.cells(_HALF_M)
    offset = np.arange(half, -half - 1, -1) * grid.cell_m
    x = grid.x_m[:rows]
    y = _followed(line, x)
    columns = grid.column(y[:, None] + offset).astype(np.float32)
    at = np.broadcast_to(np.arange(rows, dtype=np.float32)[:, None], columns.shape)
    strip = cv2.remap(
        values, columns, np.ascontiguousarray(at), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    beside = np.abs(offset) > _MIDDLE_M + 0.05
    road = np.median(strip[:, beside], axis=1, keepdims=True)
    middle = np.clip(np.round(grid.column(y)).astype(np.int64), 0, len(grid.y_m) - 1)
    return LineStrip(
        offset_m=np.asarray(offset, dtype=np.float64),
        x_m=x,
        contrast=(strip - road).astype(np.float32),
        sharp=grid.footprint_m[np.arange(rows), middle] < _SHARP_M,
        inside=grid.inside[np.arange(rows), middle],
    )


def _followed(line: PaintLine, x_m: _F64) -> _F64:
    """Return y along the line: its polynomial, moved to the paint that is nearby."""
    off = np.interp(x_m, line.x_m, line.y_m - line.at(line.x_m))
    window = min(15, len(off))
    smooth: _F64 = line.at(x_m) + np.convolve(
        np.pad(off, (window // 2, window - 1 - window // 2), mode="edge"),
        np.ones(window) / window,
        mode="valid",
    )
    return smooth


def pair_of(*strips: LineStrip) -> tuple[float, float] | None:
    """Return the offsets of the two lines of a pair, left then right; None for a single line.

    Args:
        *strips: Of the same line; the first one that shows a pair decides.
    """
    return next((pair for strip in strips if (pair := _pair(strip)) is not None), None)


def _pair(strip: LineStrip) -> tuple[float, float] | None:
    usable = strip.sharp & strip.inside
    if usable.sum() < 5:
        return None
    clear = strip.contrast[usable]
    painted = clear.max(axis=1) > _PAINTED * np.percentile(clear.max(axis=1), 80)
    if not painted.any():
        return None
    across = np.median(clear[painted], axis=0)
    peaks = [
        k
        for k in range(1, len(across) - 1)
        if across[k] >= across[k - 1] and across[k] > across[k + 1] and across[k] > _LEAST
        and abs(strip.offset_m[k]) <= _MIDDLE_M + 0.05
    ]  # fmt: skip
    peaks = sorted(sorted(peaks, key=lambda k: -float(across[k]))[:2])
    if len(peaks) < 2:
        return None
    i, j = peaks
    apart = float(strip.offset_m[i] - strip.offset_m[j])
    lower = min(float(across[i]), float(across[j]))
    dip = float(across[i : j + 1].min())
    if not _PAIR_APART_M[0] <= apart <= _PAIR_APART_M[1] or dip > _DIP * lower:
        return None
    if lower < 0.5 * max(float(across[i]), float(across[j])):
        return None
    return float(strip.offset_m[i]), float(strip.offset_m[j])


def line_type(strip: LineStrip, pair: tuple[float, float] | None) -> str:
    """Return the type of a line in the words of Lanelet2."""
    if pair is None:
        return _single_type(strip, 0.0, 0.12)
    left, right = (_single_type(strip, offset, 0.05) for offset in pair)
    both = f"{left}_{right}"
    return both if both in ("solid_solid", "solid_dashed", "dashed_solid") else "unknown"


def _single_type(strip: LineStrip, offset_m: float, half_m: float) -> str:
    columns = np.abs(strip.offset_m - offset_m) <= half_m + 1e-9
    contrast = strip.contrast[:, columns].max(axis=1)[strip.inside]
    if len(contrast) < 5:
        return "unknown"
    step = float(strip.x_m[1] - strip.x_m[0])
    # The usual contrast of the paint falls with range, as pixels mix it with the road.
    paint = contrast > _PAINTED * _usual_paint(contrast)
    changes = np.flatnonzero(np.diff(paint.astype(np.int8)))
    bounds = np.concatenate([[0], changes + 1, [len(paint)]])
    lengths = np.diff(bounds) * step
    kinds = paint[bounds[:-1]]
    runs, gaps = lengths[kinds], lengths[~kinds]
    longest_gap = float(gaps.max(initial=0.0))
    share = float(paint.mean())
    if runs.max(initial=0.0) >= _SOLID_RUN_M and share > 0.75 and longest_gap < 2 * _GAP_M:
        return "solid"
    if longest_gap >= _GAP_M and share < 0.75 and runs.max(initial=0.0) < _SOLID_RUN_M:
        return "dashed"
    return "unknown"


def _usual_paint(contrast: _F32) -> _F64:
    """Return for each row (N,) the contrast of clear paint within some metres of it."""
    window = min(len(contrast), 121)
    padded = np.pad(contrast, (window // 2, window - 1 - window // 2), mode="reflect")
    rows = np.lib.stride_tricks.sliding_window_view(padded, window)
    usual: _F64 = np.percentile(rows, 85, axis=1)
    return np.maximum(usual, 0.04)
