"""Scans seen from above, drawn for reports: numpy and OpenCV only."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.export.canvas import (
    BACKGROUND,
    FIXED_SHIFT,
    QUIET,
    TEXT,
    Image,
    Rgb,
    blank,
    fixed_point,
    text_width,
    write_text,
)
from percept.export.palette import class_colour, cluster_colours

__all__ = ["birds_eye", "png_data_uri"]

_RING: Rgb = (58, 66, 74)
_GROUND: Rgb = (74, 82, 90)
_EXTENTS_M = (20.0, 30.0, 40.0, 60.0, 80.0)
_AROUND_M = 5.0
_LABELS = 25
_TEXT_HEIGHT_PX = 9


def birds_eye(
    points_xyz: NDArray[np.floating],
    ground: NDArray[np.bool_],
    cluster_ids: NDArray[np.integer],
    boxes_m: NDArray[np.floating],
    labels: Sequence[str],
    *,
    extent_m: float | None = None,
    size_px: int = 900,
) -> Image:
    """Draw a scan from above, forward up and left on the left.

    Ground is dark grey, clusters have colours of their own, boxes the colours of their class
    with a tick ahead. Names stand beside the nearest boxes of a known class as far as there
    is room, and a legend counts all boxes.

    Args:
        points_xyz: (N, 3) metres, x forward, y left.
        ground: (N,) True where a point is ground.
        cluster_ids: (N,) -1 for none.
        boxes_m: (M, 7) centre x, y, z, length, width, height, yaw in rad.
        labels: M class names.
        extent_m: From the sensor in the middle to the edge; None chooses a middle and an
            extent that show the sensor and most of the points.
        size_px: Side of the picture.

    Returns:
        (size_px, size_px, 3) uint8 BGR.

    Raises:
        GeometryError: If the columns do not have one length, or the extent is not positive.
    """
    points = np.asarray(points_xyz)
    boxes = np.asarray(boxes_m, dtype=np.float64).reshape(-1, 7)
    if not len(points) == len(ground) == len(cluster_ids) or len(boxes) != len(labels):
        raise GeometryError("points or boxes and what is known of them differ in number")
    if extent_m is not None and not extent_m > 0:
        raise GeometryError(f"a picture cannot reach {extent_m:g} m")
    view = _fitting(points, size_px) if extent_m is None else _View(extent_m, size_px)
    image = blank(size_px, size_px)
    view.draw_rings(image)
    view.draw_points(image, points, np.asarray(ground), np.asarray(cluster_ids))
    view.draw_boxes(image, boxes, labels)
    view.draw_ego(image)
    taken = _draw_legend(image, labels)
    view.draw_labels(image, boxes, labels, taken)
    return image


def png_data_uri(image: Image) -> str:
    """Return a picture (H, W, 3) BGR or (H, W) uint8 as a PNG data URI for HTML.

    Raises:
        GeometryError: If it is no picture that PNG can hold.
    """
    shape = np.shape(image)
    if image.dtype != np.uint8 or 0 in shape or shape[2:] not in ((), (3,)) or len(shape) < 2:
        raise GeometryError(f"{image.dtype} {shape} is no picture")
    _, png = cv2.imencode(".png", image)
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode("ascii")


class _View:
    """Where the metres of a picture from above are."""

    def __init__(
        self, extent_m: float, size_px: int, middle_m: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.extent_m = extent_m
        self.scale = size_px / (2 * extent_m)
        self.middle_m = np.array(middle_m)
        self.middle_px = (size_px - 1) / 2

    def pixels(self, points_xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return (N, 2) column and row of points (N, 2) in metres."""
        from_middle = np.asarray(points_xy, dtype=np.float64) - self.middle_m
        pixels: NDArray[np.float64] = self.middle_px - self.scale * from_middle[:, ::-1]
        return pixels

    def draw_rings(self, image: Image) -> None:
        """Draw circles around the sensor, with their metres straight ahead of it."""
        step = 20 if self.extent_m > 45 else 10 if self.extent_m > 15 else 5
        centre = fixed_point(self.pixels(np.zeros((1, 2))))[0].tolist()
        farthest_m = float(np.hypot(*(np.abs(self.middle_m) + self.extent_m)))
        for metres in range(step, int(farthest_m) + 1, step):
            radius = int(metres * self.scale * 2**FIXED_SHIFT)
            cv2.circle(image, centre, radius, _RING[::-1], 1, cv2.LINE_AA, FIXED_SHIFT)
            column, row = self.pixels(np.array([[metres, 0.0]]))[0]
            if row > 16:
                write_text(image, f"{metres} m", (int(column) + 4, int(row) - 4), QUIET)

    def draw_points(
        self,
        image: Image,
        points: NDArray[np.floating],
        ground: NDArray[np.bool_],
        cluster_ids: NDArray[np.integer],
    ) -> None:
        columns, rows = np.rint(self.pixels(points[:, :2])).T
        inside = (np.minimum(columns, rows) >= 0) & (np.maximum(columns, rows) < len(image))
        colours = np.where(
            ground[:, None], np.array(_GROUND, np.uint8), cluster_colours(cluster_ids)
        )
        # Ground first, so that what stands on it is on top.
        for chosen in (inside & ground, inside & ~ground):
            at = rows[chosen].astype(np.intp), columns[chosen].astype(np.intp)
            image[at] = colours[chosen][:, ::-1]

    def draw_boxes(self, image: Image, boxes: NDArray[np.float64], labels: Sequence[str]) -> None:
        """Draw outlines; what is known lies over what is not, and is bolder."""
        for row in sorted(range(len(labels)), key=lambda row: labels[row] != "unknown"):
            # The tick goes out and back, since both are drawn as closed lines.
            outlines = [fixed_point(self.pixels(part)) for part in _outline(boxes[row])]
            cv2.polylines(
                image, outlines, isClosed=True, color=class_colour(labels[row])[::-1],
                thickness=1 if labels[row] == "unknown" else 2, lineType=cv2.LINE_AA,
                shift=FIXED_SHIFT,
            )  # fmt: skip

    def draw_ego(self, image: Image) -> None:
        arrow = np.array([[2.2, 0.0], [-1.4, 1.2], [-0.7, 0.0], [-1.4, -1.2]])
        size = max(1.0, self.extent_m / 45)
        cv2.fillPoly(
            image, [fixed_point(self.pixels(arrow * size))], TEXT[::-1], cv2.LINE_AA, FIXED_SHIFT
        )

    def draw_labels(
        self,
        image: Image,
        boxes: NDArray[np.float64],
        labels: Sequence[str],
        taken: list[NDArray[np.float64]],
    ) -> None:
        """Write names beside boxes, nearest first, and leave out those that have no room."""
        nearest = np.argsort(np.hypot(boxes[:, 0], boxes[:, 1]), kind="stable")
        named = [row for row in nearest if labels[row] != "unknown"][:_LABELS]
        for row in named:
            text, height = labels[row], _TEXT_HEIGHT_PX
            width = text_width(text)
            outline = self.pixels(_outline(boxes[row])[0])
            left, top = outline.min(axis=0)
            right, bottom = outline.max(axis=0)
            for x, y in (
                (right + 5, (top + bottom + height) / 2),
                (left - 5 - width, (top + bottom + height) / 2),
                ((left + right - width) / 2, top - 5),
                ((left + right - width) / 2, bottom + 5 + height),
            ):
                place = np.array([x - 2, y - height - 2, x + width + 2, y + 4])
                if _free(place, taken, len(image)):
                    taken.append(place)
                    write_text(image, text, (int(x), int(y)), class_colour(labels[row]))
                    break


def _outline(box: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a box's corners (4, 2) and its heading tick (2, 2) from above, metres."""
    x, y, _, length, width, _, yaw = box
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    signs = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) / 2
    corners = [x, y] + signs[:, :1] * length * ahead + signs[:, 1:] * width * left
    front = np.array([x, y]) + length / 2 * ahead
    return corners, np.array([front, front + max(0.6, length / 4) * ahead])


def _fitting(points: NDArray[np.floating], size_px: int) -> _View:
    """Return the closest usual view of the sensor and 95 % of the points along each axis.

    The sensor stays in the middle unless it sees much more on one side.
    """
    if not len(points):
        return _View(_EXTENTS_M[0], size_px)
    low, high = np.quantile(points[:, :2], (0.025, 0.975), axis=0)
    low, high = np.minimum(low, -_AROUND_M), np.maximum(high, _AROUND_M)
    middle = (low + high) / 2
    middle[np.abs(middle) < (high - low) / 6] = 0
    reach = float(np.maximum(high - middle, middle - low).max())
    extent = next((extent for extent in _EXTENTS_M if extent >= reach), _EXTENTS_M[-1])
    # Where even the largest view is too small, the sensor's surroundings matter most.
    middle = np.clip(middle, _AROUND_M - extent, extent - _AROUND_M)
    return _View(extent, size_px, (float(middle[0]), float(middle[1])))


def _draw_legend(image: Image, labels: Sequence[str]) -> list[NDArray[np.float64]]:
    """Write how many boxes of each class there are; return the place that it takes."""
    counts = sorted(Counter(labels).items(), key=lambda pair: (-pair[1], pair[0]))
    height = 20 + 20 * len(counts)
    if counts:
        cv2.rectangle(image, (0, 0), (150, height - 8), BACKGROUND[::-1], -1)
    for row, (label, count) in enumerate(counts):
        y = 16 + 20 * row
        cv2.rectangle(image, (12, y), (23, y + 11), class_colour(label)[::-1], -1)
        write_text(image, f"{count} {label}", (31, y + 10), TEXT)
    return [np.array([0.0, 0.0, 150.0, float(height)])]


def _free(place: NDArray[np.float64], taken: list[NDArray[np.float64]], size_px: int) -> bool:
    inside = bool((place >= 0).all() and (place < size_px).all())
    return inside and not any(
        (place[:2] < t[2:]).all() and (t[:2] < place[2:]).all() for t in taken
    )
