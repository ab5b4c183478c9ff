"""Pictures of a finding: the camera's image and the road from above, with map and paint drawn.

What the map says is cyan, what was seen is magenta, and the rest of the map is grey. Lines are laid
on the road as the look saw it, whatever heights the map has, and on the map as the look was
brought to it: so what agrees with the map lies on its paint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.map_findings import Discrepancy, Kind
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.export.canvas import (
    FIXED_SHIFT,
    Image,
    Rgb,
    blank,
    draw_scale_bar,
    fixed_point,
    with_header,
)
from percept.hdmap.elements import MapMarking

__all__ = [
    "EXPECTED_RGB",
    "NOTHING_SEEN",
    "OBSERVED_RGB",
    "EvidenceLook",
    "evidence_of_look",
    "write_evidence",
]

_F64 = NDArray[np.float64]

EXPECTED_RGB: Rgb = (0, 220, 255)
OBSERVED_RGB: Rgb = (255, 70, 210)
_MAP_RGB: Rgb = (150, 158, 166)

_PANEL_PX = (640, 400)
_STEP_M = 0.25
_GAP_PX = 6
_LEAST_SHARE = 0.3  # of the image's width that the crop shows, so that the place is known again
_SPAN_M = (9.0, 18.0)  # half of what the view from above shows at least and at most, along the road
_NEAREST_M = 0.5
_AROUND_M = 60.0
_SHOWN_M = 25.0  # of the map's lines ahead, where all of them are what is shown
_BESIDE_M = 0.25  # lines about paint are drawn on both sides of it, so that it can be seen
_LIGHTS = {Kind.TRAFFIC_LIGHT_MISSING, Kind.TRAFFIC_LIGHT_MISSING_IN_MAP}
NOTHING_SEEN = {
    Kind.MISSING_ON_ROAD,
    Kind.STOP_LINE_MISSING,
    Kind.TRAFFIC_LIGHT_MISSING,
    Kind.GLOBAL_OFFSET,
}
"""Kinds whose points are not of paint that was seen."""
_ITS_OWN_PAINT = {Kind.TYPE, Kind.COLOUR, Kind.MISSING_IN_MAP}


class EvidenceLook(NamedTuple):
    """One look at a finding.

    Attributes:
        camera: Lens and place of the camera.
        T_map_base: Where the vehicle was, as the log has it.
        height_m: Makes heights (N,) of the road in the vehicle's frame of points (N, 2) of it.
        lateral_m: How far paint lay left of the map at this pose, seen from the vehicle.
        heading_rad: By how much it was turned to the left.
    """

    camera: CameraSensor
    T_map_base: Transform
    height_m: Callable[[_F64], _F64]
    lateral_m: float = 0.0
    heading_rad: float = 0.0


class _Shape(NamedTuple):
    """A line (K, 3) in the vehicle's frame."""

    points: _F64
    colour: Rgb
    thickness: int


class _View(NamedTuple):
    """An image with its lens; `road` lays points (N, 2) of the vehicle's frame on the ground."""

    pixels: Image
    lens: Camera
    T_cam_base: Transform
    road: Callable[[_F64], _F64]

    def project(self, points_base: _F64) -> tuple[_F64, NDArray[np.bool_]]:
        points_cam = self.T_cam_base.apply(points_base)
        pixels, seen = self.lens.project(points_cam)
        return pixels, seen & (points_cam[:, 2] > _NEAREST_M)


def evidence_of_look(
    finding: Discrepancy, pixels: Image, look: EvidenceLook, markings: Sequence[MapMarking]
) -> Image | None:
    """Draw a finding in the image of a look and from above; None where it is not in it.

    Args:
        finding: What to show.
        pixels: (H, W, 3) uint8 BGR image.
        look: Where it was taken.
        markings: Lines of the map; those around the vehicle are drawn.

    Returns:
        (H, W, 3) uint8 BGR: the crop of the image, and the road with the vehicle's direction up.

    Raises:
        ConfigError: If the lens makes no camera.
    """
    camera = look.camera
    if camera.T_base_sensor is None:
        return None

    def road(points: _F64) -> _F64:
        return np.column_stack([points[:, :2], look.height_m(points[:, :2])])

    view = _View(pixels, camera.camera(), camera.T_base_sensor.inverse(), road)
    rest, shown = _shapes(finding, look, markings, road)
    if not shown:
        return None
    focus = np.concatenate([shape.points for shape in shown])
    at, seen = view.project(focus)
    if not seen.any():
        return None
    crop = _crop(at[seen], view.lens.image_size)
    front = _front(view, [*rest, *shown], crop)
    above = _above(view, [*rest, *shown], focus[seen])
    title = f"{finding.kind.replace('_', ' ')}: {finding.observed}"
    return with_header(
        np.hstack([front, blank(_GAP_PX, _PANEL_PX[1]), above]), title, _legend(rest, shown)
    )


def write_evidence(path: Path, picture: Image) -> None:
    """Write a picture as PNG; it gets its name when it is whole."""
    _, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 6])
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.write_bytes(data.tobytes())
    unfinished.replace(path)


def _shapes(
    finding: Discrepancy,
    look: EvidenceLook,
    markings: Sequence[MapMarking],
    road: Callable[[_F64], _F64],
) -> tuple[list[_Shape], list[_Shape]]:
    """Return what lies around a finding, and what shows it."""
    is_offset = finding.kind is Kind.GLOBAL_OFFSET
    T_map_base = look.T_map_base if is_offset else _brought_to_map(look)
    place = T_map_base.translation_m
    near = [m.points_map for m in markings if _distance_m(m.points_map, place) < _AROUND_M]
    lines = [road(_dense(_level(points, T_map_base))) for points in near]
    if is_offset:  # the map as the log has it, beside the paint
        ahead = [line[(line[:, 0] > 0) & (line[:, 0] < _SHOWN_M)] for line in lines]
        return [], [_Shape(line, EXPECTED_RGB, 2) for line in ahead if len(line) > 1]
    rest = [_Shape(line, _MAP_RGB, 1) for line in lines]

    def laid(points_map: _F64) -> _F64:
        if finding.kind in _LIGHTS:  # they hang where the map says
            return _dense(T_map_base.inverse().apply(points_map))
        return road(_dense(_level(points_map, T_map_base)))

    own = finding.kind in _ITS_OWN_PAINT
    shown = []
    if len(finding.points_expected_map) and not own:
        shown += [_Shape(laid(finding.points_expected_map), EXPECTED_RGB, 2)]
    if len(finding.points_map) and finding.kind not in NOTHING_SEEN:
        seen = laid(finding.points_map)
        sides = (_beside(seen, -_BESIDE_M), _beside(seen, _BESIDE_M)) if own else (seen,)
        shown += [_Shape(road(line) if own else line, OBSERVED_RGB, 2) for line in sides]
    return rest, shown


def _level(points_map: _F64, T_map_base: Transform) -> _F64:
    """Return points (K, 3) in the vehicle's frame as a map without heights has them."""
    ahead = T_map_base.rotation[:2, 0] / np.linalg.norm(T_map_base.rotation[:2, 0])
    apart = points_map[:, :2] - T_map_base.translation_m[:2]
    left = np.array([-ahead[1], ahead[0]])
    return np.column_stack([apart @ ahead, apart @ left, np.zeros(len(apart))])


def _brought_to_map(look: EvidenceLook) -> Transform:
    """Return the pose at which the paint that all lines share lies on the map."""
    turn = -look.heading_rad
    cos, sin = np.cos(turn), np.sin(turn)
    matrix = look.T_map_base.matrix.copy()
    matrix[:3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ matrix[:3, :3]
    ahead = matrix[:2, 0] / np.linalg.norm(matrix[:2, 0])
    matrix[:2, 3] -= look.lateral_m * np.array([-ahead[1], ahead[0]])
    return Transform(look.T_map_base.target, look.T_map_base.source, matrix)


def _distance_m(points_map: _F64, place_map: _F64) -> float:
    low, high = points_map[:, :2].min(axis=0), points_map[:, :2].max(axis=0)
    return float(np.hypot(*(np.clip(place_map[:2], low, high) - place_map[:2])))


def _legend(rest: Sequence[_Shape], shown: Sequence[_Shape]) -> list[tuple[str, Rgb]]:
    drawn = {shape.colour for shape in (*rest, *shown)}
    words = [("map", EXPECTED_RGB), ("seen", OBSERVED_RGB), ("rest of the map", _MAP_RGB)]
    return [(word, colour) for word, colour in words if colour in drawn]


def _dense(points: _F64) -> _F64:
    """Return a line (K, 3) with points every quarter of a metre."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.linspace(0.0, along[-1], max(int(along[-1] / _STEP_M), 1) + 1)
    return np.column_stack([np.interp(places, along, points[:, k]) for k in range(3)])


def _beside(points: _F64, left_m: float) -> _F64:
    """Return a line (K, 3) moved to its left."""
    ahead = np.gradient(points[:, :2], axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    return points + left_m * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(points))])


def _crop(pixels: _F64, image_size: tuple[int, int]) -> tuple[float, float, float]:
    """Return the left, the top and the width in pixels of the part of the image that is shown."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    aspect = _PANEL_PX[0] / _PANEL_PX[1]
    largest = min(image_size[0], image_size[1] * aspect)
    width = float(max((high - low).max() * 1.5 * aspect, _LEAST_SHARE * image_size[0]))
    width = min(width, largest)
    corner = (low + high) / 2 - np.array([width, width / aspect]) / 2
    limit = np.maximum(np.array(image_size) - np.array([width, width / aspect]), 0.0)
    left, top = np.clip(corner, 0.0, limit).tolist()
    return left, top, width


def _front(view: _View, shapes: Sequence[_Shape], crop: tuple[float, float, float]) -> Image:
    left, top, width = crop
    scale = _PANEL_PX[0] / width
    warp = np.array([[scale, 0.0, -left * scale], [0.0, scale, -top * scale]])
    warped = cv2.warpAffine(view.pixels, warp, _PANEL_PX, flags=cv2.INTER_LINEAR)
    panel = np.asarray(warped, np.uint8)
    for shape in shapes:
        pixels, seen = view.project(shape.points)
        _draw(panel, (pixels - [left, top]) * scale, seen, shape)
    return panel


def _above(view: _View, shapes: Sequence[_Shape], focus: _F64) -> Image:
    """Draw the road from above, the vehicle's direction upwards, about the finding."""
    low, high = focus[:, :2].min(axis=0), focus[:, :2].max(axis=0)
    middle = (low + high) / 2
    half = float(np.clip((high - low).max() * 0.7, *_SPAN_M))
    metres = 2 * half / _PANEL_PX[1]
    top_left = middle + np.array([half, _PANEL_PX[0] / 2 * metres])
    rows, columns = np.mgrid[0 : _PANEL_PX[1], 0 : _PANEL_PX[0]].astype(np.float64)
    places = top_left - np.column_stack([rows.ravel(), columns.ravel()]) * metres
    pixels, seen = view.project(view.road(places))
    pixels[~seen] = -1.0
    u, v = pixels.astype(np.float32).T.reshape(2, _PANEL_PX[1], _PANEL_PX[0])
    panel = np.asarray(cv2.remap(view.pixels, u, v, cv2.INTER_LINEAR), np.uint8)
    for shape in shapes:
        drawn = ((top_left - shape.points[:, :2]) / metres)[:, ::-1]
        _draw(panel, drawn, np.ones(len(drawn), bool), shape)
    draw_scale_bar(panel, 1 / metres)
    return panel


def _draw(panel: Image, pixels: _F64, seen: NDArray[np.bool_], shape: _Shape) -> None:
    """Draw the parts of a line whose both ends are seen."""
    for start in np.flatnonzero(seen[:-1] & seen[1:]):
        first, last = fixed_point(pixels[start : start + 2]).tolist()
        colour = shape.colour[::-1]
        cv2.line(panel, first, last, colour, shape.thickness, cv2.LINE_AA, FIXED_SHIFT)
