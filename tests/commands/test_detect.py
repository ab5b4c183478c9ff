"""`percept detect` on real and synthetic logs, as a user runs it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import Result

from percept.core.rig import load_rig
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.sensors import choose_lidars
from percept.datasets.write import CloudLayout
from percept.export.tables import DETECTIONS_3D

Run = Callable[..., Result]
Pack = Callable[..., Path]

_VARIANTS = {
    "rosbag1": ("rosbag1", None),
    "rosbag2": ("rosbag2", None),
    "mcap": ("mcap", None),
    "mcap big-endian": ("mcap", CloudLayout(big_endian=True)),
    "rosbag1 padded": ("rosbag1", CloudLayout(point_padding=12, row_padding=40)),
    "rosbag2 doubles": ("rosbag2", CloudLayout(xyz="f8", big_endian=True, row_padding=8)),
}


@pytest.fixture(scope="module")
def reference_table(
    real_clouds: list[PointCloud], pack: Pack, run: Run, tmp_path_factory: pytest.TempPathFactory
) -> bytes:
    folder = tmp_path_factory.mktemp("reference")
    log = pack(real_clouds, folder, "mcap")
    done = run("detect", "--bag", log, "--out", folder / "run")
    assert done.exit_code == 0, done.stderr
    return (folder / "run" / "detections_3d.parquet").read_bytes()


@pytest.mark.parametrize("variant", _VARIANTS)
def test_the_same_scans_give_the_same_bytes_in_every_container(
    variant: str,
    real_clouds: list[PointCloud],
    reference_table: bytes,
    pack: Pack,
    run: Run,
    tmp_path: Path,
) -> None:
    log_format, layout = _VARIANTS[variant]
    log = pack(real_clouds, tmp_path, log_format, layout)
    before = {p: p.read_bytes() for p in [log, *log.glob("*")] if p.is_file()}
    done = run("detect", "--bag", log, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "run" / "detections_3d.parquet").read_bytes() == reference_table
    assert all(path.read_bytes() == content for path, content in before.items())


def test_real_scans_yield_cars_where_the_labels_have_them(
    reference_table: bytes, tmp_path: Path
) -> None:
    (tmp_path / "t.parquet").write_bytes(reference_table)
    rows = pq.read_table(tmp_path / "t.parquet")
    assert rows.schema.equals(DETECTIONS_3D)
    assert set(rows["frame"].to_pylist()) == {0, 1, 2, 3}
    assert rows["label"].to_pylist().count("car") >= 10


def test_a_real_luminar_log_runs_as_it_stands(shared_data: Path, run: Run, tmp_path: Path) -> None:
    log = shared_data / "bags" / "embag" / "test.bag"
    done = run("detect", "--bag", log, "--out", tmp_path / "run", "--mcap", "--json")
    assert done.exit_code == 0, done.stderr
    written = json.loads(done.stdout)
    assert written == json.loads((tmp_path / "run" / "run.json").read_text())
    assert written["counts"]["frames"] == 5
    assert written["counts"]["objects"] > 100
    assert written["verdict"] in ("good", "doubtful")
    assert {p.name for p in (tmp_path / "run").iterdir()} == {
        "detections_3d.parquet", "scans_3d.parquet", "tracks.parquet", "poses.parquet",
        "rig.yaml", "view.rrd", "report.html", "overlay.mcap", "run.json",
    }  # fmt: skip


def test_several_lidars_are_merged_in_the_base_frame_or_kept_apart(
    drive: Path, run: Run, tmp_path: Path
) -> None:
    log = drive / "drive.mcap"
    merged = run("detect", "--bag", log, "--rig", drive / "rig.yaml", "--out", tmp_path / "a")
    apart = run("detect", "--bag", log, "--lidars", "separate", "--out", tmp_path / "b")
    assert (merged.exit_code, apart.exit_code) == (0, 0), merged.stderr + apart.stderr
    one = pq.read_table(tmp_path / "a" / "detections_3d.parquet")
    four = pq.read_table(tmp_path / "b" / "detections_3d.parquet")
    assert set(one["sensor"].to_pylist()) == {"lidars"}
    assert len(set(four["sensor"].to_pylist())) == 4
    assert {*one["frame_id"].to_pylist(), *four["frame_id"].to_pylist()} == {"base_link"}


def test_the_rig_tells_where_a_sensor_sits_and_else_the_log_does(drive: Path) -> None:
    rig = load_rig(drive / "rig.yaml")
    top = rig.lidars()["lidar_top"]
    assert top.T_base_sensor is not None
    moved = replace(top, T_base_sensor=Transform.identity("base_link", top.frame))
    silent = replace(top, T_base_sensor=None)
    with open_recording(drive / "drive.mcap") as recording:
        for known, expected in ((moved, np.eye(4)), (silent, top.T_base_sensor.matrix)):
            (chosen,) = choose_lidars(recording, replace(rig, sensors={"lidar_top": known}), {})
            assert chosen.T_base_sensor is not None
            np.testing.assert_allclose(chosen.T_base_sensor.matrix, expected, atol=1e-9)


def test_flags_win_over_the_file_and_both_are_stored(drive: Path, run: Run, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("lidars: merge\nlidar: {max_range_m: 40, cluster: {min_points: 20}}\n")
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--config", config, "--lidars", "separate",
        "--out", tmp_path / "run", "--json",
    )  # fmt: skip
    stored = json.loads(done.stdout)["config"]
    assert stored["lidars"] == "separate"
    assert stored["lidar"]["max_range_m"] == 40
    assert stored["lidar"]["cluster"]["min_points"] == 20


def test_start_and_end_take_a_part_of_the_log(drive: Path, run: Run, tmp_path: Path) -> None:
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--start", 0.2, "--end", 0.45,
        "--out", tmp_path / "run", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert 1 <= json.loads(done.stdout)["counts"]["frames"] <= 3


@pytest.fixture(scope="module")
def long_log(
    real_clouds: list[PointCloud], pack: Pack, run: Run, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """A log of 16 real scans, and the run over it that nobody stopped."""
    base = real_clouds[0].stamp_ns
    clouds = [
        replace(c, stamp_ns=base + 10**8 * i, log_time_ns=base + 10**8 * i)
        for i, c in enumerate(real_clouds[:2] * 8)
    ]
    folder = tmp_path_factory.mktemp("long")
    log = pack(clouds, folder, "mcap")
    whole = run("detect", "--bag", log, "--out", folder / "whole")
    assert whole.exit_code == 0, whole.stderr
    return log, folder / "whole"


@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGINT], ids=["kill -9", "Ctrl-C"])
def test_a_run_that_was_stopped_resumes_to_the_same_bytes(
    stop: signal.Signals, long_log: tuple[Path, Path], run: Run, tmp_path: Path
) -> None:
    log, whole = long_log
    command = [sys.executable, "-m", "percept.cli", "detect", "--bag", str(log), "--out"]
    killed = subprocess.Popen([*command, str(tmp_path / "cut")], stderr=subprocess.DEVNULL)
    journal = tmp_path / "cut" / ".journal"
    deadline = time.monotonic() + 60
    while not list(journal.glob("part-*")) and time.monotonic() < deadline:
        time.sleep(0.01)
    killed.send_signal(stop)
    assert killed.wait() == (130 if stop == signal.SIGINT else -stop)
    assert not (tmp_path / "cut" / "run.json").exists()
    resumed = run("detect", "--bag", log, "--out", tmp_path / "cut", "--resume", "--json")
    assert resumed.exit_code == 0, resumed.stderr
    assert json.loads(resumed.stdout)["counts"]["frames"] == 16
    name = "detections_3d.parquet"
    assert (tmp_path / "cut" / name).read_bytes() == (whole / name).read_bytes()
    assert not journal.exists()


def test_a_run_cannot_be_resumed_with_other_settings(drive: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run"
    (out / ".journal").mkdir(parents=True)
    (out / ".journal" / "journal.json").write_text('{"fingerprint": "of another run"}')
    done = run("detect", "--bag", drive / "drive.mcap", "--out", out, "--resume")
    assert done.exit_code == 2
    assert "other inputs or settings" in done.stderr


def test_a_damaged_log_is_doubtful_and_says_what_was_lost(
    real_clouds: list[PointCloud], pack: Pack, run: Run, tmp_path: Path
) -> None:
    for log_format in ("rosbag1", "mcap"):
        folder = tmp_path / log_format
        folder.mkdir()
        log = pack(real_clouds, folder, log_format)
        content = log.read_bytes()
        log.write_bytes(content[: int(0.6 * len(content))])
        done = run("detect", "--bag", log, "--out", folder / "run", "--json")
        assert done.exit_code == 0, done.stderr
        result = json.loads(done.stdout)
        assert result["verdict"] == "doubtful"
        assert "could not be read" in " ".join(result["why"])
        assert result["counts"]["frames"] >= 2


def test_a_given_height_that_the_scans_contradict_is_doubtful(
    drive: Path, run: Run, tmp_path: Path
) -> None:
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--topic", "top=/lidar_top/points",
        "--sensor-height", 2.6, "--out", tmp_path / "run", "--json",
    )  # fmt: skip
    result = json.loads(done.stdout)
    assert result["verdict"] == "doubtful"
    assert "above what the scans show" in " ".join(result["why"])
    (sensor,) = result["config"]["sensors"]
    assert sensor["found_height_m"] < 0.1  # of the base frame, which stands on the road
    T_base_top = load_rig(drive / "rig.yaml").sensors["lidar_top"].T_base_sensor
    assert T_base_top is not None
    assert sensor["height_m"] == pytest.approx(2.6 - T_base_top.translation_m[2], abs=1e-3)


def test_a_closed_pipe_is_no_error(drive: Path) -> None:
    command = f"{sys.executable} -m percept.cli inspect {drive / 'drive.mcap'} | head -1"
    shell = ["bash", "-c", f"set -o pipefail; {command}"]
    done = subprocess.run(shell, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
