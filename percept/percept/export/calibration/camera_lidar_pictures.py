"""Pictures of a camera-LiDAR calibration: a board under its points, and where the boards stood."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.export.canvas import (
    FIXED_SHIFT,
    Image,
    Rgb,
    as_bgr,
    blank,
    draw_scale_bar,
    fixed_point,
    resized,
    with_header,
    write_text,
)

__all__ = ["board_close_up", "boards_in_space", "plate_outline"]

_F64 = NDArray[np.float64]

_CLOSE_UP_PX = 560
_MARGIN = 0.25
_OUTLINE_STEPS = 12
_IMAGE_RGB: Rgb = (240, 228, 66)
_LIDAR_RGB: Rgb = (86, 180, 233)
_ON_BOARD_RGB: Rgb = (0, 220, 130)
_BESIDE_RGB: Rgb = (213, 94, 0)
_NOT_USED_RGB: Rgb = (150, 150, 150)
_SPACE_PX = 520
_ARROW_M = 0.3
_RING_BGR = (58, 50, 44)
_RAY_RGB: Rgb = (90, 100, 110)
_TEXT_RGB: Rgb = (228, 232, 236)


def plate_outline(size_m: tuple[float, float]) -> _F64:
    """Return the outline (K, 3) of a plate in its own frame, closed, metres.

    The sides have points between their ends, since a lens bends them.

    Args:
        size_m: Width along x and height along y.
    """
    half = np.array(size_m) / 2
    ends = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    steps = np.linspace(0, 1, _OUTLINE_STEPS, endpoint=False)[:, None]
    sides = [a + steps * (b - a) for a, b in pairwise(ends)]
    flat = np.concatenate([*sides, ends[-1:]])
    return np.column_stack([flat, np.zeros(len(flat))])


def board_close_up(
    pixels: NDArray[np.generic],
    camera: Camera,
    outlines_cam: tuple[_F64, _F64],
    points_cam: tuple[_F64, _F64],
    *,
    title: str = "",
) -> Image:
    """Draw the part of an image around a board, with what the LiDAR says about it.

    Args:
        pixels: (H, W) or (H, W, 3) BGR.
        camera: The camera that took it.
        outlines_cam: (K, 3) outline of the plate as the image shows it, and as the LiDAR alone
            shows it, both in the camera's frame.
        points_cam: (N, 3) points on the board, and (M, 3) all others, in the camera's frame.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR. The two outlines lie on each other where the calibration is right.
    """
    image = as_bgr(pixels)
    drawn = [camera.project(outline)[0] for outline in outlines_cam]
    known = np.concatenate([d[np.isfinite(d).all(axis=1)] for d in drawn])
    low, high = known.min(axis=0), known.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    low = np.clip(np.floor(low - margin), 0, np.array(camera.image_size) - 2).astype(int)
    high = np.clip(np.ceil(high + margin), low + 2, camera.image_size).astype(int)
    scale = _CLOSE_UP_PX / float((high - low).max())
    crop = resized(np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), scale)
    canvas: Image = (crop * 0.7).astype(np.uint8)
    for points, colour in zip(points_cam[::-1], (_BESIDE_RGB, _ON_BOARD_RGB), strict=True):
        at, seen = camera.project(points)
        _dots(canvas, (at[seen] - low + 0.5) * scale - 0.5, colour)
    for outline, colour in zip(drawn, (_IMAGE_RGB, _LIDAR_RGB), strict=True):
        _polyline(canvas, (outline - low + 0.5) * scale - 0.5, colour)
    legend = [
        ("plate by the image", _IMAGE_RGB),
        ("by the LiDAR", _LIDAR_RGB),
        ("points on it", _ON_BOARD_RGB),
        ("other points", _BESIDE_RGB),
    ]
    return with_header(canvas, title, legend if title else ())


def boards_in_space(
    poses: Sequence[_F64],
    used: Sequence[bool],
    size_m: tuple[float, float],
    camera: Camera,
    seen_from: Literal["above", "side"],
    *,
    title: str = "",
) -> Image:
    """Draw where boards stood before a camera, each edge-on as a line with where it faces.

    Args:
        poses: (4, 4) T_camera_plate of each board, z away from the camera.
        used: Whether the result rests on it.
        size_m: Width and height of the plate.
        camera: Its field of view is drawn.
        seen_from: From above the camera looks up the page, from the side to the right.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    above = seen_from == "above"
    to_page = np.array([[1.0, 0, 0], [0, 0, -1]] if above else [[0.0, 0, 1], [0, 1, 0]])
    canvas = blank(_SPACE_PX, _SPACE_PX)
    foot = np.array([_SPACE_PX / 2, _SPACE_PX - 30.0] if above else [30.0, _SPACE_PX / 2])
    places = np.array([T[:3, 3] for T in poses]).reshape(-1, 3)
    ahead = float(places[:, 2].max(initial=1.0)) + max(size_m) / 2
    aside = float(np.abs(places[:, 0 if above else 1]).max(initial=0.5)) + max(size_m) / 2
    px_per_m = min((_SPACE_PX - 60) / ahead, (_SPACE_PX / 2 - 10) / aside)
    for metres in range(1, int(ahead) + 2):
        radius = round(metres * px_per_m * 2**FIXED_SHIFT)
        centre = fixed_point(foot).tolist()
        cv2.circle(canvas, centre, radius, _RING_BGR, 1, cv2.LINE_AA, FIXED_SHIFT)
    for ray in _view_edges(camera, across=above):
        _polyline(canvas, foot + np.array([np.zeros(2), to_page @ ray * px_per_m * 20]), _RAY_RGB)
    for T, is_used in zip(poses, used, strict=True):
        middle, facing = to_page @ T[:3, 3], -to_page @ T[:3, 2]
        along = np.array([-facing[1], facing[0]]) / max(float(np.linalg.norm(facing)), 1e-9)
        half = along * min(size_m) / 2
        line = np.array([middle - half, middle + half])
        colour = _ON_BOARD_RGB if is_used else _NOT_USED_RGB
        _polyline(canvas, foot + line * px_per_m, colour, thickness=2)
        stroke = np.array([middle, middle + _ARROW_M * facing])
        _polyline(canvas, foot + stroke * px_per_m, _IMAGE_RGB)
    draw_scale_bar(canvas, px_per_m)
    write_text(canvas, "camera", (round(foot[0]) - 22, round(foot[1]) + 18), _TEXT_RGB)
    legend = [("board", _ON_BOARD_RGB), ("left out", _NOT_USED_RGB), ("facing", _IMAGE_RGB)]
    return with_header(canvas, title, legend)


def _view_edges(camera: Camera, *, across: bool) -> list[_F64]:
    """Return the rays (3,) of the two edges of the field of view, across or up and down."""
    width, height = camera.image_size
    middles = [[0.0, height / 2], [width - 1.0, height / 2]]
    if not across:
        middles = [[width / 2, 0.0], [width / 2, height - 1.0]]
    return [ray for ray in camera.unproject(np.array(middles)) if np.isfinite(ray).all()]


def _dots(canvas: Image, at_px: _F64, rgb: Rgb) -> None:
    for centre in fixed_point(at_px).tolist():
        cv2.circle(canvas, centre, 2 * 2**FIXED_SHIFT, rgb[::-1], -1, cv2.LINE_AA, FIXED_SHIFT)


def _polyline(canvas: Image, at_px: _F64, rgb: Rgb, *, thickness: int = 1) -> None:
    if np.isfinite(at_px).all():
        line, bgr = [fixed_point(at_px)], rgb[::-1]
        cv2.polylines(
            canvas,
            line,
            isClosed=False,
            color=bgr,
            thickness=thickness,
            lineType=cv2.LINE_AA,
            shift=FIXED_SHIFT,
        )
