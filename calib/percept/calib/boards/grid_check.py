"""Is a grid of points really a checkerboard, which way does it run, and does it end there?

The squares' brightness answers all three: around each true inner corner it alternates, and
beyond the outermost squares it does not. A detector alone is no proof: it finds grids in
texture, and parts of larger patterns.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["canonical_order", "grid_fault", "smallest_gap_px"]

_F64 = NDArray[np.float64]
_U8 = NDArray[np.uint8]

# A square's brightness is the mean of 3 x 3 samples about its centre.
_SAMPLES = np.array([0.35, 0.5, 0.65])
_LEAST_CONTRAST = 3.0  # grey levels between black and white squares; below it is rounding
_FAINTEST = 0.1  # of a corner's contrast over the board's median; glare leaves less
_MOST_UNSEEN = 0.5
_GOES_ON = 0.8  # alternation on the pattern's rim: 0.5 on a plain margin, 1 where squares follow
_ROUGHEST = 0.35  # second difference over spacing; a view at 75 deg reaches 0.2


def smallest_gap_px(grid: _F64) -> float:
    """Return the smallest distance between neighbours in a grid (rows, columns, 2)."""
    along = np.linalg.norm(np.diff(grid, axis=1), axis=2).min()
    across = np.linalg.norm(np.diff(grid, axis=0), axis=2).min()
    return float(min(along, across))


def grid_fault(grey: _U8, grid: _F64) -> str | None:
    """Return what speaks against a grid (rows, columns, 2) being a whole checkerboard, or None."""
    if not _is_smooth(grid):
        return "no board (the corners found lie on no regular grid)"
    saddle = _alternation(_cell_brightness(grey, grid))
    inner = saddle[1:-1, 1:-1]
    # Corners beside the image's border are judged by the others: half of them must be visible.
    if np.isnan(inner).mean() > _MOST_UNSEEN:
        return "the board is partly out of view"
    sign = np.sign(np.nanmedian(inner))
    usual = sign * np.nanmedian(inner)
    if usual < _LEAST_CONTRAST or (sign * inner < _FAINTEST * usual).any():
        return "no board (the squares found do not alternate between black and white)"
    rims = sign * np.array(
        [saddle[0, 1:-1].mean(), saddle[-1, 1:-1].mean(),
         saddle[1:-1, 0].mean(), saddle[1:-1, -1].mean()]
    )  # fmt: skip
    if (rims > _GOES_ON * usual).any():
        rows, columns = grid.shape[:2]
        return f"the pattern goes on beyond {columns}x{rows} inner corners: count them again"
    return None


def canonical_order(grey: _U8, grid: _F64) -> _F64:
    """Return a grid (rows, columns, 2) in the order that all views of the board share.

    Seen from the front, the rows lie clockwise of the columns; the first corner's outermost
    square is black. Where that leaves a choice, the columns run to the right in the image.
    """
    x, y = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    along, down = x.sum(axis=0), y.sum(axis=0)
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    choices = [grid, grid[::-1, ::-1]]
    if grid.shape[0] == grid.shape[1]:
        choices += [np.rot90(g, axes=(0, 1)) for g in tuple(choices)]
    return np.ascontiguousarray(max(choices, key=lambda g: _preference(grey, g)))


def _preference(grey: _U8, grid: _F64) -> tuple[bool, float]:
    saddle = _alternation(_cell_brightness(grey, grid))
    # Positive alternation: the square up and left of the first corner is brighter than beside it.
    black_first = bool(np.nanmedian(saddle[1:-1, 1:-1]) < 0)
    return black_first, float((grid[:, -1, 0] - grid[:, 0, 0]).sum())


def _is_smooth(grid: _F64) -> bool:
    for axis in (0, 1):
        steps = np.diff(grid, axis=axis)
        bends = np.linalg.norm(np.diff(steps, axis=axis), axis=2)
        lengths = np.linalg.norm(steps, axis=2)
        shorter, longer = (
            (lengths[:-1], lengths[1:]) if axis == 0 else (lengths[:, :-1], lengths[:, 1:])
        )
        if (bends > _ROUGHEST * (shorter + longer) / 2).any():
            return False
    return True


def _alternation(cells: _F64) -> _F64:
    """Return half the difference of the diagonals of 2 x 2 squares, its sign alternating."""
    diagonal = cells[:-1, :-1] + cells[1:, 1:] - cells[:-1, 1:] - cells[1:, :-1]
    row, column = np.indices(diagonal.shape)
    signed: _F64 = np.where((row + column) % 2 == 0, 0.5, -0.5) * diagonal
    return signed


def _cell_brightness(grey: _U8, grid: _F64) -> _F64:
    """Return the squares' brightness (rows + 3, columns + 3), NaN outside of the image.

    The outermost ring is the one beyond the pattern, the next the pattern's outermost squares.
    """
    wide = _extended(_extended(grid))
    s, t = (f.ravel()[:, None, None, None] for f in np.meshgrid(_SAMPLES, _SAMPLES))
    points = (
        (1 - t) * ((1 - s) * wide[:-1, :-1] + s * wide[:-1, 1:])
        + t * ((1 - s) * wide[1:, :-1] + s * wide[1:, 1:])
    )  # fmt: skip
    height, width = grey.shape
    inside = (
        ((points >= 0) & (points <= [width - 1, height - 1])).all(axis=-1).reshape(len(points), -1)
    )
    # One row a sample point, one column a square: remap takes at most 32767 of either.
    u, v = (points[..., k].astype(np.float32).reshape(len(points), -1) for k in (0, 1))
    values = cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = inside.sum(axis=0)
    total = np.where(inside, values.astype(np.float64), 0.0).sum(axis=0)
    mean = np.where(seen > 0, total / np.maximum(seen, 1), np.nan)
    return mean.reshape(points.shape[1:3])


def _extended(grid: _F64) -> _F64:
    """Return a grid with one more corner on each side, by quadratic extrapolation."""
    for _ in range(2):
        first = 3 * grid[:1] - 3 * grid[1:2] + grid[2:3]
        last = 3 * grid[-1:] - 3 * grid[-2:-1] + grid[-3:-2]
        grid = np.concatenate([first, grid, last]).swapaxes(0, 1)
    return grid
