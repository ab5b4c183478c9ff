"""`percept detect` on cameras: several networks at once, as a user runs them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from onnx_graphs import yolo_graph
from typer.testing import Result

from percept.cli.detect.outputs import RunOutputs
from percept.core.rig import CameraSensor, LidarSensor, Rig, rig_as_yaml
from percept.core.samples import CameraImage, CameraInfo, PointCloud
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.bag_recording import BagRecording
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.datasets.write import LogWriter
from percept.export.tables import DETECTIONS_2D

Run = Callable[..., Result]
Models = dict[str, Path]

_CAMERAS = ("cam_front", "cam_left", "cam_right", "cam_rear")
_IMAGES_OF_ONE = 6
_TABLES = ("detections_2d.parquet", "detections_3d.parquet", "images_2d.parquet")


@pytest.fixture(scope="module")
def drive4(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a short drive with four small cameras and few beams."""
    folder = tmp_path_factory.mktemp("drive4")
    generate_drive(
        DriveConfig(seconds=0.6, beam_share=0.25, cameras=_CAMERAS, image_size=(320, 200)), folder
    )
    return folder / "drive.mcap"


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Models:
    """Three networks of different kinds that always find four things each."""
    folder = tmp_path_factory.mktemp("models")
    return {
        "one": yolo_graph(folder / "one.onnx", "v8", size=(320, 320), names=True),
        "two": yolo_graph(folder / "two.onnx", "yolox", size=(416, 416)),
        "three": yolo_graph(folder / "three.onnx", "end2end", size=(640, 640), class_count=3),
    }


def _flags(models: Models, *names: str, every: int = 1) -> list[str]:
    rate = f"@every={every}" if every > 1 else ""
    return [part for name in names for part in ("--model", f"{name}={models[name]}{rate}")]


def _rows(run: Path, name: str = "detections_2d.parquet") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.read_table(run / name).to_pylist()
    return rows


@pytest.fixture(scope="module")
def three(drive4: Path, models: Models, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three networks on four cameras, one of them at every fifth image."""
    out = tmp_path_factory.mktemp("three") / "run"
    done = run(
        "detect", "--bag", drive4, *_flags(models, "one", "two"),
        *_flags(models, "three", every=5), "--out", out, "--mcap",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    return out


# ---- what a run does


def test_every_network_sees_every_image_whose_turn_it_is(three: Path) -> None:
    looked = Counter((row["model"], row["camera"]) for row in _rows(three, "images_2d.parquet"))
    assert looked == {
        **{(model, camera): _IMAGES_OF_ONE for model in ("one", "two") for camera in _CAMERAS},
        **{("three", camera): 2 for camera in _CAMERAS},
    }
    counts = json.loads((three / "run.json").read_text())["counts"]
    assert counts["images"] == 4 * _IMAGES_OF_ONE
    found = {
        model: len([r for r in _rows(three) if r["model"] == model]) for model in counts["boxes_2d"]
    }
    assert found == {
        m: sum(sum(c.values()) for c in by.values()) for m, by in counts["boxes_2d"].items()
    }
    assert found["one"] == found["two"] == 3 * found["three"]


def test_boxes_stand_in_log_order_with_the_schema(three: Path) -> None:
    assert pq.read_schema(three / "detections_2d.parquet").equals(DETECTIONS_2D)
    frames = [row["frame"] for row in _rows(three)]
    assert frames == sorted(frames)
    assert set(frames) == set(range(4 * _IMAGES_OF_ONE))


def test_together_networks_find_what_each_finds_alone(
    three: Path, drive4: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    for name, every in (("one", 1), ("two", 1), ("three", 5)):
        out = tmp_path / name
        done = run("detect", "--bag", drive4, *_flags(models, name, every=every), "--out", out)
        assert done.exit_code == 0, done.stderr
        alone = [{**row, "primary": None} for row in _rows(out)]
        together = [{**row, "primary": None} for row in _rows(three) if row["model"] == name]
        assert alone == together


def test_the_scans_are_those_of_a_run_without_cameras(
    three: Path, drive4: Path, run: Run, tmp_path: Path
) -> None:
    done = run("detect", "--bag", drive4, "--lidar-only", "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    name = "detections_3d.parquet"
    assert (tmp_path / "run" / name).read_bytes() == (three / name).read_bytes()
    assert not (tmp_path / "run" / "detections_2d.parquet").exists()
    assert "camera" not in done.stderr


def test_what_was_found_out_about_a_network_is_shown_and_stored(three: Path) -> None:
    run = json.loads((three / "run.json").read_text())
    one, far = run["config"]["models"]["one"], run["config"]["models"]["three"]
    assert (one["layout"], one["input_size"], one["pixels"]) == ("v8", [320, 320], "rgb1")
    assert (far["layout"], far["every"]) == ("end2end", 5)
    assert {camera["name"] for camera in run["config"]["cameras"]} == set(_CAMERAS)
    assert (three / "overlay.mcap").stat().st_size > 0
    assert "one" in (three / "report.html").read_text()


def test_without_a_network_a_log_with_cameras_says_that_it_has_them(
    drive4: Path, run: Run, tmp_path: Path
) -> None:
    done = run("detect", "--bag", drive4, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert "note: No camera was looked at. Give --model" in done.stderr


def test_cameras_alone_find_boxes_without_places(
    drive4: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    done = run(
        "detect", "--bag", drive4, "--camera-only", *_flags(models, "one"),
        "--topic", "left=/cam_left/image_raw/compressed", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    rows = _rows(out)
    assert {row["camera"] for row in rows} == {"left"}
    assert {row["range_m"] for row in rows} == {None}
    assert not (out / "detections_3d.parquet").exists()
    assert f"{_IMAGES_OF_ONE} images" in done.stdout


def test_settings_of_one_network_come_from_the_file_and_flags_win(
    drive4: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("models: {one: {score: 0.7, class_scores: {thing 0: 0.95}}, two: {iou: 0.3}}")
    done = run(
        "detect", "--bag", drive4, "--camera-only", *_flags(models, "one", "two"), "--iou", 0.6,
        "--config", config, "--out", tmp_path / "run", "--json", "--end", 0.15,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    stored = json.loads(done.stdout)["config"]["models"]
    assert (stored["one"]["config"]["score"], stored["two"]["config"]["score"]) == (0.7, 0.25)
    assert stored["one"]["config"]["iou"] == stored["two"]["config"]["iou"] == 0.6
    labels = Counter(r["label"] for r in _rows(tmp_path / "run") if r["model"] == "one")
    assert set(labels) == {"thing 79"}  # 0.78; thing 0 has 0.91, the others are below 0.7


# ---- what goes wrong


@pytest.fixture(scope="module")
def damaged(drive4: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log with the third JPEG of one camera overwritten, and all of another camera."""
    path = tmp_path_factory.mktemp("damaged") / "log.mcap"
    seen: Counter[str] = Counter()
    with open_recording(drive4) as recording, LogWriter(path, "mcap") as writer:
        assert isinstance(recording, BagRecording)
        for raw in recording.messages():
            topic = raw.connection.topic
            seen[topic] += 1
            third = topic.startswith("/cam_left/image") and seen[topic] == 3
            if third or topic.startswith("/cam_rear/image"):
                data = bytes(raw.data)
                raw = replace(raw, data=data[:100] + bytes(len(data) - 100))
            writer.write_raw(raw)
    return path


def test_a_broken_jpeg_is_counted_and_named_and_the_rest_is_done(
    damaged: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    done = run("detect", "--bag", damaged, *_flags(models, "one"), "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["counts"]["images_unusable"] == 1 + _IMAGES_OF_ONE
    named = {why: n for why, n in result["dropped"].items() if "cam_" in why}
    assert sum(named.values()) == 1 + _IMAGES_OF_ONE
    assert any("cam_left" in why and count == 1 for why, count in named.items())
    assert result["verdict"] == "doubtful"
    assert "1 of 6 images of cam_left cannot be used" in result["why"]
    assert "6 of 6 images of cam_rear cannot be used" in result["why"]
    looked = Counter(r["camera"] for r in _rows(out, "images_2d.parquet") if r["model"])
    assert looked == {"cam_front": 6, "cam_left": 5, "cam_right": 6}


def test_a_run_without_a_usable_image_is_bad(
    damaged: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    done = run(
        "detect", "--bag", damaged, "--camera-only", *_flags(models, "one"), "--out",
        tmp_path / "run", "--topic", "rear=/cam_rear/image_raw/compressed",
    )  # fmt: skip
    assert done.exit_code == 4
    assert "verdict: bad: no image could be used" in done.stdout


def test_a_part_of_the_log_without_images_is_named(
    drive4: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    done = run(
        "detect", "--bag", drive4, "--camera-only", *_flags(models, "one"), "--start", 9,
        "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.exit_code == 4
    assert "verdict: bad: no image in this part of the log" in done.stdout


def test_a_network_that_finds_nothing_is_doubtful(drive4: Path, run: Run, tmp_path: Path) -> None:
    silent = yolo_graph(tmp_path / "silent.onnx", "v8", size=(320, 320), class_count=80)
    done = run(
        "detect", "--bag", drive4, "--camera-only", "--model", f"silent={silent}", "--score", 0.99,
        "--out", tmp_path / "run", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["verdict"] == "doubtful"
    assert "'silent' found nothing in 24 images" in result["why"]
    assert any("silent: " in note for note in result["notes"])


def test_images_that_change_their_size_are_looked_at(
    models: Models, run: Run, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    with LogWriter(log, "mcap", images="jpeg") as writer:
        for number, size in enumerate([(100, 160), (40, 40), (33, 501), (100, 160)]):
            pixels = np.full((*size, 3), 90, np.uint8)
            writer.write(_image("/cam/image_raw/compressed", number, pixels))
    done = run("detect", "--bag", log, *_flags(models, "one"), "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert "4 images" in done.stdout
    looked_at = _rows(tmp_path / "run", "images_2d.parquet")
    assert [(row["frame"], row["model"]) for row in looked_at] == [(k, "one") for k in range(4)]


def test_depth_images_tell_where_boxes_are(models: Models, run: Run, tmp_path: Path) -> None:
    log, K = tmp_path / "log.mcap", np.array([[100.0, 0, 80], [0, 100, 50], [0, 0, 1]])
    with LogWriter(log, "mcap") as writer:
        for number in range(4):
            image = _image("/cam/image_raw", number, np.full((100, 160, 3), 90, np.uint8))
            writer.write(
                CameraInfo(
                    topic="/cam/camera_info",
                    stamp_ns=image.stamp_ns,
                    frame="camera",
                    log_time_ns=image.log_time_ns,
                    image_size=(160, 100),
                    model="plumb_bob",
                    K=K,
                    distortion=np.zeros(5),
                )
            )
            writer.write(image)
            late_ns = image.log_time_ns + 40_000_000
            depth = np.full((100, 160), 8.0 + number, np.float32)
            writer.write(
                replace(image, topic="/cam/depth/image_raw", log_time_ns=late_ns, pixels=depth)
            )
    done = run("detect", "--bag", log, *_flags(models, "one"), "--out", tmp_path / "run", "--json")
    assert done.exit_code == 0, done.stderr
    rows = _rows(tmp_path / "run")
    assert {row["depth_source"] for row in rows} == {"depth"}
    assert all(row["z"] == pytest.approx(8.0 + row["frame"], abs=1e-4) for row in rows)
    assert {row["frame_id"] for row in rows} == {"camera"}
    assert json.loads(done.stdout)["counts"]["boxes_2d_placed"] == {"depth": len(rows)}


def _image(topic: str, number: int, pixels: NDArray[np.uint8]) -> CameraImage:
    stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
    return CameraImage(
        topic=topic, stamp_ns=stamp_ns, log_time_ns=stamp_ns, frame="camera", pixels=pixels
    )


_LEFT, _TOP = "/cam_left/image_raw/compressed", "/lidar_top/points"
_GOOD = ("--model", "one={one}")


@pytest.mark.parametrize(
    ("arguments", "code", "texts"),
    [
        (("--model", "{one}"), 2, ("NAME=FILE",)),
        (("--model", "a=missing.onnx"), 3, ("missing.onnx",)),
        (("--model", "a={one}@every=0"), 2, ("every=0",)),
        ((*_GOOD, *_GOOD), 2, ("names 'one' twice",)),
        ((*_GOOD, "--layout", "one=v77"), 2, ("v77", "v8")),
        ((*_GOOD, "--layout", "two=v8"), 2, ("names no model", "one")),
        ((*_GOOD, "--layout", "yolox"), 2, ("yolox", "one.onnx")),
        ((*_GOOD, "--input-size", "big"), 2, ("'big'", "640x384")),
        ((*_GOOD, "--input-size", "640x640"), 2, ("320",)),
        ((*_GOOD, "--classes", "nowhere.txt"), 3, ("nowhere.txt",)),
        ((*_GOOD, "--pixels", "hsv"), 2, ("one.pixels", "bgr255")),
        ((*_GOOD, "--score", "1.5"), 2, ("score",)),
        ((*_GOOD, "--lidar-only"), 2, ("--lidar-only",)),
        ((*_GOOD, "--topic", f"a={_LEFT}", "--topic", f"b={_LEFT}"), 2, ("'a' and 'b' are one",)),
        (("--topic", "a={top}", "--topic", "b={top}"), 2, ("'a' and 'b' are one LiDAR",)),
        ((*_GOOD, "--bag", "{drive}", "--bag", "{drive}"), 2, ("--bag names a log twice",)),
        ((*_GOOD, "--topic", "cam=/nope"), 3, ("/nope", _LEFT)),
        (("--camera-only",), 2, ("--model NAME=FILE.onnx",)),
        (("--lidar-only", "--camera-only"), 2, ("nothing",)),
        (("--layout", "v8"), 2, ("--model",)),
        (("--score", "0.5"), 2, ("--score is for --model",)),
        (("--undistort",), 2, ("--undistort is for --model",)),
        (("--topic", f"cam={_LEFT}"), 2, ("--model NAME=FILE.onnx",)),
        ((*_GOOD, "--config", "{config}"), 2, ("'far'", "one")),
        ((*_GOOD, "--undistort", "--camera-only", "--bag", "{pictures}"), 2, ("lens",)),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else str(value),
)
def test_what_cannot_be_asked_for_is_one_line(
    arguments: tuple[str, ...],
    code: int,
    texts: tuple[str, ...],
    drive4: Path,
    models: Models,
    run: Run,
    tmp_path: Path,
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("models: {far: {score: 0.5}}")
    pictures = tmp_path / "pictures.mcap"
    with LogWriter(pictures, "mcap") as writer:
        writer.write(_image("/cam/image_raw", 0, np.zeros((40, 60, 3), np.uint8)))
    places = {**models, "config": config, "pictures": pictures, "drive": drive4, "top": _TOP}
    given = [argument.format(**places) for argument in arguments]
    bag = [] if "--bag" in given else ["--bag", drive4]
    done = run("detect", *bag, *given, "--out", tmp_path / "run")
    assert done.exit_code == code, (done.stdout, done.stderr)
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert not [text for text in texts if text not in done.stderr], done.stderr
    assert not (tmp_path / "run").exists()


def test_a_log_of_images_alone_needs_a_network(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    with LogWriter(log, "mcap") as writer:
        writer.write(_image("/cam/image_raw", 0, np.zeros((40, 60, 3), np.uint8)))
    done = run("detect", "--bag", log, "--out", tmp_path / "run")
    assert done.exit_code == 2
    assert "images but no point clouds" in done.stderr
    assert "--model NAME=FILE.onnx" in done.stderr


# ---- runs that end early


@pytest.mark.parametrize("kept", [0, 1, 7, 23])
def test_a_stopped_run_resumes_to_the_same_tables(
    kept: int,
    three: Path,
    drive4: Path,
    models: Models,
    run: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, add_image, left = tmp_path / "run", RunOutputs.add_image, iter(range(kept))

    def add_some(outputs: RunOutputs, image: Any) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        add_image(outputs, image)

    command = (
        "detect", "--bag", drive4, *_flags(models, "one", "two"),
        *_flags(models, "three", every=5), "--out", out,
    )  # fmt: skip
    with monkeypatch.context() as patch:
        patch.setattr(RunOutputs, "add_image", add_some)
        assert run(*command).exit_code == 130
    assert not (out / "run.json").exists()
    resumed = run(*command, "--resume", "--json")
    assert resumed.exit_code == 0, resumed.stderr
    assert json.loads(resumed.stdout)["counts"]["images"] == 4 * _IMAGES_OF_ONE
    for name in _TABLES:
        assert (out / name).read_bytes() == (three / name).read_bytes(), name
    assert not list(out.glob(".*"))


def test_a_run_stops_before_the_disk_is_full(
    drive4: Path, models: Models, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, left = tmp_path / "run", iter([100 << 20] * 9)

    def shrinking(_folder: Path) -> SimpleNamespace:
        return SimpleNamespace(free=next(left, 63 << 20))

    command = ("detect", "--bag", drive4, "--camera-only", *_flags(models, "one"), "--out", out)
    with monkeypatch.context() as patch:
        patch.setattr("percept.cli.detect.outputs.shutil.disk_usage", shrinking)
        done = run(*command)
    assert done.exit_code == 2
    assert f"{out}: only 63 MB are left on its disk. Make room" in done.stderr
    resumed = run(*command, "--resume", "--json")
    assert resumed.exit_code == 0, resumed.stderr
    frames = [row["frame"] for row in _rows(out, "images_2d.parquet")]
    assert frames == list(range(4 * _IMAGES_OF_ONE))


def test_a_killed_run_resumes_to_the_same_tables(
    three: Path, drive4: Path, models: Models, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    command = [
        "detect", "--bag", str(drive4), *_flags(models, "one", "two"),
        *_flags(models, "three", every=5), "--out", str(out),
    ]  # fmt: skip
    killed = subprocess.Popen(
        [sys.executable, "-m", "percept.cli", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 60
    while not list(out.glob(".journal-images/part-*")) and time.monotonic() < deadline:
        time.sleep(0.002)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    resumed = run(*command, *(["--resume"] if not (out / "run.json").exists() else ["--force"]))
    assert resumed.exit_code == 0, resumed.stderr
    for name in _TABLES:
        assert (out / name).read_bytes() == (three / name).read_bytes(), name


# ---- memory

_MEASURED = (
    "import resource, subprocess, sys\n"
    "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)\n"
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
)


@pytest.mark.slow
def test_ten_times_the_images_need_no_more_memory(models: Models, tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    peaks = {}
    for count in (100, 1000):
        log = tmp_path / f"{count}.mcap"
        with LogWriter(log, "mcap", images="jpeg") as writer:
            for number in range(count):
                writer.write(_image("/cam/image_raw/compressed", number, pixels))
        command = [
            sys.executable, "-m", "percept.cli", "detect", "--bag", str(log),
            *_flags(models, "one", "two"), "--out", str(tmp_path / str(count)),
        ]  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", _MEASURED, *command], capture_output=True, text=True, check=True
        )
        peaks[count] = int(done.stdout)
    assert peaks[1000] < 1.1 * peaks[100], peaks


# ---- a real image and its scan


@pytest.fixture(scope="module")
def kitti(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log of KITTI's image and scan 000008, and their rig."""
    folder, scene = tmp_path_factory.mktemp("kitti"), shared_data / "scenes" / "kitti_000008"
    pixels = cv2.imread(str(scene / "000008.png"))
    scan = np.fromfile(scene / "000008.bin", np.float32).reshape(-1, 4)
    image = _image("/cam/image_raw", 0, np.asarray(pixels, np.uint8))
    with LogWriter(folder / "log.mcap", "mcap") as writer:
        writer.write(image)
        writer.write(
            PointCloud(
                topic="/velodyne/points",
                stamp_ns=image.stamp_ns + 20_000_000,
                log_time_ns=image.log_time_ns + 50_000_000,
                frame="velodyne",
                points_xyz=scan[:, :3],
                intensity=scan[:, 3],
            )
        )
    camera = _labels(scene)["images"]["CAM2"]
    K, T_camera_lidar = _kitti_calibration(camera)
    T_base_lidar = Transform("base_link", "velodyne", np.eye(4))
    lidar = LidarSensor("top", "/velodyne/points", "velodyne", T_base_lidar)
    sensor = CameraSensor(
        "cam", image.topic, "camera", (camera["width"], camera["height"]), "pinhole",
        (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), (0.0,) * 5,
        Transform("base_link", "camera", np.asarray(np.linalg.inv(T_camera_lidar), np.float64)),
    )  # fmt: skip
    rig = Rig("base_link", {"top": lidar, "cam": sensor})
    (folder / "rig.yaml").write_text(rig_as_yaml(rig))
    return folder


def _labels(scene: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((scene / "000008.json").read_text())["data_list"][0]
    return content


def _kitti_calibration(camera: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return K, and `T_camera_lidar` of the colour camera, which stands beside the reference."""
    P = np.array(camera["cam2img"])
    beside = np.eye(4)
    beside[:3, 3] = np.linalg.solve(P[:3, :3], P[:3, 3])
    return P[:3, :3], beside @ np.array(camera["lidar2cam"])


def test_the_cars_of_kitti_are_found_with_their_places(
    kitti: Path, shared_data: Path, run: Run, tmp_path: Path
) -> None:
    model = shared_data / "yolo" / "yolox_nano" / "yolox_nano.onnx"
    done = run(
        "detect", "--bag", kitti / "log.mcap", "--rig", kitti / "rig.yaml", "--model",
        f"nano={model}", "--score", 0.3, "--sensor-height", 1.73, "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    labels = _labels(shared_data / "scenes" / "kitti_000008")
    cars = [i for i in labels["instances"] if i["bbox_label"] == 2]
    assert len(cars) == 6
    found = [row for row in _rows(tmp_path / "run") if row["label"] in ("car", "truck")]
    _, T_camera_lidar = _kitti_calibration(labels["images"]["CAM2"])
    for car in cars:
        row = max(found, key=lambda row: _iou(row, car["bbox"]))
        assert _iou(row, car["bbox"]) > 0.5
        assert row["depth_source"] == "cluster"
        centre = np.linalg.inv(T_camera_lidar) @ [*car["bbox_3d"][:3], 1]
        assert np.hypot(row["x"] - centre[0], row["y"] - centre[1]) < 2.0


def _iou(row: dict[str, Any], box: list[float]) -> float:
    own = np.array([row[name] for name in ("x1_px", "y1_px", "x2_px", "y2_px")])
    shared = np.clip(np.minimum(own[2:], box[2:]) - np.maximum(own[:2], box[:2]), 0, None).prod()
    areas = (own[2:] - own[:2]).prod() + np.subtract(box[2:], box[:2]).prod()
    return float(shared / (areas - shared))
