"""Exact 2D truth: which objects a camera sees of the synthetic street, and where.

An object's box holds its visible part only, in pixels of the recorded (distorted) image, with
edges as boxes have them in data sets: the box of the whole image is 0, 0, width, height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import PinholeCamera
from percept.core.transform import Transform
from percept.datasets.synthetic.camera import UndistortedView
from percept.datasets.synthetic.mesh import joined
from percept.datasets.synthetic.render import Rasterised, RenderConfig, rasterised, shaded
from percept.datasets.synthetic.render_kernels import rasterise
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.street_mesh import StreetPart, street_parts
from percept.datasets.synthetic.world import World

__all__ = ["VisibleBoxes", "picture_with_boxes"]

_F64 = NDArray[np.float64]
_SIGNAL = "traffic_light"
# How far beyond the view an object's whole silhouette is followed, in widths of the view.
_BEYOND = 1


@dataclass(frozen=True, slots=True, eq=False)
class VisibleBoxes:
    """What a camera sees at a moment: N objects.

    Attributes:
        boxes_px: (N, 4) float64 x1, y1, x2, y2 of the visible part in the recorded image.
        labels: N classes; signal heads are `light_red`, `light_yellow`, `light_green` or
            `light_off` by the lamp that shines.
        ids: (N,) int64 of the objects and lights.
        visible: (N,) float64 share of the object's silhouette that is seen, the part beyond the
            image counted as not seen.
        range_m: (N,) float64 distance of the object's middle from the camera.
    """

    boxes_px: _F64
    labels: tuple[str, ...]
    ids: NDArray[np.int64]
    visible: _F64
    range_m: _F64

    def __len__(self) -> int:
        return len(self.labels)


def picture_with_boxes(
    world: World,
    camera: PinholeCamera,
    T_cam_map: Transform,
    time_s: float,
    x_m: float,
    config: RenderConfig,
) -> tuple[NDArray[np.uint8], VisibleBoxes]:
    """Draw the street as a camera sees it, and say where its objects are in the picture.

    Signal heads count from their front only: from behind no lamp is seen.

    Args:
        world: The street.
        camera: The lens.
        T_cam_map: From the map into the optical frame.
        time_s: Time since the start of the drive.
        x_m: Place along the street whose surroundings are drawn.
        config: Light and sensor.

    Returns:
        The picture (height, width, 3) uint8 BGR, the same as `render_image` makes, and the boxes.
    """
    parts = list(street_parts(world, time_s, x_m))
    mesh = joined([part.mesh_map for part in parts])
    seen = rasterised(mesh, camera, T_cam_map, config.supersampling)
    picture = shaded(mesh, seen, T_cam_map, config)
    return picture, _visible_boxes(parts, seen, camera, T_cam_map)


def _visible_boxes(
    parts: Sequence[StreetPart], seen: Rasterised, camera: PinholeCamera, T_cam_map: Transform
) -> VisibleBoxes:
    owners = np.repeat(np.arange(len(parts)), [len(part.mesh_map.faces) for part in parts])
    labels = [_label(part, T_cam_map) for part in parts]
    counted = np.array([label != "" for label in labels])
    # The last place stands for the sky, which face -1 is.
    shown = np.flatnonzero(np.append(counted[owners], False)[seen.face_at.ravel()])
    owner = owners[seen.face_at.ravel()[shown]]
    corners = _sample_corners(seen.view, camera)
    low, high = corners[0][shown], corners[1][shown]
    inside = (high > 0).all(axis=1) & (low < camera.image_size).all(axis=1)
    owner, low, high = owner[inside], low[inside], high[inside]
    order = np.argsort(owner, kind="stable")
    found, first = np.unique(owner[order], return_index=True)
    if not len(found):
        empty = np.zeros(0)
        return VisibleBoxes(np.zeros((0, 4)), (), np.zeros(0, np.int64), empty, empty)
    boxes = np.column_stack(
        [np.minimum.reduceat(low[order], first), np.maximum.reduceat(high[order], first)]
    ).astype(np.float64)
    samples = np.diff([*first, len(order)])
    objects = [parts[part] for part in found]
    silhouettes = np.array([_silhouette(part, seen.view, T_cam_map) for part in objects])
    return VisibleBoxes(
        np.clip(boxes, 0.0, np.tile(camera.image_size, 2)),
        tuple(labels[part] for part in found),
        np.array([p.placed.object_id for p in objects if p.placed is not None], dtype=np.int64),
        np.minimum(samples / np.maximum(silhouettes, 1), 1.0),
        np.array([_range_m(part, T_cam_map) for part in objects]),
    )


def _label(part: StreetPart, T_cam_map: Transform) -> str:
    """Return the class of a part, or nothing for one that does not count."""
    if part.placed is None:
        return ""
    label = part.placed.shape.label
    if label in DETECTABLE:
        return label
    if label != _SIGNAL:
        return ""
    # A head faces along +y of its frame.
    yaw = part.placed.yaw_rad
    facing = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    to_camera = T_cam_map.inverse().translation_m - part.mesh_map.vertices.mean(axis=0)
    return f"light_{part.lamp}" if facing @ to_camera > 0 else ""


def _range_m(part: StreetPart, T_cam_map: Transform) -> float:
    vertices = part.mesh_map.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return float(np.linalg.norm(T_cam_map.apply(middle[None])[0]))


def _silhouette(part: StreetPart, view: UndistortedView, T_cam_map: Transform) -> int:
    """Return how many samples the object would cover with nothing before it."""
    vertices_cam = T_cam_map.apply(part.mesh_map.vertices)
    fx, fy, cx, cy = view.grid
    depth = np.maximum(vertices_cam[:, 2], 0.3)
    corners = vertices_cam[:, :2] / depth[:, None] * (fx, fy) + (cx, cy)
    size = np.array([view.width, view.height])
    low = np.floor(np.maximum(corners.min(axis=0) - 1, -_BEYOND * size)).astype(int)
    high = np.ceil(np.minimum(corners.max(axis=0) + 2, (1 + _BEYOND) * size)).astype(int)
    width, height = np.maximum(high - low, 1).tolist()
    inverse_depth = np.zeros((height, width), np.float32)
    face_at = np.full((height, width), -1, np.int32)
    grid = (fx, fy, cx - float(low[0]), cy - float(low[1]))
    faces = part.mesh_map.faces
    rasterise(vertices_cam, faces, np.ones(len(faces)), grid, inverse_depth, face_at)
    return int(np.count_nonzero(face_at >= 0))


def _sample_corners(
    view: UndistortedView, camera: PinholeCamera
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where the two opposite corners of each sample lie in the image, (H * W, 2) each."""
    lens = (camera.K.tobytes(), camera.distortion.tobytes(), camera.image_size)
    return _sample_corners_of(view.width, view.height, view.grid, *lens)


@lru_cache(maxsize=4)
def _sample_corners_of(
    width: int,
    height: int,
    grid: tuple[float, float, float, float],
    K_bytes: bytes,
    distortion_bytes: bytes,
    image_size: tuple[int, int],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    K = np.frombuffer(K_bytes).reshape(3, 3)
    camera = PinholeCamera(image_size, K, np.frombuffer(distortion_bytes))
    fx, fy, cx, cy = grid
    columns, rows = np.meshgrid(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
    rays = np.column_stack([(columns.ravel() - cx) / fx, (rows.ravel() - cy) / fy])
    pixels, _ = camera.project(np.column_stack([rays, np.ones(len(rays))]))
    # Pixel 0 covers 0 to 1 in a box's coordinates.
    edges = (pixels + 0.5).astype(np.float32).reshape(height + 1, width + 1, 2)
    low = np.ascontiguousarray(edges[:-1, :-1].reshape(-1, 2))
    high = np.ascontiguousarray(edges[1:, 1:].reshape(-1, 2))
    return low, high
