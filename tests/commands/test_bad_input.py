"""Bad input: one clear line, the right exit code, and nothing written."""

from __future__ import annotations

import fcntl
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from percept.core.samples import ImuSample, PointCloud
from percept.datasets.write import LogWriter

Run = Callable[..., Result]
Pack = Callable[..., Path]


def _expect(done: Result, code: int, *texts: str) -> None:
    assert done.exit_code == code, (done.stdout, done.stderr)
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, lines
    for text in texts:
        assert text in lines[0]
    assert done.stdout == ""


def test_an_unknown_topic_names_the_candidates(drive: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = run("detect", "--bag", drive / "drive.mcap", "--topic", "top=/nope", "--out", out)
    _expect(done, 3, "no topic '/nope'", "/lidar_top/points (6 PointCloud2)")
    assert not out.exists()


def test_a_topic_without_clouds_is_refused(drive: Path, run: Run, tmp_path: Path) -> None:
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--topic", "/imu/data", "--out", tmp_path / "run"
    )
    _expect(done, 3, "not point clouds", "/lidar_top/points")


def test_a_log_without_clouds_says_what_it_has(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "imu.mcap"
    with LogWriter(log, "mcap") as writer:
        writer.write(
            ImuSample(
                topic="/imu",
                stamp_ns=1,
                log_time_ns=1,
                angular_velocity_radps=np.zeros(3),
                linear_acceleration_mps2=np.zeros(3),
            )
        )
    done = run("detect", "--bag", log, "--out", tmp_path / "run")
    _expect(done, 3, "no point clouds", "/imu (1 Imu)")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["detect", "inspect"])
@pytest.mark.parametrize("kind", ["text", "empty", "folder", "missing"])
def test_what_is_no_log_is_named(command: str, kind: str, run: Run, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    if kind == "text":
        log.write_text("this is a text file, not a log\n" * 20)
    elif kind == "empty":
        log.touch()
    elif kind == "folder":
        log.mkdir()
    out = tmp_path / "run"
    arguments = ["detect", "--bag", log, "--out", out] if command == "detect" else ["inspect", log]
    _expect(run(*arguments), 3, "log.mcap")
    assert not out.exists()


def test_an_unknown_setting_names_the_nearest(drive: Path, run: Run, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("lidar: {cluster: {tolerence_m: 0.4}}\n")
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--config", config, "--out", tmp_path / "run"
    )
    _expect(done, 2, "lidar.cluster.tolerence_m", "Did you mean 'tolerance_m'")


@pytest.mark.parametrize("height", ["-2", "60"])
def test_an_impossible_height_is_refused(
    height: str, drive: Path, run: Run, tmp_path: Path
) -> None:
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--sensor-height", height,
        "--out", tmp_path / "run",
    )  # fmt: skip
    _expect(done, 2, "height")
    assert not (tmp_path / "run").exists()


def test_a_cloud_of_nothing_but_nan_is_refused(run: Run, tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    from percept.datasets.messages import Connection, RawMessage

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    header = kinds["std_msgs/msg/Header"](
        stamp=kinds["builtin_interfaces/msg/Time"](sec=5, nanosec=0), frame_id="top"
    )
    fields = [
        kinds["sensor_msgs/msg/PointField"](name=n, offset=4 * i, datatype=7, count=1)
        for i, n in enumerate("xyz")
    ]
    data = np.full((50, 3), np.nan, np.float32).tobytes()
    message = kinds["sensor_msgs/msg/PointCloud2"](
        header=header, height=1, width=50, fields=fields, is_bigendian=False, point_step=12,
        row_step=600, data=np.frombuffer(data, np.uint8), is_dense=False,
    )  # fmt: skip
    msgtype = "sensor_msgs/msg/PointCloud2"
    definition, _ = store.generate_msgdef(msgtype, ros_version=2)
    connection = Connection("/nan", msgtype, "cdr", definition, "msg")
    log = tmp_path / "nan.mcap"
    with LogWriter(log, "mcap") as writer:
        for stamp in (1, 2, 3):
            raw = bytes(store.serialize_cdr(message, msgtype))
            writer.write_raw(RawMessage(connection, stamp, raw))
    done = run("detect", "--bag", log, "--out", tmp_path / "run")
    _expect(done, 3, "NaN", "/nan")
    assert not (tmp_path / "run").exists()


def test_a_folder_with_something_in_it_is_left_alone(drive: Path, run: Run, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    done = run("detect", "--bag", drive / "drive.mcap", "--out", tmp_path)
    _expect(done, 2, "is not empty", "--force")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_folder_that_another_run_writes_is_left_alone(
    drive: Path, run: Run, tmp_path: Path
) -> None:
    with (tmp_path / ".percept-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = run("detect", "--bag", drive / "drive.mcap", "--out", tmp_path)
    _expect(done, 2, "in use")


def test_a_file_as_run_folder_is_refused(drive: Path, run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = run("detect", "--bag", drive / "drive.mcap", "--out", tmp_path / "file")
    _expect(done, 2, "not a folder")


def test_a_merge_without_places_is_refused(run: Run, pack: Pack, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    clouds = [
        PointCloud(
            topic=topic,
            stamp_ns=10**9 * i,
            log_time_ns=10**9 * i,
            frame=topic.strip("/"),
            points_xyz=rng.uniform(-20, 20, (500, 3)).astype(np.float32),
        )
        for i in range(1, 4)
        for topic in ("/left", "/right")
    ]
    log = pack(clouds, tmp_path, "mcap")
    done = run("detect", "--bag", log, "--lidars", "merge", "--out", tmp_path / "run")
    _expect(done, 2, "left, right", "--rig")


def test_a_rig_that_lies_about_its_rotation_is_refused(
    drive: Path, run: Run, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(
        "sensors: {top: {kind: lidar, topic: /lidar_top/points, frame: lidar_top, "
        "T_base_sensor: {translation_m: [0, 0, 2], quat_xyzw: [0, 0, 0, 3]}}}"
    )
    done = run("detect", "--bag", drive / "drive.mcap", "--rig", rig, "--out", tmp_path / "run")
    _expect(done, 2, "quaternion length 3")


def test_a_missing_system_library_is_named_with_its_package() -> None:
    from percept.cli.dependencies import explain_import_error

    text = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"
    explained = explain_import_error(ImportError(text))
    assert explained is not None
    assert explained.exit_code == 5
    assert "sudo apt-get install libusb-1.0-0" in str(explained)
    missing = explain_import_error(ModuleNotFoundError("No module named 'rerun'", name="rerun"))
    assert missing is not None
    assert "rerun" in str(missing)
    assert explain_import_error(ImportError("cannot import name 'x'")) is None


@pytest.mark.parametrize("flag", ["--start", "--end"])
@pytest.mark.parametrize("seconds", ["nan", "inf", "-1"])
def test_a_time_that_is_none_is_refused(
    flag: str, seconds: str, drive: Path, run: Run, tmp_path: Path
) -> None:
    log = drive / "drive.mcap"
    _expect(run("detect", "--bag", log, flag, seconds, "--out", tmp_path / "run"), 2, flag)
    _expect(run("inspect", log, flag, seconds), 2, flag)


def test_clouds_that_cannot_be_decoded_are_said_with_their_reason(run: Run, tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    from percept.datasets.messages import Connection, RawMessage

    msgtype = "sensor_msgs/msg/PointCloud2"
    definition, _ = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(msgtype, ros_version=2)
    connection = Connection("/broken", msgtype, "cdr", definition, "msg")
    log = tmp_path / "broken.mcap"
    with LogWriter(log, "mcap") as writer:
        for stamp in (1, 2):
            writer.write_raw(RawMessage(connection, stamp, b"\0\1\0\0 not a cloud"))
    done = run("detect", "--bag", log, "--out", tmp_path / "run")
    _expect(done, 3, "not one scan can be read: 2 x messages on /broken")


def test_a_bad_input_leaves_the_run_that_was_there(drive: Path, run: Run, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "report.html").write_text("of the run before")
    done = run("detect", "--bag", tmp_path / "none.bag", "--out", tmp_path, "--force")
    _expect(done, 3, "none.bag")
    done = run(
        "detect", "--bag", drive / "drive.mcap", "--topic", "/none", "--out", tmp_path, "--force"
    )
    _expect(done, 3, "/none")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["report.html", "run.json"]
