"""Exact Euclidean clustering (single linkage at a tolerance)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from percept.core.errors import ConfigError, GeometryError
from percept.core.settings import Settings
from percept.lidar.points import as_points, finite_rows

__all__ = ["MAX_GROWTH", "ClusterConfig", "cluster_points"]

MAX_GROWTH = 4.0  # the tolerance grows with range up to this many times itself
_CELLS_FROM_ORIGIN = 2.0**31 - 64  # cells are counted in int32, neighbours included


class ClusterConfig(Settings):
    """Which points join, and which groups count as clusters.

    Two points a and b join when ``|a - b| <= tolerance_m + range_growth * min(r_a, r_b)``, with
    r the horizontal distance to the frame's origin. Beams diverge, so that the gaps within one
    object grow with range; the nearer of two points decides, which keeps the rule symmetric, and
    the tolerance stops growing at `MAX_GROWTH` times itself.

    Attributes:
        tolerance_m: Largest gap inside a cluster at range 0, m.
        min_points: Smaller groups get the label -1.
        max_points: Larger groups get the label -1; None keeps them.
        range_growth: Metres of tolerance per metre of range; 0 is plain single linkage.
    """

    tolerance_m: float = Field(default=0.5, ge=0.01, le=10.0)
    min_points: int = Field(default=1, ge=1)
    max_points: int | None = Field(default=None, ge=1)
    range_growth: float = Field(default=0.0, ge=0.0, le=0.1)

    @model_validator(mode="after")
    def _check_order(self) -> ClusterConfig:
        if self.max_points is not None and self.max_points < self.min_points:
            raise ConfigError(f"max_points {self.max_points} is below min_points {self.min_points}")
        return self


def cluster_points(
    points: NDArray[np.floating], config: ClusterConfig | None = None
) -> NDArray[np.int32]:
    """Group points whose chains of gaps stay within the tolerance. Exact, not approximate.

    Args:
        points: (N, 3 or more) float32 or float64 x, y, z, metres.
        config: Settings; None takes the defaults.

    Returns:
        (N,) int32 cluster of each point, numbered 0, 1, ... in the order of the clusters' first
        points; -1 where the group is smaller or larger than the settings allow, and for points
        with a coordinate that is not finite.

    Raises:
        GeometryError: If the points are not (N, 3+), or so far from the origin that
            the grid of this tolerance cannot count its cells.
    """
    from percept.lidar.cluster_kernels import CELL_PER_TOLERANCE, label_components

    config = config or ClusterConfig()
    finite = finite_rows(points)
    labels = np.full(len(finite), -1, np.int32)
    if not finite.any():
        return labels
    points = np.asarray(points)[finite, :3]
    if points.dtype.itemsize > 4 and not config.range_growth:
        # Kernels work in float32, which has steps of 3 cm at map coordinates: near the cloud's
        # own middle it has none that matter. Growth with range needs the true origin.
        points = points - np.median(points, axis=0)
    xyz = as_points(points)
    farthest_m = float(np.abs(xyz).max())
    if farthest_m > config.tolerance_m * CELL_PER_TOLERANCE * _CELLS_FROM_ORIGIN:
        raise GeometryError(
            f"a point lies {farthest_m:.3g} m from the origin, too far for a tolerance of "
            f"{config.tolerance_m} m",
            remedy="Move the cloud near the origin or give a larger tolerance",
        )
    labels[finite] = label_components(
        xyz,
        config.tolerance_m,
        config.range_growth,
        config.tolerance_m * MAX_GROWTH,
        config.min_points,
        len(xyz) if config.max_points is None else config.max_points,
    )
    return labels
