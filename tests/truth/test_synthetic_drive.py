"""The synthetic drive as a whole: the same every time, and its tables say what the log shows."""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from percept.core.clock import NS_PER_MS
from percept.core.errors import UsageError
from percept.core.rig import load_rig
from percept.core.samples import (
    CameraImage,
    CameraInfo,
    GnssFix,
    ImuSample,
    OdometrySample,
    PointCloud,
    Sample,
    TransformSample,
)
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.synthetic.drive import (
    MAP_ORIGIN,
    START_NS,
    Drive,
    DriveConfig,
    generate_drive,
)
from percept.datasets.synthetic.navigation import Navigation
from percept.datasets.synthetic.sensor_rig import T_BASE_GNSS
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.truth import light_rows
from percept.datasets.write import LogFormat

SMALL = DriveConfig(seed=5, seconds=0.5, cameras=(), beam_share=0.25)


def digest(samples: list[Sample]) -> str:
    """A hash of everything that the samples of a drive say."""
    state = hashlib.sha256()
    for sample in samples:
        state.update(f"{sample.topic} {sample.stamp_ns} {sample.log_time_ns}".encode())
        if isinstance(sample, PointCloud):
            state.update(sample.points_xyz.tobytes())
            for column in (sample.intensity, sample.offset_ns, sample.ring):
                assert column is not None
                state.update(column.tobytes())
        elif isinstance(sample, CameraImage):
            state.update(sample.pixels.tobytes())
        elif isinstance(sample, ImuSample):
            state.update(sample.linear_acceleration_mps2.tobytes())
        elif isinstance(sample, GnssFix):
            state.update(f"{sample.latitude_deg} {sample.longitude_deg}".encode())
        elif isinstance(sample, OdometrySample | TransformSample):
            state.update(sample.T_frame_child.matrix.tobytes())
    return state.hexdigest()


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A written drive without noise."""
    out = tmp_path_factory.mktemp("drive") / "exact"
    generate_drive(SMALL.model_copy(update={"noise": 0.0, "seconds": 1.0}), out)
    return out


def test_the_same_seed_gives_the_same_samples() -> None:
    config = SMALL.model_copy(update={"cameras": ("cam_front",), "image_size": (96, 64)})
    first, again = (digest(list(Drive(config).samples())) for _ in range(2))
    other = digest(list(Drive(config.model_copy(update={"seed": 6})).samples()))
    assert first == again
    assert other != first


@pytest.mark.parametrize("log_format", ["mcap", "rosbag1", "rosbag2"])
def test_every_format_carries_the_same_samples(tmp_path: Path, log_format: LogFormat) -> None:
    summary = generate_drive(SMALL, tmp_path / "out", log_format)
    with open_recording(summary.log) as recording:
        found = list(recording.samples())
        assert not recording.losses
    made = list(Drive(SMALL).samples())
    assert digest([s for s in found if isinstance(s, PointCloud)]) == digest(
        [s for s in made if isinstance(s, PointCloud)]
    )
    assert sum(summary.counts.values()) == len(made) == len(found)
    log_times = [s.log_time_ns for s in made]
    assert log_times == sorted(log_times)
    assert all(s.stamp_ns <= s.log_time_ns for s in made)


def test_the_written_rig_is_the_exact_one(exact: Path) -> None:
    rig = load_rig(exact / "truth" / "rig.yaml")
    for model in Drive(SMALL).lidars:
        T_base_sensor = rig.sensors[model.name].T_base_sensor
        assert T_base_sensor is not None
        assert np.abs(T_base_sensor.matrix - model.T_base_sensor.matrix).max() < 1e-12


def test_the_default_drive_shows_every_class(tmp_path: Path) -> None:
    generate_drive(DriveConfig(cameras=()), tmp_path)
    table = pq.read_table(tmp_path / "truth" / "objects.parquet").to_pylist()
    assert set(DETECTABLE) == {row["label"] for row in table}
    for label in DETECTABLE:
        seen = {r["track_id"] for r in table if r["label"] == label and r["points"] >= 10}
        assert len(seen) >= 2, label
    assert len({row["stamp_ns"] for row in table}) == 30
    moving = {row["label"] for row in table if row["vx"]}
    assert {"car", "cyclist", "pedestrian"} <= moving
    still_cars = [r for r in table if r["label"] == "car" and not r["vx"]]
    assert still_cars


def test_truth_rows_count_the_returns_in_their_boxes(exact: Path) -> None:
    """Points in the logged clouds, put into the map by poses.parquet, against the boxes."""
    rows = pq.read_table(exact / "truth" / "objects.parquet").to_pylist()
    poses = pq.read_table(exact / "truth" / "poses.parquet").to_pydict()
    matrices = [
        Transform.from_quat_xyzw("map", "base_link", p, q).matrix
        for p, q in zip(
            zip(poses["x"], poses["y"], poses["z"], strict=True),
            zip(*(poses[k] for k in ("qx", "qy", "qz", "qw")), strict=True),
            strict=True,
        )
    ]
    trajectory = Trajectory("map", "base_link", np.array(poses["stamp_ns"]), np.array(matrices))
    rig = load_rig(exact / "rig.yaml")
    stamp_ns = rows[0]["stamp_ns"]
    points = []
    with open_recording(exact / "drive.mcap") as recording:
        for sample in recording.samples():
            if isinstance(sample, PointCloud) and abs(sample.stamp_ns - stamp_ns) < 20 * NS_PER_MS:
                assert sample.offset_ns is not None
                T_base_sensor = rig.sensors[sample.frame].T_base_sensor
                assert T_base_sensor is not None
                for offset in np.unique(sample.offset_ns):
                    T_map_base = trajectory.at(sample.stamp_ns + int(offset))
                    assert T_map_base is not None
                    part = sample.select(sample.offset_ns == offset)
                    points.append((T_map_base @ T_base_sensor).apply(part.points_xyz))
    cloud = np.concatenate(points)
    checked = 0
    for row in rows:
        if row["stamp_ns"] != stamp_ns or row["vx"] or row["points"] < 5:
            continue
        apart = cloud - [row["x"], row["y"], row["z"]]
        cos, sin = np.cos(row["yaw_rad"]), np.sin(row["yaw_rad"])
        local = apart @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        half = np.array([row["length"], row["width"], row["height"]]) / 2
        inside = (np.abs(local) <= half + 1e-4).all(axis=1)
        on_it = inside & (local[:, 2] > -half[2] + 0.12)
        assert inside.sum() >= row["points"], row["label"]
        assert on_it.sum() <= row["points"], row["label"]
        checked += 1
    assert checked >= 8


def test_the_road_has_slopes() -> None:
    drive = Drive(SMALL)
    x = np.arange(0.0, 480.0, 1.0)
    grades = np.diff(drive.world.profile.height(x))
    assert grades.max() > 0.02
    assert grades.min() < -0.02
    assert np.abs(grades).max() <= 0.05 + 1e-9
    poses = drive.ego.poses(np.linspace(0, 40, 400))
    climb = poses[:, 2, 0]
    assert climb.max() > 0.02
    assert climb.min() < -0.02


def test_exact_navigation_agrees_with_the_trajectory(exact: Path) -> None:
    """GNSS, odometry and IMU without noise, each by its own way back to the exact poses."""
    ego = Drive(SMALL).ego
    with open_recording(exact / "drive.mcap") as recording:
        samples = list(recording.samples())
    T_map_start = ego.poses(np.zeros(1))[0]
    odometry = [s for s in samples if isinstance(s, OdometrySample)]
    for sample in odometry:
        time_s = np.atleast_1d(ego.seconds(sample.stamp_ns))
        found = T_map_start @ sample.T_frame_child.matrix
        assert np.abs(found - ego.poses(time_s)[0]).max() < 1e-9
    first, last = odometry[0], odometry[-1]
    walked = last.T_frame_child.translation_m - first.T_frame_child.translation_m
    seconds = (last.stamp_ns - first.stamp_ns) / 1e9
    speeds = [float(np.linalg.norm(s.linear_velocity_mps)) for s in odometry]
    assert np.linalg.norm(walked) == pytest.approx(np.mean(speeds) * seconds, rel=2e-3)
    still = [s for s in samples if isinstance(s, ImuSample)]
    mean_up = np.mean([s.linear_acceleration_mps2[2] for s in still])
    assert mean_up == pytest.approx(9.80665, abs=0.3)
    fixes = [s for s in samples if isinstance(s, GnssFix)]
    earth_m = 6_371_000.0 * np.pi / 180
    east = (fixes[-1].longitude_deg - fixes[0].longitude_deg) * earth_m
    east *= np.cos(np.radians(MAP_ORIGIN.latitude_deg))
    times_s = ego.seconds(np.array([fixes[0].stamp_ns, fixes[-1].stamp_ns]))
    moved = np.diff(ego.poses(times_s)[:, 0, 3])[0]
    assert east == pytest.approx(moved, rel=5e-3)


def test_exact_motion_is_told_in_the_axes_and_at_the_places_of_the_sensors() -> None:
    ego = Drive(SMALL).ego
    navigation = Navigation(ego, MAP_ORIGIN, seed=7, noise=0.0)
    moving = [s for s in navigation.odometry(5_000_000_000) if isinstance(s, OdometrySample)]
    velocities = np.array([s.linear_velocity_mps for s in moving])
    assert velocities[:, 0].min() > 6.0
    assert np.abs(velocities[:, 1]).max() < 0.01  # the vehicle points where it goes
    turning = [s for s in navigation.imu(5_000_000_000) if isinstance(s, ImuSample)]
    yaws = [np.arctan2(p[1, 0], p[0, 0]) for p in ego.poses(np.array([0.0, 5.0]))]
    rates = [s.angular_velocity_radps[2] for s in turning]
    assert np.mean(rates) * 5.0 == pytest.approx(yaws[1] - yaws[0], abs=1e-3)
    for fix in navigation.gnss(5_000_000_000):
        assert isinstance(fix, GnssFix)
        T_map_base = ego.poses(np.atleast_1d(ego.seconds(fix.stamp_ns)))[0]
        antenna = T_map_base @ T_BASE_GNSS.matrix[:, 3]
        assert fix.altitude_m - MAP_ORIGIN.altitude_m == pytest.approx(antenna[2], abs=0.005)


def test_camera_topics_carry_images_and_intrinsics(tmp_path: Path) -> None:
    config = DriveConfig(
        seed=1,
        seconds=0.2,
        cameras=("cam_front", "cam_rear"),
        image_size=(160, 100),
        beam_share=0.1,
    )
    summary = generate_drive(config, tmp_path)
    assert summary.counts["/cam_rear/image_raw/compressed"] == 2
    rig = load_rig(tmp_path / "rig.yaml")
    with open_recording(summary.log) as recording:
        for sample in recording.samples():
            if isinstance(sample, CameraImage):
                assert sample.pixels.shape == (100, 160, 3)
                assert sample.pixels.std() > 20
            elif isinstance(sample, CameraInfo):
                camera = rig.cameras()[sample.frame].pinhole()
                assert np.array_equal(camera.K, sample.K)


def test_the_map_carries_lanes_paint_stop_lines_and_lights(exact: Path) -> None:
    root = ET.parse(exact / "map.osm").getroot()  # noqa: S314  # written by this test
    tags = {
        element: {tag.get("k"): tag.get("v") for tag in element.iter("tag")}
        for element in (*root.iter("way"), *root.iter("relation"))
    }
    ways = {element.get("id"): element for element in root.iter("way")}
    places = {node.get("id"): node for node in root.iter("node")}
    relations = {element.get("id"): element for element in root.iter("relation")}
    lanelets = [r for r in relations.values() if tags[r]["type"] == "lanelet"]
    rules = [r for r in relations.values() if tags[r]["type"] == "regulatory_element"]
    assert len(lanelets) % 4 == 0
    assert rules
    for element in (*lanelets, *rules):
        for member in element.iter("member"):
            assert member.get("ref") in (ways if member.get("type") == "way" else relations)
    kinds = {(t["type"], t.get("subtype"), t.get("color")) for t in tags.values()}
    assert ("line_thin", "solid_solid", "yellow") in kinds
    assert ("line_thin", "dashed", "white") in kinds
    assert ("traffic_light", "red_yellow_green", None) in kinds
    for way, described in tags.items():
        if described["type"] == "stop_line":
            ends = [places[nd.get("ref")] for nd in way.iter("nd")]
            xs = {t.get("v") for end in ends for t in end.iter("tag") if t.get("k") == "local_x"}
            assert len(xs) == 1
    lights = pq.read_table(exact / "truth" / "lights.parquet").to_pylist()
    assert {str(row["light_id"]) for row in lights} <= set(ways)
    markings = json.loads((exact / "truth" / "markings.geojson").read_text(encoding="utf-8"))
    for feature in markings["features"]:
        assert str(feature["id"]) in ways
        longitude, latitude = feature["geometry"]["coordinates"][0]
        assert abs(latitude - MAP_ORIGIN.latitude_deg) < 0.01
        assert abs(longitude - MAP_ORIGIN.longitude_deg) < 0.02


def test_lights_in_the_truth_change_and_flash() -> None:
    config = DriveConfig(seed=0, seconds=6.0, cameras=("cam_front",), beam_share=0.1)
    drive = Drive(config)
    colours: dict[int, set[str]] = {}
    flashes: dict[int, list[bool]] = {}
    for stamp_ns in range(START_NS, START_NS + 6_000_000_000, 100_000_000):
        for row in light_rows(drive.world, drive.ego, stamp_ns, drive.cameras):
            colours.setdefault(row["light_id"], set()).add(row["state"])
            if row["flashing"]:
                flashes.setdefault(row["light_id"], []).append(row["lit"])
            towards_east = row["yaw_rad"] > 0
            assert not (row["cameras"] and not towards_east)
    assert any(len(found) > 1 for found in colours.values())
    assert flashes
    assert all(0.4 < np.mean(lit) < 0.7 for lit in flashes.values() if len(lit) > 30)


def test_a_drive_that_cannot_be_made_is_refused() -> None:
    with pytest.raises(UsageError, match="too short for one scan"):
        Drive(DriveConfig(seconds=0.05))
    with pytest.raises(UsageError, match="no such camera 'cam_top'"):
        Drive(DriveConfig(cameras=("cam_top",)))


def test_noisy_navigation_has_the_stated_spread() -> None:
    drive = Drive(SMALL)
    navigation = Navigation(drive.ego, MAP_ORIGIN, seed=7, noise=1.0)
    exact = Navigation(drive.ego, MAP_ORIGIN, seed=7, noise=0.0)
    duration_ns = 60_000_000_000

    def heights(source: Navigation) -> list[float]:
        return [s.altitude_m for s in source.gnss(duration_ns) if isinstance(s, GnssFix)]

    def rates(source: Navigation) -> list[float]:
        return [
            float(s.angular_velocity_radps[2])
            for s in source.imu(duration_ns)
            if isinstance(s, ImuSample)
        ]

    error_m = np.subtract(heights(navigation), heights(exact))
    assert error_m.std() == pytest.approx(0.03, rel=0.15)
    assert abs(error_m.mean()) < 0.005
    error_radps = np.subtract(rates(navigation), rates(exact))
    assert error_radps.std() == pytest.approx(0.002, rel=0.1)
    assert 0 < abs(error_radps.mean()) < 0.004
    last = list(navigation.odometry(duration_ns))[-2]
    truth = list(exact.odometry(duration_ns))[-2]
    assert isinstance(last, OdometrySample)
    assert isinstance(truth, OdometrySample)
    drift_m = np.linalg.norm(last.T_frame_child.translation_m - truth.T_frame_child.translation_m)
    assert 0.05 < drift_m < 0.03 * np.linalg.norm(truth.T_frame_child.translation_m)
