"""Rays of the synthetic LiDARs against surfaces that are computed in another way."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.lidar import LidarScan
from percept.datasets.synthetic.primitives import Kind, Primitive
from percept.datasets.synthetic.shapes import DETECTABLE

Points = NDArray[np.float64]

REACH_M = 140.0


def signed_distance(primitive: Primitive, points: Points) -> Points:
    """Distance (N,) to a primitive's surface, negative inside; to first order if curved."""
    local = (points - primitive.centre) @ primitive.rotation
    if primitive.kind is Kind.BOX:
        over = np.abs(local) - primitive.size
        outside = np.linalg.norm(np.maximum(over, 0), axis=1)
        return np.asarray(outside + np.minimum(over.max(axis=1), 0))
    if primitive.kind is Kind.ELLIPSOID:
        scaled = local / primitive.size
        level = (scaled**2).sum(axis=1) - 1
        steep = np.linalg.norm(2 * scaled / primitive.size, axis=1)
        return np.asarray(level / np.maximum(steep, 1e-9))
    r0, r1, half = primitive.size
    lean = (r1 - r0) / (2 * half)
    radius = np.hypot(local[:, 0], local[:, 1])
    mantle = (radius - (r0 + r1) / 2 - lean * local[:, 2]) / np.hypot(1, lean)
    return np.asarray(np.maximum(mantle, np.abs(local[:, 2]) - half))


def distance_to_shape(placed: Placed, points_object: Points) -> Points:
    """Distance (N,) to the outside of an object: of the nearest of its primitives."""
    apart = [signed_distance(p, points_object) for p in placed.shape.primitives]
    return np.asarray(np.min(apart, axis=0))


def everything(drive: Drive, time_s: float, x_m: float) -> dict[int, Placed]:
    heads = [signal.head for signal in drive.world.signals(x_m, REACH_M)]
    return {o.object_id: o for o in [*drive.world.objects(time_s, x_m, REACH_M), *heads]}


def points_map(drive: Drive, sensor: int, scan: LidarScan) -> Points:
    """Returns in the map, each through the exact pose at its own time."""
    times_s = drive.ego.seconds(scan.stamp_ns + scan.offset_ns)
    poses = drive.ego.poses(times_s) @ drive.lidars[sensor].T_base_sensor.matrix
    turned = np.einsum("nij,nj->ni", poses[:, :3, :3], scan.points_sensor)
    return np.asarray(turned + poses[:, :3, 3])


def into_object(drive: Drive, placed: Placed, points: Points, times_s: Points) -> Points:
    """Map points (N, 3) at times (N,) into the frame of an object that moves."""
    x = placed.x_m + placed.vx_mps * times_s
    z = drive.world.profile.ground(x, placed.y_m) + placed.z_m
    apart = points - np.column_stack([x, np.full(len(x), placed.y_m), z])
    cos, sin = np.cos(placed.yaw_rad), np.sin(placed.yaw_rad)
    return np.asarray(apart @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]))


@pytest.fixture(scope="module")
def drive() -> Drive:
    return Drive(DriveConfig(seed=3, seconds=1.0, noise=0.0, cameras=()))


@pytest.mark.parametrize("sensor", range(4))
def test_exact_returns_lie_on_the_surfaces(drive: Drive, sensor: int) -> None:
    scan = drive.scan(sensor, 4)
    assert len(scan.points_sensor) == scan.rays
    points = points_map(drive, sensor, scan)
    times_s = drive.ego.seconds(scan.stamp_ns + scan.offset_ns)
    known = everything(drive, float(drive.ego.seconds(scan.stamp_ns)), float(points[0, 0]))
    profile = drive.world.profile
    on_ground = scan.object_ids == -1
    over = points[on_ground, 2] - profile.height(points[on_ground, 0])
    beside = np.abs(points[on_ground, 1])
    flat = np.abs(over - np.where(beside > 10.2, 0.15, 0.0))
    on_kerb = (np.abs(beside - 10.2) < 1e-6) & (over > -1e-6) & (over < 0.15 + 1e-6)
    assert np.where(on_kerb, 0, flat).max() < 1e-6
    assert np.unique(scan.object_ids).size > 10
    for identity in np.unique(scan.object_ids[~on_ground]):
        mine = scan.object_ids == identity
        placed = known[int(identity)]
        local = into_object(drive, placed, points[mine], times_s[mine])
        assert np.abs(distance_to_shape(placed, local)).max() < 1e-6, placed.shape.label


@pytest.mark.parametrize("sensor", range(4))
def test_nothing_lies_before_a_return_and_none_is_missing(drive: Drive, sensor: int) -> None:
    """Walk along some rays: they stay outside of all solids, and stop where they must."""
    model = dataclasses.replace(drive.lidars[sensor], azimuth_steps=60)
    coarse = Drive(drive.config)
    coarse.lidars = tuple(model for _ in coarse.lidars)
    scan = coarse.scan(sensor, 2)
    azimuths, elevations = model.azimuths_rad(), model.elevations_rad
    ranges = np.full((len(azimuths), len(elevations)), np.nan)
    column = np.searchsorted(model.offsets_ns(), scan.offset_ns)
    ranges[column, scan.ring] = np.linalg.norm(scan.points_sensor, axis=1)
    middle_s = float(coarse.ego.seconds(scan.stamp_ns))
    origin_x = float(coarse.ego.poses(np.array([middle_s]))[0, 0, 3])
    known = list(everything(coarse, middle_s, origin_x).values())
    for c in range(0, len(azimuths), 3):
        for b in range(0, len(elevations), 5):
            free = np.nan_to_num(ranges[c, b], nan=model.max_range_m) - 1e-6
            along = np.arange(0.02, free, 0.1)
            el, az = elevations[b], azimuths[c]
            ray = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
            times_s = np.full(len(along), coarse.ego.seconds(scan.stamp_ns + model.offsets_ns()[c]))
            pose = coarse.ego.poses(times_s[:1])[0] @ model.T_base_sensor.matrix
            path = (along[:, None] * ray) @ pose[:3, :3].T + pose[:3, 3]
            assert (path[:, 2] >= coarse.world.profile.ground(path[:, 0], path[:, 1])).all()
            for placed in known:
                local = into_object(coarse, placed, path, times_s)
                near = np.linalg.norm(local - placed.shape.middle, axis=1) < placed.shape.radius_m
                if near.any():
                    assert distance_to_shape(placed, local[near]).min() > -1e-6


def test_boxes_contain_their_returns_and_are_tight(drive: Drive) -> None:
    scan = drive.scan(0, 5)
    points = points_map(drive, 0, scan)
    times_s = drive.ego.seconds(scan.stamp_ns + scan.offset_ns)
    seen = set()
    for placed in everything(drive, 0.5, float(points[0, 0])).values():
        mine = scan.object_ids == placed.object_id
        shape = placed.shape
        if shape.label not in DETECTABLE or not mine.any():
            continue
        local = into_object(drive, placed, points[mine], times_s[mine])
        half = np.array([shape.length_m, shape.width_m, shape.height_m]) / 2
        assert (np.abs(local - [0, 0, half[2]]) <= half + 1e-6).all()
        assert np.abs(shape.middle - [0, 0, half[2]]).max() < 1e-9
        seen.add(shape.label)
    assert {"car", "truck", "pedestrian", "barrel", "sign"} <= seen


def test_points_fit_only_with_their_own_times(drive: Drive) -> None:
    """Still walls seen at the ends of a scan are centimetres off when motion is ignored."""
    scan = drive.scan(0, 5)
    exact = points_map(drive, 0, scan)
    frozen = points_map(drive, 0, dataclasses.replace(scan, offset_ns=0 * scan.offset_ns))
    early = scan.offset_ns < -40_000_000
    moved = np.linalg.norm(frozen - exact, axis=1)
    expected_m = 9.0 * np.abs(scan.offset_ns) * 1e-9
    assert np.median(moved[early]) == pytest.approx(np.median(expected_m[early]), rel=0.1)
    assert moved[np.abs(scan.offset_ns) < 100_000].max() < 2e-3
    assert scan.offset_ns.min() < -49_000_000
    assert scan.offset_ns.max() > 49_000_000


def test_moving_objects_move_during_a_scan(drive: Drive) -> None:
    """An oncoming car is where its own time puts it, not where the stamp does."""
    scan = drive.scan(0, 5)
    points = points_map(drive, 0, scan)
    times_s = drive.ego.seconds(scan.stamp_ns + scan.offset_ns)
    checked = 0
    for placed in everything(drive, 0.5, float(points[0, 0])).values():
        mine = (scan.object_ids == placed.object_id) & (np.abs(scan.offset_ns) > 20_000_000)
        if abs(placed.vx_mps) < 6 or mine.sum() < 20:
            continue
        at_stamp = into_object(
            drive, placed, points[mine], np.full(mine.sum(), drive.ego.seconds(scan.stamp_ns))
        )
        assert np.abs(distance_to_shape(placed, at_stamp)).max() > 0.05
        assert (
            np.abs(
                distance_to_shape(placed, into_object(drive, placed, points[mine], times_s[mine]))
            ).max()
            < 1e-6
        )
        checked += 1
    assert checked >= 2


def test_noise_has_the_stated_spread_and_drops_weak_returns() -> None:
    exact = Drive(DriveConfig(seed=3, seconds=0.2, noise=0.0, cameras=())).scan(0, 0)
    noisy = Drive(DriveConfig(seed=3, seconds=0.2, noise=1.0, cameras=())).scan(0, 0)
    assert noisy.rays == exact.rays
    assert 0.9 * exact.rays < len(noisy.points_sensor) < 0.995 * exact.rays

    def by_ray(scan: LidarScan) -> dict[tuple[int, int], float]:
        reach = np.linalg.norm(scan.points_sensor, axis=1)
        keys = zip(scan.offset_ns.tolist(), scan.ring.tolist(), strict=True)
        return dict(zip(keys, reach.tolist(), strict=True))

    truth = by_ray(exact)
    error = np.array([reach - truth[key] for key, reach in by_ray(noisy).items()])
    assert abs(error.mean()) < 1e-3
    assert error.std() == pytest.approx(0.02, rel=0.05)
    lost = set(truth) - set(by_ray(noisy))
    assert np.mean([truth[key] for key in lost]) > 1.5 * np.mean(list(truth.values()))


def test_retro_reflectors_are_brighter_than_any_diffuser(drive: Drive) -> None:
    scans = [drive.scan(0, k) for k in (0, 5, 9)]
    known = everything(drive, 0.5, 24.0)
    by_label: dict[str, list[float]] = {}
    for scan in scans:
        for identity, value in zip(scan.object_ids.tolist(), scan.intensity.tolist(), strict=True):
            label = known[identity].shape.label if identity in known else "ground"
            by_label.setdefault(label, []).append(value)
    assert max(by_label["building"]) < 100
    assert max(by_label["pedestrian"]) < 100
    for label in ("sign", "barrel", "barricade"):
        assert np.percentile(by_label[label], 90) > 200, label
