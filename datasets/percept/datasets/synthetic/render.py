"""The camera of the synthetic world: triangles to a picture.

Geometry is exact (`PinholeCamera.project` says where every edge lies); light is simple: a sun,
a sky that lights from above, lamps that shine by themselves, haze, gamma, sensor noise. There
are no cast shadows.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.cameras import PinholeCamera
from percept.core.errors import GeometryError
from percept.core.settings import Settings
from percept.core.transform import Transform
from percept.datasets.synthetic.camera import UndistortedView, undistorted_view
from percept.datasets.synthetic.edge_kernels import settle_edges
from percept.datasets.synthetic.mesh import Mesh
from percept.datasets.synthetic.render_kernels import Lighting, gather, rasterise, shine

__all__ = ["Rasterised", "RenderConfig", "rasterised", "render_image", "shaded"]

# A layer brings a face this share of its depth nearer: more than rounding, less than a sheet
# of paper at the distances where anything of it is seen.
_LAYER_STEP = 1e-4
_TONE_STEPS = 1 << 16

Colour = tuple[float, float, float]


class RenderConfig(Settings):
    """Light and sensor of a rendered image.

    Attributes:
        sun_direction_map: Direction towards the sun, of any length.
        sun: Light of the sun on a face turned to it.
        ambient: Light of the sky on a face turned up; a face turned down gets half.
        exposure: Factor on all light before it is clipped at 1.
        sky_zenith_rgb: Linear colour of the sky overhead.
        sky_horizon_rgb: Linear colour of the sky at the horizon, and of the haze.
        fog_per_m: Extinction of the haze; 0 is clear air, 0.01 is a visibility of about 400 m.
        gamma: Picture values are light to the power of 1 / gamma; 1 for a linear sensor.
        supersampling: Samples along each side of a pixel.
        noise_sd: Standard deviation of the sensor's noise, in grey levels; 0 for none.
        seed: Of the noise; give each image its own.
    """

    sun_direction_map: tuple[float, float, float] = (-0.4, 0.5, 0.8)
    sun: float = Field(default=0.75, ge=0)
    ambient: float = Field(default=0.45, ge=0)
    exposure: float = Field(default=1.0, gt=0)
    sky_zenith_rgb: Colour = (0.16, 0.34, 0.72)
    sky_horizon_rgb: Colour = (0.66, 0.74, 0.82)
    fog_per_m: float = Field(default=0.0, ge=0)
    gamma: float = Field(default=2.2, gt=0)
    supersampling: int = Field(default=2, ge=1, le=8)
    noise_sd: float = Field(default=1.5, ge=0)
    seed: int = Field(default=0, ge=0)


def render_image(
    mesh_map: Mesh, camera: PinholeCamera, T_cam_map: Transform, config: RenderConfig
) -> NDArray[np.uint8]:
    """Draw what a camera sees of a mesh.

    Args:
        mesh_map: Triangles in the map frame, z up. Of coplanar ones the higher layer is seen.
        camera: The lens; pixel (0, 0) is the centre of the top-left pixel.
        T_cam_map: From the map into the optical frame.
        config: Light and sensor.

    Returns:
        (height, width, 3) uint8 BGR. The same arguments give the same bytes.

    Raises:
        GeometryError: If a vertex is not finite, or the lens's distortion has no inverse.
    """
    seen = rasterised(mesh_map, camera, T_cam_map, config.supersampling)
    return shaded(mesh_map, seen, T_cam_map, config)


class Rasterised(NamedTuple):
    """What each sample of an undistorted view shows, before any light.

    Attributes:
        view: The grid of samples.
        vertices_cam: (V, 3) float64 vertices of the mesh in the optical frame, metres.
        inverse_depth: (H, W) float32, 1/m; zero where nothing is.
        face_at: (H, W) int32 index of the face that is seen, -1 for none.
    """

    view: UndistortedView
    vertices_cam: NDArray[np.float64]
    inverse_depth: NDArray[np.float32]
    face_at: NDArray[np.int32]


def rasterised(
    mesh_map: Mesh, camera: PinholeCamera, T_cam_map: Transform, supersampling: int
) -> Rasterised:
    """Find the nearest face at every sample; see `render_image`.

    Raises:
        GeometryError: If a vertex is not finite, or the lens's distortion has no inverse.
    """
    if not np.isfinite(mesh_map.vertices).all():
        raise GeometryError("a vertex of the mesh is not finite")
    view = undistorted_view(camera, supersampling)
    vertices_cam = T_cam_map.apply(mesh_map.vertices)
    inverse_depth = np.zeros((view.height, view.width), np.float32)
    face_at = np.full((view.height, view.width), -1, np.int32)
    bias = 1.0 + _LAYER_STEP * mesh_map.layer.astype(np.float64)
    rasterise(vertices_cam, mesh_map.faces, bias, view.grid, inverse_depth, face_at)
    return Rasterised(view, vertices_cam, inverse_depth, face_at)


def shaded(
    mesh_map: Mesh, seen: Rasterised, T_cam_map: Transform, config: RenderConfig
) -> NDArray[np.uint8]:
    """Light what was rasterised, and return the picture; see `render_image`.

    Args:
        mesh_map: The mesh that was rasterised.
        seen: What `rasterised` found with the supersampling of `config`.
        T_cam_map: From the map into the optical frame.
        config: Light and sensor.
    """
    view, vertices_cam, inverse_depth, face_at = seen
    up = T_cam_map.rotation[:, 2]
    lighting = Lighting(
        _face_light(mesh_map, T_cam_map.inverse().translation_m, config),
        _bgr(config.sky_zenith_rgb, config.exposure),
        _bgr(config.sky_horizon_rgb, config.exposure),
        (float(up[0]), float(up[1]), float(up[2])),
        config.fog_per_m,
    )
    light = shine(face_at, inverse_depth, view.grid, lighting)
    settle_edges(light, face_at, inverse_depth, vertices_cam, mesh_map.faces, view.grid, lighting)
    return _exposed(gather(light, view.lattice, config.supersampling, _tone(config.gamma)), config)


def _face_light(
    mesh: Mesh, eye_map: NDArray[np.float64], config: RenderConfig
) -> NDArray[np.float32]:
    """Return the linear light (F, 3) BGR that each face sends to the eye (Lambert 1760)."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    # Faces have two sides: the one that is seen is the one that is lit.
    normals *= np.where(np.einsum("ij,ij->i", normals, eye_map - a) < 0, -1.0, 1.0)[:, None]
    sun = np.asarray(config.sun_direction_map)
    facing_sun = np.maximum(normals @ (sun / np.linalg.norm(sun)), 0.0)
    received = config.sun * facing_sun + config.ambient * (0.75 + 0.25 * normals[:, 2])
    light = mesh.colours[:, ::-1] * (received + mesh.emission)[:, None] * config.exposure
    return np.ascontiguousarray(light, dtype=np.float32)


def _exposed(picture: NDArray[np.float32], config: RenderConfig) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) in 0..255 with the sensor's noise, in whole grey levels."""
    if config.noise_sd > 0:
        noise = np.random.default_rng(config.seed).standard_normal(picture.shape, np.float32)
        picture += np.float32(config.noise_sd) * noise
    rounded: NDArray[np.uint8] = cv2.convertScaleAbs(np.maximum(picture, 0, out=picture)).view(
        np.uint8
    )
    return rounded


@lru_cache(maxsize=4)
def _tone(gamma: float) -> NDArray[np.float32]:
    """Return the picture value of linear light 0..1, in even steps."""
    linear = np.linspace(0.0, 1.0, _TONE_STEPS)
    return (255 * linear ** (1 / gamma)).astype(np.float32)


def _bgr(rgb: Colour, exposure: float) -> Colour:
    red, green, blue = rgb
    return blue * exposure, green * exposure, red * exposure
