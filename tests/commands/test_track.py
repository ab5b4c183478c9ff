"""`percept track` as a user runs it: finished runs, damaged ones, and other settings."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lxml import etree
from onnx_graphs import KnownBoxes, yolo_graph
from typer.testing import Result

from percept.datasets import open_recording
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.export.track_table import read_tracks

Run = Callable[..., Result]
Damage = Callable[[Path], object]

_TABLES = ("poses.parquet", "tracks.parquet", "lights.parquet")


def _files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _refused(done: Result, code: int, *texts: str) -> None:
    assert done.exit_code == code, (done.stdout, done.stderr)
    (line,) = done.stderr.strip().splitlines()
    for text in texts:
        assert text in line
    assert done.stdout == ""


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a drive with few beams and a small camera."""
    folder = tmp_path_factory.mktemp("street")
    config = DriveConfig(
        seconds=1.2, beam_share=0.15, cameras=("cam_front",), image_size=(160, 100)
    )
    generate_drive(config, folder)
    return folder


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that sees a traffic light and a person at one place of each image."""
    path = tmp_path_factory.mktemp("network") / "two.onnx"
    boxes = np.array([[150.0, 60, 170, 110], [40, 160, 70, 240]])
    known = KnownBoxes(boxes, np.array([0, 1]), np.array([0.9, 0.8]))
    names = {"names": "{0: 'light_red', 1: 'person'}"}
    return yolo_graph(path, "v8", size=(320, 320), class_count=2, known=known, metadata=names)


@pytest.fixture(scope="module")
def detected(
    street: Path, network: Path, run: Run, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A run of LiDARs and a camera with a map."""
    out = tmp_path_factory.mktemp("detected") / "run"
    done = run(
        "detect", "--bag", street / "drive.mcap", "--model", f"net={network}",
        "--map", street / "map.osm", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def lidar_only(street: Path, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of LiDARs without a camera."""
    out = tmp_path_factory.mktemp("lidar_only") / "run"
    done = run("detect", "--bag", street / "drive.mcap", "--lidar-only", "--out", out)
    assert done.exit_code == 0, done.stderr
    return out


# ---- a finished run


def test_the_same_settings_give_the_same_bytes_and_the_run_stays_as_it_is(
    detected: Path, street: Path, run: Run, tmp_path: Path
) -> None:
    before = _files(detected)
    out = tmp_path / "again"
    done = run("track", detected, "--map", street / "map.osm", "--mcap", "--out", out)
    assert done.exit_code == 0, done.stderr
    for name in _TABLES:
        assert (out / name).read_bytes() == before[name], name
    assert _files(detected) == before
    with open_recording([out / "overlay.mcap"]) as overlay:
        assert {topic.topic for topic in overlay.topics()} >= {"/percept/tracks", "/tf"}


def test_without_the_map_of_the_run_that_is_said(detected: Path, run: Run, tmp_path: Path) -> None:
    done = run("track", detected, "--out", tmp_path / "again")
    assert done.exit_code == 0, done.stderr
    assert "map.osm: give it with --map, too" in done.stderr


def test_a_track_run_tells_what_it_did(lidar_only: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "again"
    done = run("track", lidar_only, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert record == json.loads((out / "run.json").read_text())
    assert record["why"] == ["12 scans were followed with poses from gnss+imu without a doubt"]
    ids = {i for tracks in read_tracks(out / "tracks.parquet") for i in tracks.ids.tolist()}
    assert sum(record["counts"]["tracks"].values()) == len(ids) > 10
    names = {Path(entry["path"]).name for entry in record["inputs"]}
    assert {"scans_3d.parquet", "detections_3d.parquet", "poses.parquet", "rig.yaml"} <= names


def test_settings_change_the_tracks_and_what_is_no_setting_is_named(
    lidar_only: Path, run: Run, tmp_path: Path
) -> None:
    config = tmp_path / "c.yaml"
    config.write_text("tracking: {classes: {unknown: {t_birth_s: 60.0}}}\n")
    done = run("track", lidar_only, "--config", config, "--out", tmp_path / "again", "--json")
    assert done.exit_code == 0, done.stderr
    before = json.loads((lidar_only / "run.json").read_text())["counts"]["tracks"]
    after = json.loads(done.stdout)["counts"]["tracks"]
    assert after.get("unknown", 0) < before["unknown"]
    config.write_text("trakking: {}\n")
    done = run("track", lidar_only, "--config", config, "--out", tmp_path / "more")
    _refused(done, 2, "Did you mean 'tracking'?")


def test_a_run_without_poses_is_tracked_in_its_moving_frame(
    street: Path, run: Run, tmp_path: Path
) -> None:
    bare, log = tmp_path / "bare", street / "drive.mcap"
    done = run("detect", "--bag", log, "--lidar-only", "--no-track", "--out", bare)
    assert done.exit_code == 0, done.stderr
    done = run("track", bare, "--out", tmp_path / "again")
    assert done.exit_code == 0, done.stderr
    assert "verdict: doubtful: nothing tells where the vehicle was" in done.stdout
    assert done.stderr.count("velocities are relative to") == 1
    assert not (tmp_path / "again" / "poses.parquet").exists()


def test_a_run_of_cameras_alone_speaks_of_images(
    street: Path, network: Path, run: Run, tmp_path: Path
) -> None:
    log, seen = street / "drive.mcap", tmp_path / "seen"
    done = run("detect", "--bag", log, "--camera-only", "--model", f"n={network}", "--out", seen)
    assert done.exit_code == 0, done.stderr
    done = run("track", seen, "--out", tmp_path / "again")
    assert done.exit_code == 0, done.stderr
    assert "12 images were followed" in done.stdout
    assert " scans" not in done.stdout
    lights = "lights.parquet"
    assert (seen / lights).read_bytes() == (tmp_path / "again" / lights).read_bytes()


# ---- poses and maps of another place


def test_poses_from_elsewhere_win_and_are_kept_as_they_are(
    lidar_only: Path, street: Path, run: Run, tmp_path: Path
) -> None:
    truth, out = street / "truth" / "poses.parquet", tmp_path / "again"
    done = run("track", lidar_only, "--poses", truth, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    assert "with poses from poses.parquet" in json.loads(done.stdout)["why"][0]
    assert (out / "poses.parquet").read_bytes() == truth.read_bytes()
    written = (out / "poses.parquet").read_bytes()
    done = run("track", lidar_only, "--poses", out / "poses.parquet", "--out", out, "--force")
    _refused(done, 2, "it is read, and lies in --out")
    assert (out / "poses.parquet").read_bytes() == written


def test_poses_of_another_frame_are_bad(lidar_only: Path, run: Run, tmp_path: Path) -> None:
    table = pq.read_table(lidar_only / "poses.parquet")
    place = table.schema.get_field_index("child_frame_id")
    other = table.set_column(place, "child_frame_id", pa.array(["camera"] * len(table)))
    pq.write_table(other, tmp_path / "other.parquet")
    done = run(
        "track", lidar_only, "--poses", tmp_path / "other.parquet", "--out", tmp_path / "again"
    )
    assert done.exit_code == 4, done.stderr
    assert "verdict: bad: 12 of 12 scans have no pose" in done.stdout
    assert "12 x tracks: scans in 'base_link', a frame without poses" in done.stderr


def test_scans_without_a_pose_are_counted(lidar_only: Path, run: Run, tmp_path: Path) -> None:
    table = pq.read_table(lidar_only / "poses.parquet")
    pq.write_table(table.slice(0, len(table) // 2), tmp_path / "half.parquet")
    done = run(
        "track", lidar_only, "--poses", tmp_path / "half.parquet", "--out", tmp_path / "again"
    )
    assert done.exit_code == 0, done.stderr
    assert "of 12 scans have no pose" in done.stdout
    assert "verdict: doubtful" in done.stdout


def test_a_map_of_another_place_is_said_to_be_far(
    detected: Path, street: Path, run: Run, tmp_path: Path
) -> None:
    tree = etree.parse(street / "map.osm")
    for tag in tree.iter("tag"):
        if tag.get("k") == "local_x":
            tag.set("v", str(float(tag.get("v", "")) + 7000.0))
    tree.write(str(tmp_path / "far.osm"))
    done = run("track", detected, "--map", tmp_path / "far.osm", "--out", tmp_path / "again")
    assert done.exit_code == 0, done.stderr
    assert "verdict: doubtful: lights are followed without the map: its nearest" in done.stdout
    assert " km from the vehicle's way" in done.stdout


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (["--origin", "1,2"], 2, "--origin is for --map"),
        (["--map", "MAP", "--origin", "here"], 2, "'here' is no place"),
        (["--map", "nowhere.osm"], 3, "nowhere.osm"),
        (["--map", "LOG"], 3, "is no XML"),
        (["--poses", "nowhere.parquet"], 3, "nowhere.parquet"),
        (["--poses", "TRACKS"], 3, "has no column child_frame_id"),
    ],
)
def test_what_is_no_map_no_place_and_no_poses_is_named(
    options: list[str],
    code: int,
    says: str,
    lidar_only: Path,
    street: Path,
    run: Run,
    tmp_path: Path,
) -> None:
    files = {
        "MAP": street / "map.osm",
        "LOG": street / "drive.mcap",
        "TRACKS": lidar_only / "tracks.parquet",
    }
    out = tmp_path / "again"
    done = run("track", lidar_only, *(files.get(word, word) for word in options), "--out", out)
    _refused(done, code, says)
    assert not out.exists()


# ---- folders


def test_a_run_is_not_written_over_and_may_hold_another(
    lidar_only: Path, run: Run, tmp_path: Path
) -> None:
    here = tmp_path / "run"
    shutil.copytree(lidar_only, here)
    before = _files(here)
    for out in (here, here / ".." / "run"):
        _refused(run("track", here, "--out", out, "--force"), 2, "--out is the run itself")
    assert run("track", here, "--out", here / "again").exit_code == 0
    _refused(run("track", here, "--out", here / "again"), 2, "is not empty")
    assert {n: c for n, c in _files(here).items() if not n.startswith("again")} == before


def test_what_is_no_run_is_named(lidar_only: Path, street: Path, run: Run, tmp_path: Path) -> None:
    again = tmp_path / "again"
    assert run("track", lidar_only, "--out", again).exit_code == 0
    out = tmp_path / "more"
    _refused(run("track", again, "--out", out), 3, "is no run of `percept detect`")
    for what in (tmp_path / "nothing", street, street / "drive.mcap"):
        _refused(run("track", what, "--out", out), 3, "holds no finished run")
    assert not out.exists()


def _gone(name: str) -> Damage:
    return lambda run: (run / name).unlink()


def _cut(name: str) -> Damage:
    return lambda run: (run / name).write_bytes((run / name).read_bytes()[:100])


def _changed(name: str, change: Callable[[pa.Table], pa.Table]) -> Damage:
    return lambda run: pq.write_table(change(pq.read_table(run / name)), run / name)


def _column(name: str, values: Callable[[int], list[Any]]) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index(name)
        return table.set_column(place, name, pa.array(values(len(table))))

    return change


def _edited(change: Callable[[dict[str, Any]], object]) -> Damage:
    def edit(run: Path) -> None:
        record = json.loads((run / "run.json").read_text())
        change(record)
        (run / "run.json").write_text(json.dumps(record))

    return edit


_BOXES, _SCANS, _POSES = "detections_3d.parquet", "scans_3d.parquet", "poses.parquet"
_DAMAGE: dict[str, tuple[Damage, str]] = {
    **{f"no {name}": (_gone(name), name) for name in (_SCANS, _POSES, "rig.yaml")},
    "no boxes": (_gone(_BOXES), "is no run of"),
    "no boxes of scans": (
        lambda run: (run / _BOXES).rename(run / "detections_2d.parquet"), f"has no {_BOXES}"
    ),
    **{f"cut {n}": (_cut(n), n) for n in (_BOXES, _SCANS, _POSES)},
    "no rows of boxes": (_changed(_BOXES, lambda t: t.slice(0, 0)), "has 0 boxes of frame"),
    "half of the scans": (_changed(_SCANS, lambda t: t.slice(0, 4)), "which the run has not"),
    "no pose": (_changed(_POSES, lambda t: t.slice(0, 0)), "holds no pose"),
    "poses backwards": (_changed(_POSES, lambda t: t.take(np.arange(len(t))[::-1])), "must rise"),
    "texts for times": (
        _changed(_SCANS, _column("stamp_ns", lambda n: ["now"] * n)), "stamp_ns is string"
    ),
    "places that are no numbers": (
        _changed(_BOXES, _column("x", lambda n: [float("nan")] * n)), "not finite"
    ),
    "a record that is cut": (_cut("run.json"), "run.json: cannot be read"),
    "a record that is a list": (lambda run: (run / "run.json").write_text("[]"), "run.json"),
    "no number of scans": (_edited(lambda r: r["counts"].update(frames="many")), "run.json"),
    "a verdict of its own": (
        _edited(lambda r: r["config"]["poses"].update(verdict="fine")), "run.json"
    ),
    "poses that are a word": (_edited(lambda r: r["config"].update(poses="gnss")), "run.json"),
}  # fmt: skip


@pytest.mark.parametrize("kind", _DAMAGE)
def test_a_damaged_run_is_named_and_what_stands_in_out_stays(
    kind: str, lidar_only: Path, run: Run, tmp_path: Path
) -> None:
    damage, says = _DAMAGE[kind]
    broken, out = tmp_path / "broken", tmp_path / "out"
    shutil.copytree(lidar_only, broken)
    damage(broken)
    out.mkdir()
    (out / "tracks.parquet").write_text("of an earlier run")
    _refused(run("track", broken, "--out", out, "--force"), 3, says)
    assert _files(out) == {"tracks.parquet": b"of an earlier run"}
