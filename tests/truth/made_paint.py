"""Made roads and what cameras would see of their paint, with every error that looks have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import GroundCoverage, PaintObservation, Sight
from percept.core.trajectory import Trajectory
from percept.hdmap.elements import Lanelet, MapMarking

_F64 = NDArray[np.float64]

WIDTH_M = 3.5
LATERALS = (-7.0, -3.5, 0.0, 3.5, 7.0)
TYPES = ("solid", "dashed", "solid_solid", "dashed", "solid")
COLOURS = ("white", "white", "yellow", "white", "white")
EGO_LATERAL = -5.25
STOP_EVERY_M = 120.0
_LOOK_EVERY_M = 1.2
_PAIR_M = 0.24


@dataclass(frozen=True)
class Noise:
    """Errors of looks and poses."""

    stroke_m: float = 0.02
    stroke_far_m: float = 0.06  # more at 20 m
    common_far_m: float = 0.03  # of all strokes of a look at 20 m
    direction_deg: float = 1.5
    missed: float = 0.05
    missed_far: float = 0.25  # more at 20 m
    false_strokes: float = 4.0
    false_bars: float = 0.02
    cracks_per_km: float = 15.0
    worn: float = 0.0  # share of lines' stretches of 2 m that are gone for good
    yellow: float = 0.25
    pose_white_m: float = 0.01
    pose_drift_m: float = 0.1
    pose_drift_deg: float = 0.1
    pose_constant_m: tuple[float, float] = (0.0, 0.0)  # map frame
    cars: int = 4


QUIET = Noise(
    0.01, 0.02, 0.01, 0.5, 0.01, 0.05, 0.5, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, (0.0, 0.0), 0
)
MEDIUM = Noise()
LOUD = Noise(
    0.03, 0.1, 0.06, 2.5, 0.15, 0.4, 10.0, 0.05, 40.0, 0.03, 0.35, 0.03, 0.2, 0.2, (0.0, 0.0), 10
)


@dataclass(frozen=True)
class Way:
    """A stretch of a line on the road: its points and its paint."""

    element_id: int
    points: _F64
    type: str
    colour: str
    width_m: float = 0.14

    def strokes(self, step_m: float, worn: _F64) -> tuple[_F64, _F64, _F64]:
        """Return points (N, 3), directions (N,) and yellow (N,) of its paint."""
        along = distances(self.points)
        at = np.arange(0.0, along[-1], step_m) + step_m / 2
        middle = np.stack([np.interp(at, along, axis) for axis in self.points.T], axis=1)
        ahead = np.stack([np.interp(at + 0.1, along, axis) for axis in self.points.T], axis=1)
        back = np.stack([np.interp(at - 0.1, along, axis) for axis in self.points.T], axis=1)
        yaw = np.arctan2(*(ahead - back)[:, 1::-1].T)
        normal = np.stack([-np.sin(yaw), np.cos(yaw), np.zeros(len(yaw))], axis=1)
        is_dash = (at + 5.0) % 12.0 < 3.0
        words = self.type.split("_")
        sides = [0.0] if len(words) == 1 else [_PAIR_M / 2, -_PAIR_M / 2]
        parts = []
        for word, side in zip(words, sides, strict=True):
            kept = (is_dash if word == "dashed" else np.ones(len(at), bool)) & ~_is_worn(at, worn)
            parts.append((middle[kept] + side * normal[kept], yaw[kept]))
        points = np.concatenate([part[0] for part in parts])
        return (
            points,
            np.concatenate([part[1] for part in parts]),
            np.full(len(points), float(self.colour == "yellow")),
        )


@dataclass(frozen=True)
class Road:
    """What is on the road: ways of paint by id, and near edges of stop lines by id."""

    ways: dict[int, Way]
    stops: dict[int, _F64]
    stop_ahead: dict[int, _F64] = field(default_factory=dict)


@dataclass(frozen=True)
class World:
    """A road, the map of it, and the path that is driven."""

    road: Road
    markings: tuple[MapMarking, ...]
    lanelets: dict[int, Lanelet]
    path: _F64  # (N, 4) x, y, yaw, along of the middle of the ego lane
    length_m: float


def made_world(length_m: float = 500.0, bend: float = 0.0, way_m: float = 80.0) -> World:
    """Return a road with two lanes each way, whose map is right.

    `bend` is the largest curvature in 1/m of its S-bends.
    """
    along = np.arange(0.0, length_m + 1e-9, 0.5)
    yaw = np.cumsum(bend * np.sin(2 * np.pi * along / 240.0) * 0.5)
    centre = np.stack([np.cumsum(np.cos(yaw)) * 0.5, np.cumsum(np.sin(yaw)) * 0.5], axis=1)
    normal = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)

    def beside(lateral: float, first: float, last: float) -> _F64:
        rows = (along >= first - 1e-6) & (along <= last + 1e-6)
        return np.column_stack([centre[rows] + lateral * normal[rows], np.zeros(rows.sum())])

    ways, lanelets = {}, {}
    cuts = [*np.arange(0.0, length_m - way_m / 2, way_m), length_m]
    for part, (first, last) in enumerate(pairwise(cuts)):
        for k, lateral in enumerate(LATERALS):
            points = beside(lateral, first, last)
            ident = 1000 + 10 * part + k
            ways[ident] = Way(ident, points, TYPES[k], COLOURS[k])
        for k in range(4):
            right, left = beside(LATERALS[k], first, last), beside(LATERALS[k + 1], first, last)
            ids = (1000 + 10 * part + k, 1000 + 10 * part + k + 1)
            if k >= 2:
                right, left, ids = left[::-1], right[::-1], ids[::-1]
            ident = 5000 + 10 * part + k
            lanelets[ident] = Lanelet(
                lanelet_id=ident, tags={"subtype": "road"}, left_ids=(ids[1],), right_ids=(ids[0],),
                left_map=left, right_map=right, centreline_id=0, rule_ids=(),
            )  # fmt: skip
    stops, ahead = {}, {}
    for n, at in enumerate(np.arange(60.0, length_m - 20.0, STOP_EVERY_M)):
        row = round(at / 0.5)
        ends = [centre[row] + lateral * normal[row] for lateral in (-0.2, -6.8)]
        stops[9000 + n] = np.column_stack([ends, np.zeros(2)])
        ahead[9000 + n] = np.array([np.cos(yaw[row]), np.sin(yaw[row])])
    ego = centre + EGO_LATERAL * normal
    road = Road(ways, stops, ahead)
    path = np.column_stack([ego, yaw, along])
    return World(road, map_of(road), lanelets, path, length_m)


def map_of(road: Road) -> tuple[MapMarking, ...]:
    """Return the markings of a map that is right."""
    lines = [
        MapMarking(
            element_id=way.element_id, kind="line", points_map=way.points, type=way.type,
            colour=way.colour, painted=True, width_m=way.width_m, name=f"way {way.element_id}",
        )
        for way in road.ways.values()
    ]  # fmt: skip
    stops = [
        MapMarking(
            element_id=ident, kind="stop_line", points_map=points, type="solid", colour="white",
            painted=True, width_m=0.4, name=f"way {ident}",
        )
        for ident, points in road.stops.items()
    ]  # fmt: skip
    return (*lines, *stops)


def moved_aside(points: _F64, lateral_m: float) -> _F64:
    """Return a line (N, 3) that lies so far to the left."""
    tangent = np.gradient(points[:, :2], axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0], np.zeros(len(points))])
    return points + lateral_m * normal


def drive(
    world: World,
    noise: Noise,
    seed: int,
    *,
    first_m: float = 5.0,
    last_m: float | None = None,
    start_ns: int = 0,
    dark: tuple[float, float] = (0.0, 0.0),
    hidden: float | None = None,
    backward: bool = False,
) -> tuple[Trajectory, Iterator[PaintObservation]]:
    """Return the poses as the log has them, and the looks of a camera.

    It is dark from one place to another; a truck drives along beside the vehicle at the lateral
    `hidden`; `backward` drives the other way in the lane of that.
    """
    rng = np.random.default_rng(seed)
    last_m = world.length_m - 5.0 if last_m is None else last_m
    at = np.arange(first_m, last_m, _LOOK_EVERY_M)
    true = np.stack([np.interp(at, world.path[:, 3], world.path[:, k]) for k in range(3)], axis=1)
    true[:, :2] += 0.2 * np.sin(at / 40.0)[:, None] * _left(true[:, 2])
    if backward:
        true[:, :2] -= 2 * EGO_LATERAL * _left(true[:, 2])
        true[:, 2] += np.pi
        true = true[::-1].copy()
    given = true.copy()
    lateral = noise.pose_drift_m * _drift(rng, at, 150.0)
    lateral += noise.pose_white_m * rng.standard_normal(len(at))
    given[:, :2] += lateral[:, None] * _left(true[:, 2]) + np.array(noise.pose_constant_m)
    given[:, 2] += np.radians(noise.pose_drift_deg) * _drift(rng, at, 100.0)
    stamps = (start_ns + at * 1e8).astype(np.int64)
    matrices = np.stack([_matrix(*pose) for pose in given])
    poses = Trajectory("map", "base_link", stamps, matrices)
    return poses, _looks(world, noise, rng, true, at, stamps, dark, hidden)


def _looks(
    world: World,
    noise: Noise,
    rng: np.random.Generator,
    true: _F64,
    at: _F64,
    stamps: NDArray[np.int64],
    dark: tuple[float, float],
    hidden: float | None,
) -> Iterator[PaintObservation]:
    step = 0.5
    worn = rng.random((64, 997)) < noise.worn
    parts = [way.strokes(step, worn[row % 64]) for row, way in enumerate(world.road.ways.values())]
    cracks = _cracks(world, noise, rng, step)
    points, yaw, yellow = (np.concatenate([part[k] for part in [*parts, cracks]]) for k in range(3))
    cars = [(rng.uniform(at[0], at[-1]), rng.choice([-1.75, -8.5, 1.75]), rng.uniform(0.3, 1.2))
            for _ in range(noise.cars)]  # fmt: skip
    for pose, place, stamp in zip(true, at, stamps, strict=True):
        is_dark = dark[0] <= place < dark[1]
        coverage = _coverage(pose, place, cars, world, is_dark=is_dark)
        if hidden is not None:
            y = np.arange(coverage.sights.shape[1]) * 0.5 - 13.75
            beyond = y * np.sign(hidden) > abs(hidden)
            coverage.sights[(coverage.sights == Sight.SEEN) & beyond] = Sight.OCCLUDED
        near = np.flatnonzero(np.abs(points[:, :2] - pose[:2]).max(axis=1) < 35.0)
        base = _to_base(points[near], pose)
        kept = coverage.at(base[:, :2]) == Sight.SEEN
        range_m = np.linalg.norm(base[:, :2], axis=1)
        kept &= rng.random(len(near)) > noise.missed + noise.missed_far * (range_m / 20.0) ** 2
        near, base, range_m = near[kept], base[kept], range_m[kept]
        yield _look(
            rng, noise, base, yaw[near] - pose[2], yellow[near], range_m, step, coverage,
            _bars(rng, noise, world, pose, coverage), int(stamp),
        )  # fmt: skip


def _look(
    rng: np.random.Generator,
    noise: Noise,
    base: _F64,
    direction: _F64,
    yellow: _F64,
    range_m: _F64,
    step: float,
    coverage: GroundCoverage,
    bars: tuple[_F64, _F64],
    stamp: int,
) -> PaintObservation:
    count = rng.poisson(noise.false_strokes)
    ghosts = np.column_stack(
        [rng.uniform(4, 22, count), rng.uniform(-8, 8, count), np.zeros(count)]
    )
    ghosts = ghosts[coverage.at(ghosts[:, :2]) == Sight.SEEN]
    base = np.concatenate([base, ghosts])
    direction = np.concatenate([direction, rng.normal(0.0, 0.2, len(ghosts))])
    yellow = np.concatenate([yellow, rng.random(len(ghosts))])
    range_m = np.concatenate([range_m, np.linalg.norm(ghosts[:, :2], axis=1)])
    far = (range_m / 20.0) ** 2
    sd = noise.stroke_m + noise.stroke_far_m * far
    across = sd * rng.standard_normal(len(base)) + noise.common_far_m * far * rng.standard_normal()
    base = base + across[:, None] * np.column_stack(
        [-np.sin(direction), np.cos(direction), np.zeros(len(base))]
    )
    direction = direction + np.radians(noise.direction_deg) * rng.standard_normal(len(base))
    direction = (direction + np.pi / 2) % np.pi - np.pi / 2
    seen_yellow = np.clip(yellow + noise.yellow * rng.standard_normal(len(base)), 0, 1)
    seen_yellow[rng.random(len(base)) < 0.1] = np.nan
    ends, bar_sd = bars
    return PaintObservation(
        stamp_ns=stamp, sensor="front", frame_id="base_link", strokes_m=base,
        direction_rad=direction, width_m=np.full(len(base), 0.14), sd_m=sd + 0.01,
        yellow=seen_yellow, strength=np.ones(len(base)), step_m=step, coverage=coverage,
        bars_m=ends, bar_width_m=np.full(len(ends), 0.4), bar_sd_m=bar_sd,
    )  # fmt: skip


def _bars(
    rng: np.random.Generator, noise: Noise, world: World, pose: _F64, coverage: GroundCoverage
) -> tuple[_F64, _F64]:
    ends, sds = [], []
    for points in world.road.stops.values():
        base = _to_base(points, pose)[:, :2]
        middle = base.mean(axis=0)
        if not 3.0 < middle[0] < 14.0 or coverage.at(middle[None])[0] != Sight.SEEN:
            continue
        if rng.random() < 2 * noise.missed:
            continue
        sd = 0.05 + 10 * noise.stroke_m * (middle[0] / 12.0) ** 2
        base = base[np.argsort(-base[:, 1])] + np.array([sd * rng.standard_normal(), 0.0])
        base[:, 1] = np.clip(base[:, 1], -5.0, 5.0)
        ends.append(base)
        sds.append(sd)
    if rng.random() < noise.false_bars:
        x, y = rng.uniform(4, 12), rng.uniform(-3, 3)
        ends.append(np.array([[x, y + 1.5], [x, y - 1.5]]))
        sds.append(0.2)
    return np.array(ends).reshape(-1, 2, 2), np.array(sds)


def _coverage(
    pose: _F64, place: float, cars: list[tuple[float, float, float]], world: World, *, is_dark: bool
) -> GroundCoverage:
    cell = 0.5
    x, y = np.meshgrid(
        np.arange(0, 36, cell) + 0.25, np.arange(-14, 14, cell) + 0.25, indexing="ij"
    )
    sights = np.full(x.shape, Sight.SEEN, dtype=np.uint8)
    sights[np.hypot(x, y) > 22.0] = Sight.TOO_FAR
    if is_dark:
        sights[:] = Sight.TOO_DARK
    azimuth = np.arctan2(y, x)
    for start, lateral, speed in cars:
        along = start + speed * (place - start)
        row = np.array([np.interp(along, world.path[:, 3], world.path[:, k]) for k in range(3)])
        row[:2] += (lateral - EGO_LATERAL) * _left(row[2:3])[0]
        middle = _to_base(np.array([[*row[:2], 0.0]]), pose)[0, :2]
        distance = float(np.hypot(*middle))
        if 3.0 < distance < 30.0:
            half = np.arctan2(1.3, distance)
            off = np.abs(azimuth - np.arctan2(middle[1], middle[0]))
            sights[(off < half) & (np.hypot(x, y) > distance - 2.0)] = Sight.OCCLUDED
    sights[(np.abs(azimuth) > np.radians(50)) | (x < 3.0)] = Sight.OUT_OF_VIEW
    return GroundCoverage((0.0, -14.0), cell, sights)


def _cracks(
    world: World, noise: Noise, rng: np.random.Generator, step: float
) -> tuple[_F64, _F64, _F64]:
    """Return short marks on the road that look like paint in every look."""
    parts = [np.zeros((0, 4))]
    for _ in range(rng.poisson(noise.cracks_per_km * world.length_m / 1000.0)):
        start = np.array([np.interp(rng.uniform(0, world.length_m), world.path[:, 3],
                                    world.path[:, k]) for k in range(3)])  # fmt: skip
        yaw = start[2] + rng.normal(0.0, 0.15)
        along = np.arange(0.0, rng.uniform(0.5, 4.0), step)
        begin = start[:2] + rng.uniform(-3, 10) * _left(start[2:3])[0]
        points = begin + along[:, None] * np.array([np.cos(yaw), np.sin(yaw)])
        parts.append(np.column_stack([points, np.zeros(len(along)), np.full(len(along), yaw)]))
    marks = np.concatenate(parts)
    return marks[:, :3], marks[:, 3], np.zeros(len(marks))


def _is_worn(at: _F64, worn: _F64) -> NDArray[np.bool_]:
    return worn[(at / 2.0).astype(np.int64) % len(worn)].astype(bool)


def _drift(rng: np.random.Generator, at: _F64, length_m: float) -> _F64:
    """Return a slow random walk that comes back (Ornstein-Uhlenbeck) with a spread of 1."""
    keep = np.exp(-_LOOK_EVERY_M / length_m)
    values = np.zeros(len(at))
    values[0] = rng.standard_normal()
    for k in range(1, len(at)):
        values[k] = keep * values[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal()
    return values


def _left(yaw: _F64) -> _F64:
    return np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)


def _matrix(x: float, y: float, yaw: float) -> _F64:
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix


def _to_base(points: _F64, pose: _F64) -> _F64:
    matrix = _matrix(*pose)
    base: _F64 = (points - matrix[:3, 3]) @ matrix[:3, :3]
    return base


def distances(points: _F64) -> _F64:
    steps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
