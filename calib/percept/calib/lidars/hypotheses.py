"""Where one LiDAR could be as seen from another, from one scene and without a guess.

For each pair of large planes, one of each sensor, that could be the same surface: both clouds
are levelled on it, which leaves a turn about its normal and a shift along it. These are searched
exhaustively by correlating the source's points with what the target's rays say is occupied or
free (Olson 2009). Several separated peaks are kept: the best one alone is often wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.levelling import LevelPlane
from percept.calib.lidars.registration import thin
from percept.calib.lidars.registration_kernels import carve_free_space, correlate_poses

__all__ = ["Hypothesis", "propose"]

_F64 = NDArray[np.float64]
_CELL_M = 0.5
_REACH_M = 30.0
_LOWEST_M = -6.0
_HIGHEST_M = 18.0
_YAWS = 120
_SHIFT_CELLS = 2  # occupied cells reach one further on each side
_MOST_POINTS = 1500
_MOST_RAYS = 12000
_OFF_PLANE_M = 0.4
_PEAKS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A rough place of the source.

    Attributes:
        T_target_source: (4, 4).
        score: Agreement of occupied and free space, up to 2 a point; NaN where none was computed.
        origin: How it came about, in words.
    """

    T_target_source: _F64
    score: float
    origin: str


def propose(
    target: _F64,
    source: _F64,
    planes: tuple[list[LevelPlane], list[LevelPlane]],
    largest_translation_m: float,
) -> list[Hypothesis]:
    """Return hypotheses for one scene, best score first.

    Args:
        target: (N, 3) cloud of the target, its sensor at the origin.
        source: (M, 3) cloud of the source, its sensor at the origin.
        planes: The largest planes of target and source.
        largest_translation_m: Sensors are not farther apart than this.
    """
    found: list[Hypothesis] = []
    for i, plane_target in enumerate(planes[0]):
        partners = [
            (j, plane)
            for j, plane in enumerate(planes[1])
            if abs(plane.height_m - plane_target.height_m) <= largest_translation_m
        ]
        if not partners:
            continue
        T_level_target = plane_target.levelling()
        grid, corner = _occupancy(target, T_level_target)
        for j, plane in partners:
            found += _search(
                grid,
                corner,
                source,
                T_level_target,
                plane,
                largest_translation_m,
                f"planes {i + 1} and {j + 1}",
            )
    return sorted(found, key=lambda hypothesis: -hypothesis.score)


def _occupancy(points: _F64, T_level_sensor: _F64) -> tuple[NDArray[np.int8], _F64]:
    """Return the grid of what a scan says about space, and the corner of its first cell."""
    level = thin(points, 0.5 * _CELL_M) @ T_level_sensor[:3, :3].T + T_level_sensor[:3, 3]
    level = level[:: max(1, -(-len(level) // _MOST_RAYS))]
    corner = np.array([-_REACH_M, -_REACH_M, _LOWEST_M])
    across = int(2 * _REACH_M / _CELL_M)
    grid = np.zeros((across, across, int((_HIGHEST_M - _LOWEST_M) / _CELL_M)), dtype=np.int8)
    carve_free_space(grid, level, T_level_sensor[:3, 3], corner, _CELL_M, 2 * _CELL_M)
    return grid, corner


def _search(
    grid: NDArray[np.int8],
    corner: _F64,
    source: _F64,
    T_level_target: _F64,
    plane: LevelPlane,
    largest_translation_m: float,
    origin: str,
) -> list[Hypothesis]:
    """Correlate over the full circle and all shifts, and return the separated peaks."""
    T_level_source = plane.levelling()
    level = source @ T_level_source[:3, :3].T + T_level_source[:3, 3]
    near = (level[:, 0] ** 2 + level[:, 1] ** 2 < _REACH_M**2) & (
        np.abs(level[:, 2]) > _OFF_PLANE_M
    )
    if near.sum() < 20:
        return []
    level = thin(level[near], _CELL_M)
    level = level[:: max(1, -(-len(level) // _MOST_POINTS))]
    yaws = np.linspace(0, 2 * np.pi, _YAWS, endpoint=False, dtype=np.float64)
    shifts = _shifts(largest_translation_m)
    scores = correlate_poses(grid, level, corner, _CELL_M, yaws, shifts) / len(level)
    peaks = _peaks(scores, yaws, shifts)
    return [
        Hypothesis(
            np.linalg.inv(T_level_target) @ _planar(yaw, shift) @ T_level_source, score, origin
        )
        for yaw, shift, score in peaks
    ]


def _shifts(largest_m: float) -> NDArray[np.int64]:
    """Return the shifts (S, 2) in cells, within the largest translation."""
    reach = int(np.ceil(largest_m / _CELL_M / _SHIFT_CELLS)) * _SHIFT_CELLS
    line = np.arange(-reach, reach + 1, _SHIFT_CELLS)
    x, y = np.meshgrid(line, line, indexing="ij")
    pairs = np.column_stack([x.ravel(), y.ravel()]).astype(np.int64)
    near: NDArray[np.int64] = pairs[np.hypot(*pairs.T) * _CELL_M <= largest_m + _CELL_M]
    return near


def _peaks(scores: _F64, yaws: _F64, shifts: NDArray[np.int64]) -> list[tuple[float, _F64, float]]:
    """Return the best separated (yaw, shift in metres, score)."""
    flat = scores.ravel()
    best = np.argsort(-flat, kind="stable")[:2000]
    kept: list[tuple[float, _F64, float]] = []
    for index in best:
        row, column = divmod(int(index), len(shifts))
        yaw, shift = float(yaws[row]), shifts[column] * _CELL_M
        if all(
            abs((yaw - other + np.pi) % (2 * np.pi) - np.pi) > np.radians(10)
            or np.hypot(*(shift - place)) > 2.0
            for other, place, _ in kept
        ):
            kept.append((yaw, shift, float(flat[index])))
        if len(kept) == _PEAKS:
            break
    return kept


def _planar(yaw: float, shift: _F64) -> _F64:
    """Return the (4, 4) turn about z and shift along x and y."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:2, 3] = shift
    return T
