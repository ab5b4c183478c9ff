"""Clouds of several LiDARs drawn over each other, and a cloud drawn into an image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.export.canvas import (
    BACKGROUND,
    FIXED_SHIFT,
    QUIET,
    Image,
    Rgb,
    as_bgr,
    blank,
    draw_scale_bar,
    fitting_scale,
    fixed_point,
    resized,
    round_limit,
    with_colour_bar,
    with_header,
    write_text,
)
from percept.export.palette import sensor_colour, sequential_colours

__all__ = ["cloud_in_image", "clouds_from_above", "clouds_zoom"]

_F64 = NDArray[np.float64]
_AXES = ("x", "y", "z")
_SIZE_PX = 860
_LEAST_REACH_M = 2.0
_CROSS: Rgb = (228, 232, 236)
_EMPTY = "no points here"
_DOT_SIZES = ((1_500, 3), (6_000, 2), (60_000, 1), (float("inf"), 0))  # fewer than: radius in px
_SPARSE = 3_000


def clouds_from_above(clouds: Mapping[str, NDArray[np.floating]], title: str = "") -> Image:
    """Draw the clouds of several sensors in one frame, each in its colour, seen from above.

    Forward (x) is up and left (y) is left. The denser a place, the brighter it is, so that walls
    and poles stand out from the ground; where clouds lie over each other, their colours add up.
    A cross marks the frame's origin. The view holds the middle half of every cloud and what at
    least two of them reach.

    Args:
        clouds: By sensor, (N, 3) metres, all in one frame. Points that are not finite are left
            out.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If a cloud is not (N, 3).
    """
    finite = {name: _finite(points) for name, points in clouds.items()}
    middle, reach = _surroundings([points[:, :2] for points in finite.values()])
    view = _View(("y", "x"), middle, _SIZE_PX / (2 * reach), _SIZE_PX)
    return view.picture(finite, title)


def clouds_zoom(
    clouds: Mapping[str, NDArray[np.floating]],
    centre_m: NDArray[np.floating],
    size_m: float,
    axes: tuple[str, str] = ("x", "y"),
    *,
    title: str = "",
) -> Image:
    """Draw what several clouds have in a cube, so that a small misfit is seen.

    In a view with z, up is up; in one of x and y, forward (x) is up. The other axis grows to the
    right, except for y, which grows to the left.

    Args:
        clouds: By sensor, (N, 3) metres, all in one frame.
        centre_m: (3,) middle of the cube in that frame.
        size_m: Side of the cube.
        axes: The two axes that the picture shows, in any order.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If a cloud is not (N, 3), the middle not (3,), the size not positive, or
            the axes are not two of x, y and z.
    """
    middle = np.asarray(centre_m, dtype=np.float64)
    if middle.shape != (3,) or not np.isfinite(middle).all() or not 0 < size_m < np.inf:
        raise GeometryError(f"a zoom needs a middle (3,) and a size, not {middle} and {size_m}")
    if len(set(axes)) != 2 or not set(axes) <= set(_AXES):
        raise GeometryError(f"a picture has two of the axes x, y and z, not {axes}")
    near = {}
    for name, points in clouds.items():
        finite = _finite(points)
        near[name] = finite[(np.abs(finite - middle) <= size_m / 2).all(axis=1)]
    across, up = _across_and_up(axes)
    view = _View(
        (across, up), middle[[_AXES.index(up), _AXES.index(across)]], _SIZE_PX / size_m, _SIZE_PX
    )
    return view.picture(near, title)


def cloud_in_image(
    pixels: NDArray[np.generic],
    points_cam: NDArray[np.floating],
    camera: Camera,
    *,
    title: str = "",
) -> Image:
    """Draw a cloud into a camera's image, near points yellow and far ones violet.

    The image is drawn grey and dim, so that the points stand out; nearer points lie over
    farther ones.

    Args:
        pixels: (H, W) or (H, W, 3) BGR.
        points_cam: (N, 3) metres in the camera's optical frame.
        camera: The camera that took the image.
        title: What is shown.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If the image is no image, has another size than the camera's, or the cloud
            is not (N, 3).
    """
    image = as_bgr(pixels)
    if image.shape[1::-1] != camera.image_size:
        raise GeometryError(
            f"the image is {image.shape[1]}x{image.shape[0]} and the camera "
            f"{camera.image_size[0]}x{camera.image_size[1]}"
        )
    points = _finite(points_cam)
    at_px, seen = camera.project(points)
    distances = np.linalg.norm(points[seen], axis=1)
    farthest_m = round_limit(float(np.quantile(distances, 0.9))) if len(distances) else 1.0
    scale = fitting_scale(*camera.image_size)
    grey = cv2.cvtColor(resized(image, scale), cv2.COLOR_BGR2GRAY)
    drawn = as_bgr((grey * 0.6).astype(np.uint8))
    _draw_dots(drawn, (at_px[seen] + 0.5) * scale - 0.5, distances, farthest_m)
    drawn = with_colour_bar(drawn, farthest_m, 0.0, "m away")
    return with_header(drawn, f"{title}   {len(distances)} points in view".strip())


def _draw_dots(image: Image, at_px: _F64, distances: _F64, farthest_m: float) -> None:
    colours = sequential_colours(1 - distances / farthest_m)[:, ::-1].tolist()
    radius = 1.0 if len(at_px) > 5_000 else 2.0
    fixed = fixed_point(at_px).tolist()
    for row in np.argsort(-distances, kind="stable").tolist():
        cv2.circle(
            image, fixed[row], int(radius * 2**FIXED_SHIFT), colours[row], -1, cv2.LINE_AA,
            FIXED_SHIFT,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _View:
    """Where the metres of a picture are: two axes, and what lies in its middle.

    Attributes:
        axes: Names of the axes that go across and up.
        middle_m: (2,) what lies in the middle: up, across.
        px_per_m: Scale.
        size_px: Side of the picture.
    """

    axes: tuple[str, str]
    middle_m: _F64
    px_per_m: float
    size_px: int

    def pixels(self, points: NDArray[np.floating]) -> _F64:
        """Return column and row (N, 2) of points (N, 3)."""
        across, up = (points[:, _AXES.index(axis)] for axis in self.axes)
        sign = -1.0 if self.axes[0] == "y" else 1.0
        half = (self.size_px - 1) / 2
        columns = half + sign * (across - self.middle_m[1]) * self.px_per_m
        rows = half - (up - self.middle_m[0]) * self.px_per_m
        return np.column_stack([columns, rows])

    def picture(self, clouds: Mapping[str, NDArray[np.floating]], title: str) -> Image:
        """Draw clouds with a legend, a scale bar and the axes."""
        light = np.zeros((self.size_px, self.size_px, 3), dtype=np.float64)
        legend = []
        for index, (name, points) in enumerate(clouds.items()):
            colour = sensor_colour(index)
            legend.append((f"{name}: {len(points)}", colour))
            np.maximum(light, self._light(points, colour), out=light)
        ground = blank(self.size_px, self.size_px)
        image: Image = np.maximum(ground, light.astype(np.uint8))
        if not any(len(points) for points in clouds.values()):
            write_text(image, _EMPTY, (self.size_px // 2 - 50, self.size_px // 2), QUIET)
        self._draw_origin(image)
        draw_scale_bar(image, self.px_per_m)
        self._draw_axes(image)
        return with_header(image, title, legend)

    def _light(self, points: NDArray[np.floating], colour: Rgb) -> _F64:
        """Return the light (H, W, 3) of one cloud as BGR: dense places are brighter."""
        columns, rows = np.rint(self.pixels(points)).T
        inside = (np.minimum(columns, rows) >= 0) & (np.maximum(columns, rows) < self.size_px)
        index = rows[inside].astype(np.intp) * self.size_px + columns[inside].astype(np.intp)
        counts = np.bincount(index, minlength=self.size_px**2).reshape(self.size_px, -1)
        # Few points are drawn large and bright, or they would not be seen.
        radius = next(size for most, size in _DOT_SIZES if len(index) < most)
        faintest = 0.35 if len(index) > _SPARSE else 0.7
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        spread = cv2.dilate(counts.astype(np.float32), kernel)
        dense = max(float(np.quantile(spread[spread > 0], 0.97)), 2.0) if len(index) else 2.0
        strength = np.minimum(np.log1p(spread) / np.log1p(dense), 1)
        strength = np.where(spread > 0, faintest + (1 - faintest) * strength, 0)
        return strength[:, :, None] * np.array(colour[::-1], dtype=np.float64)

    def _draw_origin(self, image: Image) -> None:
        at = fixed_point(self.pixels(np.zeros((1, 3)))[0]).tolist()
        arm = 9 * 2**FIXED_SHIFT
        for dx, dy in ((arm, 0), (0, arm)):
            ends = (at[0] - dx, at[1] - dy), (at[0] + dx, at[1] + dy)
            cv2.line(image, *ends, BACKGROUND[::-1], 4, cv2.LINE_AA, FIXED_SHIFT)
            cv2.line(image, *ends, _CROSS[::-1], 1, cv2.LINE_AA, FIXED_SHIFT)

    def _draw_axes(self, image: Image) -> None:
        """Draw two arrows in the lower right corner: which way the axes grow."""
        corner = self.size_px - 22 if self.axes[0] == "y" else self.size_px - 66
        foot = (corner, self.size_px - 20)
        tip = (corner + (-40 if self.axes[0] == "y" else 40), foot[1])
        for end, name in ((tip, self.axes[0]), ((corner, foot[1] - 40), self.axes[1])):
            cv2.arrowedLine(image, foot, end, QUIET[::-1], 1, cv2.LINE_AA, 0, 0.2)
            write_text(image, name, (end[0] - 4, end[1] - 6), QUIET)


def _finite(points: NDArray[np.floating]) -> _F64:
    values = np.asarray(points, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 3:
        raise GeometryError(f"a cloud is (N, 3), not {values.shape}")
    return values[np.isfinite(values).all(axis=1)]


def _across_and_up(axes: tuple[str, str]) -> tuple[str, str]:
    up = "z" if "z" in axes else "x"
    across = axes[0] if axes[1] == up else axes[1]
    return across, up


def _surroundings(clouds: list[_F64]) -> tuple[_F64, float]:
    """Return the middle (2,) and the reach of a square to draw.

    It holds the origin, the middle half of every cloud, and what at least two clouds reach with
    95 % of their points: what one cloud alone reaches cannot show how well the clouds fit, and
    would make the rest small.
    """
    filled = [points for points in clouds if len(points)]
    if not filled:
        return np.zeros(2), 10.0
    low, near_low, near_high, high = np.stack(
        [np.quantile(points, (0.025, 0.25, 0.75, 0.975), axis=0) for points in filled], axis=1
    )
    second = min(1, len(filled) - 1)
    lowest = np.minimum(np.minimum(np.sort(low, axis=0)[second], near_low.min(axis=0)), 0)
    highest = np.maximum(np.maximum(np.sort(high, axis=0)[-1 - second], near_high.max(axis=0)), 0)
    middle: _F64 = (lowest + highest) / 2
    return middle, max(float((highest - lowest).max()) / 2 * 1.05, _LEAST_REACH_M)
