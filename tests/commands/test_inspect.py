"""`percept inspect` on logs that were just written, on real ones, and on broken ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from percept.cli.app import app
from percept.core.samples import CameraImage, CameraInfo, PointCloud, TransformSample
from percept.core.transform import Transform
from percept.datasets.write import LogWriter

_S = 1_000_000_000
_EPOCH = 1_700_000_000 * _S
_POINTS = np.random.default_rng(0).uniform(-20, 20, (2000, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds of one LiDAR at 10 Hz with half a second missing, and one camera."""
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    K = np.array([[100.0, 0, 32], [0, 100, 24], [0, 0, 1]])
    with LogWriter(path, "mcap") as log:
        log.write(
            TransformSample(
                topic="/tf_static",
                stamp_ns=_EPOCH,
                log_time_ns=_EPOCH,
                frame="base_link",
                T_frame_child=Transform.identity("base_link", "lidar"),
                static=True,
            )
        )
        for index in range(100):
            at: dict[str, Any] = {
                "stamp_ns": _EPOCH + index * _S // 10,
                "log_time_ns": _EPOCH + index * _S // 10 + 15_000_000,
            }
            if not 40 <= index < 45:
                cloud = PointCloud(topic="/lidar/points", frame="lidar", points_xyz=_POINTS, **at)
                log.write(cloud)
            pixels = np.zeros((48, 64, 3), np.uint8)
            log.write(
                CameraImage(
                    topic="/cam/image_raw", frame="cam", pixels=pixels, encoding="bgr8", **at
                )
            )
            log.write(
                CameraInfo(
                    topic="/cam/camera_info",
                    frame="cam",
                    image_size=(64, 48),
                    model="plumb_bob",
                    K=K,
                    distortion=np.zeros(5),
                    **at,
                )
            )
    return path


def _run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["inspect", *map(str, arguments)])


def _json(*arguments: object) -> dict[str, Any]:
    done = _run(*arguments, "--json")
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def test_the_tables_tell_what_the_log_is_made_of(drive: Path) -> None:
    done = _run(drive)
    assert done.exit_code == 0, done.output
    assert all(len(line) <= 100 for line in done.stdout.splitlines())
    assert "verdict: doubtful" in done.stdout
    assert "messages missing: /lidar/points (about 5 in 1 gap)" in done.stdout
    assert "600 ms at 3.9 s (5)" in done.stdout
    assert "4.2..4.5 s silent" in done.stdout
    assert "64x48 bgr8, CameraInfo plausible" in done.stdout
    assert "└─ lidar (static)" in done.stdout
    assert done.stderr == ""


def test_json_is_one_document_and_agrees_with_the_log(drive: Path) -> None:
    document = _json(drive)
    counts = {topic["topic"]: topic["count"] for topic in document["topics"]}
    assert counts == {
        "/cam/camera_info": 100,
        "/cam/image_raw": 100,
        "/lidar/points": 95,
        "/tf_static": 1,
    }
    assert document["messages"] == 296
    assert document["verdict"] == "doubtful"
    lidar = next(t for t in document["topics"] if t["topic"] == "/lidar/points")
    assert lidar["timing"]["rate_hz"] == pytest.approx(10)
    assert lidar["clock"]["offset_s"] == pytest.approx(0.015)
    assert lidar["lateness"]["late_spans"] == 1
    assert lidar["lateness"]["late_s"] == pytest.approx(0.3, abs=1e-6)
    (late,) = lidar["lateness"]["spans"]
    assert late["end_ns"] - late["start_ns"] == pytest.approx(0.3e9, abs=1e3)
    assert late["reason"] == "silent"
    assert lidar["sensor"]["points"] == 2000
    usable = {use["job"] for use in document["uses"] if use["usable"]}
    assert {"detect (LiDAR)", "calib camera-lidar", "odometry"} <= usable
    assert document["frames"]["missing"] == {"cam": ["/cam/image_raw"]}


def test_an_expected_topic_that_is_absent_ends_with_4(drive: Path) -> None:
    done = _run(drive, "--rate", "/lidar_left/points=10")
    assert done.exit_code == 4
    assert "expected but not in the log: /lidar_left/points" in done.stdout


def test_limits_come_from_a_file(drive: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.yaml"
    limits.write_text("max_dropped_share: 0.1\nmax_late_share: 0.1\n")
    assert _json(drive, "--config", limits)["verdict"] == "good"
    limits.write_text("max_droped_share: 0.1\n")
    done = _run(drive, "--config", limits)
    assert done.exit_code == 2
    assert "Did you mean 'max_dropped_share'?" in done.stderr


def test_a_part_of_the_log_can_be_looked_at(drive: Path) -> None:
    document = _json(drive, "--start", 5, "--end", 7)
    assert document["verdict"] == "good"
    assert document["duration_s"] == pytest.approx(1.9)
    assert _run(drive, "--start", 7, "--end", 5).exit_code == 2


@pytest.mark.parametrize("rate", ["/lidar/points", "/lidar/points=fast", "/lidar/points=0"])
def test_a_rate_that_is_none_is_a_usage_error(drive: Path, rate: str) -> None:
    done = _run(drive, "--rate", rate)
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")


def test_a_cut_log_is_doubtful_and_its_sound_copy_is_whole(drive: Path, tmp_path: Path) -> None:
    cut, copy = tmp_path / "cut.mcap", tmp_path / "copy.mcap"
    cut.write_bytes(drive.read_bytes()[: drive.stat().st_size * 6 // 10])
    before = cut.read_bytes()
    document = _json(cut, "--recover", copy)
    assert document["verdict"] == "doubtful"
    assert document["losses"]
    assert document["why"][0].startswith("lost: ")
    assert document["messages"] >= 0.55 * 296
    assert document["recovery"]["messages"] == document["messages"]
    assert document["recovery"]["outputs"] == [str(copy)]
    assert cut.read_bytes() == before
    sound = _json(copy)
    assert (sound["losses"], sound["messages"]) == ({}, document["messages"])


def test_a_recovery_overwrites_nothing_unless_told(drive: Path, tmp_path: Path) -> None:
    taken = tmp_path / "taken.mcap"
    taken.write_text("mine")
    refused = _run(drive, "--recover", taken)
    assert refused.exit_code == 2
    assert taken.read_text() == "mine"
    done = _run(drive, "--recover", taken, "--force")
    assert done.exit_code == 0
    assert "nothing was lost" in done.stdout
    assert _json(taken)["messages"] == 296


@pytest.mark.parametrize("content", [b"", b"just some text, and no log at all\n" * 10])
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.mcap"
    path.write_bytes(content)
    done = _run(path)
    assert done.exit_code == 3
    assert done.stdout == ""
    assert done.stderr.startswith(f"error: {path}")
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "messages"),
    [
        ("embag/test.bag", 15),
        ("evo/ROS_example.bag", 26_566),
        ("evo/nav2_turtlebot.mcap", 8_197),
        ("rosbagjs/example.bag", 8_647),
        ("rosbagjs/example-bz2.bag", 8_647),
        ("rosbagjs/example-lz4.bag", 8_647),
        ("rosbag2/mcap/wbag", 6_074),
        ("rosbag2/sqlite3/wbag", 6_074),
        ("rosbag2/cpp_bags/topics_and_services.mcap", 13),
    ],
)
def test_real_logs_have_their_known_counts(shared_data: Path, name: str, messages: int) -> None:
    done = _run(shared_data / "bags" / name, "--json")
    assert done.exit_code == 0
    document = json.loads(done.stdout)
    assert document["messages"] == messages
    assert sum(topic["count"] for topic in document["topics"]) == messages
    assert document["losses"] == {}


@pytest.mark.parametrize("name", ["rosbagjs/no-messages.bag", "rosbag2/empty_bag"])
def test_a_log_without_messages_ends_with_4(shared_data: Path, name: str) -> None:
    done = _run(shared_data / "bags" / name)
    assert done.exit_code == 4
    assert "it holds no messages" in done.stdout


def test_real_scans_are_described(shared_data: Path) -> None:
    document = _json(shared_data / "bags" / "embag" / "test.bag")
    lidar = next(t for t in document["topics"] if t["kind"] == "lidar")
    assert lidar["frame"] == "luminar_lidar"
    assert 30_000 < lidar["sensor"]["points"] < 40_000
    assert lidar["sensor"]["scan_s"] == pytest.approx(0.09, abs=0.02)
    assert 100 < lidar["sensor"]["azimuth_deg"] < 130
