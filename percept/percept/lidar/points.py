"""The one check that points pass on their way into the LiDAR kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["as_columns", "as_points", "finite_rows"]


def as_points(points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return a copy of the first three columns, (N, 3) float32, metres.

    Args:
        points: (N, 3 or more) x, y, z and columns that are ignored, such as intensity.

    Raises:
        GeometryError: If the array has another shape or a coordinate is not finite.
    """
    points = _checked_shape(points)
    # Always a copy: a read-only array would have every kernel compiled once more. By column,
    # because numpy copies rows of three numbers three times slower.
    xyz = np.empty((len(points), 3), np.float32)
    for axis in range(3):
        xyz[:, axis] = points[:, axis]
    if not np.isfinite(xyz).all():
        raise GeometryError(
            "a coordinate is not finite", remedy="Drop points with NaN or infinite coordinates"
        )
    return xyz


def finite_rows(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which points (N, 3 or more) have finite x, y and z, as (N,) bool.

    Raises:
        GeometryError: If the array has another shape.
    """
    rows: NDArray[np.bool_] = np.isfinite(_checked_shape(points)[:, :3]).all(axis=1)
    return rows


def as_columns(points: NDArray[np.floating]) -> NDArray[np.float32] | None:
    """Return a copy of x, y and z, (3, N) float32, metres: kernels read several numbers at once.

    Args:
        points: As in `as_points`.

    Returns:
        The columns, or None where a coordinate is not finite.

    Raises:
        GeometryError: If the array has another shape.
    """
    from percept.lidar.point_kernels import copy_columns

    xyz = np.require(_checked_shape(points)[:, :3], np.float32, ["ALIGNED"])
    columns = np.empty((3, len(xyz)), np.float32)
    return columns if copy_columns(xyz, columns) else None


def _checked_shape(points: NDArray[np.floating]) -> NDArray[Any]:
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] < 3:
        raise GeometryError(f"points are (N, 3) or wider, not {points.shape}")
    return points
