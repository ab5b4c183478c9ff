"""Bars of paint across the road: stop lines, by their extent along the road and their length."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.birdseye import BirdsEye
from percept.lanes.paint_config import PaintConfig
from percept.lanes.paint_mask import lightness

__all__ = ["find_bars_across"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_FLANK_M = 0.4
_CONTRAST = 2.0  # of that of a line: a bar is large and shows well
_COARSEST_M = 0.45  # of road along that a pixel covers
_STEEPEST = 0.6
_STRAIGHT_M = 0.25
_LEAST_FILL = 0.7
_UNLIKE = 0.5  # of the contrast, by which the road before and behind may differ
_PIXEL_SD = 0.35


def find_bars_across(
    view: BirdsEye, warped: NDArray[np.uint8], seen: NDArray[np.bool_], config: PaintConfig
) -> tuple[_F64, _F64, _F64]:
    """Find bars in a view from above.

    Args:
        view: The view.
        warped: (rows, columns, 3) uint8 BGR, the image in it.
        seen: (rows, columns) bool, where paint would be seen.
        config: Settings.

    Returns:
        Ends of the near edges (B, 2, 2), left then right; extents along the road (B,); spreads
        of the near edges along the road (B,).
    """
    grid = view.grid
    light = lightness(warped)
    _, along = view.footprint_m
    usable = seen & (along <= _COARSEST_M)
    usable &= (grid.x_m[0] + np.arange(grid.shape[0]) * grid.along_m <= config.bar_reach_m)[:, None]
    contrast = np.where(usable, _bar_contrast(light, view, config), 0).astype(np.float32)
    mask = (contrast > _CONTRAST * config.contrast).astype(np.uint8)
    # Lines along the road that a bar meets, and worn places, leave narrow gaps in it.
    gap = round(0.4 / grid.across_m)
    mask = np.asarray(
        cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((1, gap), np.uint8)), np.uint8
    )
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found = []
    for number in range(1, count):
        _, _, width, _, area = stats[number]
        if width * grid.across_m < config.least_bar_m or area * grid.across_m * grid.along_m < 0.2:
            continue
        bar = _measured(light, labels == number, view, config)
        if bar is not None:
            found.append(bar)
    found.sort(key=lambda bar: float(bar[0][:, 0].mean()))
    if not found:
        return np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0)
    edges, extents, spreads = zip(*found, strict=True)
    return np.array(edges), np.array(extents), np.array(spreads)


def _bar_contrast(light: _F32, view: BirdsEye, config: PaintConfig) -> _F32:
    """Return by how much places are above the road before and behind them."""
    step = view.grid.along_m
    best = np.zeros(light.shape, np.float32)
    side = max(round(_FLANK_M / step), 1)
    flank = cv2.blur(light, (1, side))
    for extent in np.linspace(*config.bar_widths_m, 4):
        rows = max(round(extent / step), 1)
        shift = (rows + 1) // 2 + 1 + side // 2
        before, behind = np.roll(flank, shift, axis=0), np.roll(flank, -shift, axis=0)
        found = cv2.blur(light, (1, rows)) - np.maximum(before, behind)
        found[:shift] = found[-shift:] = 0
        best = np.maximum(best, found)
    return best


def _measured(
    light: _F32, bar: NDArray[np.bool_], view: BirdsEye, config: PaintConfig
) -> tuple[_F64, float, float] | None:
    """Return near edge, extent and spread of a bar, by the half of its contrast in strips."""
    grid = view.grid
    columns = np.flatnonzero(bar.any(axis=0))
    strips = np.array_split(columns, max(int(len(columns) * grid.across_m / 0.4), 4))
    rows = np.flatnonzero(bar.any(axis=1))
    low = max(int(rows[0]) - round(0.8 / grid.along_m), 0)
    high = int(rows[-1]) + round(0.8 / grid.along_m) + 1
    edges = []
    for strip in strips:
        inside = bar[:, strip].any(axis=1)
        if not inside.any():
            continue
        peak = int(np.flatnonzero(inside).mean()) - low
        edge = _edges(light[low:high, strip].mean(axis=1), peak)
        if edge is not None:
            edges.append((grid.points(np.array([[0, strip.mean()]]))[0, 1], *edge))
    if len(edges) < max(_LEAST_FILL * len(strips), 3):
        return None
    y, near, far = np.array(edges).T
    near, far = (grid.x_m[0] + (low + 0.5 + edge) * grid.along_m for edge in (near, far))
    slope = _theil_slope(y, near)
    start = float(np.median(near - slope * y))
    off = np.abs(near - start - slope * y)
    extent = float(np.median(far - near))
    ends = grid.points(np.array([[0, columns[-1]], [0, columns[0]]]))[:, 1]
    x = start + slope * float(ends.mean())
    blur = float(_along_at(view, x, float(ends.mean())))
    fits = config.bar_widths_m[0] - blur <= extent <= config.bar_widths_m[1] + blur
    if abs(slope) > _STEEPEST or not fits or np.median(off) > _STRAIGHT_M:
        return None
    return np.column_stack([start + slope * ends, ends]), extent, _spread(x, blur, view, config)


def _edges(profile: _F32, peak: int) -> tuple[float, float] | None:
    """Return where a profile along the road falls to half of its contrast, before and behind."""
    if not 2 <= peak < len(profile) - 2:
        return None
    top = float(profile[peak - 1 : peak + 2].max())
    sides = (profile[peak::-1], profile[peak:])
    roads = [float(np.median(side[len(side) // 2 :])) for side in sides]
    # Road lies on both sides of a bar; at the edge of a bonnet or of a shadow it does not.
    if abs(roads[0] - roads[1]) > _UNLIKE * (top - max(roads)):
        return None
    found = []
    for side, road in zip(sides, roads, strict=True):
        level = (top + road) / 2
        below = np.flatnonzero(side < level)
        if not len(below) or below[0] == 0:
            return None
        k = int(below[0])
        drop = max(float(side[k - 1] - side[k]), 1e-9)
        found.append(k - 1 + float(side[k - 1] - level) / drop)
    return peak - found[0], peak + found[1]


def _theil_slope(x: _F64, y: _F64) -> float:
    """Return the median of the slopes of all pairs (Theil 1950, Sen 1968)."""
    i, j = np.triu_indices(len(x), 1)
    return float(np.median((y[j] - y[i]) / (x[j] - x[i])))


def _along_at(view: BirdsEye, x: float, y: float) -> float:
    cell = np.clip(
        np.rint(view.grid.cells(np.array([[x, y]])))[0], 0, np.array(view.grid.shape) - 1
    )
    return float(view.footprint_m[1][int(cell[0]), int(cell[1])])


def _spread(x: float, blur: float, view: BirdsEye, config: PaintConfig) -> float:
    """Return the spread of an edge along the road: of the pixels, the ground and the pitch."""
    away = x - float(view.eye_m[0])
    place = np.array([x])
    height = max(float(view.eye_m[2] - view.ground.profile(place)[0]), 0.3)
    by_ground = away / height * float(view.ground.spread(place)[0])
    by_pitch = np.radians(config.rotation_sd_deg) * (away**2 + height**2) / height
    return float(np.sqrt((_PIXEL_SD * blur) ** 2 + by_ground**2 + by_pitch**2))
