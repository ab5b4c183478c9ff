"""Lights of the map in a camera's image: which can be seen, where, and how surely there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.cameras import Camera
from percept.core.errors import ConfigError
from percept.core.rig import CameraSensor
from percept.core.settings import Settings
from percept.core.transform import Transform
from percept.hdmap.light import MapLight

__all__ = ["ProjectedLights", "ProjectionConfig", "project_lights"]

_F64 = NDArray[np.float64]
_STEPS = np.linspace(0.0, 1.0, 5)
_HALF_PIXEL = 0.5  # from the centres of pixels, as lenses count, to their edges, as boxes do


class ProjectionConfig(Settings):
    """Which lights of the map are looked for, and how well their place in the image is known.

    Attributes:
        range_m: Lights further from the camera are not looked for.
        facing_deg: Nor those whose face is turned away from the camera by more than this.
        min_height_px: Nor those that would be lower than this in the image.
        position_sd_m: Standard deviation of the vehicle's place, and of the light's in the map.
        rotation_sd_deg: Standard deviation of the camera's direction: pose and calibration.
    """

    range_m: float = Field(default=150.0, gt=0)
    facing_deg: float = Field(default=75.0, gt=0, le=90)
    min_height_px: float = Field(default=4.0, ge=0)
    position_sd_m: float = Field(default=0.3, gt=0)
    rotation_sd_deg: float = Field(default=0.7, gt=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ProjectedLights:
    """The lights that a camera should see in one image.

    Attributes:
        ids: (N,) int64 ids in the map.
        boxes_px: (N, 4) float64 x1, y1, x2, y2 around the face, with edges as boxes have them
            (the image is 0, 0, width, height); may reach over the image.
        inside: (N,) float64 share of the box that lies in the image, over 0 up to 1.
        range_m: (N,) float64 distance from the camera.
        angle_rad: (N,) float64 between the direction that the light faces and the camera.
        bulbs: For each light the colours of its lamps; empty where the map does not say.
        shared_sd_px: Standard deviation of a shift that all lights of the image share, from
            the uncertain direction of the camera.
        own_sd_px: (N,) float64 of a shift of each light's own, from uncertain positions.
        image_size: (width, height) in pixels.
    """

    ids: NDArray[np.int64]
    boxes_px: _F64
    inside: _F64
    range_m: _F64
    angle_rad: _F64
    bulbs: tuple[tuple[str, ...], ...]
    shared_sd_px: float
    own_sd_px: _F64
    image_size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.ids)


def project_lights(
    lights: Sequence[MapLight],
    T_map_base: Transform,
    camera: CameraSensor,
    config: ProjectionConfig | None = None,
) -> ProjectedLights:
    """Return the lights within range that face a camera and of which a part is in its image.

    Args:
        lights: Of the map.
        T_map_base: Pose of the vehicle when the image was taken.
        camera: Where the camera sits, and its lens.
        config: Settings; None takes the defaults.

    Raises:
        ConfigError: If the rig does not say where the camera sits.
        GeometryError: If the frames of pose and rig do not meet.
    """
    config = config or ProjectionConfig()
    if camera.T_base_sensor is None:
        raise ConfigError(
            f"camera '{camera.name}' has no T_base_sensor, so lights of the map cannot be found "
            "in its images",
            remedy="Add it to the rig file",
        )
    T_map_cam = T_map_base @ camera.T_base_sensor
    near, range_m, angle_rad = _that_face_us(lights, T_map_cam.translation_m, config)
    lens = camera.camera()
    boxes = _face_boxes([lights[row] for row in near], T_map_cam.inverse(), lens)
    inside = _share_inside(boxes, camera.image_size)
    seen = (inside > 0) & (boxes[:, 3] - boxes[:, 1] >= config.min_height_px)
    focal_px = float(np.sqrt(lens.K[0, 0] * lens.K[1, 1]))
    return ProjectedLights(
        ids=np.array([lights[row].light_id for row in near[seen]], dtype=np.int64),
        boxes_px=boxes[seen],
        inside=inside[seen],
        range_m=range_m[seen],
        angle_rad=angle_rad[seen],
        bulbs=tuple(lights[row].bulbs for row in near[seen]),
        shared_sd_px=focal_px * float(np.radians(config.rotation_sd_deg)),
        own_sd_px=focal_px * config.position_sd_m / range_m[seen],
        image_size=camera.image_size,
    )


def _that_face_us(
    lights: Sequence[MapLight], camera_map: _F64, config: ProjectionConfig
) -> tuple[NDArray[np.intp], _F64, _F64]:
    """Return rows of lights in range that face a point (3,), their distances and angles."""
    if not lights:
        return np.zeros(0, np.intp), np.zeros(0), np.zeros(0)
    towards = camera_map - np.array([light.corners_map.mean(axis=0) for light in lights])
    range_m = np.linalg.norm(towards, axis=1)
    along = np.einsum("ij,ij->i", towards, np.array([light.facing for light in lights]))
    angle = np.arccos(np.clip(along / np.maximum(range_m, 1e-9), -1.0, 1.0))
    rows = np.flatnonzero((range_m <= config.range_m) & (angle <= np.radians(config.facing_deg)))
    return rows, range_m[rows], angle[rows]


def _face_boxes(lights: Sequence[MapLight], T_cam_map: Transform, lens: Camera) -> _F64:
    """Return the box (N, 4) of each face in pixels; NaN where the lens sees none of it.

    A face is sampled on a grid with its corners, so that one which the edge of the lens cuts
    is bounded by the part that the lens sees.
    """
    if not lights:
        return np.zeros((0, 4))
    corners = np.array([light.corners_map for light in lights])
    across = (_STEPS[:, None] * np.ones_like(_STEPS)).ravel()[:, None]
    up = (np.ones_like(_STEPS)[:, None] * _STEPS).ravel()[:, None]
    low = corners[:, 0, None] * (1 - across) + corners[:, 1, None] * across
    high = corners[:, 3, None] * (1 - across) + corners[:, 2, None] * across
    points_cam = T_cam_map.apply((low * (1 - up) + high * up).reshape(-1, 3))
    pixels, _ = lens.project(points_cam)
    off_axis = np.arctan2(np.hypot(points_cam[:, 0], points_cam[:, 1]), points_cam[:, 2])
    pixels[off_axis > lens.widest_rad] = np.nan
    pixels = pixels.reshape(len(lights), -1, 2)
    none = np.isnan(pixels).all(axis=(1, 2))
    boxes = np.full((len(lights), 4), np.nan)
    boxes[~none, :2] = np.nanmin(pixels[~none], axis=1)
    boxes[~none, 2:] = np.nanmax(pixels[~none], axis=1)
    return boxes + _HALF_PIXEL


def _share_inside(boxes: _F64, image_size: tuple[int, int]) -> _F64:
    """Return the share (N,) of each box that lies in the image; 0 of a box that is NaN."""
    size = np.array(image_size, dtype=np.float64)
    sides = np.clip(boxes[:, 2:], 0.0, size) - np.clip(boxes[:, :2], 0.0, size)
    whole = np.maximum(boxes[:, 2:] - boxes[:, :2], 1e-9)
    share: _F64 = np.nan_to_num((sides / whole).prod(axis=1), nan=0.0)
    return share
