"""Registration of two LiDARs over all scenes at once: symmetric, robust generalised ICP.

Each scene adds its residuals to one 6x6 system for one transform. Points of either cloud look
for their neighbour in the other, because one of the two is often sparse.

The unknowns of a step are a rotation vector (rad) and a shift (m) along the target's axes,
``R <- exp(w) R`` and ``t <- t + s``: the rotation turns about the source's origin. Beside them
stand two faults of the source: ranges that are too long (m) and beams that point higher than
they are said to (rad).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from percept.calib.lidars.registration_kernels import local_moments, normal_equations

__all__ = [
    "Stage",
    "Surface",
    "System",
    "apply_step",
    "linearise",
    "refine",
    "refine_with_offset",
    "solve_step",
    "surface",
    "thin",
]

_F64 = NDArray[np.float64]
_NEIGHBOURS = 16
_FEWEST_NEIGHBOURS = 6
_SOFTNESS = 0.2  # of bushes and posts, which count too
_LOOSE_FLAT = 0.001
_BEAM_RAD = 0.003  # divergence of a beam, which edges and bushes are seen with
_FLATNESS = 0.1  # smallest over middle eigenvalue: a plane, not a bush
_CONVERGED = 1e-3  # 0.1 mm and 0.0006 deg at the finest gate of 0.3 m
_BREADTH = 0.05  # middle over largest eigenvalue: a plane, not the line of one laser ring


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A thinned cloud with the local plane at each point.

    Attributes:
        points: (N, 3) metres, in the sensor's frame.
        anchors: (N, 3) centres of the local planes.
        normals: (N, 3) unit normals, towards the sensor.
        is_plane: (N,) bool; elsewhere the neighbourhood is a line or a bush.
        tree: Search tree over `points`.
        probes: (P, 3) the points, or some of them, that are looked for in the other cloud.
        probe_normals: (P, 3) their normals.
        is_round: (N,) bool, where the neighbourhood is a bush or a post.
        probe_is_round: (P,) bool, as `is_round`.
    """

    points: _F64
    anchors: _F64
    normals: _F64
    is_plane: NDArray[np.bool_]
    tree: cKDTree
    probes: _F64
    probe_normals: _F64
    is_round: NDArray[np.bool_]
    probe_is_round: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of coarse to fine.

    Attributes:
        gate_m: Largest distance between corresponding points.
        kernel_m: Scale of the Geman-McClure kernel.
        steps: Most Gauss-Newton steps.
    """

    gate_m: float
    kernel_m: float
    steps: int


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """The linearised problem at a transform, as sums over blocks of residuals.

    Attributes:
        H: (B, 8, 8) and
        b: (B, 8) of rotation (rad) and shift (m) in the target's axes, then by how much the
            source measures too far (m) and too high (rad).
        G: (B, 6, 6) the part of H that comes from the shape of the surfaces alone.
        squares: (B,) weighted sums of squared residuals, m^2.
        weights: (B,) sums of weights.
    """

    H: _F64
    b: _F64
    G: _F64
    squares: _F64
    weights: _F64


def thin(points: _F64, voxel_m: float) -> _F64:
    """Return the mean of the points of each voxel, (M, 3), sorted by voxel."""
    cells = np.floor(points / voxel_m).astype(np.int64) + (1 << 20)
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    means: _F64 = np.add.reduceat(points[order], starts, axis=0) / counts[:, None]
    return means


def surface(points: _F64, voxel_m: float, most_probes: int | None = None) -> Surface:
    """Thin a cloud (N, 3), whose sensor is at the origin, and find its local planes.

    Args:
        points: (N, 3) metres, finite.
        voxel_m: One point a voxel is left.
        most_probes: Of these, at most so many are looked for in the other cloud.
    """
    thinned = thin(points, voxel_m)
    tree = cKDTree(thinned)
    _, neighbours = tree.query(thinned, k=min(_NEIGHBOURS, len(thinned)))
    neighbours = np.asarray(neighbours, dtype=np.int64).reshape(len(thinned), -1)
    anchors, covariances = local_moments(thinned, neighbours)
    spreads, axes = np.linalg.eigh(covariances)
    normals = axes[:, :, 0]
    normals = np.where((normals * thinned).sum(axis=1, keepdims=True) > 0, -normals, normals)
    is_plane = (spreads[:, 0] < _FLATNESS * spreads[:, 1]) & (
        spreads[:, 1] > _BREADTH * spreads[:, 2]
    )
    is_round = (spreads[:, 0] >= _FLATNESS * spreads[:, 1]) & (
        spreads[:, 1] > _BREADTH * spreads[:, 2]
    )
    is_plane &= neighbours.shape[1] >= _FEWEST_NEIGHBOURS
    stride = 1 if most_probes is None else max(1, -(-len(thinned) // most_probes))
    return Surface(
        thinned,
        anchors,
        normals,
        is_plane,
        tree,
        thinned[::stride],
        normals[::stride],
        is_round,
        is_round[::stride],
    )


def apply_step(T_target_source: _F64, step: _F64) -> _F64:
    """Return the transform (4, 4) moved by rotation (rad) and shift (m), `step` (6,)."""
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ T_target_source[:3, :3]
    moved[:3, 3] = T_target_source[:3, 3] + step[3:]
    return moved


def linearise(
    target: Surface,
    source: Surface,
    T_target_source: _F64,
    stage: Stage,
    *,
    sectors: int = 1,
    offset_m: float = 0.0,
) -> System:
    """Linearise one scene's residuals in both directions.

    Neighbours whose normals point away from each other are the two sides of one thing, a sign
    or a post, seen from either sensor; taken for one surface they draw the sensors together.

    Args:
        target: The target's surface.
        source: The source's surface.
        T_target_source: (4, 4) where to linearise.
        stage: Gate and kernel.
        sectors: Number of azimuth sectors (about the source) to sum apart.
        offset_m: By how much the source measures too far.
    """
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    forth_s, forth_t = _nearest(target, source.probes @ R.T + t, stage.gate_m)
    back_t, back_s = _nearest(source, (target.probes - t) @ R, stage.gate_m)
    arms = np.vstack([source.probes[forth_s], source.points[back_s]]) @ R.T
    ends = np.vstack([target.points[forth_t], target.probes[back_t]])
    normals_t = np.vstack([target.normals[forth_t], target.probe_normals[back_t]])
    normals_s = np.vstack([source.probe_normals[forth_s], source.normals[back_s]]) @ R.T
    round_ = np.concatenate(
        [
            target.is_round[forth_t] & source.probe_is_round[forth_s],
            target.probe_is_round[back_t] & source.is_round[back_s],
        ]
    )
    one_side = (normals_t * normals_s).sum(axis=1) > 0
    arms = arms[one_side]
    if offset_m:
        arms = arms * (1 - offset_m / np.linalg.norm(arms, axis=1, keepdims=True))
    turns = np.arctan2(arms[:, 1], arms[:, 0]) / (2 * np.pi) + 0.5
    blocks = np.minimum((turns * sectors).astype(np.int64), sectors - 1)
    return System(
        *normal_equations(
            arms,
            arms + t - ends[one_side],
            (normals_t[one_side], normals_s[one_side]),
            blocks,
            sectors,
            _SOFTNESS,
            np.where(round_[one_side], _SOFTNESS, _LOOSE_FLAT),
            stage.kernel_m,
            _BEAM_RAD,
            np.ascontiguousarray(R[:, 2]),
        )
    )


def _nearest(
    onto: Surface, points: _F64, gate_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which points (K,) have a neighbour within the gate, and which one (K,)."""
    distances, nearest = onto.tree.query(points, distance_upper_bound=gate_m)
    kept = np.flatnonzero(np.isfinite(distances))
    return kept, nearest[kept]


def refine(
    scenes: Sequence[tuple[Surface, Surface]],
    T_target_source: _F64,
    stages: Sequence[Stage],
    *,
    offset_m: float = 0.0,
) -> _F64:
    """Refine one transform (4, 4) on all scenes (target, source), stage by stage.

    Args:
        scenes: Surfaces of target and source, one pair a scene.
        T_target_source: (4, 4) to begin with.
        stages: From coarse to fine.
        offset_m: By how much the source measures too far.
    """
    T = T_target_source
    for stage in stages:
        T, _ = _settled(scenes, T, stage, offset_m, None)
    return T


def refine_with_offset(
    scenes: Sequence[tuple[Surface, Surface]],
    T_target_source: _F64,
    stage: Stage,
    stiffness: float,
    *,
    offset_m: float = 0.0,
) -> tuple[_F64, float]:
    """Refine a transform (4, 4) together with how much too far (m) the source measures.

    Args:
        scenes: Surfaces of target and source, one pair a scene.
        T_target_source: (4, 4) to begin with.
        stage: Gate and kernel.
        stiffness: What the offset is held at zero with, in units of `System.H`.
        offset_m: The offset to begin with.
    """
    return _settled(scenes, T_target_source, stage, offset_m, stiffness)


def _settled(
    scenes: Sequence[tuple[Surface, Surface]],
    T: _F64,
    stage: Stage,
    offset_m: float,
    stiffness: float | None,
) -> tuple[_F64, float]:
    """Return transform and offset after the steps of one stage; no stiffness holds the offset."""
    unknowns = 6 if stiffness is None else 7
    for _ in range(stage.steps):
        systems = [linearise(a, b, T, stage, offset_m=offset_m) for a, b in scenes]
        H = np.sum([system.H[0] for system in systems], axis=0)[:unknowns, :unknowns]
        b = np.sum([system.b[0] for system in systems], axis=0)[:unknowns]
        if stiffness is not None:
            H[6, 6] += stiffness
            b[6] += stiffness * offset_m
        step = solve_step(H, b)
        T = apply_step(T, step[:6])
        offset_m += float(step[6:].sum())
        enough = _CONVERGED * stage.gate_m**2  # the next stage goes on from here
        if np.abs(step[:3]).max() < 0.1 * enough and np.abs(step[3:]).max() < enough:
            break
    return T, offset_m


def solve_step(H: _F64, b: _F64) -> _F64:
    """Return the Gauss-Newton step (6 or more), held back where nothing determines it."""
    diagonal = np.diag(H)
    largest = np.full(len(b), diagonal[3:].max())
    largest[:3] = diagonal[:3].max()
    return np.asarray(-np.linalg.solve(H + np.diag(1e-6 * largest + 1e-9), b), dtype=np.float64)
