"""Scans of simple places, seen from a vehicle that drives through them: the truth is exact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS, NS_PER_S
from percept.core.samples import PointCloud
from percept.core.trajectory import Trajectory

__all__ = ["PERIOD_NS", "START_NS", "drive", "field", "scans", "street", "tunnel"]

START_NS = 1_700_000_000_123_456_789
PERIOD_NS = 100 * NS_PER_MS
_F = NDArray[np.float64]


def _wall(rng: np.random.Generator, corner: list[float], along: list[float], count: int) -> _F:
    """Return points on a wall of 6 m from a corner along a horizontal vector."""
    share = rng.random((count, 1))
    points: _F = np.array(corner) + share * np.array(along)
    points[:, 2] = 6 * rng.random(count)
    return points


def _ground(rng: np.random.Generator, reach_m: float, count: int) -> _F:
    points = rng.uniform(-1, 1, (count, 3)) * [reach_m, 0.4 * reach_m, 0]
    points[:, 0] += 0.5 * reach_m
    return points


def street(rng: np.random.Generator) -> _F:
    """Return points (N, 3) of a street with houses that stand forward and back."""
    parts = [_ground(rng, 120, 40_000)]
    for side in (-1, 1):
        for k in range(-4, 18):
            x, y = 10.0 * k, side * (9 + 2.5 * ((k * 7 + side) % 3))
            parts.append(_wall(rng, [x, y, 0], [7.0, 0, 0], 1500))
            parts.append(_wall(rng, [x, y, 0], [0, side * 4.0, 0], 800))
    return np.concatenate(parts)


def tunnel(rng: np.random.Generator) -> _F:
    """Return points (N, 3) of a straight, smooth tunnel: nothing tells how far one is in it."""
    sides = [_wall(rng, [-80.0, y, 0], [280.0, 0, 0], 30_000) for y in (-5.0, 5.0)]
    roof = rng.uniform([-80, -5, 6], [200, 5, 6], (30_000, 3))
    floor = rng.uniform([-80, -5, 0], [200, 5, 0], (30_000, 3))
    return np.concatenate([*sides, roof, floor])


def field(rng: np.random.Generator) -> _F:
    """Return points (N, 3) of an open field."""
    return _ground(rng, 150, 200_000)


def drive(speed_mps: float, turn_radps: float) -> Callable[[_F], _F]:
    """Return a function that gives poses (N, 4, 4) at times (N,) in seconds on a circle."""

    def poses(seconds: _F) -> _F:
        angle = turn_radps * seconds
        matrices = np.tile(np.eye(4), (len(seconds), 1, 1))
        matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(angle)
        matrices[:, 1, 0], matrices[:, 0, 1] = np.sin(angle), -np.sin(angle)
        radius_m = speed_mps / turn_radps
        matrices[:, 0, 3] = radius_m * np.sin(angle)
        matrices[:, 1, 3] = radius_m * (1 - np.cos(angle))
        return matrices

    return poses


def scans(
    world: _F,
    poses: Callable[[_F], _F],
    count: int,
    *,
    noise_m: float = 0.01,
    times: bool = True,
    seed: int = 0,
) -> tuple[list[PointCloud], Trajectory]:
    """Return scans of a spinning LiDAR and the exact poses every 10 ms.

    Each point is seen from where the vehicle is when the beam passes it; the stamp of a scan is
    that of its beginning.
    """
    rng = np.random.default_rng(seed)
    clouds = []
    for number in range(count):
        begun_s = 0.1 * number
        near = world[rng.random(len(world)) < 0.25]
        offsets_s = np.sort(rng.random(len(near))) * 0.099
        matrices = poses(begun_s + offsets_s)
        seen = np.einsum("nji,nj->ni", matrices[:, :3, :3], near - matrices[:, :3, 3])
        seen += noise_m * rng.standard_normal(seen.shape)
        reach = np.linalg.norm(seen, axis=1) < 60
        offsets_ns = np.round(offsets_s * NS_PER_S).astype(np.int64)
        clouds.append(
            PointCloud(
                topic="/points",
                stamp_ns=START_NS + number * PERIOD_NS,
                log_time_ns=START_NS + (number + 1) * PERIOD_NS,
                frame="base_link",
                points_xyz=seen[reach].astype(np.float32),
                offset_ns=offsets_ns[reach] if times else None,
            )
        )
    ticks = np.arange(10 * count + 1)
    stamps_ns = START_NS + ticks * (10 * NS_PER_MS)
    return clouds, Trajectory(
        "map", "base_link", stamps_ns, poses(np.asarray(0.01 * ticks, np.float64))
    )
