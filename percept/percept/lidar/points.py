"""The one check that points pass on their way into the LiDAR kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["as_points"]


def as_points(points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return a copy of the first three columns, (N, 3) float32, metres.

    Args:
        points: (N, 3 or more) x, y, z and columns that are ignored, such as intensity.

    Raises:
        GeometryError: If the array has another shape or a coordinate is not finite.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] < 3:
        raise GeometryError(f"points are (N, 3) or wider, not {points.shape}")
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
