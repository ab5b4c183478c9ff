"""Folders of scans and images as a recording: topics, times, and what cannot be used."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from percept.core.errors import RecordingError, TopicNotFoundError
from percept.core.samples import CameraImage, PointCloud
from percept.datasets.files.folders import open_folder

STAMP_NS = 315966265259836000


def write_scan(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    table = np.random.default_rng(11).normal(size=(500, 4)) * (30, 20, 1, 100)
    table.astype("<f4").tofile(path)


def write_image(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, np.full((4, 6, 3), 90, np.uint8))[1].tobytes())


def test_raw_kitti_takes_the_lines_of_its_timestamps(tmp_path: Path) -> None:
    folder = tmp_path / "drive" / "velodyne_points"
    # Scan 1 is missing, as in drive 0009.
    for number in (0, 2):
        write_scan(folder / "data" / f"{number:010d}.bin")
    seconds = ("25.100000001", "25.200000002", "26.300000003")
    text = "".join(f"2011-09-26 13:02:{second}\n" for second in seconds)
    (folder / "timestamps.txt").write_text(text)
    recording = open_folder(tmp_path / "drive")
    (info,) = recording.topics()
    assert (info.topic, info.count, info.msgtype) == ("/velodyne_points", 2, "folder/bin")
    start_ns = 1317042145_100000001
    assert [s.stamp_ns for s in recording.samples()] == [start_ns, start_ns + 1_200000002]
    assert (recording.start_ns, recording.end_ns) == (start_ns, start_ns + 1_200000002)


def test_kitti_odometry_takes_seconds(tmp_path: Path) -> None:
    for number in range(3):
        write_scan(tmp_path / "velodyne" / f"{number:06d}.bin")
    (tmp_path / "times.txt").write_text("0.0\n1.038e-01\n2.0e-01\n")
    stamps = [sample.stamp_ns for sample in open_folder(tmp_path).samples()]
    assert stamps == [0, 103_800_000, 200_000_000]


@pytest.mark.parametrize("text", ["0.0\n1.0\n", "yesterday\n", "2011-99-99 00:00:00\n"])
def test_times_that_do_not_fit_are_counted(tmp_path: Path, text: str) -> None:
    for name in "abc":
        write_scan(tmp_path / f"{name}.bin")
    (tmp_path / "times.txt").write_text(text)
    recording = open_folder(tmp_path)
    assert [sample.stamp_ns for sample in recording.samples()] == [0, 10**8, 2 * 10**8]
    assert sum(recording.losses.values()) == 1
    assert "times.txt" in next(iter(recording.losses))


def test_names_that_are_stamps(tmp_path: Path) -> None:
    for stamp in (STAMP_NS + 100_000_000, STAMP_NS):
        write_scan(tmp_path / f"{stamp}.bin")
    recording = open_folder(tmp_path)
    assert recording.topics()[0].topic == f"/{tmp_path.name}"
    assert [s.stamp_ns for s in recording.samples()] == [STAMP_NS, STAMP_NS + 100_000_000]


def test_numbers_join_the_folders_of_one_data_set(tmp_path: Path) -> None:
    for number in (3, 12):
        write_scan(tmp_path / "training" / "velodyne" / f"{number:06d}.bin")
        write_image(tmp_path / "training" / "image_2" / f"{number:06d}.png")
    recording = open_folder(tmp_path)
    found = [(s.topic, s.stamp_ns, s.frame) for s in recording.samples()]
    assert found == [
        ("/training/image_2", 300_000_000, "image_2"),
        ("/training/velodyne", 300_000_000, "velodyne"),
        ("/training/image_2", 1_200_000_000, "image_2"),
        ("/training/velodyne", 1_200_000_000, "velodyne"),
    ]


def test_clouds_and_images_in_one_folder_are_two_topics(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        write_scan(tmp_path / "scene" / f"{number}.bin")
        write_image(tmp_path / "scene" / f"{number}.jpg")
    with open_folder(tmp_path) as recording:
        kinds = {info.topic: info.sample_type for info in recording.topics()}
        assert kinds == {"/scene/image": CameraImage, "/scene/points": PointCloud}
        (image,) = recording.samples(topics=["/scene/image"], start_ns=1, end_ns=150_000_000)
        assert isinstance(image, CameraImage)
        assert (image.pixels.shape, image.encoding, image.stamp_ns) == ((4, 6, 3), "jpeg", 10**8)
        sizes = {e.topic: e.size_bytes for e in recording.envelopes()}
        assert sizes["/scene/points"] == 500 * 16
        with pytest.raises(TopicNotFoundError, match="/scene/points"):
            recording.samples(topics=["/scene/radar"])


def test_files_that_cannot_be_decoded_are_counted_and_skipped(tmp_path: Path) -> None:
    write_scan(tmp_path / "1.bin")
    (tmp_path / "2.bin").write_bytes(b"12345")
    (tmp_path / "3.bin").write_bytes(b"")
    write_scan(tmp_path / "4.bin")
    recording = open_folder(tmp_path)
    assert [s.stamp_ns for s in recording.samples()] == [10**8, 4 * 10**8]
    assert list(recording.losses.values()) == [2]


@pytest.mark.parametrize("make", [lambda _: None, lambda p: (p / "a.txt").write_text("x")])
def test_an_empty_or_foreign_folder_is_refused(tmp_path: Path, make: Callable[[Path], Any]) -> None:
    make(tmp_path)
    with pytest.raises(RecordingError, match=r"\.bin, \.npy, \.pcd, \.ply, \.jpg"):
        open_folder(tmp_path)


def test_a_file_of_another_kind_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(RecordingError, match=r"\.pcd"):
        open_folder(tmp_path / "notes.txt")


def test_a_single_file_is_a_recording(tmp_path: Path) -> None:
    write_scan(tmp_path / f"{STAMP_NS}.bin")
    recording = open_folder(tmp_path / f"{STAMP_NS}.bin")
    (sample,) = recording.samples()
    assert (sample.topic, sample.stamp_ns) == (f"/{STAMP_NS}", STAMP_NS)


def test_a_wrong_real_header_loses_only_what_has_no_known_place(shared_data: Path) -> None:
    recording = open_folder(shared_data / "scenes" / "sustechpoints" / "lidar")
    (cloud,) = recording.samples()
    assert isinstance(cloud, PointCloud)
    assert len(cloud) == 66_781
    assert cloud.intensity is not None
    assert 0 <= cloud.intensity.min() <= cloud.intensity.max() == 255
    assert cloud.ring is None
    assert cloud.offset_ns is None
    assert "COUNT 0" in next(iter(recording.losses))


def test_files_without_numbers_are_topics_of_one_scan_each(tmp_path: Path) -> None:
    for name in ("top", "left", "right"):
        write_scan(tmp_path / f"{name}.bin")
        write_scan(tmp_path / "more" / f"{name}.bin")
    write_image(tmp_path / "front.png")
    recording = open_folder(tmp_path)
    topics = {info.topic: info.count for info in recording.topics()}
    names = ("left", "right", "top")
    assert topics == dict.fromkeys(
        [
            *(f"/{n}/points" for n in names),
            *(f"/more/{n}" for n in names),
            f"/{tmp_path.name}/image",
        ],
        1,
    )


def test_one_number_makes_a_sequence(tmp_path: Path) -> None:
    for name in ("top", "top2"):
        write_scan(tmp_path / f"{name}.bin")
    (info,) = open_folder(tmp_path).topics()
    assert (info.topic, info.count) == (f"/{tmp_path.name}", 2)
    assert len(list(open_folder(tmp_path).samples(topics=info.topic))) == 2
