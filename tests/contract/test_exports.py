"""What the exports promise to other programs, read back by readers that are not percept's own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from percept.core.errors import InputError, UsageError
from percept.export import tables
from percept.export.finished import detections_of
from percept.export.journal import FrameJournal
from percept.export.overlay import OverlayWriter
from percept.export.tables import DETECTIONS_3D, detections_3d_table, write_parquet
from percept.lidar.result import ScanResult

MakeScan = Callable[..., ScanResult]


class TestTables:
    def test_columns_are_those_of_the_interface(self, make_scan: MakeScan) -> None:
        result = make_scan(3)
        table = detections_3d_table(7, result.detections)
        assert ", ".join(table.schema.names) == (
            "frame, stamp_ns, sensor, frame_id, x, y, z, length, width, height, yaw_rad, "
            "label, confidence, mean_intensity, points, offset_ns"
        )
        rows = table.to_pylist()
        assert [row["frame"] for row in rows] == [7, 7, 7]
        assert rows[1]["stamp_ns"] == result.detections.stamp_ns
        assert rows[1]["yaw_rad"] == result.detections.boxes_m[1, 6]
        assert rows[1]["label"] == "pedestrian"
        assert np.isnan(rows[1]["mean_intensity"])
        assert rows[0]["mean_intensity"] == 12.5

    def test_bytes_do_not_depend_on_batches(
        self, make_scan: MakeScan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(tables, "_ROWS_PER_GROUP", 16)
        parts = [detections_3d_table(i, make_scan(i, boxes=i % 6).detections) for i in range(20)]
        whole = pa.concat_tables(parts)
        assert write_parquet(tmp_path / "a.parquet", DETECTIONS_3D, parts) == whole.num_rows
        write_parquet(tmp_path / "b.parquet", DETECTIONS_3D, [whole])
        write_parquet(tmp_path / "c.parquet", DETECTIONS_3D, whole.to_batches(max_chunksize=7))
        first, *others = ((tmp_path / f"{name}.parquet").read_bytes() for name in "abc")
        assert others == [first, first]
        file = pq.ParquetFile(tmp_path / "a.parquet")
        assert file.num_row_groups == -(-whole.num_rows // 16)
        assert file.schema_arrow == DETECTIONS_3D
        assert (
            file.read().drop_columns("mean_intensity").equals(whole.drop_columns("mean_intensity"))
        )

    def test_no_rows_is_a_table_too(self, tmp_path: Path) -> None:
        assert write_parquet(tmp_path / "t.parquet", DETECTIONS_3D, []) == 0
        assert pq.read_table(tmp_path / "t.parquet").schema == DETECTIONS_3D

    def test_a_failure_leaves_the_old_file_alone(self, make_scan: MakeScan, tmp_path: Path) -> None:
        def rows() -> Iterator[pa.Table]:
            yield detections_3d_table(0, make_scan(0).detections)
            raise InputError("the log ends here")

        path = tmp_path / "t.parquet"
        path.write_bytes(b"old")
        with pytest.raises(InputError, match="ends here"):
            write_parquet(path, DETECTIONS_3D, rows())
        assert path.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [path]


class TestJournal:
    def test_gives_back_what_was_finished(self, make_scan: MakeScan, tmp_path: Path) -> None:
        scans = [make_scan(i, boxes=i, sensor=("top", "left")[i % 2]) for i in range(4)]
        with FrameJournal(tmp_path / "j", "same") as journal:
            for i, scan in enumerate(scans):
                journal.append(i, scan)
        with FrameJournal(tmp_path / "j", "same", resume=True) as journal:
            assert (journal.frames, journal.next_frame) == (4, 4)
            for (finished, rows), scan in zip(journal.read(), scans, strict=True):
                found = detections_of(finished, rows)
                assert np.array_equal(found.boxes_m, scan.detections.boxes_m)
                assert found.labels == scan.detections.labels
                assert np.array_equal(
                    found.mean_intensity, scan.detections.mean_intensity, equal_nan=True
                )
                assert (found.stamp_ns, found.sensor) == (
                    scan.detections.stamp_ns,
                    scan.detections.sensor,
                )
                assert finished.log_time_ns == scan.cloud.log_time_ns
                assert finished.ground_points == np.count_nonzero(scan.ground)
                assert finished.timings_ms == scan.timings_ms
                assert finished.dropped == scan.dropped

    def test_frames_may_be_left_out(self, make_scan: MakeScan, tmp_path: Path) -> None:
        with FrameJournal(tmp_path / "j", "x") as journal:
            journal.append(0, make_scan(0))
            journal.append(4, make_scan(4))
            assert (journal.frames, journal.next_frame) == (2, 5)
        with FrameJournal(tmp_path / "j", "x", resume=True) as journal:
            assert (journal.frames, journal.next_frame) == (2, 5)
            assert [finished.frame for finished, _ in journal.read()] == [0, 4]

    def test_any_cut_leaves_a_readable_prefix(self, make_scan: MakeScan, tmp_path: Path) -> None:
        with FrameJournal(tmp_path / "j", "x") as journal:
            sizes = []
            part = tmp_path / "j" / "part-0000.arrows"
            for i in range(3):
                journal.append(i, make_scan(i))
                sizes.append(part.stat().st_size)
        whole = part.read_bytes()
        for cut in [*range(0, sizes[0], 97), *sizes, sizes[0] + 1, sizes[1] - 1, sizes[1] + 9]:
            part.write_bytes(whole[:cut])
            with FrameJournal(tmp_path / "j", "x", resume=True) as journal:
                assert journal.frames == sum(size <= cut for size in sizes), cut

    def test_resumed_rows_equal_those_of_one_run(self, make_scan: MakeScan, tmp_path: Path) -> None:
        with FrameJournal(tmp_path / "once", "x") as once:
            for i in range(6):
                once.append(i, make_scan(i))
            write_parquet(tmp_path / "once.parquet", DETECTIONS_3D, once.batches())
        with FrameJournal(tmp_path / "twice", "x") as journal:
            for i in range(3):
                journal.append(i, make_scan(i))
        part = tmp_path / "twice" / "part-0000.arrows"
        part.write_bytes(part.read_bytes()[:-40])
        with FrameJournal(tmp_path / "twice", "x", resume=True) as journal:
            assert journal.next_frame == 2
            for i in range(journal.next_frame, 6):
                journal.append(i, make_scan(i))
            write_parquet(tmp_path / "twice.parquet", DETECTIONS_3D, journal.batches())
        assert (tmp_path / "twice.parquet").read_bytes() == (tmp_path / "once.parquet").read_bytes()

    def test_survives_kill(self, tmp_path: Path) -> None:
        code = (
            "import os, sys, runpy, pathlib\n"
            f"scan = runpy.run_path({str(Path(__file__).with_name('conftest.py'))!r})['_scan']\n"
            "from percept.export.journal import FrameJournal\n"
            "journal = FrameJournal(pathlib.Path(sys.argv[1]), 'x')\n"
            "for i in range(5): journal.append(i, scan(i))\n"
            "os.kill(os.getpid(), 9)\n"
        )
        done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "j")], check=False)
        assert done.returncode == -signal.SIGKILL
        with FrameJournal(tmp_path / "j", "x", resume=True) as journal:
            assert journal.frames == 5

    def test_refuses_another_run(self, tmp_path: Path) -> None:
        FrameJournal(tmp_path / "j", "inputs a").close()
        with pytest.raises(UsageError, match=r"unfinished run.*--resume"):
            FrameJournal(tmp_path / "j", "inputs a")
        with pytest.raises(UsageError, match="other inputs or settings"):
            FrameJournal(tmp_path / "j", "inputs b", resume=True)

    def test_refuses_a_second_writer(self, tmp_path: Path) -> None:
        with (
            FrameJournal(tmp_path / "j", "x"),
            pytest.raises(UsageError, match="another process"),
        ):
            FrameJournal(tmp_path / "j", "x", resume=True)

    def test_remove_leaves_nothing(self, make_scan: MakeScan, tmp_path: Path) -> None:
        journal = FrameJournal(tmp_path / "j", "x")
        journal.append(0, make_scan(0))
        journal.remove()
        assert list(tmp_path.iterdir()) == []


class TestOverlay:
    def write(self, path: Path, scans: list[ScanResult]) -> Path:
        with OverlayWriter(path) as overlay:
            for scan in scans:
                overlay.add(scan.detections, scan.cloud.log_time_ns)
        return path

    def test_mcap_ros2_reads_boxes(self, make_scan: MakeScan, tmp_path: Path) -> None:
        scan = make_scan(4)
        path = self.write(tmp_path / "overlay.mcap", [scan])
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            assert reader.get_header().profile == "ros2"
            read = {c.topic: (s, m, ros) for s, c, m, ros in reader.iter_decoded_messages()}
        schema, message, array = read["/percept/top/detections_3d"]
        assert schema is not None
        assert (schema.name, schema.encoding) == ("vision_msgs/msg/Detection3DArray", "ros2msg")
        assert message.log_time == scan.cloud.log_time_ns
        stamp = array.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == scan.detections.stamp_ns
        assert array.header.frame_id == "lidar_top"
        assert len(array.detections) == 3
        for box, found in zip(scan.detections.boxes_m, array.detections, strict=True):
            center, size = found.bbox.center, found.bbox.size
            place = [center.position.x, center.position.y, center.position.z]
            assert [*place, size.x, size.y, size.z] == box[:6].tolist()
            yaw = 2 * np.arctan2(center.orientation.z, center.orientation.w)
            assert yaw == pytest.approx(box[6])
        hypothesis = array.detections[1].results[0].hypothesis
        assert hypothesis.class_id == "pedestrian"
        assert hypothesis.score == scan.detections.confidences[1]

    def test_rosbags_reads_markers(self, make_scan: MakeScan, tmp_path: Path) -> None:
        scans = [make_scan(0), make_scan(1, boxes=0), make_scan(2, sensor="left/rear 2")]
        path = self.write(tmp_path / "overlay.mcap", scans)
        with AnyReader([path]) as reader:
            assert {c.topic: c.msgcount for c in reader.connections} == {
                "/percept/top/detections_3d": 2,
                "/percept/top/markers": 2,
                "/percept/left_rear_2/detections_3d": 1,
                "/percept/left_rear_2/markers": 1,
            }
            markers: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages()
                if connection.topic == "/percept/top/markers"
            ]
        assert [len(found.markers) for found in markers] == [1 + 2 * 3, 1]
        assert [marker.action for marker in markers[0].markers] == [3, 0, 0, 0, 0, 0, 0]
        cube, text = markers[0].markers[1:3]
        assert (cube.type, text.type) == (1, 9)
        assert text.text == f"car {scans[0].detections.confidences[0]:.2f}"
        assert cube.scale.x == scans[0].detections.boxes_m[0, 3]

    def test_the_same_scans_give_the_same_bytes(self, make_scan: MakeScan, tmp_path: Path) -> None:
        scans = [make_scan(i) for i in range(3)]
        first = self.write(tmp_path / "a.mcap", scans).read_bytes()
        assert self.write(tmp_path / "b.mcap", scans).read_bytes() == first

    def test_a_failure_leaves_nothing(self, make_scan: MakeScan, tmp_path: Path) -> None:
        def broken() -> None:
            with OverlayWriter(tmp_path / "o.mcap") as overlay:
                overlay.add(make_scan(0).detections, 1)
                raise InputError("the log ends here")

        with pytest.raises(InputError, match="ends here"):
            broken()
        assert list(tmp_path.iterdir()) == []
