"""Single pictures of many streets with their truth: what a camera network is trained on.

Every view has a street, a moment, a place, a camera and a light of its own, all drawn from its
seed and number, so that a set of them varies far more than the images of one drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import PinholeCamera
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.layout import BLOCK_M
from percept.datasets.synthetic.render import RenderConfig
from percept.datasets.synthetic.sensor_rig import BASE, CAMERA_NAMES, make_cameras
from percept.datasets.synthetic.visible import VisibleBoxes, picture_with_boxes
from percept.datasets.synthetic.world import World

__all__ = ["LabelledView", "random_view"]

_LANES_Y_M = (-5.25, -1.75, 1.75, 5.25)
_STREET_M = 8 * BLOCK_M
_FREE_M = 4.5
_FRONT_SHARE = 0.6
# Signals are small and rare: so many views stand before a crossing, so far from its signals.
_CROSSING_SHARE = 0.35
_SIGNALS_AHEAD_M = (12.0, 45.0)
# The heads for traffic along -x hang so far before the end of a block.
_WEST_HEADS_M = 21.0
# Road works and deer stand in this part of every block.
_RARE_SHARE = 0.35
_RARE_M = (43.0, 85.0)
_RARE_AHEAD_M = (4.0, 18.0)
_RENDER_SEEDS = 2**31


@dataclass(frozen=True, slots=True, eq=False)
class LabelledView:
    """A picture and what it shows.

    Attributes:
        pixels: (height, width, 3) uint8 BGR.
        boxes: Its objects.
    """

    pixels: NDArray[np.uint8]
    boxes: VisibleBoxes


def random_view(
    seed: int, number: int, image_size: tuple[int, int] = (640, 400), supersampling: int = 1
) -> LabelledView:
    """Return a view of a street that is drawn from a seed and a number.

    Args:
        seed: Of the world; sets with different seeds share no street.
        number: Of the view in the set.
        image_size: (width, height) in pixels.
        supersampling: Samples along each side of a pixel.

    Returns:
        The view; the same arguments give the same bytes.
    """
    rng = np.random.default_rng([seed, 77, number])
    world = World.from_seed(seed)
    name = CAMERA_NAMES[0] if rng.uniform() < _FRONT_SHARE else str(rng.choice(CAMERA_NAMES[1:]))
    (sensor,) = make_cameras((name,), image_size)
    mounted = sensor.T_base_sensor or Transform.identity(BASE, sensor.frame)
    time_s = float(rng.uniform(0, 60))
    T_map_base = _vehicle(world, time_s, rng)
    T_cam_map = (T_map_base @ _shaken(mounted, rng)).inverse()
    x_m = float(T_map_base.translation_m[0])
    pixels, boxes = picture_with_boxes(
        world,
        _lens(sensor.pinhole(), rng),
        T_cam_map,
        time_s,
        x_m,
        _light(rng, supersampling),
    )
    return LabelledView(pixels, boxes)


def _vehicle(world: World, time_s: float, rng: np.random.Generator) -> Transform:
    """Return `T_map_base` on a free place of a lane, driving along it."""
    while True:
        y_m = float(rng.choice(_LANES_Y_M))
        x_m = _place_along(y_m, rng)
        y_m += float(rng.normal(0, 0.3))
        near = world.objects(time_s, x_m, _FREE_M)
        if all(np.hypot(o.x_at(time_s) - x_m, o.y_m - y_m) > _FREE_M for o in near):
            break
    yaw = (0.0 if y_m < 0 else np.pi) + rng.normal(0, 0.03)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, 0.0, float(yaw))
    matrix[:3, 3] = x_m, y_m, float(world.profile.ground(x_m, y_m))
    return Transform("map", BASE, matrix)


def _place_along(y_m: float, rng: np.random.Generator) -> float:
    """Return a place along the street: anywhere, before a crossing, or before rare things."""
    block = BLOCK_M * int(rng.integers(1, int(_STREET_M // BLOCK_M)))
    direction = 1.0 if y_m < 0 else -1.0
    draw = rng.uniform()
    if draw < _CROSSING_SHARE:
        heads = 0.0 if y_m < 0 else -_WEST_HEADS_M
        return float(block + heads - direction * rng.uniform(*_SIGNALS_AHEAD_M))
    if draw < _CROSSING_SHARE + _RARE_SHARE:
        return float(block + rng.uniform(*_RARE_M) - direction * rng.uniform(*_RARE_AHEAD_M))
    return float(rng.uniform(0, _STREET_M))


def _shaken(T_base_cam: Transform, rng: np.random.Generator) -> Transform:
    """Return a mounting that differs a little in height and angles."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*np.radians(rng.normal(0, (0.7, 1.5, 3.0))).tolist())
    matrix[:3, 3] = 0.0, 0.0, float(rng.uniform(-0.4, 0.5))
    return Transform(BASE, BASE, matrix) @ T_base_cam


def _lens(camera: PinholeCamera, rng: np.random.Generator) -> PinholeCamera:
    """Return a lens that is a little longer or shorter."""
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= rng.uniform(0.9, 1.35)
    return PinholeCamera(camera.image_size, K, camera.distortion)


def _light(rng: np.random.Generator, supersampling: int) -> RenderConfig:
    """Draw the light of a day, from a clear noon to a hazy evening."""
    sun = (*rng.uniform(-1, 1, 2).tolist(), float(rng.uniform(0.25, 1.0)))
    return RenderConfig(
        sun_direction_map=sun,
        sun=float(rng.uniform(0.15, 0.95)),
        ambient=float(rng.uniform(0.25, 0.6)),
        exposure=float(rng.uniform(0.65, 1.45)),
        fog_per_m=float(rng.choice([0.0, rng.uniform(0, 0.008)])),
        gamma=float(rng.uniform(1.9, 2.5)),
        noise_sd=float(rng.uniform(0.5, 4.0)),
        supersampling=supersampling,
        seed=int(rng.integers(_RENDER_SEEDS)),
    )
