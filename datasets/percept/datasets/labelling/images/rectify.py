"""Images and boxes without lens distortion, for formats that know no lens model.

The rectified camera keeps the camera matrix and the image size, as `cv2.undistort` does and as
`percept calib export` assumes. Boxes count from the outer edge of the top left pixel, pixels of
cameras from its centre: half a pixel lies between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.undistort import undistort_maps
from percept.core.cameras import Camera, make_camera
from percept.core.errors import GeometryError
from percept.core.rig import CameraSensor

__all__ = [
    "LEAST_SHOWN",
    "has_distortion",
    "recorded_boxes",
    "rectified_boxes",
    "rectified_camera",
    "rectify_image",
]

_F64 = NDArray[np.float64]
_Map = Callable[[_F64], _F64]

LEAST_SHOWN = 0.25
"""The share of a box that the rectified image must still show for formats to keep the box."""

_STEPS_ACROSS = (np.arange(9) + 0.5) / 9
_GRID = np.stack(np.meshgrid(_STEPS_ACROSS, _STEPS_ACROSS), axis=-1).reshape(-1, 2)
_OUTLINE = np.array([[x, y] for x in (0, 0.5, 1) for y in (0, 0.5, 1) if (x, y) != (0.5, 0.5)])
_STEEPEST = 1e-3
_STEPS = 30
_CLOSE_PX = 1e-6
_CAMERAS_HELD = 16


def has_distortion(sensor: CameraSensor) -> bool:
    """Return whether a camera's images differ from those of a pinhole without distortion."""
    return sensor.model == "fisheye" or any(sensor.distortion)


def rectified_camera(sensor: CameraSensor) -> CameraSensor:
    """Return the pinhole without distortion that the rectified images are of."""
    return replace(sensor, model="pinhole", distortion=(0.0,) * 5)


def rectify_image(pixels: NDArray[Any], sensor: CameraSensor) -> NDArray[Any]:
    """Return the image that the rectified camera would have taken; black where nothing is known.

    Args:
        pixels: (H, W) or (H, W, 3) as recorded, uint8, uint16 or float32.
        sensor: The camera that took it.

    Raises:
        ConfigError: If the intrinsics do not fit their model.
        GeometryError: If the image has not the size that the camera was calibrated for.
    """
    width, height = sensor.image_size
    if pixels.shape[:2] != (height, width):
        raise GeometryError(
            f"an image of {pixels.shape[1]} x {pixels.shape[0]} pixels cannot be rectified with "
            f"intrinsics for {width} x {height}",
            where=sensor.name,
        )
    if not has_distortion(sensor):
        return pixels
    places, weights = _maps(sensor.model, sensor.image_size, sensor.K, sensor.distortion)
    return np.asarray(
        cv2.remap(pixels, places, weights, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    )


def rectified_boxes(boxes_px: _F64, sensor: CameraSensor) -> tuple[_F64, _F64]:
    """Return boxes of the recorded image in the rectified one, and how much of them it shows.

    Each side goes where the middle of it goes. Objects touch their box there rather than in its
    corners: a rectangle around the whole bent outline is too large, by 2 to 4 % of IoU for a lens
    of 90 degrees. `recorded_boxes` is the exact way back for boxes that are not cut.

    Args:
        boxes_px: (N, 4) x1, y1, x2, y2 in the recorded image.
        sensor: The camera that took it.

    Returns:
        (N, 4) boxes cut at the image's edges, and (N,) the share of the recorded box that is in
        the rectified image, counted on 9 x 9 places; 0 where nothing is left of the box.

    Raises:
        ConfigError: If the intrinsics do not fit their model.
    """
    boxes = np.asarray(boxes_px, dtype=np.float64).reshape(-1, 4)
    if not has_distortion(sensor) or not len(boxes):
        return boxes.copy(), np.ones(len(boxes))
    place = _to_rectified(sensor.camera())
    cut = _cut(_moved(boxes, place), sensor)
    # A box whose outline is inside is inside: most need no closer look.
    shown = _inside(boxes, _OUTLINE, place, sensor)
    partly = shown < 1
    if partly.any():
        shown[partly] = _inside(boxes[partly], _GRID, place, sensor)
    return cut, np.where((cut[:, 2:] > cut[:, :2]).all(axis=1), shown, 0.0)


def recorded_boxes(boxes_px: _F64, sensor: CameraSensor) -> _F64:
    """Return boxes of the rectified image in the recorded one: the reverse of `rectified_boxes`.

    What lies outside the rectified image cannot come back: a side at its edge becomes the
    recorded place of that edge. A side where the lens shows nothing goes to where it ends.

    Args:
        boxes_px: (N, 4) x1, y1, x2, y2 in the rectified image.
        sensor: The camera that took the recorded one.

    Returns:
        (N, 4) boxes, cut at the image's edges.

    Raises:
        ConfigError: If the intrinsics do not fit their model.
    """
    wanted = np.asarray(boxes_px, dtype=np.float64).reshape(-1, 4)
    if not has_distortion(sensor) or not len(wanted):
        return wanted.copy()
    camera = sensor.camera()
    forward, back = _to_rectified(camera), _to_recorded(camera)
    boxes = _moved(wanted, back)
    for _ in range(_STEPS):
        step = np.nan_to_num(_moved(wanted, back) - _moved(_moved(boxes, forward), back))
        boxes = boxes + step
        if np.abs(step).max() < _CLOSE_PX:
            break
    return _cut(boxes, sensor)


def _inside(boxes: _F64, places: _F64, to_rectified: _Map, sensor: CameraSensor) -> _F64:
    """Return of each box the share of places (P, 2), 0..1 across it, that the image shows."""
    points = boxes[:, None, :2] + places * (boxes[:, None, 2:] - boxes[:, None, :2])
    moved = to_rectified(points.reshape(-1, 2)).reshape(points.shape)
    shown: _F64 = ((moved >= 0) & (moved <= sensor.image_size)).all(axis=-1).mean(axis=1)
    return shown


@lru_cache(maxsize=_CAMERAS_HELD)
def _maps(
    model: str,
    image_size: tuple[int, int],
    K: tuple[float, float, float, float],
    distortion: tuple[float, ...],
) -> tuple[NDArray[Any], NDArray[Any]]:
    fx, fy, cx, cy = K
    K_matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    maps = undistort_maps(make_camera(model, image_size, K_matrix, distortion))
    places, weights = cv2.convertMaps(maps.map_x, maps.map_y, cv2.CV_16SC2)
    return np.asarray(places), np.asarray(weights)


def _moved(boxes: _F64, place: _Map) -> _F64:
    """Return boxes (N, 4) whose sides are where `place` takes the middles of the sides."""
    x1, y1, x2, y2 = boxes.T
    x, y = (x1 + x2) / 2, (y1 + y2) / 2
    sides = np.concatenate([np.column_stack(at) for at in ((x1, y), (x, y1), (x2, y), (x, y2))])
    left, top, right, bottom = place(sides).reshape(4, -1, 2)
    return np.column_stack([left[:, 0], top[:, 1], right[:, 0], bottom[:, 1]])


def _to_rectified(camera: Camera) -> _Map:
    def place(points: _F64) -> _F64:
        rays = camera.unproject(points - 0.5)
        # What is 90 degrees off the axis or more lies outside the image, on the side it is seen.
        slopes = rays[:, :2] / np.maximum(rays[:, 2:], _STEEPEST)
        moved: _F64 = slopes * np.diag(camera.K)[:2] + camera.K[:2, 2] + 0.5
        return moved

    return place


def _to_recorded(camera: Camera) -> _Map:
    widest = np.tan(camera.widest_rad)

    def place(points: _F64) -> _F64:
        normal = (points - 0.5 - camera.K[:2, 2]) / np.diag(camera.K)[:2]
        # Beyond its widest angle the lens model folds back.
        slopes = np.maximum(np.hypot(normal[:, 0], normal[:, 1]) / widest, 1.0)
        pixels, _ = camera.project(np.column_stack([normal, slopes]))
        return pixels + 0.5

    return place


def _cut(boxes: _F64, sensor: CameraSensor) -> _F64:
    """Return boxes within the image; a side that the lens model does not reach is at its edge."""
    size = np.array(sensor.image_size * 2, dtype=np.float64)
    edges = np.where([True, True, False, False], 0.0, size)
    cut: _F64 = np.clip(np.where(np.isfinite(boxes), boxes, edges), 0.0, size)
    return cut
