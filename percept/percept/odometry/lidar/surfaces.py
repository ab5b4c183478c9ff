"""A scan on the surfaces of the local map: how well it fits, what holds it, and the last step.

KISS-ICP matches points to points and tells nothing of its match. A point is held by the surface
at its place in the map: a wall holds it across, and not along. Where no surface stands across a
direction (a tunnel, an open field), that direction is weak, and what a registration says of it is
a guess (Zhang, Kaess and Singh 2016, "On degeneracy of optimization-based state estimation
problems").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

__all__ = ["LEAST_HOLD", "MapFit", "SurfaceMap"]

_F = NDArray[np.float64]

LEAST_HOLD = 0.01
"""Share of the surfaces from which on a direction is held."""

_NEIGHBOURS = 8
_MOST_POINTS = 1500
# Neighbours are a surface where their least spread is below this share of the middle one, and
# no line of one beam where the middle one is above this share of the largest.
_THINNEST, _WIDEST = 0.05, 0.05
_SMALLEST_SD_M = 0.02
_STEPS, _STILL_M = 5, 1e-3
# Points of one wall err together: so many of them tell as much as one that errs alone.
_POINTS_THAT_ERR_TOGETHER = 20.0
# Where nothing holds, the spread ends here: 10 m and 1 rad.
_LEAST_INFORMATION = np.diag([1e-2] * 3 + [1.0] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class MapFit:
    """How a scan fits a map.

    Attributes:
        points: Points of the scan that were looked at.
        overlap: Share of them with a point of the map within half a cell.
        residual_m: Median distance from the surface of the map; NaN where there is none.
        hold: (3,) float64 share of surfaces that hold each principal direction, rising; they
            add up to 1, or are 0 where there is no surface.
        weakest: (3,) float64 unit vector of the direction that is held least, in the map.
        covariance: (6, 6) float64 of the pose by its surfaces: translation, m^2, and rotation
            about the scan's origin, rad^2, in the axes of the map.
    """

    points: int
    overlap: float
    residual_m: float
    hold: _F
    weakest: _F
    covariance: _F

    @property
    def degenerate(self) -> bool:
        """Whether there is a direction that nothing holds."""
        return float(self.hold[0]) < LEAST_HOLD

    @classmethod
    def nothing(cls, points: int = 0, overlap: float = 0.0) -> MapFit:
        """Return the fit of a scan that no surface holds."""
        spread = np.linalg.inv(_LEAST_INFORMATION)
        return cls(points, overlap, float("nan"), np.zeros(3), np.array([1.0, 0, 0]), spread)


@dataclass(frozen=True, slots=True, eq=False)
class _Contacts:
    """Points of a scan that lie on surfaces: (N,) residuals, (N, 3) normals, (N, 6) Jacobian."""

    residuals_m: _F
    normals: _F
    jacobian: _F
    overlap: float


class SurfaceMap:
    """The points of a local map, ready to be asked for surfaces.

    Args:
        points_map: (M, 3) float64, metres.
        cell_m: Edge of a cell of the map: neighbours farther away make no surface.
    """

    def __init__(self, points_map: _F, cell_m: float) -> None:
        self._points = points_map
        self._cell_m = cell_m
        self._tree = cKDTree(points_map, balanced_tree=False, compact_nodes=False)

    def settle(self, points_scan: _F, T_map_scan: _F) -> _F:
        """Return the pose (4, 4) at which a scan lies on the surfaces, from one nearby.

        Point-to-plane Gauss-Newton (Chen and Medioni 1992) with the weights of Geman and
        McClure. A direction that nothing holds stays as it is, and so does a pose that would
        move by more than half a cell.

        Args:
            points_scan: (N, 3) float64, metres; about 1,500 are used.
            T_map_scan: (4, 4) float64 pose to begin with.
        """
        chosen, pose = _thinned(points_scan), T_map_scan
        for _ in range(_STEPS):
            contacts = self._contacts(chosen, pose)
            if contacts is None:
                return T_map_scan
            step = _gauss_newton(contacts)
            turned = Rotation.from_rotvec(step[3:]).as_matrix() @ pose[:3, :3]
            pose = np.vstack([np.column_stack([turned, pose[:3, 3] + step[:3]]), [0, 0, 0, 1]])
            if np.linalg.norm(step[:3]) < _STILL_M:
                break
        moved_m = float(np.linalg.norm(pose[:3, 3] - T_map_scan[:3, 3]))
        return pose if moved_m <= 0.5 * self._cell_m else T_map_scan

    def fit(self, points_scan: _F, T_map_scan: _F) -> MapFit:
        """Return how a scan (N, 3) fits at a pose (4, 4); about 1,500 points are looked at."""
        chosen = _thinned(points_scan)
        contacts = self._contacts(chosen, T_map_scan)
        if contacts is None:
            return MapFit.nothing(len(chosen))
        hold, axes = np.linalg.eigh(contacts.normals.T @ contacts.normals / len(contacts.normals))
        information = contacts.jacobian.T @ contacts.jacobian / _sd_m(contacts) ** 2
        information = information / _POINTS_THAT_ERR_TOGETHER + _LEAST_INFORMATION
        covariance: _F = np.asarray(np.linalg.inv(information), dtype=np.float64)
        return MapFit(
            points=len(chosen),
            overlap=contacts.overlap,
            residual_m=float(np.median(np.abs(contacts.residuals_m))),
            hold=np.maximum(hold, 0.0),
            weakest=axes[:, 0],
            covariance=covariance,
        )

    def _contacts(self, points_scan: _F, pose: _F) -> _Contacts | None:
        """Return the points on surfaces; None where there is none."""
        if not len(points_scan) or len(self._points) < _NEIGHBOURS:
            return None
        arms = points_scan @ pose[:3, :3].T
        placed = arms + pose[:3, 3]
        reach_m = 1.5 * self._cell_m
        distances_m, near = self._tree.query(placed, _NEIGHBOURS, distance_upper_bound=reach_m)
        held = np.isfinite(distances_m[:, -1])
        if not held.any():
            return None
        centres, normals, flat = _surfaces(self._points[near[held]])
        if not flat.any():
            return None
        residuals_m = np.einsum("ni,ni->n", placed[held] - centres, normals)
        jacobian = np.hstack([normals, np.cross(arms[held], normals)])
        overlap = float((distances_m[:, 0] < 0.5 * self._cell_m).mean())
        return _Contacts(residuals_m[flat], normals[flat], jacobian[flat], overlap)


def _thinned(points: _F) -> _F:
    return points[:: max(1, len(points) // _MOST_POINTS)]


def _surfaces(groups: _F) -> tuple[_F, _F, NDArray[np.bool_]]:
    """Return centres (N, 3) and normals (N, 3) of groups (N, K, 3), and (N,) which are flat."""
    centres = groups.mean(axis=1)
    spread = groups - centres[:, None]
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    flat = (values[:, 0] < _THINNEST * values[:, 1]) & (values[:, 1] > _WIDEST * values[:, 2])
    return centres, vectors[:, :, 0], flat


def _sd_m(contacts: _Contacts) -> float:
    """Return the standard deviation of the residuals, by their median."""
    return max(1.4826 * float(np.median(np.abs(contacts.residuals_m))), _SMALLEST_SD_M)


def _gauss_newton(contacts: _Contacts) -> _F:
    """Return the step (6,) of translation and rotation that brings points onto their surfaces."""
    jacobian, residuals = contacts.jacobian, contacts.residuals_m
    weights = (1 + (residuals / (2 * _sd_m(contacts))) ** 2) ** -2
    weighted = jacobian * weights[:, None]
    normal = weighted.T @ jacobian + 1e-6 * len(residuals) * np.eye(6)
    step: _F = np.asarray(np.linalg.solve(normal, -(weighted.T @ residuals)), np.float64)
    hold, axes = np.linalg.eigh(contacts.normals.T @ contacts.normals / len(residuals))
    for axis in axes[:, hold < LEAST_HOLD].T:
        step[:3] -= (step[:3] @ axis) * axis
    return step
