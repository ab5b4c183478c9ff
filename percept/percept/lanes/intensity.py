"""Paint in the intensity of a LiDAR: a view from above of how strongly the road returns light.

Paint returns more than asphalt at any range, but intensities are not calibrated and fall with
range and angle. So each place is compared with the road right beside it, as a logarithm.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.lane_markings import GroundCoverage, PaintObservation, Sight
from percept.lanes.ground import GroundSurface

__all__ = ["observe_intensity"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_REACH_M, _HALF_WIDTH_M = (-10.0, 20.0), 9.0
_ALONG_M, _ACROSS_M = 0.2, 0.03
_THICK_M = 0.1  # returns nearer to the surface are of the road
# Cells of the middle, of each side, and from middle to middle: of thin lines, whose sides fit
# between the two of a pair, and of wide ones.
_SCALES = ((3, 3, 4), (5, 3, 8))
_BLUR_ROWS = 3
_CONTRAST, _NOISE = 0.4, 4.0  # logarithm, and times the usual
_WIDEST_CELLS = 12
_PEAK_CELLS, _LINK = 3, (5, 5)
_SHORTEST_M, _STEP_M = 1.5, 0.5
_STEEPEST = 0.7
_SPARSE = 4.0  # points in a cell of coverage below which a line can be missed
_COVER_M = 0.25
_MOSTLY = 0.7
_TELLING = 0.5  # logarithm of the strong returns over the usual ones
_LEAST_POINTS, _LEAST_VALUES = 2000, 8
_FLOOR_SD_M, _YAW_SD_RAD = 0.03, 0.002


def observe_intensity(
    points_base: NDArray[np.floating],
    *,
    stamp_ns: int,
    sensor: str,
    frame_id: str,
    ground: GroundSurface,
) -> PaintObservation:
    """Find lines of paint in the intensity of LiDAR points.

    Bars across the road are not looked for, and colour cannot be told; nor can a pair of lines
    where the points are too sparse to show both.

    Args:
        points_base: (N, 4) x, y, z in the vehicle's frame at one moment and intensity >= 0 of
            any scale, of several sweeps put together; one sweep alone is mostly too sparse.
        stamp_ns: That moment.
        sensor: Name of the LiDAR.
        frame_id: The vehicle's frame.
        ground: The road's surface in it.

    Returns:
        The paint. Where intensity tells nothing there is none, a note says why, and no place
        counts as seen.

    Raises:
        GeometryError: If the points are not (N, 4).
    """
    points = np.asarray(points_base, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 4:
        raise GeometryError(f"points with intensity are (N, 4), not {points.shape}")
    road = _on_road(points, ground)
    note = _why_not(road[:, 3])
    strokes = np.zeros((0, 5))
    coverage = _coverage(road, told=note is None)
    if note is None:
        strokes = _strokes(*_grid(road))
        strokes = strokes[coverage.at(strokes[:, :2]) == Sight.SEEN]
    x, y, slope, width, contrast = strokes.T
    direction = np.arctan(slope)
    return PaintObservation(
        stamp_ns=stamp_ns,
        sensor=sensor,
        frame_id=frame_id,
        strokes_m=np.column_stack([x, y, ground.height(strokes[:, :2])]),
        direction_rad=direction,
        width_m=width * np.cos(direction),
        sd_m=np.hypot(_FLOOR_SD_M, _YAW_SD_RAD * x),
        yellow=np.full(len(x), np.nan),
        strength=1 - np.exp(-contrast),
        step_m=_STEP_M,
        coverage=coverage,
        lines_only=True,
        notes=ground.notes if note is None else (*ground.notes, note),
    )


def _on_road(points: _F64, ground: GroundSurface) -> _F64:
    inside = np.isfinite(points).all(axis=1) & (np.abs(points[:, 1]) < _HALF_WIDTH_M)
    inside &= (points[:, 0] > _REACH_M[0]) & (points[:, 0] < _REACH_M[1])
    points = points[inside]
    road: _F64 = points[np.abs(points[:, 2] - ground.height(points)) < _THICK_M]
    return road


def _why_not(intensity: _F64) -> str | None:
    """Return why intensities tell nothing of paint, or None where they may."""
    if len(intensity) < _LEAST_POINTS:
        return f"Only {len(intensity)} LiDAR points lie on the road: too few to see paint."
    if len(np.unique(intensity)) < _LEAST_VALUES:
        return "The LiDAR's intensity has hardly any values: it tells nothing of paint."
    usual, strong = np.quantile(intensity, [0.5, 0.99])
    if strong <= np.exp(_TELLING) * max(usual, 1e-9):
        return "The LiDAR's intensity is the same all over the road: it tells nothing of paint."
    return None


def _grid(road: _F64) -> tuple[_F32, NDArray[np.bool_]]:
    """Return logarithms of intensity (rows, columns) and where there are points."""
    rows = round((_REACH_M[1] - _REACH_M[0]) / _ALONG_M)
    columns = round(2 * _HALF_WIDTH_M / _ACROSS_M)
    i = ((road[:, 0] - _REACH_M[0]) / _ALONG_M).astype(np.intp)
    j = ((road[:, 1] + _HALF_WIDTH_M) / _ACROSS_M).astype(np.intp)
    cell = np.clip(i, 0, rows - 1) * columns + np.clip(j, 0, columns - 1)
    least = max(float(np.quantile(road[:, 3], 0.5)) * 0.1, 1e-6)
    light = np.log(np.maximum(road[:, 3], least))
    total, count = (
        cv2.boxFilter(
            np.bincount(cell, weights, rows * columns).reshape(rows, columns).astype(np.float32),
            -1,
            (1, _BLUR_ROWS),
            normalize=False,
        )
        for weights in (light, None)
    )
    return np.asarray(total / np.maximum(count, 1), np.float32), np.asarray(count >= 1)


def _strokes(light: _F32, known: NDArray[np.bool_]) -> _F64:
    """Return x, y, slope, width and contrast (S, 5) of strokes."""
    ridge = np.fmax(*(_ridge(light, known, *scale) for scale in _SCALES))
    usual = float(np.median(np.abs(ridge[np.isfinite(ridge)]))) if np.isfinite(ridge).any() else 0.0
    ridge = np.nan_to_num(ridge, nan=0.0, neginf=0.0)
    highest = cv2.dilate(ridge, np.ones((1, 2 * _PEAK_CELLS + 1), np.uint8))
    peak = (ridge >= highest) & (ridge > max(_CONTRAST, _NOISE * usual))
    peak &= known
    peak[:, :_PEAK_CELLS] = peak[:, -_PEAK_CELLS:] = False
    rows, columns = np.nonzero(peak)
    if not len(rows):
        return np.zeros((0, 5))
    grown = cv2.dilate(peak.astype(np.uint8), np.ones(_LINK, np.uint8))
    _, numbers = cv2.connectedComponents(grown, connectivity=8)
    around = np.arange(-_PEAK_CELLS, _PEAK_CELLS + 1)
    weight = np.maximum(ridge[rows[:, None], columns[:, None] + around], 0).astype(np.float64)
    middle = columns + (weight @ around) / weight.sum(axis=1)
    wide = _widths(np.where(known, light, np.inf), rows, columns, ridge[rows, columns])
    x = _REACH_M[0] + (rows + 0.5) * _ALONG_M
    y = -_HALF_WIDTH_M + (middle + 0.5) * _ACROSS_M
    chain = np.asarray(numbers)[rows, columns]
    table = np.column_stack([x, y, wide, ridge[rows, columns]])
    found = [_of_chain(table[chain == number]) for number in np.unique(chain)]
    return np.concatenate(found)


def _widths(light: _F32, rows: NDArray[np.intp], columns: NDArray[np.intp], contrast: _F32) -> _F64:
    """Return widths (P,) over which light stays above half of the contrast, metres.

    Cells without points have infinite light: they end no line.
    """
    sides = np.arange(_WIDEST_CELLS + 1)
    level = (light[rows, columns] - contrast / 2)[:, None]
    cells = np.full(len(rows), -1)  # the middle is in both sides
    for sign in (-1, 1):
        around = np.clip(columns[:, None] + sign * sides, 0, light.shape[1] - 1)
        cells += np.cumprod(light[rows[:, None], around] > level, axis=1).sum(axis=1)
    widths: _F64 = np.maximum(cells, 1) * _ACROSS_M
    return widths


def _ridge(light: _F32, known: NDArray[np.bool_], line: int, side: int, shift: int) -> _F32:
    """Return by how much a line's width is above both sides; NaN where a side has no points."""
    weight = known.astype(np.float32)
    filled = np.where(known, light, 0).astype(np.float32)

    def mean(cells: int) -> _F32:
        size = (cells, 1)
        share = cv2.blur(weight, size)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(share > 0, cv2.blur(filled, size) / share, np.nan))

    # The darkest part of the middle counts: the gap of a pair is no line between its sides.
    thin, flank = mean(_SCALES[0][0]), mean(side)
    half = (line - _SCALES[0][0]) // 2
    middle = np.minimum.reduce([np.roll(thin, k, axis=1) for k in range(-half, half + 1)])
    ridge = middle - np.maximum(np.roll(flank, shift, axis=1), np.roll(flank, -shift, axis=1))
    ridge[:, :shift] = ridge[:, -shift:] = np.nan
    return np.asarray(ridge, np.float32)


def _of_chain(peaks: _F64) -> _F64:
    """Return the strokes (S, 5) of a chain of peaks; none of one that is short or steep."""
    x, y = peaks[:, 0], peaks[:, 1]
    length = float(np.ptp(x))
    if length < _SHORTEST_M:
        return np.zeros((0, 5))
    slope = float(np.polyfit(x, y, 1)[0])
    if abs(slope) > _STEEPEST:
        return np.zeros((0, 5))
    _, inverse = np.unique(np.floor(x / _STEP_M), return_inverse=True)
    count = np.bincount(inverse)
    mean = [np.bincount(inverse, column) / count for column in peaks.T]
    return np.column_stack([mean[0], mean[1], np.full(len(count), slope), mean[2], mean[3]])


def _coverage(road: _F64, *, told: bool) -> GroundCoverage:
    """Return where points are dense enough for a line of paint not to be missed."""
    rows = round((_REACH_M[1] - _REACH_M[0]) / _COVER_M)
    columns = round(2 * _HALF_WIDTH_M / _COVER_M)
    edges = (
        np.linspace(*_REACH_M, rows + 1),
        np.linspace(-_HALF_WIDTH_M, _HALF_WIDTH_M, columns + 1),
    )
    count = np.histogram2d(road[:, 0], road[:, 1], bins=edges)[0]
    dense = cv2.blur(count, (1, 3)) >= _SPARSE
    # One ring crosses a line at one place: it takes a stretch of road to see a line.
    stretch = (1, round(_SHORTEST_M / _COVER_M) | 1)
    dense &= cv2.blur(dense.astype(np.float32), stretch) >= _MOSTLY
    sights = np.where(count > 0, np.uint8(Sight.TOO_FAR), np.uint8(Sight.OUT_OF_VIEW))
    sights[dense] = Sight.SEEN if told else Sight.TOO_DARK
    return GroundCoverage((_REACH_M[0], -_HALF_WIDTH_M), _COVER_M, sights.astype(np.uint8))
