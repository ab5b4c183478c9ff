"""The photographs of a camera-LiDAR report: clouds in images, boards under their points."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.core.rig import CameraSensor
from percept.export.calibration.camera_lidar_pictures import board_close_up, plate_outline
from percept.export.calibration.pictures import board_overlay, cloud_in_image, contact_sheet
from percept.export.report import Block, Paragraph, Picture

if TYPE_CHECKING:
    from percept.calib.board_in_cloud.find import BoardInCloud
    from percept.calib.boards.views import BoardView

__all__ = ["CameraLidarAlbum", "ShownPair", "moved"]

_F64 = NDArray[np.float64]

_WHOLE_IMAGES = 3
_CLOSE_UPS = 12
_DETECTIONS = 30
_JPEG_QUALITY = 85


@dataclass(frozen=True, slots=True, eq=False)
class ShownPair:
    """What is needed to draw a pair.

    Attributes:
        read_image: Returns the image, (H, W) or (H, W, 3) BGR.
        points: (N, 3) the whole cloud in the LiDAR's frame.
        view: The board in the image, or None.
        board: The board in the cloud, or None.
    """

    read_image: Callable[[], NDArray[Any]]
    points: NDArray[np.floating]
    view: BoardView | None
    board: BoardInCloud | None


class CameraLidarAlbum:
    """Draws pairs; images are read when they are drawn, and not kept.

    Args:
        result: What was found.
        shown: Its pairs.
        camera: The camera, with its intrinsics.
        plate_size_m: Width and height of the plate.
    """

    def __init__(
        self,
        result: CameraLidarCalibration,
        shown: Sequence[ShownPair],
        camera: CameraSensor,
        plate_size_m: tuple[float, float],
    ) -> None:
        self._result = result
        self._shown = shown
        self._camera = camera.camera()
        self._outline = plate_outline(plate_size_m)

    def whole_images(self) -> Iterator[Block]:
        """Yield some images with their whole clouds."""
        rows = self._rows(_WHOLE_IMAGES)
        if rows:
            yield Paragraph(
                "Points by distance. Where the distance jumps the colour must jump too: at the "
                "rims of boards, poles and people, not beside them."
            )
        for row in rows:
            name = self._result.pairs[row].name
            picture = cloud_in_image(
                self._shown[row].read_image(),
                self._in_camera(self._shown[row].points),
                self._camera,
                title=name,
            )
            yield _photo(picture, f"The cloud of {name} in its image", name)

    def close_ups(self) -> Iterator[Block]:
        """Yield the boards of some pairs, the worst ones always among them."""
        rows = self._rows(_CLOSE_UPS)
        if not rows:
            return
        yield Paragraph(
            "Yellow is the plate's rim as the image shows it, blue as the LiDAR alone shows it, "
            "brought into the image by the result. The two must lie on each other, the green "
            "points inside and the orange ones outside."
        )
        for row in rows:
            pair = self._result.pairs[row]
            caption = f"{pair.name}: {pair.reprojection_px or 0:.1f} px apart"
            caption += "" if pair.used else f"; left out: {pair.reason}"
            yield _photo(self._close_up(row), f"The board of {pair.name}", caption)

    def detections(self) -> Iterator[Block]:
        """Yield the corners that were found, one small picture a view."""
        rows = [k for k, s in enumerate(self._shown) if s.view is not None]
        kept = rows[:: max(1, -(-len(rows) // _DETECTIONS))]
        pictures = []
        for row in kept:
            view = self._shown[row].view
            if view is not None:
                pictures.append(board_overlay(self._shown[row].read_image(), view.corners_px))
        if pictures:
            sheet = contact_sheet(pictures, [self._result.pairs[row].name for row in kept])
            yield _photo(
                sheet,
                "The corners that were found in the images",
                f"{len(kept)} of {len(rows)} images in which the board was found",
            )

    def _rows(self, most: int) -> list[int]:
        """Return pairs to show: those left out and the worst first, then an even choice."""
        drawable = [k for k, p in enumerate(self._result.pairs) if p.T_lidar_plate is not None]
        if self._result.T_camera_lidar is None or not drawable:
            return []
        pairs = self._result.pairs
        worst = sorted(drawable, key=lambda k: (pairs[k].used, -(pairs[k].reprojection_px or 1e9)))
        chosen = worst[: most // 3]
        rest = [k for k in drawable if k not in chosen]
        step = max(1, -(-len(rest) // max(most - len(chosen), 1)))
        return sorted([*chosen, *rest[::step]])[:most]

    def _close_up(self, row: int) -> NDArray[np.uint8]:
        pair, shown = self._result.pairs[row], self._shown[row]
        if pair.T_camera_plate is None or pair.T_lidar_plate is None or shown.board is None:
            raise ValueError("only pairs with both boards can be drawn")
        by_image = moved(self._outline, pair.T_camera_plate)
        by_lidar = self._in_camera(moved(self._outline, pair.T_lidar_plate))
        on_board = shown.board.points
        others = _without(shown.points, on_board)
        return board_close_up(
            shown.read_image(),
            self._camera,
            (by_image, by_lidar),
            (self._in_camera(on_board), self._in_camera(others)),
            title=pair.name,
        )

    def _in_camera(self, points: NDArray[np.floating]) -> _F64:
        """Return points of the LiDAR, ranges corrected, in the camera's frame."""
        finite = np.asarray(points, dtype=np.float64)
        finite = finite[np.isfinite(finite).all(axis=1)]
        range_m = np.maximum(np.linalg.norm(finite, axis=1, keepdims=True), 1e-6)
        offset = self._result.range_offset_m
        corrected = finite * (1 + (0.0 if offset is None else offset.value) / range_m)
        return moved(corrected, self._result.T_camera_lidar)


def _without(points: NDArray[np.floating], some: _F64) -> _F64:
    """Return the points (N, 3) that are none of some others, by their coordinates."""
    taken = {row.tobytes() for row in np.ascontiguousarray(some, dtype=np.float32)}
    values = np.ascontiguousarray(points[:, :3], dtype=np.float32)
    keep = np.array([row.tobytes() not in taken for row in values], dtype=bool)
    return np.asarray(values[keep], dtype=np.float64)


def moved(points: _F64, T: _F64 | None) -> _F64:
    """Return points (N, 3) through a transform (4, 4); unchanged where there is none."""
    return points if T is None else points @ T[:3, :3].T + T[:3, 3]


def _photo(image: NDArray[np.uint8], alt: str, caption: str) -> Picture:
    """Return a photograph as a picture: as JPEG, since PNG would be ten times as large."""
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    data = base64.b64encode(content.tobytes()).decode("ascii")
    return Picture(f"data:image/jpeg;base64,{data}", alt, caption)
