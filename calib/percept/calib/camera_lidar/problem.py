"""The joint problem of camera and LiDAR: what is measured, what is unknown, and how they meet.

Unknown are the transform, one range offset, and the plate's pose in every pair. Measured are the
corners in the image, the points on the plate, and where the plate's outline lies in its own plane.
A pair shares only the transform and the few other common unknowns with the rest, so its plate
pose is eliminated at once (Schur complement; Triggs et al. 2000, section 6) and a pair is left as a
small block of normal equations. Leaving pairs out, or taking half of them, is a sum of blocks.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera

__all__ = [
    "CENTRE",
    "COMMON",
    "FOCAL",
    "OFFSET",
    "PATTERN",
    "SCALE",
    "Block",
    "Common",
    "PairData",
    "Sigmas",
    "linearise",
    "linearised_view",
    "moved_pose",
    "pose_step",
    "residuals_of",
]

_F64 = NDArray[np.float64]

OFFSET, SCALE, FOCAL = 6, 7, 8
"""Columns of the common unknowns after the transform's rotation (3) and translation (3)."""
CENTRE = slice(9, 11)
PATTERN = slice(11, 13)
COMMON = 13
_LOSS_SCALE = 3.0
"""Cauchy's scale in standard deviations: 95 % efficient for normal errors at 2.4, more above."""
_DIFFERENCE = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class PairData:
    """What one pair measured.

    Attributes:
        name: Name of the pair.
        corners_plate: (N, 3) corners that were seen, in the plate's frame, metres.
        seen_xy: (N, 2) their rays, on the plane z = 1 of the camera.
        pixels_per_xy: (N, 2, 2) change of the pixel with the point on that plane.
        points_lidar: (M, 3) points on the plate.
        cells_lidar: (C, 3) means of the points in the cells of a grid on the plate: of a plane
            they say the same.
        cell_counts: (C,) float64 points in each cell.
        outline: (4, 4) T_lidar_plate, the outline in the cloud; only its place within its own
            plane is used, the plane itself comes from the points.
        outline_covariance: (3, 3) of that place: x, y in metres and the angle in rad.
    """

    name: str
    corners_plate: _F64
    seen_xy: _F64
    pixels_per_xy: _F64
    points_lidar: _F64
    cells_lidar: _F64
    cell_counts: _F64
    outline: _F64
    outline_covariance: _F64


@dataclass(frozen=True, slots=True, eq=False)
class Common:
    """The unknowns that all pairs share.

    Attributes:
        T_camera_lidar: (4, 4).
        range_offset_m: Added to measured ranges.
        board_scale: Size of the printed pattern over the size that was given.
        focal_scale: Focal length over the one that was given.
        centre_xy: How far the principal point is from the given one, in focal lengths.
        pattern_m: Where the pattern's middle lies from the plate's, along columns and rows.
    """

    T_camera_lidar: _F64
    range_offset_m: float = 0.0
    board_scale: float = 1.0
    focal_scale: float = 1.0
    centre_xy: tuple[float, float] = (0.0, 0.0)
    pattern_m: tuple[float, float] = (0.0, 0.0)

    def moved(self, step: _F64) -> Common:
        """Return the unknowns after a step (13,)."""
        return Common(
            moved_pose(self.T_camera_lidar, step[:6]),
            self.range_offset_m + float(step[OFFSET]),
            self.board_scale + float(step[SCALE]),
            self.focal_scale + float(step[FOCAL]),
            (self.centre_xy[0] + float(step[9]), self.centre_xy[1] + float(step[10])),
            (self.pattern_m[0] + float(step[11]), self.pattern_m[1] + float(step[12])),
        )


@dataclass(frozen=True, slots=True)
class Sigmas:
    """Standard deviations of what is measured.

    Attributes:
        corner_px: Of a corner, along each axis of the image.
        point_m: Of a point, along the plate's normal.
        plane_m: Of the whole plane of a plate: what its points have in common, such as warp.
        outline_m: Of the outline's place beyond its own covariance.
        outline_rad: Of the outline's angle beyond its own covariance.
    """

    corner_px: float
    point_m: float
    plane_m: float
    outline_m: float
    outline_rad: float

    def close_to(self, other: Sigmas) -> bool:
        """Return whether all differ by less than a twentieth."""
        return all(
            abs(a - b) <= 0.05 * b for a, b in zip(astuple(self), astuple(other), strict=True)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Normal equations of one pair, for the common unknowns and its plate's pose.

    Attributes:
        common: (13, 13) normal matrix, the plate's pose eliminated.
        right: (13,) right-hand side.
        cost: Robust cost.
        pose_solve: (6, 13) and pose_right (6,): step of the pose = pose_right - pose_solve @ step.
    """

    common: _F64
    right: _F64
    cost: float
    pose_solve: _F64
    pose_right: _F64


def linearised_view(camera: Camera, seen_xy: _F64) -> _F64:
    """Return d pixel / d (x, y) on the plane z = 1 (N, 2, 2), by central differences."""
    columns = []
    for axis in np.eye(2) * _DIFFERENCE:
        ahead, _ = camera.project(np.column_stack([seen_xy + axis, np.ones(len(seen_xy))]))
        behind, _ = camera.project(np.column_stack([seen_xy - axis, np.ones(len(seen_xy))]))
        columns.append((ahead - behind) / (2 * _DIFFERENCE))
    return np.stack(columns, axis=2)


def moved_pose(T: _F64, step: _F64) -> _F64:
    """Return a pose (4, 4) after a rotation vector and a shift (6,), in the target's axes.

    The source's origin stays where it is under the rotation.
    """
    moved = T.copy()
    R = _rotation(step[:3]) @ T[:3, :3]
    U, _, Vt = np.linalg.svd(R)  # keeps rounding from adding up
    moved[:3, :3] = U @ Vt
    moved[:3, 3] += step[3:]
    return moved


def pose_step(T_from: _F64, T_to: _F64) -> _F64:
    """Return the rotation vector (rad) and shift (6,) that `moved_pose` needs."""
    R = T_to[:3, :3] @ T_from[:3, :3].T
    sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    length = float(np.linalg.norm(sine))
    angle = float(np.arctan2(length, (np.trace(R) - 1) / 2))
    turn = sine * (angle / length if length > 1e-12 else 1.0)
    return np.concatenate([turn, T_to[:3, 3] - T_from[:3, 3]])


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Residuals of one kind, in standard deviations, with what they depend on.

    Attributes:
        residual: (K,); by_common: (K, 13); by_pose: (K, 6); weight: (K,) of the robust loss,
            times what correlation leaves of it.
        cost: Robust cost.
    """

    residual: _F64
    by_common: _F64
    by_pose: _F64
    weight: _F64
    cost: float


def linearise(pair: PairData, common: Common, T_camera_plate: _F64, sigmas: Sigmas) -> Block:
    """Return the normal equations of one pair at the given unknowns."""
    parts = (
        _corner_rows(pair, common, T_camera_plate, sigmas),
        _plane_rows(pair, common, T_camera_plate, sigmas),
        _outline_rows(pair, common, T_camera_plate, sigmas),
    )
    J = np.concatenate([np.column_stack([p.by_common, p.by_pose]) for p in parts])
    weight = np.concatenate([p.weight for p in parts])
    residual = np.concatenate([p.residual for p in parts])
    H = (J * weight[:, None]).T @ J
    right = -(J * weight[:, None]).T @ residual
    H_gg, H_gp, H_pp = H[:COMMON, :COMMON], H[:COMMON, COMMON:], H[COMMON:, COMMON:]
    solved = np.linalg.solve(H_pp, np.column_stack([H_gp.T, right[COMMON:]]))
    return Block(
        common=H_gg - H_gp @ solved[:, :COMMON],
        right=right[:COMMON] - H_gp @ solved[:, COMMON],
        cost=sum(p.cost for p in parts),
        pose_solve=solved[:, :COMMON],
        pose_right=solved[:, COMMON],
    )


def residuals_of(pair: PairData, common: Common, T_camera_plate: _F64) -> tuple[_F64, _F64, _F64]:
    """Return the plain residuals of one pair.

    Returns:
        Corners (2 N,) in pixels, points (M,) along the normal in metres, outline (3,): x, y in
        metres and the angle in rad.
    """
    one = Sigmas(corner_px=1.0, point_m=1.0, plane_m=0.0, outline_m=1.0, outline_rad=1.0)
    plain = replace(pair, outline_covariance=np.zeros((3, 3)))
    _, _, arm = _reach(pair.points_lidar, common, T_camera_plate)
    return (
        _corner_rows(plain, common, T_camera_plate, one).residual,
        arm @ T_camera_plate[:3, 2],
        _outline_rows(plain, common, T_camera_plate, one).residual,
    )


def _corner_rows(pair: PairData, common: Common, T: _F64, sigmas: Sigmas) -> _Rows:
    turned = pair.corners_plate @ T[:3, :3].T
    scaled = turned * common.board_scale
    x, y, z = (scaled + T[:3, 3]).T
    count = len(z)
    seen_xy = (pair.seen_xy - common.centre_xy) / common.focal_scale
    off = np.column_stack([x / z, y / z]) - seen_xy
    on_plane = np.zeros((count, 2, 3))
    on_plane[:, 0, 0] = on_plane[:, 1, 1] = 1 / z
    on_plane[:, 0, 2], on_plane[:, 1, 2] = -x / z**2, -y / z**2
    to_pixels = pair.pixels_per_xy / sigmas.corner_px
    by_point = to_pixels @ on_plane
    by_pose = np.concatenate([by_point @ -_cross_matrices(scaled), by_point], axis=2)
    by_common = np.zeros((count, 2, COMMON))
    by_common[:, :, SCALE] = np.einsum("nij,nj->ni", by_point, turned)
    by_common[:, :, FOCAL] = np.einsum("nij,nj->ni", to_pixels, seen_xy) / common.focal_scale
    by_common[:, :, CENTRE] = to_pixels / common.focal_scale
    residual = np.einsum("nij,nj->ni", to_pixels, off).ravel()
    weight, cost = _cauchy(residual, 1.0)
    return _Rows(residual, by_common.reshape(-1, COMMON), by_pose.reshape(-1, 6), weight, cost)


def _plane_rows(pair: PairData, common: Common, T: _F64, sigmas: Sigmas) -> _Rows:
    ray, turned, arm = _reach(pair.cells_lidar, common, T)
    by_common, by_pose = _along(T[:3, 2], turned, arm, ray)
    # What all points of a plate have in common is measured once, not once a point.
    count = float(pair.cell_counts.sum())
    shared = sigmas.point_m**2 / (sigmas.point_m**2 + count * sigmas.plane_m**2)
    per_sd = np.sqrt(pair.cell_counts) / sigmas.point_m
    residual = arm @ T[:3, 2] * per_sd
    weight, cost = _cauchy(residual, shared)
    return _Rows(residual, by_common * per_sd[:, None], by_pose * per_sd[:, None], weight, cost)


def _outline_rows(pair: PairData, common: Common, T: _F64, sigmas: Sigmas) -> _Rows:
    """Return the outline's place in the plate's plane; its three rows are decorrelated."""
    ray, turned, arm = _reach(pair.outline[None, :3, 3], common, T)
    rows = [_along(T[:3, axis], turned, arm, ray) for axis in (0, 1)]
    x_axis = common.T_camera_lidar[:3, :3] @ pair.outline[:3, 0]
    angle = np.arctan2(x_axis @ T[:3, 1], x_axis @ T[:3, 0])
    spin = np.concatenate([T[:3, 2], np.zeros(COMMON - 3)])[None]
    by_common = np.concatenate([rows[0][0], rows[1][0], spin])
    by_pose = np.concatenate([rows[0][1], rows[1][1], -spin[:, :6]])
    by_common[:2, PATTERN] = np.eye(2)
    x_off, y_off = common.pattern_m
    residual = np.array([arm[0] @ T[:3, 0] + x_off, arm[0] @ T[:3, 1] + y_off, angle])
    extra = np.diag([sigmas.outline_m**2, sigmas.outline_m**2, sigmas.outline_rad**2])
    whiten = np.linalg.inv(np.linalg.cholesky(pair.outline_covariance + extra))
    residual = whiten @ residual
    weight, cost = _cauchy(residual, 1.0)
    return _Rows(residual, whiten @ by_common, whiten @ by_pose, weight, cost)


def _reach(points: _F64, common: Common, T: _F64) -> tuple[_F64, _F64, _F64]:
    """Return, in camera axes: unit rays, points from the LiDAR, and points from the plate."""
    R = common.T_camera_lidar[:3, :3]
    range_m = np.linalg.norm(points, axis=1, keepdims=True)
    ray = points / range_m @ R.T
    turned = ray * (range_m + common.range_offset_m)
    return ray, turned, turned + common.T_camera_lidar[:3, 3] - T[:3, 3]


def _along(axis: _F64, turned: _F64, arm: _F64, ray: _F64) -> tuple[_F64, _F64]:
    """Return derivatives of axis . arm, for an axis that is fixed to the plate."""
    by_common = np.zeros((len(arm), COMMON))
    across = _cross_matrices(axis[None])[0]
    by_common[:, :3] = turned @ across
    by_common[:, 3:6] = axis
    by_common[:, OFFSET] = ray @ axis
    by_pose = np.column_stack([-arm @ across, np.broadcast_to(-axis, arm.shape)])
    return by_common, by_pose


def _cauchy(residual: _F64, share: float) -> tuple[_F64, float]:
    squared = (residual / _LOSS_SCALE) ** 2
    return share / (1 + squared), share * _LOSS_SCALE**2 * float(np.log1p(squared).sum())


def _cross_matrices(vectors: _F64) -> _F64:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _rotation(vector: _F64) -> _F64:
    """Return the rotation (3, 3) about a vector by its length in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    K = _cross_matrices(vector[None])[0]
    first = np.sinc(angle / np.pi)
    second = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    R: _F64 = np.eye(3) + first * K + second * (K @ K)
    return R
