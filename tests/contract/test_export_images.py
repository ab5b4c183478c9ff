"""What the exports promise of images: tables, journal and messages, read back by others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from made_images import make_image
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from percept.core.errors import UsageError
from percept.detection.result import ImageResult
from percept.export.finished import finished_image, image_of
from percept.export.image_table import image_rows
from percept.export.journal import FrameJournal, ImageJournal
from percept.export.overlay import OverlayWriter
from percept.export.tables import DETECTIONS_2D, detections_2d_table, write_parquet


def _same(found: ImageResult, expected: ImageResult) -> None:
    assert (found.frame, found.camera, found.stamp_ns, found.log_time_ns) == (
        expected.frame, expected.camera, expected.stamp_ns, expected.log_time_ns,
    )  # fmt: skip
    assert (found.failure, found.decode_ms) == (expected.failure, expected.decode_ms)
    assert found.timings_ms == expected.timings_ms
    assert list(found.boxes) == list(expected.boxes)
    assert set(found.positions) == set(expected.positions)
    for model, boxes in expected.boxes.items():
        assert np.array_equal(found.boxes[model].boxes_px, boxes.boxes_px)
        assert found.boxes[model].labels == boxes.labels
        assert np.array_equal(found.boxes[model].confidences, boxes.confidences)
        assert (found.boxes[model].stamp_ns, found.boxes[model].camera) == (
            boxes.stamp_ns, boxes.camera,
        )  # fmt: skip
        assert np.array_equal(found.primary[model], expected.primary[model])
    for model, places in expected.positions.items():
        again = found.positions[model]
        assert (again.frame_id, again.sources) == (places.frame_id, places.sources)
        assert np.array_equal(again.points_m, places.points_m, equal_nan=True)
        assert np.array_equal(again.range_m, places.range_m, equal_nan=True)
        assert np.array_equal(again.points, places.points)


class TestTable:
    def test_columns_are_those_of_the_interface(self) -> None:
        result = make_image(3)
        table = detections_2d_table(result)
        assert ", ".join(table.schema.names) == (
            "frame, stamp_ns, camera, model, x1_px, y1_px, x2_px, y2_px, label, confidence, "
            "primary, range_m, x, y, z, frame_id, depth_source, depth_points, light_state"
        )
        rows = table.to_pylist()
        assert [(row["model"], row["label"]) for row in rows] == [
            (model, label) for model in ("near", "far") for label in ("car", "pedestrian", "deer")
        ]
        assert {(row["frame"], row["camera"]) for row in rows} == {(3, "front")}
        assert [row["primary"] for row in rows] == [True, True, True, False, True, True]
        place = result.positions["near"]
        assert rows[0]["range_m"] == place.range_m[0]
        assert [rows[2][name] for name in "xyz"] == place.points_m[2].tolist()
        assert [row["depth_source"] for row in rows] == ["cluster", None, "depth", None, None, None]
        assert [row["depth_points"] > 0 for row in rows] == [True, False, True, False, False, False]
        assert rows[5]["x2_px"] == result.boxes["far"].boxes_px[2, 2]

    def test_what_is_not_known_is_null(self) -> None:
        row = detections_2d_table(make_image(0)).to_pylist()[1]
        assert [row[name] for name in ("range_m", "x", "y", "z", "frame_id", "depth_source")] == (
            [None] * 6
        )

    def test_an_image_without_boxes_has_no_rows(self, tmp_path: Path) -> None:
        for empty in (make_image(0, boxes=0), make_image(1, failure="the file is cut")):
            table = detections_2d_table(empty)
            assert (table.num_rows, table.schema) == (0, DETECTIONS_2D)
            write_parquet(tmp_path / "t.parquet", DETECTIONS_2D, [table])
            assert pq.read_table(tmp_path / "t.parquet").schema == DETECTIONS_2D


class TestJournal:
    def images(self) -> list[ImageResult]:
        silent = make_image(2, camera="left", boxes=0)
        return [
            make_image(0),
            make_image(1, failure="the JPEG is cut"),
            replace(silent, positions={}),  # two networks that find nothing
            make_image(3, camera="left", models=("far",)),
        ]

    def test_gives_back_what_was_finished(self, tmp_path: Path) -> None:
        images = self.images()
        with ImageJournal(tmp_path / "j", "x") as journal:
            for image in images:
                journal.append(image)
        with ImageJournal(tmp_path / "j", "x", resume=True) as journal:
            assert (journal.frames, journal.next_frame) == (4, 4)
            read = list(journal.read())
        for (finished, rows), image in zip(read, images, strict=True):
            _same(image_of(finished, rows), image)
        assert [(f.width_px, f.height_px, f.frame_id) for f, _ in read[:2]] == [
            (800, 450, "front_optical"), (0, 0, ""),
        ]  # fmt: skip

    def test_any_cut_leaves_a_readable_prefix(self, tmp_path: Path) -> None:
        images = self.images()
        part = tmp_path / "j" / "part-0000.arrows"
        sizes = []
        with ImageJournal(tmp_path / "j", "x") as journal:
            for image in images:
                journal.append(image)
                sizes.append(part.stat().st_size)
        whole = part.read_bytes()
        for cut in [*range(0, sizes[0], 301), *sizes, *(size - 1 for size in sizes), sizes[0] + 9]:
            part.write_bytes(whole[:cut])
            with ImageJournal(tmp_path / "j", "x", resume=True) as journal:
                read = list(journal.read())
                assert journal.frames == len(read) == sum(size <= cut for size in sizes), cut
            for (finished, rows), image in zip(read, images, strict=False):
                _same(image_of(finished, rows), image)

    def test_resumed_rows_equal_those_of_one_run(self, tmp_path: Path) -> None:
        images = [make_image(i, camera=("front", "left")[i % 2]) for i in range(6)]
        with ImageJournal(tmp_path / "once", "x") as once:
            for image in images:
                once.append(image)
            write_parquet(tmp_path / "once.parquet", DETECTIONS_2D, once.batches())
        with ImageJournal(tmp_path / "twice", "x") as journal:
            for image in images[:3]:
                journal.append(image)
        part = tmp_path / "twice" / "part-0000.arrows"
        part.write_bytes(part.read_bytes()[:-40])
        with ImageJournal(tmp_path / "twice", "x", resume=True) as journal:
            assert journal.next_frame == 2
            for image in images[2:]:
                journal.append(image)
            write_parquet(tmp_path / "twice.parquet", DETECTIONS_2D, journal.batches())
        assert (tmp_path / "twice.parquet").read_bytes() == (tmp_path / "once.parquet").read_bytes()

    def test_scans_and_images_do_not_share_a_folder(self, tmp_path: Path) -> None:
        with FrameJournal(tmp_path / "j", "x"), pytest.raises(UsageError, match="another process"):
            ImageJournal(tmp_path / "j", "x", resume=True)


class TestOverlay:
    def write(self, path: Path, images: list[ImageResult]) -> Path:
        with OverlayWriter(path, models=("near", "far")) as overlay:
            for image in images:
                overlay.add_image(image, "front_optical")
        return path

    def test_mcap_ros2_reads_boxes(self, tmp_path: Path) -> None:
        image = make_image(4)
        path = self.write(tmp_path / "overlay.mcap", [image])
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            read = {c.topic: (s, m, ros) for s, c, m, ros in reader.iter_decoded_messages()}
        schema, message, array = read["/percept/front/near/detections_2d"]
        assert schema is not None
        assert (schema.name, schema.encoding) == ("vision_msgs/msg/Detection2DArray", "ros2msg")
        assert (message.log_time, message.publish_time) == (image.log_time_ns, image.stamp_ns)
        assert array.header.frame_id == "front_optical"
        stamp = array.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == image.stamp_ns
        found = image.boxes["near"]
        for (x1, y1, x2, y2), box in zip(found.boxes_px, array.detections, strict=True):
            middle = box.bbox.center.position
            assert (middle.x, middle.y) == ((x1 + x2) / 2, (y1 + y2) / 2)
            assert (box.bbox.size_x, box.bbox.size_y) == (x2 - x1, y2 - y1)
        hypothesis = array.detections[1].results[0].hypothesis
        assert (hypothesis.class_id, hypothesis.score) == ("pedestrian", found.confidences[1])

    def test_rosbags_reads_outlines_and_texts(self, tmp_path: Path) -> None:
        images = [make_image(0), make_image(1, models=("near",)), make_image(2, failure="cut")]
        path = self.write(tmp_path / "overlay.mcap", images)
        with AnyReader([path]) as reader:
            assert {c.topic: c.msgcount for c in reader.connections} == {
                "/percept/front/near/detections_2d": 2,
                "/percept/front/near/annotations": 2,
                "/percept/front/far/detections_2d": 1,
                "/percept/front/far/annotations": 1,
            }
            drawn: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages()
                if connection.topic == "/percept/front/near/annotations"
            ]
        found = images[0].boxes["near"]
        x1, y1, x2, y2 = found.boxes_px[0]
        assert [(p.x, p.y) for p in drawn[0].points[0].points] == [
            (x1, y1), (x2, y1), (x2, y2), (x1, y2),
        ]  # fmt: skip
        assert drawn[0].points[0].type == 2
        away_m = images[0].positions["near"].range_m[0]
        assert [text.text for text in drawn[0].texts[:2]] == [
            f"car {found.confidences[0]:.2f} {away_m:.1f} m",
            f"pedestrian {found.confidences[1]:.2f}",
        ]

    def test_a_resumed_run_writes_the_same_bytes(self, tmp_path: Path) -> None:
        images = [make_image(i) for i in range(3)]
        first = self.write(tmp_path / "a.mcap", images).read_bytes()
        with ImageJournal(tmp_path / "j", "x") as journal:
            for image in images:
                journal.append(image)
            again = [image_of(finished, rows) for finished, rows in journal.read()]
        assert self.write(tmp_path / "b.mcap", again).read_bytes() == first


def test_the_table_of_images_says_who_looked_and_what_failed() -> None:
    whole = make_image(0, models=("near", "far"))
    partly = replace(make_image(1, models=("near",)), failure="far: no numbers")
    broken = make_image(2, failure="the JPEG is cut")
    rows = [row for image in (whole, partly, broken) for row in _looks(image)]
    assert rows == [
        (0, "near", None),
        (0, "far", None),
        (1, "near", None),
        (1, None, "far: no numbers"),
        (2, None, "the JPEG is cut"),
    ]


def _looks(image: ImageResult) -> list[tuple[int, str | None, str | None]]:
    rows = image_rows(finished_image(image)).to_pylist()
    assert {(row["stamp_ns"], row["camera"]) for row in rows} == {(image.stamp_ns, image.camera)}
    return [(row["frame"], row["model"], row["failure"]) for row in rows]
