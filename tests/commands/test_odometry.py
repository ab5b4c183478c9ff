"""`percept odometry` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import Result

from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.export.odometry_table import POSE_QUALITY
from percept.export.pose_table import read_poses
from percept.odometry.drift import measure_drift
from percept.odometry.files import read_kitti_poses, read_tum

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("street")
    generate_drive(DriveConfig(seed=1, seconds=1.5, beam_share=0.5, cameras=()), folder)
    return folder


@pytest.fixture(scope="module")
def way(street: Path, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("way") / "run"
    truth = street / "truth" / "poses.parquet"
    done = run(
        "odometry", "--bag", street / "drive.mcap", "--source", "lidar", "--topic",
        "/lidar_top/points", "--reference", truth, "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "verdict: good" in done.stdout
    assert "end of its scan" in done.stderr
    return out


def test_all_files_say_the_same(way: Path) -> None:
    poses = read_poses(way / "poses.parquet")
    assert (poses.target, poses.source) == ("odom", "base_link")
    tum = read_tum(way / "trajectory.tum")
    assert tum.stamps_ns.tolist() == poses.stamps_ns.tolist()
    np.testing.assert_allclose(tum.matrices, poses.matrices, atol=1e-12)
    np.testing.assert_allclose(
        read_kitti_poses(way / "trajectory.kitti"), poses.matrices, atol=1e-12
    )
    quality = pq.read_table(way / "quality.parquet")
    assert quality.schema.names == POSE_QUALITY.names
    assert quality["stamp_ns"].to_pylist() == poses.stamps_ns.tolist()
    behind = np.subtract(quality["stamp_ns"], quality["scan_stamp_ns"])
    assert (behind > 45_000_000).all()  # the drive's stamps are those of the middle of scans


def test_the_way_is_that_of_the_truth(street: Path, way: Path) -> None:
    run = json.loads((way / "run.json").read_text())
    assert run["verdict"] == "good"
    assert run["counts"]["source"] == "lidar"
    by_name = {d["against"]: d for d in run["counts"]["drift"]}
    assert set(by_name) == {str(street / "truth" / "poses.parquet"), "gnss+imu", "odometry"}
    drift = measure_drift(
        read_poses(way / "poses.parquet"), read_poses(street / "truth" / "poses.parquet")
    )
    assert drift.ate_m < 0.05
    told = by_name[str(street / "truth" / "poses.parquet")]
    assert told["ate_m"] == pytest.approx(drift.ate_m, abs=1e-9)
    assert run["counts"]["way_m"] == pytest.approx(drift.way_m, abs=0.3)
    assert run["counts"]["sd_position_end_m"] > 0.004 * drift.way_m


def test_the_report_shows_the_way(way: Path) -> None:
    page = (way / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 2
    assert "gnss+imu" in page
    assert "Drift" in page


@pytest.mark.parametrize("source", ["auto", "gnss", "odometry", "tf"])
def test_every_source_of_a_log_gives_poses(
    source: str, street: Path, run: Run, tmp_path: Path
) -> None:
    done = run(
        "odometry", "--bag", street / "drive.mcap", "--source", source, "--out", tmp_path / "o",
        "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    assert content["counts"]["poses"] > 50
    assert content["counts"]["source"] in (source, "gnss+imu")
    assert content["counts"]["way_m"] > 9
    assert len(read_tum(tmp_path / "o" / "trajectory.tum")) == content["counts"]["poses"]


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--topic", "/nope"], 3, "no topic '/nope'"),
        (["--source", "pose"], 3, "nothing for --source pose"),
        (["--source", "lidar", "--start", "100"], 3, "no scan in this part of the log"),
        (["--source", "odometry", "--topic", "/gnss/fix"], 2, "do not go together"),
        (["--topic", "/lidar_top/points", "--topic", "/lidar_left/points"], 2, "two topics"),
        (["--reference", "none.tum"], 3, "cannot be read"),
        (["--source", "lidar", "--end", "0.12"], 4, "LiDAR scans"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    options: list[str], code: int, words: str, street: Path, run: Run, tmp_path: Path
) -> None:
    done = run("odometry", "--bag", street / "drive.mcap", *options, "--out", tmp_path / "o")
    assert done.exit_code == code, done.output
    assert words in done.stderr
    errors = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert len(errors) == 1
    assert not (tmp_path / "o").exists()


def test_a_wrong_setting_is_named(street: Path, run: Run, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("lidar: {voxel: 1.0}\n")
    done = run(
        "odometry", "--bag", street / "drive.mcap", "--config", config, "--out", tmp_path / "o"
    )
    assert done.exit_code == 2
    assert "voxel_m" in done.stderr


def test_a_log_without_lidar_says_so(shared_data: Path, run: Run, tmp_path: Path) -> None:
    bag = shared_data / "bags" / "rosbagjs" / "example.bag"
    done = run("odometry", "--bag", bag, "--source", "lidar", "--out", tmp_path / "o")
    assert done.exit_code == 3
    assert "no point clouds in the log" in done.stderr
