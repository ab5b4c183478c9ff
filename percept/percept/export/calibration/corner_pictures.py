"""Board corners in the image plane: what was found, where, and how far it is off."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.export.canvas import (
    BACKGROUND,
    FIXED_SHIFT,
    QUIET,
    Image,
    Rgb,
    as_bgr,
    blank,
    fitting_scale,
    fixed_point,
    resized,
    round_limit,
    text_width,
    with_colour_bar,
    with_header,
    write_text,
)
from percept.export.palette import sensor_colour, sequential_colours

__all__ = ["board_overlay", "contact_sheet", "coverage_map", "heat_map", "residual_quiver"]

_F64 = NDArray[np.float64]
_EDGE: Rgb = (58, 66, 74)
_UNSEEN: Rgb = (32, 37, 42)
_UNSEEN_LINE: Rgb = (84, 92, 100)
_FOUND: Rgb = sensor_colour(1)
_EXPECTED: Rgb = sensor_colour(0)
_ARROW_SHARE = 0.045  # of the picture's width, for a large residual
_LABELS = (6, 4)  # columns and rows of numbers on a heat map
_NAME_PX = 22


def residual_quiver(
    image_size: tuple[int, int],
    corners_px: NDArray[np.floating],
    residuals_px: NDArray[np.floating],
    scale: float | None = None,
    *,
    title: str = "",
) -> Image:
    """Draw reprojection residuals as arrows, enlarged, where the corners are.

    Arrows without an order are noise; arrows that turn around a point or all point one way are
    an error of the model.

    Args:
        image_size: (width, height) of the camera's image.
        corners_px: (N, 2) where the corners were found.
        residuals_px: (N, 2) found minus projected, pixels. Rows that are not finite are left out.
        scale: How much the arrows are enlarged; None makes large ones readable.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If there is not one residual a corner.
    """
    corners, residuals = _pairs(corners_px), _pairs(residuals_px)
    if len(corners) != len(residuals):
        raise GeometryError(f"{len(corners)} corners cannot have {len(residuals)} residuals")
    known = np.isfinite(corners).all(axis=1) & np.isfinite(residuals).all(axis=1)
    corners, residuals = corners[known], residuals[known]
    image, shrink = _sheet(image_size)
    lengths = np.linalg.norm(residuals, axis=1)
    large = round_limit(float(np.quantile(lengths, 0.95))) if len(lengths) else 1.0
    enlarged = scale if scale is not None else image.shape[1] * _ARROW_SHARE / large / shrink
    starts = _scaled(corners, shrink)
    ends = starts + residuals * enlarged * shrink
    colours = sequential_colours(lengths / large)[:, ::-1].tolist()
    for start, end, colour in zip(starts, ends, colours, strict=True):
        _arrow(image, start, end, colour)
    image = with_colour_bar(image, 0.0, large, "px", beyond=" and more")
    told = f"{title}   {len(corners)} residuals, enlarged {enlarged:.3g} times".strip()
    return with_header(image, told)


def coverage_map(
    image_size: tuple[int, int],
    corners_px_per_view: Sequence[NDArray[np.floating]],
    *,
    title: str = "",
) -> Image:
    """Draw how many views saw a board at each place of the image, and where none did.

    Args:
        image_size: (width, height) of the camera's image.
        corners_px_per_view: Of each view, the corners (N, 2). A board covers their hull.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    image, shrink = _sheet(image_size)
    views = [_scaled(_finite(corners), shrink) for corners in corners_px_per_view]
    counts: NDArray[np.int64] = np.zeros(image.shape[:2], dtype=np.int64)
    for corners in (view for view in views if len(view) >= 3):
        hull = cv2.convexHull(np.rint(corners).astype(np.int32))
        covered = cv2.fillConvexPoly(np.zeros(image.shape[:2], np.uint8), hull, (1,))
        counts += np.asarray(covered, dtype=np.int64)
    most, parts = _whole_limit(int(counts.max()))
    image[:] = sequential_colours((counts.ravel() - 1) / (most - 1))[:, ::-1].reshape(image.shape)
    _hatch(image, counts == 0)
    for corner in (corner for view in views for corner in view):
        centre = fixed_point(corner).tolist()
        cv2.circle(image, centre, 16, BACKGROUND[::-1], -1, cv2.LINE_AA, FIXED_SHIFT)
    seen = float((counts > 0).mean())
    image = with_colour_bar(image, 1, most, "views", parts=parts)
    told = f"{title}   {len(views)} views cover {seen:.0%} of the image".strip()
    return with_header(image, told, [("no board was here", _UNSEEN_LINE)])


def heat_map(
    values: NDArray[np.floating],
    image_size: tuple[int, int],
    unit: str,
    limits: tuple[float, float] | None = None,
    title: str = "",
) -> Image:
    """Draw values on a grid over the image as colours, with numbers on it.

    Args:
        values: (rows, columns), evenly spread over the image; NaN is hatched.
        image_size: (width, height) of the camera's image.
        unit: Unit of the values.
        limits: Values of the first and the last colour; None takes 0 and what 95 % stay below.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If the values are no grid.
    """
    grid = np.asarray(values, dtype=np.float64)
    if grid.ndim != 2 or grid.size == 0:
        raise GeometryError(f"a heat map needs a grid of values, not {grid.shape}")
    known = np.isfinite(grid)
    low, high = limits or (0.0, _upper_limit(grid[known]))
    image, _ = _sheet(image_size)
    filled = _filled(grid, known)
    size = (image.shape[1], image.shape[0])
    smooth = cv2.resize(filled, size, interpolation=cv2.INTER_LINEAR).astype(np.float64)
    share = (smooth - low) / max(high - low, 1e-12)
    image[:] = sequential_colours(share.ravel())[:, ::-1].reshape(image.shape)
    _hatch(image, cv2.resize((~known).astype(np.uint8), size, interpolation=0).astype(bool))
    _write_values(image, grid)
    above = " and more" if known.any() and float(grid[known].max()) > high else ""
    return with_header(with_colour_bar(image, low, high, unit, beyond=above), title)


def board_overlay(
    pixels: NDArray[np.generic],
    corners_px: NDArray[np.floating],
    expected_px: NDArray[np.floating] | None = None,
    *,
    title: str = "",
) -> Image:
    """Draw the corners that were found into an image, in their order, and where they should be.

    Args:
        pixels: (H, W) or (H, W, 3) BGR.
        corners_px: (N, 2) found corners in the board's order; the first has a larger circle.
        expected_px: (M, 2) where a calibration puts the corners, or None.
        title: What is shown; without it there is no legend either, as a contact sheet needs it.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If the image is no image.
    """
    whole = as_bgr(pixels)
    shrink = fitting_scale(whole.shape[1], whole.shape[0])
    image: Image = (resized(whole, shrink) * 0.75).astype(np.uint8)
    found = _scaled(_finite(corners_px), shrink)
    line = fixed_point(found)
    cv2.polylines(
        image, [line], isClosed=False, color=_FOUND[::-1], lineType=cv2.LINE_AA, shift=FIXED_SHIFT
    )
    for row, corner in enumerate(line.tolist()):
        radius = (9 if row == 0 else 4) * 2**FIXED_SHIFT
        cv2.circle(image, corner, radius, _FOUND[::-1], 1, cv2.LINE_AA, FIXED_SHIFT)
    legend = [(f"{len(found)} found (large circle: first)", _FOUND)]
    if expected_px is not None:
        expected = _scaled(_finite(expected_px), shrink)
        for corner in expected:
            for arm in (np.array([5, 5]), np.array([5, -5])):
                _line(image, corner - arm, corner + arm, _EXPECTED)
        legend.append((f"{len(expected)} expected", _EXPECTED))
    return with_header(image, title, legend if title else ())


def contact_sheet(
    pictures: Sequence[NDArray[np.generic]],
    titles: Sequence[str],
    *,
    columns: int | None = None,
    width_px: int = 1200,
) -> Image:
    """Draw many pictures side by side, each with its title below it.

    Args:
        pictures: (H, W) or (H, W, 3) BGR each, of any size.
        titles: As many titles; those that are too long are cut.
        columns: Pictures in a row; None chooses.
        width_px: Width of the sheet.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If the numbers differ or a picture is none.
    """
    if len(pictures) != len(titles):
        raise GeometryError(f"{len(pictures)} pictures cannot have {len(titles)} titles")
    if not pictures:
        empty = blank(width_px, 60)
        write_text(empty, "nothing to show", (12, 35), QUIET)
        return empty
    across = columns or min(len(pictures), max(2, math.ceil(math.sqrt(len(pictures) * 1.2))), 6)
    cell = max(width_px // across, 16)
    drawn = [_in_cell(as_bgr(picture), cell) for picture in pictures]
    high = max(picture.shape[0] for picture in drawn)
    sheet = blank(cell * across, (high + _NAME_PX) * math.ceil(len(drawn) / across))
    for index, (picture, title) in enumerate(zip(drawn, titles, strict=True)):
        top, left = (index // across) * (high + _NAME_PX), (index % across) * cell
        left_in = left + (cell - picture.shape[1]) // 2
        sheet[top : top + picture.shape[0], left_in : left_in + picture.shape[1]] = picture
        write_text(sheet, _cut(title, cell - 12), (left + 6, top + high + 15))
    return sheet


def _sheet(image_size: tuple[int, int]) -> tuple[Image, float]:
    """Return an empty picture of a camera's image, and how much smaller it is."""
    width, height = image_size
    if width < 1 or height < 1:
        raise GeometryError(f"{width}x{height} is no size of an image")
    scale = fitting_scale(width, height)
    image = blank(round(width * scale), round(height * scale))
    cv2.rectangle(image, (0, 0), (image.shape[1] - 1, image.shape[0] - 1), _EDGE[::-1], 1)
    return image, scale


def _pairs(pixels: NDArray[np.floating]) -> _F64:
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def _finite(pixels: NDArray[np.floating]) -> _F64:
    pairs = _pairs(pixels)
    return pairs[np.isfinite(pairs).all(axis=1)]


def _scaled(pixels: _F64, scale: float) -> _F64:
    """Return pixels of a resized image: (0, 0) is the middle of the first one in both."""
    return (pixels + 0.5) * scale - 0.5


def _line(image: Image, start: _F64, end: _F64, colour: Rgb) -> None:
    ends = fixed_point(start).tolist(), fixed_point(end).tolist()
    cv2.line(image, *ends, colour[::-1], 2, cv2.LINE_AA, FIXED_SHIFT)


def _arrow(image: Image, start: _F64, end: _F64, colour: list[int]) -> None:
    cv2.arrowedLine(
        image, fixed_point(start).tolist(), fixed_point(end).tolist(), colour, 1, cv2.LINE_AA,
        FIXED_SHIFT, 0.25,
    )  # fmt: skip


def _hatch(image: Image, where: NDArray[np.bool_]) -> None:
    rows, columns = np.nonzero(where)
    stripe = (rows + columns) % 14 < 2
    image[rows, columns] = _UNSEEN[::-1]
    image[rows[stripe], columns[stripe]] = _UNSEEN_LINE[::-1]


def _whole_limit(most: int) -> tuple[int, int]:
    """Return the last number of a scale of whole ones from 1, and its parts."""
    if most <= 6:
        return max(most, 2), max(most, 2) - 1
    return 1 + 5 * math.ceil((most - 1) / 5), 5


def _upper_limit(values: _F64) -> float:
    return round_limit(float(np.quantile(values, 0.95))) if len(values) else 1.0


def _filled(grid: _F64, known: NDArray[np.bool_]) -> _F64:
    """Return a grid whose unknown values are their nearest known ones."""
    if not known.any():
        return np.zeros_like(grid)
    if known.all():
        return grid
    from scipy.ndimage import distance_transform_edt  # half a second to import, rarely needed

    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: _F64 = grid[rows, columns]
    return filled


def _write_values(image: Image, grid: _F64) -> None:
    """Write some of the values at their places."""
    height, width = image.shape[:2]
    for down in range(_LABELS[1]):
        for across in range(_LABELS[0]):
            x, y = (across + 0.5) / _LABELS[0], (down + 0.5) / _LABELS[1]
            value = grid[int(y * grid.shape[0]), int(x * grid.shape[1])]
            text = f"{value:.3g}" if math.isfinite(value) else "-"
            at = (int(x * width) - text_width(text) // 2, int(y * height) + 5)
            write_text(image, text, at)


def _in_cell(picture: Image, cell: int) -> Image:
    return resized(picture, (cell - 8) / max(picture.shape[1], picture.shape[0] * 0.8))


def _cut(title: str, width: int) -> str:
    while title and text_width(title) > width:
        title = title[:-1]
    return title
