"""A first camera-LiDAR transform without a guess: every pair proposes, all pairs vote.

A planar target seen by a camera has up to two poses (Collins and Bartoli 2014, IPPE), a bare
rectangle in a cloud looks the same after half a turn, a square one after a quarter, and a cloud
may hold another plate of that size. Each combination of these proposes a transform. The one that
brings most pairs together wins, and what it takes of every pair is decided by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera

if TYPE_CHECKING:
    from percept.calib.board_in_cloud.find import BoardInCloud
    from percept.calib.boards.views import BoardView

__all__ = [
    "CloudPose",
    "Seed",
    "ViewPose",
    "fit_rigid",
    "misfit",
    "poses_of_cloud",
    "poses_of_view",
    "rotation_angle_deg",
    "seed_rig",
]

_F64 = NDArray[np.float64]

_CENTRE_GATE_M = 0.15
"""Centres of sparse boards are good to a few centimetres; a wrong pose is off by decimetres."""
_NORMAL_GATE_DEG = 10.0
"""Normals of sparse boards are good to one or two degrees."""
_NORMAL_ARM_M = 1.0
"""How far along its normal a board gets a second point for the rigid fit."""
_TURN_GATE_DEG = 15.0
"""Sides of sparse boards are good to a few degrees; a wrong turn is off by 90 or 180."""
_SAME_RIG_DEG = 10.0
_SAME_RIG_M = 0.3
_RIVAL_SHARE = 0.7
_RIVALS_TRIED = 20
_SETTLE_ROUNDS = 5
_FEWEST_FOR_FIT = 3
_FEWEST_CORNERS = 6
_AMBIGUOUS = 2.0
"""Below this ratio of errors IPPE's second pose may be the right one."""
_FLIP = np.diag([1.0, -1.0, -1.0])
_IN_PLANE = [3, 4, 2]
"""Of a small motion: shifts along x and y, turn about z."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewPose:
    """A pose of the plate that explains an image of it.

    Attributes:
        T_camera_plate: (4, 4); z points away from the camera.
        corners_plate: (N, 3) float64, the corners that were seen, in that plate frame, metres.
        seen_xy: (N, 2) float64, where their rays meet the plane z = 1 of the camera.
        error_px: Root mean square distance of the corners seen from those expected.
    """

    T_camera_plate: _F64
    corners_plate: _F64
    seen_xy: _F64
    error_px: float


@dataclass(frozen=True, slots=True, eq=False)
class CloudPose:
    """A pose of the plate that explains a part of a cloud, one of several turns of the rectangle.

    Attributes:
        T_lidar_plate: (4, 4); z points away from the LiDAR.
        in_plane_covariance: (3, 3) of its place in its own plane: x, y in metres, angle in rad.
        board: The points.
    """

    T_lidar_plate: _F64
    in_plane_covariance: _F64
    board: BoardInCloud


@dataclass(frozen=True, slots=True, eq=False)
class Seed:
    """What the vote decided.

    Attributes:
        T_camera_lidar: (4, 4) rigid fit of the centres and normals of the pairs that agree.
        agreeing: (P,) bool, pairs whose board is where the others put it.
        views: For each pair the chosen pose of the plate in the image.
        clouds: For each pair the chosen pose of the plate in the cloud, turned to fit the image.
        centre_errors_m: (P,) float64 distance of the two centres.
        score: Agreement of all pairs, those that fit well counting more.
        rival: Agreement with the best other transform as a share of that with this one; 0 where
            no other comes near it.
    """

    T_camera_lidar: _F64
    agreeing: NDArray[np.bool_]
    views: tuple[ViewPose, ...]
    clouds: tuple[CloudPose, ...]
    centre_errors_m: _F64
    score: float
    rival: float


def poses_of_view(view: BoardView, camera: Camera, corners_board: _F64) -> tuple[ViewPose, ...]:
    """Return the poses of a plate that explain a view of it, the best first.

    The pixels become rays first, so every camera model is served by the same solver. The second
    solution is kept where its error is less than `_AMBIGUOUS` times that of the first.

    Args:
        view: Corners seen.
        camera: Intrinsics.
        corners_board: (N, 3) all corners of the board; their mean is the plate's centre.

    Returns:
        None, one or two poses.
    """
    import cv2

    rays = camera.unproject(view.corners_px)
    sound = np.isfinite(rays).all(axis=1) & (rays[:, 2] > 1e-3)
    if sound.sum() < _FEWEST_CORNERS:
        return ()
    corners = (corners_board - corners_board.mean(axis=0))[view.ids[sound]]
    normal_xy = rays[sound, :2] / rays[sound, 2:]
    found, turns, shifts, _ = cv2.solvePnPGeneric(
        corners, normal_xy, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    poses = []
    for turn, shift in zip(turns[:found], shifts[:found], strict=True):
        turn, shift = cv2.solvePnPRefineLM(corners, normal_xy, np.eye(3), None, turn, shift)
        poses.append(
            _view_pose(
                _matrix(
                    np.asarray(cv2.Rodrigues(turn)[0], np.float64),
                    np.asarray(shift, np.float64).ravel(),
                ),
                (corners, normal_xy, view.corners_px[sound]),
                camera,
            )
        )
    poses = sorted((p for p in poses if np.isfinite(p.error_px)), key=lambda p: p.error_px)
    return tuple(p for p in poses if p.error_px < _AMBIGUOUS * poses[0].error_px)


def _view_pose(T_camera_plate: _F64, seen: tuple[_F64, _F64, _F64], camera: Camera) -> ViewPose:
    corners, seen_xy, seen_px = seen
    R, t_m = T_camera_plate[:3, :3], T_camera_plate[:3, 3]
    if R[:, 2] @ t_m < 0:  # the corners were counted from the other side
        R, corners = R @ _FLIP, corners @ _FLIP
    pixels, _ = camera.project(corners @ R.T + t_m)
    error_px = float(np.sqrt(np.mean(np.sum((pixels - seen_px) ** 2, axis=1))))
    return ViewPose(_matrix(R, t_m), corners, seen_xy, error_px)


def poses_of_cloud(board: BoardInCloud) -> tuple[CloudPose, ...]:
    """Return the poses of the plate in a cloud: the board's and its alternatives', z away."""
    return tuple(_cloud_pose(candidate) for candidate in (board, *board.alternatives))


def seed_rig(
    views: Sequence[Sequence[ViewPose]],
    clouds: Sequence[Sequence[CloudPose]],
    *,
    square_plate: bool,
) -> Seed:
    """Find the transform that brings most pairs together.

    Args:
        views: Poses of each pair's image; at least one pair, each with at least one pose.
        clouds: Poses of each pair's cloud, as many.
        square_plate: Whether the plate looks the same after a quarter turn too.

    Returns:
        The vote's outcome.
    """
    table = _Table.of(views, clouds, turn_deg=90.0 if square_plate else 180.0)
    proposals = np.concatenate([_proposals(v, c) for v, c in zip(views, clouds, strict=True)])
    scores = np.array([table.score(T) for T in proposals])
    best = _settle(table, proposals[int(np.argmax(scores))])
    rows, agreeing, centre_errors_m = table.judge(best)
    chosen = [
        (views[i][table.view[row]], clouds[i][table.cloud[row]]) for i, row in enumerate(rows)
    ]
    return Seed(
        T_camera_lidar=best,
        agreeing=agreeing,
        views=tuple(view for view, _ in chosen),
        clouds=tuple(_turned(best, view, cloud, table.turn_deg) for view, cloud in chosen),
        centre_errors_m=centre_errors_m,
        score=table.score(best),
        rival=_rival(table, proposals, scores, best),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """All combinations of a view's and a cloud's pose, one a row.

    Attributes:
        pair: (Q,) number of the pair.
        view, cloud: (Q,) number of the pose within the pair.
        camera, lidar: (Q, 4, 4) pose of the plate in either frame.
        turn_deg: The plate looks the same after this turn.
    """

    pair: NDArray[np.intp]
    view: NDArray[np.intp]
    cloud: NDArray[np.intp]
    camera: _F64
    lidar: _F64
    turn_deg: float

    @classmethod
    def of(
        cls,
        views: Sequence[Sequence[ViewPose]],
        clouds: Sequence[Sequence[CloudPose]],
        turn_deg: float,
    ) -> _Table:
        rows = [
            (i, v, c, view.T_camera_plate, cloud.T_lidar_plate)
            for i, (of_view, of_cloud) in enumerate(zip(views, clouds, strict=True))
            for v, view in enumerate(of_view)
            for c, cloud in enumerate(of_cloud)
        ]
        pair, view_no, cloud_no = (np.array([r[k] for r in rows], dtype=np.intp) for k in range(3))
        camera, lidar = (np.array([r[k] for r in rows]) for k in (3, 4))
        return cls(pair, view_no, cloud_no, camera, lidar, turn_deg)

    def misfits(self, T_camera_lidar: _F64) -> tuple[_F64, _F64]:
        """Return misfits (Q,), 1 at the gate, and distances of the centres (Q,) in metres."""
        moved = T_camera_lidar @ self.lidar
        distance_m = np.linalg.norm(moved[:, :3, 3] - self.camera[:, :3, 3], axis=1)
        cosine = np.einsum("qi,qi->q", moved[:, :3, 2], self.camera[:, :3, 2])
        tilt_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        turn_deg = _in_plane_deg(self.camera[:, :3, :3], moved[:, :3, :3]) % self.turn_deg
        turn_deg = np.minimum(turn_deg, self.turn_deg - turn_deg)
        parts = [
            distance_m / _CENTRE_GATE_M,
            tilt_deg / _NORMAL_GATE_DEG,
            turn_deg / _TURN_GATE_DEG,
        ]
        return np.max(parts, axis=0), distance_m

    def judge(self, T: _F64) -> tuple[NDArray[np.intp], NDArray[np.bool_], _F64]:
        """Return the best row, whether it agrees, and its distance in metres, for each pair."""
        misfit, distance_m = self.misfits(T)
        rows = np.array(
            [
                np.flatnonzero(self.pair == i)[np.argmin(misfit[self.pair == i])]
                for i in range(self.pair[-1] + 1)
            ]
        )
        return rows, misfit[rows] < 1, distance_m[rows]

    def score(self, T: _F64) -> float:
        """Return how many pairs agree, those that fit well counting more."""
        lowest = np.full(self.pair[-1] + 1, np.inf)
        np.minimum.at(lowest, self.pair, self.misfits(T)[0])
        return float(np.sum(np.maximum(0.0, 1.0 - (lowest / 2) ** 2)))


def _in_plane_deg(R_a: _F64, R_b: _F64) -> _F64:
    """Return by how much (...,) the x axes differ about the common normal, in degrees."""
    R = np.swapaxes(R_a, -1, -2) @ R_b
    return np.degrees(np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1]))


def _proposals(views: Sequence[ViewPose], clouds: Sequence[CloudPose]) -> _F64:
    """Return the transforms (K, 4, 4) that one pair allows, quarter turns of the plate included."""
    return np.array(
        [
            view.T_camera_plate @ np.linalg.inv(cloud.T_lidar_plate @ _turn_about_z(90.0 * k))
            for view in views
            for cloud in clouds
            for k in range(4)
        ]
    )


def _settle(table: _Table, T_camera_lidar: _F64) -> _F64:
    """Fit the transform to all pairs that agree with it, until these stay the same."""
    T, before = T_camera_lidar, None
    for _ in range(_SETTLE_ROUNDS):
        rows, agreeing, _ = table.judge(T)
        if agreeing.sum() < _FEWEST_FOR_FIT or (before is not None and (agreeing == before).all()):
            break
        kept = rows[agreeing]
        fitted = fit_rigid(_arms(table.lidar[kept]), _arms(table.camera[kept]))
        if table.score(fitted) < table.score(T):
            break
        T, before = fitted, agreeing
    return T


def _rival(table: _Table, proposals: _F64, scores: _F64, best: _F64) -> float:
    """Return the share of the best transform's score that another one reaches."""
    own = table.score(best)
    tried = 0
    for k in np.argsort(-scores):
        if scores[k] < _RIVAL_SHARE * own or tried == _RIVALS_TRIED:
            break
        if _same_rig(proposals[k], best):
            continue
        tried += 1
        other = _settle(table, proposals[k])
        if not _same_rig(other, best):
            return float(table.score(other) / own)
    return 0.0


def _same_rig(T_a: _F64, T_b: _F64) -> bool:
    apart_m = float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]))
    return apart_m < _SAME_RIG_M and rotation_angle_deg(T_a[:3, :3], T_b[:3, :3]) < _SAME_RIG_DEG


def misfit(
    T_camera_lidar: _F64,
    views: Sequence[ViewPose],
    clouds: Sequence[CloudPose],
    *,
    square_plate: bool,
) -> float:
    """Return how badly an image and a cloud agree under a transform; they do below 1."""
    table = _Table.of([views], [clouds], turn_deg=90.0 if square_plate else 180.0)
    return float(table.misfits(T_camera_lidar)[0].min())


def _turned(T: _F64, view: ViewPose, cloud: CloudPose, turn_deg: float) -> CloudPose:
    """Turn the plate in the cloud by the whole number of turns that fits the image best."""
    moved = T[:3, :3] @ cloud.T_lidar_plate[:3, :3]
    angle_deg = float(_in_plane_deg(view.T_camera_plate[:3, :3], moved))
    turn = _turn_about_z(-turn_deg * round(angle_deg / turn_deg))
    covariance = turn[:3, :3].T @ cloud.in_plane_covariance @ turn[:3, :3]
    return CloudPose(cloud.T_lidar_plate @ turn, covariance, cloud.board)


def fit_rigid(source: _F64, target: _F64) -> _F64:
    """Return the (4, 4) rigid transform of least squares, source to target (Kabsch 1976).

    Args:
        source: (N, 3) points, N >= 3 and not on one line.
        target: (N, 3) the same points in the other frame.
    """
    from_mean, to_mean = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - to_mean).T @ (source - from_mean))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return _matrix(R, to_mean - R @ from_mean)


def rotation_angle_deg(R_a: _F64, R_b: _F64) -> float:
    """Return the angle between two rotations (3, 3), in degrees."""
    chord = float(np.linalg.norm(R_a - R_b)) / np.sqrt(8.0)
    return float(np.degrees(2 * np.arcsin(min(chord, 1.0))))


def _arms(T_sensor_plate: _F64) -> _F64:
    """Return the centres and a point on each normal (2 N, 3) of poses (N, 4, 4)."""
    centres = T_sensor_plate[:, :3, 3]
    return np.concatenate([centres, centres + _NORMAL_ARM_M * T_sensor_plate[:, :3, 2]])


def _cloud_pose(board: BoardInCloud) -> CloudPose:
    T, covariance = board.T_lidar_plate, board.covariance[np.ix_(_IN_PLANE, _IN_PLANE)]
    if T[:3, 2] @ T[:3, 3] < 0:
        T, flip = T.copy(), _FLIP
        T[:3, :3] = T[:3, :3] @ flip
        covariance = flip @ covariance @ flip
    return CloudPose(T, covariance, board)


def _turn_about_z(angle_deg: float) -> _F64:
    T = np.eye(4)
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def _matrix(R: _F64, t_m: _F64) -> _F64:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t_m
    return T
