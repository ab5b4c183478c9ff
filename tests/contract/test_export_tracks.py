"""What a run says of tracks, poses and scans: tables that give back what went in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_images import make_image
from made_tracks import STEP_NS, make_tracks, make_trajectory

from percept.core.errors import InputError
from percept.core.results import Detections3D, Tracks
from percept.core.trajectory import Trajectory
from percept.export import table_reader
from percept.export.finished import finished_frame
from percept.export.image_table import IMAGES_2D, image_rows
from percept.export.journal import ImageJournal
from percept.export.pose_table import POSES, pose_rows, read_poses
from percept.export.run_detections import read_detections_2d, read_detections_3d
from percept.export.scan_table import SCANS_3D, read_scans, scan_rows
from percept.export.tables import (
    DETECTIONS_2D,
    DETECTIONS_3D,
    detections_2d_table,
    detections_3d_table,
    write_parquet,
)
from percept.export.track_table import TRACKS, read_tracks, track_rows
from percept.lidar.result import ScanResult

MakeScan = Callable[..., ScanResult]


def _with(path: Path, column: str, values: pa.Array | None) -> Path:
    """Replace a column of a table, or take it away."""
    table = pq.read_table(path)
    at = table.schema.get_field_index(column)
    table = table.remove_column(at)
    pq.write_table(table if values is None else table.add_column(at, column, values), path)
    return path


class TestTracks:
    def write(self, folder: Path, moments: list[Tracks]) -> Path:
        path = folder / "tracks.parquet"
        write_parquet(path, TRACKS, map(track_rows, moments))
        return path

    def test_columns_are_those_of_the_interface(self) -> None:
        rows = track_rows(make_tracks(4))
        assert ", ".join(rows.schema.names) == (
            "stamp_ns, track_id, frame_id, x, y, z, length, width, height, yaw_rad, vx, vy, "
            "label, label_probability, state, position_sd_m, velocity_sd_mps, observed, score"
        )
        assert [row["state"] for row in rows.to_pylist()] == ["full", "full", "trial"]
        assert track_rows(make_tracks(0, count=0)).schema == TRACKS

    def test_gives_back_what_went_in(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(table_reader, "_ROWS_PER_BATCH", 4)  # moments that lie across batches
        moments = [make_tracks(step, count=step % 5) for step in range(12)]
        read = list(read_tracks(self.write(tmp_path, moments)))
        expected = [tracks for tracks in moments if len(tracks)]
        assert len(read) == len(expected) == 9
        for found, tracks in zip(read, expected, strict=True):
            assert (found.stamp_ns, found.frame_id) == (tracks.stamp_ns, tracks.frame_id)
            assert (found.labels, found.states) == (tracks.labels, tracks.states)
            for name in (
                "ids", "boxes_m", "velocities_mps", "label_probabilities", "position_sd_m",
                "velocity_sd_mps", "observed", "scores",
            ):  # fmt: skip
                given, back = getattr(tracks, name), getattr(found, name)
                assert back.dtype == given.dtype
                assert np.array_equal(back, given, equal_nan=name == "scores")

    def test_no_track_at_all(self, tmp_path: Path) -> None:
        assert list(read_tracks(self.write(tmp_path, []))) == []

    @pytest.mark.parametrize(
        ("column", "values", "said"),
        [
            ("vx", None, "has no column vx"),
            ("track_id", pa.array(["1", "2", "3"]), "column track_id is string, not int64"),
            ("observed", pa.array([1, 0, 1]), "column observed is int64, not bool"),
            ("x", pa.array([1.0, None, 3.0]), "column x has empty cells"),
            ("x", pa.array([1.0, np.inf, 3.0]), "column x holds numbers that are not finite"),
            ("stamp_ns", pa.array([3, 2, 4]), "its rows are not in the order of stamp_ns"),
            ("frame_id", pa.array(["map", "map", "odom"]), "has several frames"),
            ("track_id", pa.array([1, 2, 2**63], pa.uint64()), "cannot be read as Parquet"),
        ],
    )  # fmt: skip
    def test_what_does_not_fit_is_said(
        self, tmp_path: Path, column: str, values: pa.Array | None, said: str
    ) -> None:
        path = _with(self.write(tmp_path, [make_tracks(0)]), column, values)
        with pytest.raises(InputError, match=said) as raised:
            list(read_tracks(path))
        assert str(raised.value).startswith(str(path))
        assert "\n" not in str(raised.value)

    def test_other_writers_types_are_taken(self, tmp_path: Path) -> None:
        path = self.write(tmp_path, [make_tracks(0)])
        _with(path, "x", pa.array([1, 2, 3], pa.int32()))
        _with(path, "label", pa.array(["car", "deer", "car"]).dictionary_encode())
        (tracks,) = read_tracks(path)
        assert tracks.boxes_m[:, 0].tolist() == [1, 2, 3]
        assert tracks.labels == ("car", "deer", "car")

    def test_damaged_files(self, tmp_path: Path) -> None:
        path = self.write(tmp_path, [make_tracks(step) for step in range(50)])
        whole = path.read_bytes()
        for damaged in (b"", b"PAR1", whole[:-20], b"x" * 400):
            path.write_bytes(damaged)
            with pytest.raises(InputError, match="cannot be read as Parquet"):
                list(read_tracks(path))
        path.unlink()
        with pytest.raises(InputError, match="there is no such table"):
            list(read_tracks(path))


class TestPoses:
    def write(self, folder: Path, trajectory: Trajectory) -> Path:
        path = folder / "poses.parquet"
        write_parquet(path, POSES, [pose_rows(trajectory)])
        return path

    def test_gives_back_what_went_in(self, tmp_path: Path) -> None:
        trajectory = make_trajectory()
        found = read_poses(self.write(tmp_path, trajectory))
        assert (found.target, found.source) == ("map", "base_link")
        assert np.array_equal(found.stamps_ns, trajectory.stamps_ns)
        assert np.abs(found.matrices - trajectory.matrices).max() < 1e-14

    def test_columns_are_those_of_the_interface(self) -> None:
        rows = pose_rows(make_trajectory())
        assert ", ".join(rows.schema.names) == (
            "stamp_ns, frame_id, child_frame_id, x, y, z, qx, qy, qz, qw, after_gap"
        )
        assert min(rows.column("qw").to_pylist()) >= 0

    @pytest.mark.parametrize(
        ("column", "values", "said"),
        [
            ("qw", None, "has no column qw"),
            ("child_frame_id", ["base_link", "imu"], "several frames"),
            ("stamp_ns", [5, 5], "must rise"),
            (("qx", "qy", "qz", "qw"), [0.0, 0.0], "no rotation"),
        ],
    )
    def test_what_does_not_fit_is_said(
        self, tmp_path: Path, column: Any, values: list[Any] | None, said: str
    ) -> None:
        path = self.write(tmp_path, make_trajectory(2))
        for name in (column,) if isinstance(column, str) else column:
            _with(path, name, None if values is None else pa.array(values))
        with pytest.raises(InputError, match=said) as raised:
            read_poses(path)
        assert str(raised.value).startswith(str(path))

    def test_gaps_stay_gaps(self, tmp_path: Path) -> None:
        whole = make_trajectory(20)
        gaps_ns = whole.stamps_ns[[[3, 4], [4, 5], [12, 13]]]
        trajectory = replace(whole, gaps_ns=gaps_ns)
        path = self.write(tmp_path, trajectory)
        found = read_poses(path)
        assert np.array_equal(found.gaps_ns, gaps_ns)
        assert found.at(int(gaps_ns[2].mean())) is None
        assert found.at(int(gaps_ns[1, 0])) is not None
        assert len(read_poses(_with(path, "after_gap", None)).gaps_ns) == 0

    def test_no_pose(self, tmp_path: Path) -> None:
        write_parquet(tmp_path / "p.parquet", POSES, [])
        with pytest.raises(InputError, match="holds no pose"):
            read_poses(tmp_path / "p.parquet")


class TestScans:
    def test_gives_back_what_went_in(self, make_scan: MakeScan, tmp_path: Path) -> None:
        path = tmp_path / "scans_3d.parquet"
        finished = [(finished_frame(i, make_scan(i, boxes=i)), i) for i in range(3)]
        write_parquet(path, SCANS_3D, [scan_rows(*scan) for scan in finished])
        assert ", ".join(pq.read_schema(path).names) == (
            "frame, stamp_ns, log_time_ns, sensor, frame_id, points, objects"
        )
        for (scan, objects), (given, count) in zip(read_scans(path), finished, strict=True):
            assert objects == count
            for name in SCANS_3D.names[:-1]:
                assert getattr(scan, name) == getattr(given, name)


class TestDetections3D:
    def write(self, folder: Path, scans: list[ScanResult]) -> None:
        frames = list(enumerate(scans))
        rows = [scan_rows(finished_frame(i, scan), len(scan.detections)) for i, scan in frames]
        write_parquet(folder / "scans_3d.parquet", SCANS_3D, rows)
        tables = [detections_3d_table(i, scan.detections) for i, scan in frames]
        write_parquet(folder / "detections_3d.parquet", DETECTIONS_3D, tables)

    def scans(self, make_scan: MakeScan) -> list[ScanResult]:
        """Return scans of two sensors, some empty, not in the order of their stamps."""
        steps = [0, 3, 1, 2, 7, 5, 4, 6]
        return [make_scan(s, boxes=s % 3, sensor=("top", "left")[s % 2]) for s in steps]

    def test_comes_by_stamp_with_the_empty_scans(
        self, make_scan: MakeScan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(table_reader, "_ROWS_PER_BATCH", 2)
        scans = self.scans(make_scan)
        self.write(tmp_path, scans)
        expected = sorted((scan.detections for scan in scans), key=lambda d: d.stamp_ns)
        found = list(read_detections_3d(tmp_path))
        assert [len(d) for d in found] == [0, 1, 2, 0, 1, 2, 0, 1]
        for given, back in zip(expected, found, strict=True):
            self.assert_same(given, back)

    def assert_same(self, given: Detections3D, back: Detections3D) -> None:
        assert (back.stamp_ns, back.sensor, back.frame_id, back.labels) == (
            given.stamp_ns, given.sensor, given.frame_id, given.labels,
        )  # fmt: skip
        for name in ("boxes_m", "confidences", "mean_intensity", "points"):
            assert np.array_equal(getattr(back, name), getattr(given, name), equal_nan=True)

    def test_tables_that_do_not_fit_together(self, make_scan: MakeScan, tmp_path: Path) -> None:
        scans = self.scans(make_scan)
        self.write(tmp_path, scans)
        listed = pq.read_table(tmp_path / "scans_3d.parquet")
        pq.write_table(listed.slice(0, 6), tmp_path / "scans_3d.parquet")
        with pytest.raises(InputError, match="boxes of frame 6, which the run has not"):
            list(read_detections_3d(tmp_path))
        _with(tmp_path / "scans_3d.parquet", "objects", pa.array([0, 0, 1, 1, 1, 2]))
        with pytest.raises(InputError, match="has 2 boxes of frame 3, which has 1"):
            list(read_detections_3d(tmp_path))
        (tmp_path / "scans_3d.parquet").unlink()
        with pytest.raises(InputError, match=r"has no scans_3d\.parquet.*Detect again"):
            list(read_detections_3d(tmp_path))


class TestDetections2D:
    def write(self, folder: Path) -> None:
        """Write four images: the first late, one broken, one empty, one for one network."""
        images = [
            make_image(3),
            make_image(1, failure="the JPEG is cut"),
            make_image(2, camera="left", boxes=0),
            make_image(0, camera="left", models=("far",)),
        ]
        images = [replace(image, frame=frame) for frame, image in enumerate(images)]
        with ImageJournal(folder / "j", "x") as journal:
            for image in images:
                journal.append(image)
            looks = [image_rows(image) for image, _ in journal.read()]
        write_parquet(folder / "images_2d.parquet", IMAGES_2D, looks)
        boxes = [detections_2d_table(image) for image in images]
        write_parquet(folder / "detections_2d.parquet", DETECTIONS_2D, boxes)

    def test_comes_by_stamp_with_the_empty_images(self, tmp_path: Path) -> None:
        self.write(tmp_path)
        found = list(read_detections_2d(tmp_path))
        assert [(d.camera, len(d)) for d in found] == [("left", 3), ("left", 0), ("front", 5)]
        stamps = [d.stamp_ns for d in found]
        assert stamps == sorted(stamps)
        assert stamps[1] - stamps[0] == 2 * STEP_NS

    def test_one_network(self, tmp_path: Path) -> None:
        self.write(tmp_path)
        near = list(read_detections_2d(tmp_path, models=["near"]))
        assert [(d.camera, len(d)) for d in near] == [("left", 0), ("front", 3)]
        far = list(read_detections_2d(tmp_path, models=["far"]))
        assert [(d.camera, len(d)) for d in far] == [("left", 3), ("left", 0), ("front", 3)]
        assert np.array_equal(far[2].boxes_px, make_image(3).boxes["far"].boxes_px)

    def test_boxes_of_unlisted_images(self, tmp_path: Path) -> None:
        self.write(tmp_path)
        listed = pq.read_table(tmp_path / "images_2d.parquet")
        pq.write_table(listed.slice(0, 2), tmp_path / "images_2d.parquet")
        with pytest.raises(InputError, match="boxes of frame 3, which the run has not"):
            list(read_detections_2d(tmp_path))
