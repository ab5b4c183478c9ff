"""What `percept detect` makes of the time in a log: poses, tracks and lights, as a user runs it."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from lxml import etree
from numpy.typing import NDArray
from onnx_graphs import KnownBoxes, yolo_graph
from typer.testing import Result

from percept.cli.detect import over_time
from percept.core.samples import (
    CameraImage,
    GnssFix,
    ImuSample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.datasets import open_recording
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.datasets.write import LogFormat, LogWriter
from percept.export.light_table import read_lights
from percept.export.pose_table import read_poses
from percept.export.track_table import read_tracks

Run = Callable[..., Result]
Change = Callable[[Sample], Sample | None]

_TABLES = ("poses.parquet", "tracks.parquet", "scans_3d.parquet", "detections_3d.parquet")
_LAMPS = {"red": (60, 40, 250), "yellow": (40, 190, 250), "green": (170, 230, 60)}  # BGR
_HEAD = (140, 60, 192, 180)


def _bytes(folder: Path, *names: str) -> list[bytes]:
    return [(folder / name).read_bytes() for name in names]


def _rewritten(log: Path, out: Path, change: Change, log_format: LogFormat = "mcap") -> Path:
    with open_recording([log]) as recording, LogWriter(out, log_format) as writer:
        for sample in recording.samples():
            changed = change(sample)
            if changed is not None:
                writer.write(changed)
    return out


def _refused(done: Result, code: int, *texts: str) -> None:
    assert done.exit_code == code, (done.stdout, done.stderr)
    (line,) = done.stderr.strip().splitlines()
    for text in texts:
        assert text in line


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a drive with few beams and a small camera, whose log is `log.mcap`."""
    folder = tmp_path_factory.mktemp("street")
    config = DriveConfig(
        seconds=1.2, beam_share=0.15, cameras=("cam_front",), image_size=(160, 100)
    )
    generate_drive(config, folder)
    _rewritten(folder / "drive.mcap", folder / "log.mcap", lambda sample: sample)
    return folder


@pytest.fixture(scope="module")
def log(street: Path) -> Path:
    return street / "log.mcap"


@pytest.fixture(scope="module")
def whole(log: Path, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of LiDARs whose poses are those of the log."""
    out = tmp_path_factory.mktemp("whole") / "run"
    done = run("detect", "--bag", log, "--lidar-only", "--out", out)
    assert done.exit_code == 0, done.stderr
    assert " tracks (" in done.stdout
    return out


# ---- poses and tracks


def test_tracks_are_in_a_frame_that_does_not_move(whole: Path) -> None:
    frames = list(read_tracks(whole / "tracks.parquet"))
    assert {tracks.frame_id for tracks in frames} == {read_poses(whole / "poses.parquet").target}
    scans = pq.read_table(whole / "scans_3d.parquet")["stamp_ns"].to_pylist()
    assert {tracks.stamp_ns for tracks in frames} <= set(scans)
    record = json.loads((whole / "run.json").read_text())
    ids = {i for tracks in frames for i in tracks.ids.tolist()}
    assert sum(record["counts"]["tracks"].values()) == len(ids) > 10
    assert record["health"]["lidars"]["messages"] == len(scans)


@pytest.mark.parametrize("log_format", ["mcap", "rosbag1", "rosbag2"])
def test_the_same_log_gives_the_same_bytes_in_every_container(
    log_format: LogFormat, log: Path, whole: Path, run: Run, tmp_path: Path
) -> None:
    suffix = {"mcap": ".mcap", "rosbag1": ".bag", "rosbag2": ""}[log_format]
    copy = _rewritten(log, tmp_path / f"log{suffix}", lambda sample: sample, log_format)
    files = [path for path in (copy, *copy.glob("*")) if path.is_file()]
    before = [path.read_bytes() for path in files]
    done = run("detect", "--bag", copy, "--lidar-only", "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert _bytes(tmp_path / "run", *_TABLES) == _bytes(whole, *_TABLES)
    assert [path.read_bytes() for path in files] == before


def test_a_run_that_was_stopped_while_it_tracked_resumes_to_the_same_bytes(
    log: Path, whole: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGINT)  # one Ctrl-C, in the middle of tracking
        pytest.fail("a Ctrl-C while tracking is not heard")

    command = ["detect", "--bag", log, "--lidar-only", "--out", tmp_path / "run"]
    with monkeypatch.context() as patch:
        patch.setattr(over_time, "follow", stopped)
        assert run(*command).exit_code == 130
    assert not (tmp_path / "run" / "run.json").exists()
    done = run(*command, "--resume")
    assert done.exit_code == 0, done.stderr
    assert _bytes(tmp_path / "run", *_TABLES) == _bytes(whole, *_TABLES)
    assert not (tmp_path / "run" / ".journal").exists()


@pytest.mark.parametrize(
    ("source", "frame"), [("gnss", "enu"), ("odometry", "odom"), ("tf", "odom"), ("lidar", "odom")]
)
def test_poses_come_from_where_the_user_says(
    source: str, frame: str, log: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    done = run("detect", "--bag", log, "--lidar-only", "--poses", source, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    poses = json.loads(done.stdout)["config"]["poses"]
    assert poses["source"].startswith(source)
    assert read_poses(out / "poses.parquet").target == poses["frame"] == frame


def test_a_source_of_poses_that_the_log_has_not_is_refused(
    log: Path, run: Run, tmp_path: Path
) -> None:
    command = ["detect", "--bag", log, "--lidar-only", "--poses", "pose"]
    done = run(*command, "--out", tmp_path / "run")
    assert done.exit_code == 3
    assert "nothing for" in done.stderr
    assert not (tmp_path / "run" / "run.json").exists()


def test_without_tracks_there_are_none_and_their_options_are_refused(
    street: Path, log: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    command = ["detect", "--bag", log, "--lidar-only", "--out", out]
    untracked = [*command, "--no-track"]
    _refused(run(*untracked, "--poses", "tf"), 2, "--no-track makes no use of --poses")
    _refused(run(*untracked, "--map", street / "map.osm"), 2, "--no-track makes no use of --map")
    _refused(run(*command, "--origin", "1,2"), 2, "--origin is for --map")
    done = run(*untracked)
    assert done.exit_code == 0, done.stderr
    assert " tracks (" not in done.stdout
    assert not {"poses.parquet", "tracks.parquet"} & {path.name for path in out.iterdir()}


def _without_navigation(sample: Sample) -> Sample | None:
    moves = isinstance(sample, TransformSample) and not sample.static
    return None if moves or isinstance(sample, ImuSample | GnssFix | PoseSample) else sample


def test_where_the_log_has_no_poses_the_lidar_tells(log: Path, run: Run, tmp_path: Path) -> None:
    silent = _rewritten(log, tmp_path / "log.mcap", _without_navigation)
    done = run("detect", "--bag", silent, "--lidar-only", "--out", tmp_path / "run", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["config"]["poses"]["source"] == "lidar"
    assert "end of its scan" in done.stderr


def test_lidars_whose_places_nobody_knows_are_not_thrown_together(
    log: Path, run: Run, tmp_path: Path
) -> None:
    def two_lidars(sample: Sample) -> Sample | None:
        other = isinstance(sample, PointCloud) and not sample.topic.startswith(
            ("/lidar_top", "/lidar_front")
        )
        return None if other or isinstance(sample, TransformSample) else sample

    two = _rewritten(log, tmp_path / "log.mcap", two_lidars)
    done = run("detect", "--bag", two, "--lidar-only", "--out", tmp_path / "run", "--json")
    record = json.loads(done.stdout)
    assert (done.exit_code, record["verdict"]) == (0, "doubtful")
    lost = [n for why, n in record["dropped"].items() if why.endswith("a frame without poses")]
    assert lost == [12]
    assert "of 24 scans have no pose" in " ".join(record["why"])
    assert "no place of a sensor in frame 'base_link' is known" in done.stderr


def test_names_of_topics_are_text(log: Path, run: Run, tmp_path: Path) -> None:
    def renamed(sample: Sample) -> Sample | None:
        return replace(sample, topic=sample.topic.replace("lidar_top", 'a b/<script>"x'))

    ugly = _rewritten(log, tmp_path / "log.mcap", renamed)
    out = tmp_path / "run"
    command = ["detect", "--bag", ugly, "--lidar-only", "--lidars", "separate", "--mcap"]
    done = run(*command, "--out", out)
    assert done.exit_code == 0, done.stderr
    page = (out / "report.html").read_text()
    assert "a_b_&lt;script&gt;" in page or "a b_&lt;script&gt;" in page
    assert "<script>" not in page
    again = run("track", out, "--mcap", "--out", tmp_path / "again")
    assert again.exit_code == 0, again.stderr
    assert "<script>" not in (tmp_path / "again" / "report.html").read_text()


def test_an_input_in_the_folder_is_not_written_over(
    street: Path, log: Path, run: Run, tmp_path: Path
) -> None:
    copies = {tmp_path / "rig.yaml": street / "rig.yaml", tmp_path / "overlay.mcap": log}
    for copy, original in copies.items():
        copy.write_bytes(original.read_bytes())
    rig, bag = copies
    for arguments in (["--bag", bag], ["--bag", log, "--rig", rig]):
        done = run("detect", *arguments, "--lidar-only", "--out", tmp_path, "--force")
        _refused(done, 2, "it is read, and lies in --out")
    for copy, original in copies.items():
        assert copy.read_bytes() == original.read_bytes()


# ---- lights


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that sees a traffic light at one place of each image, and never tells its state."""
    path = tmp_path_factory.mktemp("network") / "lights.onnx"
    known = KnownBoxes(np.array([_HEAD], dtype=np.float64), np.array([0]), np.array([0.9]))
    names = {"names": "{0: 'traffic light', 1: 'person'}"}
    return yolo_graph(path, "v8", size=(320, 320), class_count=2, known=known, metadata=names)


def _shifted_map(source: Path, out: Path, east_m: float) -> Path:
    tree = etree.parse(source)
    for tag in tree.iter("tag"):
        if tag.get("k") == "local_x":
            tag.set("v", str(float(tag.get("v", "")) + east_m))
    tree.write(str(out))
    return out


def _map_without_lights(source: Path, out: Path) -> Path:
    tree = etree.parse(source)
    root = tree.getroot()
    for element in list(root):
        if any(tag.get("v") == "traffic_light" for tag in element.iter("tag")):
            root.remove(element)
    tree.write(str(out))
    return out


@pytest.mark.parametrize("case", ["far away", "no lights", "wrong origin"])
def test_a_map_that_cannot_be_used_is_doubtful_and_says_why(
    case: str, street: Path, log: Path, network: Path, run: Run, tmp_path: Path
) -> None:
    own = street / "map.osm"
    wrong, says = {
        "far away": (_shifted_map(own, tmp_path / "far.osm", 5000.0), "its nearest traffic light"),
        "no lights": (_map_without_lights(own, tmp_path / "none.osm"), "it has no traffic light"),
        "wrong origin": (own, "nothing tells where the vehicle was"),
    }[case]
    origin = ["--origin", "10,20"] if case == "wrong origin" else []
    done = run(
        "detect", "--bag", log, "--camera-only", "--model", f"l={network}",
        "--map", wrong, *origin, "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "verdict: doubtful: lights are followed without the map" in done.stdout
    assert says in done.stdout
    assert (" km from the vehicle's way" in done.stdout) == (case == "far away")
    assert (" km from the fixes" in done.stderr) == (case == "wrong origin")
    assert next(read_lights(tmp_path / "run" / "lights.parquet"))


def test_a_map_is_good_for_a_camera_alone(
    street: Path, log: Path, network: Path, run: Run, tmp_path: Path
) -> None:
    command = ["detect", "--bag", log, "--camera-only", "--model", f"l={network}"]
    done = run(*command, "--map", street / "map.osm", "--out", tmp_path / "run", "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["config"]["poses"]["frame"] == "map"
    assert record["config"]["map"] == str(street / "map.osm")
    assert "tracks" not in record["counts"]
    done = run(*command, "--poses", "tf", "--out", tmp_path / "other")
    _refused(done, 2, "--camera-only makes use of --poses for the lights of a map alone")


def test_a_map_without_cameras_is_said_to_be_idle(
    street: Path, log: Path, run: Run, tmp_path: Path
) -> None:
    command = ["detect", "--bag", log, "--lidar-only", "--map", street / "map.osm"]
    done = run(*command, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert "lights of the map are not followed" in done.stderr


# ---- states of lights that a network does not tell


def _head(lit: str | None) -> NDArray[np.uint8]:
    picture = np.full((320, 320, 3), 190, np.uint8)
    x1, y1, x2, y2 = _HEAD
    cv2.rectangle(picture, (x1 + 6, y1 + 4), (x2 - 7, y2 - 5), (45, 45, 45), -1)
    for number, (name, colour) in enumerate(_LAMPS.items()):
        shown = colour if name == lit else tuple(c // 6 for c in colour)
        centre = (x1 + 26, y1 + 24 + 36 * number)
        cv2.circle(picture, centre, 14, shown, -1)
    return picture


def _lit_images(states: list[str]) -> Iterator[CameraImage]:
    for number, state in enumerate(states):
        stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
        pixels = _head(state)
        yield CameraImage(
            topic="/cam/image_raw", stamp_ns=stamp_ns, log_time_ns=stamp_ns, frame="cam",
            pixels=pixels, encoding="bgr8",
        )  # fmt: skip


def test_colours_of_pictures_become_states_of_lights(
    network: Path, run: Run, tmp_path: Path
) -> None:
    shown = ["red"] * 12 + ["green"] * 30
    log = tmp_path / "lights.mcap"
    with LogWriter(log, "mcap") as writer:
        for image in _lit_images(shown):
            writer.write(image)
    done = run("detect", "--bag", log, "--model", f"l={network}", "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert "1 traffic light\n" in done.stdout
    rows: list[dict[str, Any]] = pq.read_table(
        tmp_path / "run" / "detections_2d.parquet"
    ).to_pylist()
    assert [row["light_state"] for row in rows] == shown
    assert {row["label"] for row in rows} == {"traffic light"}
    states = [s.states[0] for s in read_lights(tmp_path / "run" / "lights.parquet")]
    assert states[-1] == "green"
    assert set(states[:12]) == {"red"}
    assert "yellow" not in states
