"""Tracks and a moving vehicle in the view and in the messages, read back by other readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_images import make_image
from made_tracks import START_NS, STEP_NS, base_from_lidar, make_tracks, make_trajectory
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from percept.core.cameras import make_camera
from percept.core.errors import GeometryError
from percept.core.health import stream_health
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, matrix_from_quat_xyzw
from percept.export.overlay import OverlayWriter
from percept.export.view import ViewCamera, ViewWriter
from percept.export.view.layout import VEHICLE, VEHICLE_PATH
from percept.lidar.result import ScanResult

MakeScan = Callable[..., ScanResult]


def _chunks(path: Path, entity: str) -> Iterator[dict[str, list[Any]]]:
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            yield chunk.to_record_batch().to_pydict()


def _rows(path: Path, entity: str) -> list[dict[str, Any]]:
    """Return what is drawn in an entity, by time."""
    rows = (
        dict(zip(columns, values, strict=True))
        for columns in _chunks(path, entity)
        for values in zip(*columns.values(), strict=True)
    )
    return sorted(rows, key=lambda row: row["bag_time"])


def _matrices(path: Path, entity: str) -> list[NDArray[np.float64]]:
    found = []
    for row in _rows(path, entity):
        if row.get("Transform3D:translation") is None:
            continue
        matrix = np.eye(4)
        matrix[:3, :3] = matrix_from_quat_xyzw(row["Transform3D:quaternion"][0])
        matrix[:3, 3] = row["Transform3D:translation"][0]
        found.append(matrix)
    return found


def _camera() -> ViewCamera:
    K = np.array([[400.0, 0, 400], [0, 400, 225], [0, 0, 1]])
    T_base_camera = Transform.from_quat_xyzw(
        "base_link", "front_optical", [1.5, 0, 1.2], [-0.5, 0.5, -0.5, 0.5]
    )
    camera = make_camera("pinhole", (800, 450), K, [])
    return ViewCamera(name="front", camera=camera, T_root_camera=T_base_camera)


class TestMotion:
    """Whenever the poses come, each scan is drawn where the vehicle was at its stamp."""

    @pytest.mark.parametrize("when", ["before", "after"])
    def test_a_scan_stays_where_it_was_made(
        self, make_scan: MakeScan, tmp_path: Path, when: str
    ) -> None:
        path, poses = tmp_path / "view.rrd", make_trajectory()
        T_base_lidar = base_from_lidar()
        with ViewWriter(path, run_id="r", T_root_frames=[T_base_lidar]) as view:
            if when == "before":
                view.add_poses(poses)
            for i in range(4):
                view.add(i, make_scan(i))
            if when == "after":
                view.add_poses(poses)
        moved = _matrices(path, "/world/lidar_top/top")
        assert len(moved) == 4
        for i, matrix in enumerate(moved):
            # The entity hangs below that of the frame, which has its place in the vehicle.
            pose = poses.at(START_NS + i * STEP_NS)
            assert pose is not None
            expected = pose.matrix @ T_base_lidar.matrix
            assert np.allclose(T_base_lidar.matrix @ matrix, expected, atol=1e-5)
        vehicle = _matrices(path, f"/{VEHICLE}")
        assert len(vehicle) == len(poses)
        assert np.allclose(vehicle[7], poses.matrices[7], atol=1e-5)

    def test_a_resumed_session_knows_what_was_drawn(
        self, make_scan: MakeScan, tmp_path: Path
    ) -> None:
        path, poses = tmp_path / "view.rrd", make_trajectory()
        camera = _camera()
        options: dict[str, Any] = {
            "run_id": "r", "T_root_frames": [base_from_lidar()], "cameras": [camera],
            "models": ("near", "far"), "images_expected": 2,
        }  # fmt: skip

        def interrupted() -> None:
            with ViewWriter(path, **options) as view:
                view.add(0, make_scan(0))
                view.add_image(make_image(0))
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()
        with ViewWriter(path, **options, resume=True) as view:
            view.recall(make_scan(0).detections)
            view.recall_image(replace(make_image(0), image=None))
            view.add(1, make_scan(1))
            view.add_poses(poses)
        assert len(_matrices(path, "/world/lidar_top/top")) == 2
        assert len(_matrices(path, "/world/front_optical/front")) == 1
        assert len(_rows(path, "/world/lidar_top/top/cloud")) == 2

    def test_poses_of_a_sensor_move_the_vehicle(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path, poses = tmp_path / "view.rrd", make_trajectory()
        T_base_lidar = base_from_lidar()
        of_lidar = Trajectory(
            "map", "lidar_top", poses.stamps_ns, poses.matrices @ T_base_lidar.matrix
        )
        with ViewWriter(path, run_id="r", T_root_frames=[T_base_lidar]) as view:
            view.add_poses(of_lidar)
            view.add(0, make_scan(3))
        assert np.allclose(_matrices(path, f"/{VEHICLE}")[3], poses.matrices[3], atol=1e-5)

    def test_images_move_too(self, tmp_path: Path) -> None:
        path, poses = tmp_path / "view.rrd", make_trajectory()
        camera = _camera()
        T_base_camera = camera.T_root_camera
        assert T_base_camera is not None
        with ViewWriter(
            path, run_id="r", frames_expected=0, cameras=[camera], models=("near", "far"),
            images_expected=2,
        ) as view:  # fmt: skip
            view.add_poses(poses)
            for number in range(2):
                view.add_image(make_image(number))
        moved = _matrices(path, "/world/front_optical/front")
        assert len(moved) == 2
        assert np.allclose(
            T_base_camera.matrix @ moved[1], poses.matrices[1] @ T_base_camera.matrix, atol=1e-5
        )

    def test_scans_without_a_pose_are_named(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        with ViewWriter(path, run_id="r", T_root_frames=[base_from_lidar()]) as view:
            view.add_poses(make_trajectory(3))
            for i in range(6):
                view.add(i, make_scan(i))
        assert len(_matrices(path, "/world/lidar_top/top")) == 3
        notes = [row["TextLog:text"][0] for row in _rows(path, "/notes")]
        assert sum("has no pose at times" in note for note in notes) == 1

    def test_the_path_is_broken_at_a_gap(self, tmp_path: Path) -> None:
        path, poses = tmp_path / "view.rrd", make_trajectory(20)
        with ViewWriter(path, run_id="r") as view:
            view.add_poses(replace(poses, gaps_ns=poses.stamps_ns[[[4, 5]]]))
        chunks = (c for c in RrdReader(path).stream() if c.entity_path == f"/{VEHICLE_PATH}")
        strips = next(chunks).to_record_batch().to_pydict()["LineStrips3D:strips"][0]
        assert [len(strip) for strip in strips] == [5, 15]

    def test_poses_that_do_not_fit_are_refused(self, tmp_path: Path) -> None:
        poses = make_trajectory()
        other = Trajectory("map", "trailer", poses.stamps_ns, poses.matrices)
        with ViewWriter(tmp_path / "v.rrd", run_id="r", T_root_frames=[base_from_lidar()]) as view:
            with pytest.raises(GeometryError, match="'trailer', which is not connected"):
                view.add_poses(other)
            view.add_poses(poses)
            with pytest.raises(GeometryError, match="one trajectory"):
                view.add_poses(poses)


class TestTracks:
    def write(self, path: Path, steps: range, *, expected: int = 60, **options: Any) -> Path:
        with ViewWriter(path, run_id="r", frames_expected=expected, **options) as view:
            view.add_poses(make_trajectory())
            for step in steps:
                view.add_tracks(make_tracks(step))
        return path

    def test_objects_of_single_scans_are_hidden(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        for with_tracks in (False, True):
            with ViewWriter(path, run_id="r", T_root_frames=[base_from_lidar()]) as view:
                view.add(0, make_scan(0))
                if with_tracks:
                    view.add_tracks(make_tracks(1, frame_id="base_link"))
            reader = RrdReader(path)
            layouts = [c.entity_path for s in reader.blueprints() for c in reader.stream(store=s)]
            hidden = [at for at in layouts if "/overrides/world/lidar_top/top/boxes" in at]
            assert len(hidden) == with_tracks
        assert len(_rows(path, "/world/base_link/tracks/full")) == 1  # without poses: its own frame

    def test_unknown_tracks_are_apart(self, tmp_path: Path) -> None:
        tracks = replace(make_tracks(0), labels=("unknown", "car", "unknown"))
        with ViewWriter(tmp_path / "v.rrd", run_id="r") as view:
            view.add_tracks(tracks)
        labels = {
            part: _rows(tmp_path / "v.rrd", f"/world/map/tracks/{part}")[0]["Boxes3D:labels"]
            for part in ("full", "unknown", "trial")
        }
        assert labels == {
            "full": ["2 car 0.75"], "unknown": ["1 unknown 0.90"], "trial": ["3 unknown 0.60"],
        }  # fmt: skip

    def test_full_and_trial_tracks_are_apart(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "view.rrd", range(3))
        full = _rows(path, "/world/map/tracks/full")
        trial = _rows(path, "/world/map/tracks/trial")
        assert (len(full), len(trial)) == (3, 3)
        assert full[1]["Boxes3D:labels"] == ["1 car 0.90", "2 pedestrian 0.75"]
        given = make_tracks(1)
        assert np.allclose(full[1]["Boxes3D:centers"], given.boxes_m[:2, :3], atol=1e-5)
        assert np.allclose(trial[1]["Boxes3D:centers"], given.boxes_m[2:, :3], atol=1e-5)
        arrows = _rows(path, "/world/map/tracks/velocities")[1]
        assert arrows["Arrows3D:vectors"] == [[2, 0, 0], [3, 0, 0]]

    def test_a_trail_has_the_last_five_seconds(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "view.rrd", range(100), expected=100)
        trail = np.array(_rows(path, "/world/map/tracks/trails")[80]["LineStrips3D:strips"][0])
        assert trail[-1, 0] == pytest.approx(10 + 2 * 8.0)
        assert trail[0, 0] == pytest.approx(10 + 2 * 3.0)
        assert len(trail) == 11 + 1

    def test_long_full_tracks_are_plotted(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "view.rrd", range(60))
        names = {
            chunk.entity_path for chunk in RrdReader(path).stream()
            if chunk.entity_path.startswith("/plots/tracks/")
        }  # fmt: skip
        assert names == {"/plots/tracks/1/car", "/plots/tracks/2/pedestrian"}
        values = [row["Scalars:scalars"][0] for row in _rows(path, "/plots/tracks/1/car")]
        assert values == pytest.approx([0.9] * 12)  # one every half second

    def test_moments_are_thinned_to_the_budget(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "v.rrd", range(60), budget_bytes=20 * 12_000)
        assert len(_rows(path, "/world/map/tracks/full")) == 20
        notes = [row["TextLog:text"][0] for row in _rows(path, "/notes")]
        assert "Of the tracks one moment in 3 is drawn." in notes

    def test_memory_is_flat(self, tmp_path: Path) -> None:
        path = tmp_path / "view.rrd"
        with ViewWriter(path, run_id="r") as view:
            for step in range(600):
                tracks = make_tracks(step, count=4)
                object.__setattr__(tracks, "ids", tracks.ids + 4 * step)
                view.add_tracks(tracks)
            assert len(view._tracks._lives) <= 300
        assert len(_rows(path, "/world/map/tracks/full")) > 0


class TestHealth:
    def test_a_lane_says_when_a_sensor_was_late(self, tmp_path: Path) -> None:
        stamps = START_NS + STEP_NS * np.array([0, 1, 2, 3, 20, 21, 22])
        span = (START_NS, START_NS + 23 * STEP_NS)
        with ViewWriter(tmp_path / "v.rrd", run_id="r") as view:
            view.add_health({"top": stream_health(stamps, span)})
        lane = _rows(tmp_path / "v.rrd", "/states/health/top")
        assert [row["StateChange:state"][0] for row in lane] == ["in time", "late", "in time"]
        late = np.datetime64(lane[1]["bag_time"], "ns").astype(np.int64)
        assert late == START_NS + 6 * STEP_NS  # three intervals after the last one
        notes = [row["TextLog:text"][0] for row in _rows(tmp_path / "v.rrd", "/notes")]
        assert "top is late: silent" in notes


class TestOverlay:
    def test_full_tracks_have_ids(self, tmp_path: Path) -> None:
        path = tmp_path / "overlay.mcap"
        with OverlayWriter(path) as overlay:
            overlay.add_poses(make_trajectory(), log_offset_ns=7)
            for step in range(3):
                overlay.add_tracks(make_tracks(step), START_NS + step)
            overlay.add_tracks(make_tracks(3, count=0), START_NS + 3)
        read: dict[str, list[Any]] = {}
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for schema, channel, message, ros in reader.iter_decoded_messages():
                assert schema is not None
                read.setdefault(f"{channel.topic} {schema.name}", []).append((message, ros))
        tracks = read["/percept/tracks vision_msgs/msg/Detection3DArray"]
        assert [len(ros.detections) for _, ros in tracks] == [2, 2, 2, 0]
        message, array = tracks[1]
        assert (message.log_time, message.publish_time) == (START_NS + 1, START_NS + STEP_NS)
        assert array.header.frame_id == "map"
        assert [found.id for found in array.detections] == ["1", "2"]
        assert array.detections[0].results[0].hypothesis.class_id == "car"
        _, markers = read["/percept/tracks/markers visualization_msgs/msg/MarkerArray"][1]
        assert [m.ns for m in markers.markers[1:]] == ["boxes", "labels"] * 2 + ["velocities"] * 2
        assert markers.markers[2].text == "1 car 0.90"
        assert markers.markers[5].scale.x == pytest.approx(2.0)
        message, tf = read["/tf tf2_msgs/msg/TFMessage"][5]
        transform = tf.transforms[0]
        assert message.log_time == START_NS + 5 * STEP_NS + 7
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base_link")
        assert transform.transform.translation.x == make_trajectory().matrices[5, 0, 3]
