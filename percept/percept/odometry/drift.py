"""How far a trajectory drifts from a reference: the measures that the field compares.

Relative errors over stretches of 100 to 800 m (Geiger, Lenz and Urtasun 2012, the KITTI odometry
benchmark), the absolute error after alignment and the relative error from pose to pose (Sturm et
al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems", section V).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.errors import GeometryError, InsufficientDataError
from percept.core.trajectory import Trajectory

__all__ = ["KITTI_LENGTHS_M", "Alignment", "Drift", "Stretch", "align_poses", "measure_drift",
           "stretch_errors"]  # fmt: skip

_F = NDArray[np.float64]
Alignment = Literal["se3", "yaw", "first"]
"""How a trajectory is laid over the reference: turned and moved freely, turned about the vertical
and moved, or with its first pose on that of the reference."""

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
_SHORT_LENGTHS_M = (10.0, 20.0, 50.0)
_STEP = 10


@dataclass(frozen=True, slots=True)
class Stretch:
    """Mean errors over all stretches of one length.

    Attributes:
        length_m: Length along the reference.
        count: Stretches.
        translation_percent: Error of the position at the end, in percent of the length.
        rotation_degpm: Error of the rotation at the end, degrees per metre.
    """

    length_m: float
    count: int
    translation_percent: float
    rotation_degpm: float


@dataclass(frozen=True, slots=True)
class Drift:
    """How far a trajectory is from a reference.

    Attributes:
        poses: Poses that were compared.
        way_m: Length of the reference over them.
        stretches: By length; empty where the way is shorter than the shortest.
        translation_percent: Mean over all stretches of all lengths; None without stretches.
        rotation_degpm: The same of the rotation.
        ate_m: Root mean square distance of the positions after alignment.
        ate_deg: Root mean square angle between the rotations after alignment.
        rpe_m: Root mean square error of the motion from pose to pose.
        rpe_deg: The same of the rotation.
        end_m: Distance at the end, with the first poses on each other.
        alignment: How the trajectory was laid over the reference for `ate_m`.
    """

    poses: int
    way_m: float
    stretches: tuple[Stretch, ...]
    translation_percent: float | None
    rotation_degpm: float | None
    ate_m: float
    ate_deg: float
    rpe_m: float
    rpe_deg: float
    end_m: float
    alignment: Alignment


def measure_drift(
    estimate: Trajectory, reference: Trajectory, *, alignment: Alignment = "se3"
) -> Drift:
    """Return how far a trajectory is from a reference, at its own stamps.

    The reference is interpolated; poses outside its span and in its gaps are not compared.
    Lengths are those of KITTI as far as the way is long enough, and 10, 20 and 50 m where it is
    shorter than 100 m.

    Args:
        estimate: The trajectory in question.
        reference: What it is compared with, of the same moving frame.
        alignment: How the one is laid over the other for the absolute error.

    Raises:
        GeometryError: If the two follow different frames.
        InsufficientDataError: If they share fewer than two poses in time.
    """
    if estimate.source != reference.source:
        raise GeometryError(
            f"a trajectory of '{estimate.source}' cannot be compared with one of "
            f"'{reference.source}'"
        )
    true, known = reference.poses_at(estimate.stamps_ns)
    if known.sum() < 2:
        raise InsufficientDataError(
            "the trajectory and its reference share no span of time",
            remedy="Compare trajectories of one drive and one clock",
        )
    true, found = true[known], estimate.matrices[known]
    way_m = float(_way_m(true)[-1])
    lengths, step = (
        (KITTI_LENGTHS_M, _STEP) if way_m > KITTI_LENGTHS_M[0] else (_SHORT_LENGTHS_M, 1)
    )
    stretches, mean = _stretches(true, found, lengths, step)
    ate = _rms(_between(true, align_poses(true, found, alignment)))
    rpe = _rms(_between(_steps(true), _steps(found)))
    ends = _between(true[-1:], align_poses(true, found, "first")[-1:])
    return Drift(
        poses=len(true),
        way_m=way_m,
        stretches=stretches,
        translation_percent=mean[0] if mean else None,
        rotation_degpm=mean[1] if mean else None,
        ate_m=ate[0],
        ate_deg=ate[1],
        rpe_m=rpe[0],
        rpe_deg=rpe[1],
        end_m=float(ends[0][0]),
        alignment=alignment,
    )


def stretch_errors(
    true: _F, found: _F, lengths_m: Sequence[float] = KITTI_LENGTHS_M, step: int = _STEP
) -> _F:
    """Return (S, 3) the length in metres and the errors of each stretch, in m/m and rad/m.

    A stretch begins at every `step`-th pose and ends at the first one that is farther along the
    reference than its length, as in the development kit of KITTI.

    Args:
        true: (N, 4, 4) poses of the reference.
        found: (N, 4, 4) poses at the same times.
        lengths_m: Lengths.
        step: Poses from the beginning of one stretch to that of the next.
    """
    way_m = _way_m(true)
    starts = np.arange(0, len(true), step)
    rows = []
    for length_m in lengths_m:
        ends = np.searchsorted(way_m, way_m[starts] + length_m, side="right")
        inside = ends < len(true)
        first, last = starts[inside], ends[inside]
        error_m, error_rad = _between(
            _relative(true[first], true[last]), _relative(found[first], found[last])
        )
        lengths = np.full(len(first), float(length_m))
        rows.append(np.column_stack([lengths, error_m / length_m, error_rad / length_m]))
    return np.concatenate(rows) if rows else np.zeros((0, 3))


def align_poses(true: _F, found: _F, alignment: Alignment) -> _F:
    """Return poses (N, 4, 4) moved as a whole so that they lie best over a reference.

    `se3` is Umeyama 1991 without scale, equation (40); `yaw` the same about z only.
    """
    if alignment == "first":
        moved: _F = true[0] @ np.linalg.inv(found[0]) @ found
        return moved
    a, b = true[:, :3, 3], found[:, :3, 3]
    spread = (a - a.mean(axis=0)).T @ (b - b.mean(axis=0))
    T = np.eye(4)
    if alignment == "yaw":
        yaw = np.arctan2(spread[1, 0] - spread[0, 1], spread[0, 0] + spread[1, 1])
        T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
    else:
        left, _, right = np.linalg.svd(spread)
        flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        T[:3, :3] = left @ flip @ right
    T[:3, 3] = a.mean(axis=0) - T[:3, :3] @ b.mean(axis=0)
    laid: _F = T @ found
    return laid


def _stretches(
    true: _F, found: _F, lengths_m: Sequence[float], step: int
) -> tuple[tuple[Stretch, ...], tuple[float, float] | None]:
    rows = stretch_errors(true, found, lengths_m, step)
    if not len(rows):
        return (), None
    by_length = []
    for length_m in np.unique(rows[:, 0]).tolist():
        of_it = rows[rows[:, 0] == length_m]
        percent, degpm = _in_percent(of_it)
        by_length.append(Stretch(length_m, len(of_it), percent, degpm))
    return tuple(by_length), _in_percent(rows)


def _in_percent(rows: _F) -> tuple[float, float]:
    return 100 * float(rows[:, 1].mean()), float(np.degrees(rows[:, 2].mean()))


def _way_m(poses: _F) -> _F:
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.append(0.0, np.cumsum(steps))


def _relative(first: _F, last: _F) -> _F:
    relative: _F = np.linalg.inv(first) @ last
    return relative


def _steps(poses: _F) -> _F:
    return _relative(poses[:-1], poses[1:])


def _between(a: _F, b: _F) -> tuple[_F, _F]:
    """Return the distances (N,) in metres and the angles (N,) in rad between poses."""
    off = np.linalg.inv(b) @ a
    angles = Rotation.from_matrix(off[:, :3, :3]).magnitude()
    return np.linalg.norm(off[:, :3, 3], axis=1), angles


def _rms(errors: tuple[_F, _F]) -> tuple[float, float]:
    """Return the root mean square of distances in metres and of angles in degrees."""
    metres, angles = (float(np.sqrt(np.mean(e**2))) for e in errors)
    return metres, float(np.degrees(angles))
