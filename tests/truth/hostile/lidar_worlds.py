"""Small worlds of boxes, and LiDARs that look at them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hostile.case import Miss, Outcome, pose
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib import calibrate_lidars

__all__ = [
    "GROUND",
    "SIDE",
    "TOP",
    "box",
    "calibrated",
    "capture",
    "corridor",
    "pillars",
    "rays",
    "room",
    "scan",
    "street",
]

_F64 = NDArray[np.float64]
Scenes = list[dict[str, _F64]]

TOP = pose(0, 0, 2, 0, 0, 0)
SIDE = pose(0.1, 0.6, -0.4, -4, 20, 92)  # as seen from the top one


def rays(
    rings: int = 24,
    columns: int = 240,
    elevation_deg: tuple[float, float] = (-28, 18),
    azimuth_deg: tuple[float, float] = (0, 360),
) -> _F64:
    """Return the directions (N, 3) of a spinning LiDAR."""
    elevation = np.radians(np.linspace(*elevation_deg, rings))[:, None]
    azimuth = np.radians(np.linspace(*azimuth_deg, columns, endpoint=False))[None, :]
    flat = np.cos(elevation)
    directions = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth]
    return np.stack(directions, axis=-1).reshape(-1, 3)


def scan(
    boxes: _F64,
    T_world_sensor: _F64,
    directions: _F64,
    rng: np.random.Generator,
    *,
    noise_m: float = 0.01,
    bias_m: float = 0.0,
) -> _F64:
    """Return where rays end on boxes (N, 2, 3), also from within one, in the sensor's frame."""
    in_world = directions @ T_world_sensor[:3, :3].T
    in_world = np.where(np.abs(in_world) < 1e-9, 1e-9, in_world)
    ranges = np.full(len(directions), np.inf)
    for low, high in boxes:
        first, second = ((side - T_world_sensor[:3, 3]) / in_world for side in (low, high))
        enter = np.minimum(first, second).max(axis=1)
        leave = np.maximum(first, second).min(axis=1)
        hit = np.where(enter > 0, enter, leave)
        ranges = np.where((enter <= leave) & (hit > 0), np.minimum(ranges, hit), ranges)
    seen = ranges < 60
    measured = ranges[seen] + bias_m + rng.normal(0, noise_m, int(seen.sum()))
    points: _F64 = directions[seen] * measured[:, None]
    return points


def box(x: float, y: float, z: float, *size: float) -> _F64:
    """Return the two corners (2, 3) of a box by its middle and its size."""
    half = np.array(size) / 2
    return np.stack([np.array([x, y, z]) - half, np.array([x, y, z]) + half])


GROUND = box(0, 0, -0.5, 400, 400, 1)


def street(seed: int) -> _F64:
    """Return ground, houses along both sides with gaps, kiosks, cars and posts."""
    rng = np.random.default_rng(seed)
    kiosks = [(x + rng.uniform(-4, 4), rng.choice([-11, 11])) for x in (-24, -14, 12, 26)]
    boxes = [GROUND, *(box(x, y, 1.5, 2, 3, 3) for x, y in kiosks)]
    for side in (-1, 1):
        at = -45.0
        while at < 45:
            length, back = rng.uniform(5, 12), rng.uniform(0, 4)
            boxes.append(box(at + length / 2, side * (14 + back), 3, length, 8, rng.uniform(5, 9)))
            at += length + rng.uniform(0.5, 4)
        for x in rng.uniform(-25, 25, 4):
            boxes.append(box(x, side * rng.uniform(5, 8), 0.8, 4.3, 1.8, 1.6))
            boxes.append(box(x + 3, side * 9, 2, 0.2, 0.2, 4))
    return np.stack(boxes)


def room(length: float, width: float, *things: _F64) -> _F64:
    """Return a room around the origin with things in it."""
    return np.stack([box(0, 0, 1.5, length, width, 3.6), *things])


def corridor(width: float) -> _F64:
    """Return a bare corridor along x."""
    return room(300, width)


def pillars(spacing_m: float) -> _F64:
    """Return a hall without walls: identical pillars on a grid, floor and ceiling."""
    at = np.arange(-15, 16) * spacing_m + spacing_m / 2
    posts = [box(x, y, 2, 0.4, 0.4, 4) for x in at for y in at if np.hypot(x, y) < 40]
    return np.stack([GROUND, box(0, 0, 4.5, 400, 400, 1), *posts])


def capture(
    worlds: Sequence[_F64],
    T_top_side: _F64 | Sequence[_F64] = SIDE,
    *,
    T_world_top: Sequence[_F64] | None = None,
    T_world_side_extra: Sequence[_F64] | None = None,
    seed: int = 0,
    top_rays: _F64 | None = None,
    side_rays: _F64 | None = None,
    noise_m: float = 0.01,
    side_bias_m: float = 0.0,
) -> Scenes:
    """Return a scene of `top` and `side` for each world.

    Args:
        worlds: Boxes (N, 2, 3), one array a scene.
        T_top_side: The mount, or one a scene.
        T_world_top: Where the vehicle stands, one a scene.
        T_world_side_extra: By how much the vehicle went on before the side LiDAR measured.
        seed: Of the noise.
        top_rays: Directions of the top LiDAR.
        side_rays: Directions of the side LiDAR.
        noise_m: Standard deviation of a range.
        side_bias_m: What the side LiDAR adds to each range.
    """
    rng = np.random.default_rng(seed)
    top_rays = rays() if top_rays is None else top_rays
    side_rays = rays(12) if side_rays is None else side_rays
    scenes = []
    for k, world in enumerate(worlds):
        T_top = TOP if T_world_top is None else T_world_top[k]
        mount = T_top_side if isinstance(T_top_side, np.ndarray) else T_top_side[k]
        T_side = T_top @ mount
        if T_world_side_extra is not None:
            T_side = T_world_side_extra[k] @ T_side
        scenes.append(
            {
                "top": scan(world, T_top, top_rays, rng, noise_m=noise_m),
                "side": scan(world, T_side, side_rays, rng, noise_m=noise_m, bias_m=side_bias_m),
            }
        )
    return scenes


def calibrated(
    scenes: Scenes,
    T_top_sensor: _F64 | dict[str, _F64] | None,
    initial: dict[str, _F64] | None = None,
) -> Outcome:
    """Calibrate and compare with the truth; None where the data have none."""
    result = calibrate_lidars(scenes, "top", initial=initial)
    truth = {"side": T_top_sensor} if isinstance(T_top_sensor, np.ndarray) else T_top_sensor
    misses: list[Miss] = []
    for extrinsic in result.extrinsics:
        T = extrinsic.T_reference_sensor
        if T is None or extrinsic.verdict.exit_code != 0:
            continue
        if truth is None:
            misses.append(Miss("what has no answer", np.inf, 0.0, 0.0, np.inf))
            continue
        right = truth[extrinsic.sensor]
        turn = Rotation.from_matrix(T[:3, :3] @ right[:3, :3].T).magnitude() * 180 / np.pi
        sd_deg = float(np.linalg.norm(extrinsic.sd_rotation_deg))
        sd_m = float(np.linalg.norm(extrinsic.sd_translation_m))
        shift = float(np.linalg.norm(T[:3, 3] - right[:3, 3]))
        misses.append(Miss(f"{extrinsic.sensor}: rotation (deg)", float(turn), sd_deg, 0.2, 0.5))
        misses.append(Miss(f"{extrinsic.sensor}: translation (m)", shift, sd_m, 0.03, 0.1))
    why = result.why[0].partition("): ")[2] or result.why[0]
    return Outcome(str(result.verdict), why, tuple(misses))
