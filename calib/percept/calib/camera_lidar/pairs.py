"""Pairs of an image and a cloud: what each says about the plate, before any transform is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.problem import Common, PairData, linearised_view
from percept.calib.camera_lidar.result import PairResult
from percept.calib.camera_lidar.seed import (
    CloudPose,
    ViewPose,
    poses_of_cloud,
    poses_of_view,
)
from percept.core.cameras import Camera
from percept.core.errors import UsageError

if TYPE_CHECKING:
    from percept.calib.board_in_cloud.find import BoardInCloud
    from percept.calib.boards.views import BoardView

__all__ = ["BoardPair", "Sighting", "check_plate", "pair_data", "pair_result", "sightings_of"]

_F64 = NDArray[np.float64]

_CELLS_PER_SIDE = 6


@dataclass(frozen=True, slots=True, eq=False)
class BoardPair:
    """An image and a cloud of one moment.

    Attributes:
        name: Name of the pair.
        view: The board in the image, or None.
        board: The board in the cloud, or None.
        reasons: Why one of them is missing.
    """

    name: str
    view: BoardView | None
    board: BoardInCloud | None
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A pair in which both sensors found the board.

    Attributes:
        row: Its row among all pairs.
        pair: The pair.
        views: Poses of the plate that explain the image.
        clouds: Poses of the plate that explain the cloud.
    """

    row: int
    pair: BoardPair
    views: tuple[ViewPose, ...]
    clouds: tuple[CloudPose, ...]


def check_plate(corners_board: _F64, plate_size_m: tuple[float, float]) -> None:
    """Refuse a plate that the pattern does not fit on.

    Raises:
        UsageError: If it does not, with the way out where width and height are swapped.
    """
    width, height = plate_size_m
    if not (0.05 < width < 10 and 0.05 < height < 10):
        raise UsageError(
            f"a board of {width:g} x {height:g} m is no board", remedy="Give its size in metres"
        )
    extent = np.ptp(corners_board[:, :2], axis=0)
    # Half a square at least lies around the outermost corners, or they would not be there.
    needed = extent + np.linalg.norm(corners_board[1] - corners_board[0])
    if needed[0] <= width and needed[1] <= height:
        return
    what = (
        f"a pattern of {needed[0]:.3f} x {needed[1]:.3f} m (columns x rows) does not fit on a "
        f"plate of {width:g} x {height:g} m"
    )
    if needed[0] <= height and needed[1] <= width:
        raise UsageError(
            what,
            remedy=f"Write --board-size {height:g}x{width:g} (along the columns x along the rows),"
            " or swap columns and rows of the board",
        )
    raise UsageError(what, remedy="Check the square's size and the plate's, both in metres")


def sightings_of(
    pairs: Sequence[BoardPair], camera: Camera, corners_board: _F64
) -> tuple[list[Sighting], dict[int, str]]:
    """Return the pairs that both sensors can be asked about, and by row why not the others."""
    sightings: list[Sighting] = []
    reasons: dict[int, str] = {}
    for row, pair in enumerate(pairs):
        if pair.view is None or pair.board is None:
            missing = "image" if pair.view is None else "cloud"
            reasons[row] = "; ".join(pair.reasons) or f"no board in the {missing}"
            continue
        views = poses_of_view(pair.view, camera, corners_board)
        if views:
            sightings.append(Sighting(row, pair, views, poses_of_cloud(pair.board)))
        else:
            reasons[row] = "the corners lie outside of what the lens model covers"
    return sightings, reasons


def pair_data(sighting: Sighting, view: ViewPose, cloud: CloudPose, camera: Camera) -> PairData:
    """Return what a pair measured, for the poses that the vote chose."""
    points = np.asarray(cloud.board.points, dtype=np.float64)
    cells, counts = _cells(points, cloud.T_lidar_plate)
    return PairData(
        name=sighting.pair.name,
        corners_plate=view.corners_plate,
        seen_xy=view.seen_xy,
        pixels_per_xy=linearised_view(camera, view.seen_xy),
        points_lidar=points,
        cells_lidar=cells,
        cell_counts=counts,
        outline=cloud.T_lidar_plate,
        outline_covariance=cloud.in_plane_covariance,
    )


def _cells(points: _F64, T_lidar_plate: _F64) -> tuple[_F64, _F64]:
    """Return the means (C, 3) of the points in a grid on the plate, and how many (C,) each has."""
    xy = (points - T_lidar_plate[:3, 3]) @ T_lidar_plate[:3, :2]
    low, size = xy.min(axis=0), np.maximum(np.ptp(xy, axis=0), 1e-9)
    column, row = np.minimum((xy - low) / size * _CELLS_PER_SIDE, _CELLS_PER_SIDE - 1).astype(int).T
    cell = row * _CELLS_PER_SIDE + column
    counts = np.bincount(cell, minlength=_CELLS_PER_SIDE**2)
    sums = np.stack([np.bincount(cell, p, _CELLS_PER_SIDE**2) for p in points.T], axis=1)
    filled = counts > 0
    return sums[filled] / counts[filled, None], counts[filled].astype(np.float64)


def pair_result(
    sighting: Sighting,
    view: ViewPose,
    cloud: CloudPose,
    camera: Camera,
    common: Common,
    joint: Mapping[str, float | _F64] | None,
    reason: str | None,
) -> PairResult:
    """Compare the plate of the LiDAR alone with the image, through a transform.

    Args:
        sighting: The pair.
        view: Chosen pose in the image.
        cloud: Chosen pose in the cloud.
        camera: Intrinsics.
        common: The transform and the range offset.
        joint: `corner_rms_px`, `point_rms_m` and `T_camera_plate` where the pair is used.
        reason: Why it is not used.
    """
    T_lidar_plate = cloud.T_lidar_plate.copy()
    range_m = float(np.linalg.norm(T_lidar_plate[:3, 3]))
    T_lidar_plate[:3, 3] *= 1 + common.range_offset_m / range_m
    T_expected = common.T_camera_lidar @ T_lidar_plate
    seen = _pixels(camera, view.corners_plate, view.T_camera_plate)
    carried = _pixels(camera, view.corners_plate, T_expected)
    off_px = np.linalg.norm(carried - seen, axis=1)
    shift_m = view.T_camera_plate[:3, :3].T @ (T_expected[:3, 3] - view.T_camera_plate[:3, 3])
    cosine = float(np.clip(T_expected[:3, 2] @ view.T_camera_plate[:3, 2], -1, 1))
    error_px = float(np.sqrt(np.mean(off_px**2))) if np.isfinite(off_px).all() else None
    joint = joint or {}
    corner, point = joint.get("corner_rms_px"), joint.get("point_rms_m")
    pose = joint.get("T_camera_plate", view.T_camera_plate)
    return PairResult(
        name=sighting.pair.name,
        used=reason is None,
        reason=reason,
        board_points=len(cloud.board.points),
        reprojection_px=error_px,
        corner_rms_px=None if corner is None else float(corner),
        point_rms_m=None if point is None else float(point),
        shift_m=shift_m,
        tilt_deg=float(np.degrees(np.arccos(cosine))),
        T_camera_plate=np.asarray(pose),
        T_lidar_plate=cloud.T_lidar_plate,
    )


def _pixels(camera: Camera, corners_plate: _F64, T_camera_plate: _F64) -> _F64:
    pixels, _ = camera.project(corners_plate @ T_camera_plate[:3, :3].T + T_camera_plate[:3, 3])
    return pixels
