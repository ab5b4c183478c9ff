"""`percept eval tracks` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from noisy_boxes import LEVELS, noisy_detections
from typer.testing import Result

from percept.core.results import Tracks
from percept.core.tracked_boxes import TrackedBoxes
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.labels.kitti_tracking import (
    read_kitti_detections,
    read_kitti_tracks,
    to_kitti_boxes,
    write_kitti_tracks,
)
from percept.evaluation.runs import read_poses
from percept.evaluation.tracks import align_frames, read_drive_truth
from percept.export.pose_table import POSES, pose_rows
from percept.export.tables import write_parquet
from percept.export.track_table import TRACKS, track_rows

Run = Callable[..., Result]

_KEYS = {
    "mota", "motp", "idf1", "idp", "idr", "precision", "recall", "num_switches",
    "num_fragmentations", "num_false_positives", "num_misses", "mostly_tracked",
    "partially_tracked", "mostly_lost", "hota",
}  # fmt: skip
_TYPES = {"Pedestrian": 1, "Car": 2, "Cyclist": 3}
_FRAMES = 40


def _json(done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.output
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def _street() -> TrackedBoxes:
    """Return three cars and two pedestrians that pass each other for four seconds."""
    rows = []
    for frame in range(_FRAMES):
        for name, label, x, y, speed in (
            (1, "Car", 10.0, -3.0, 8.0), (2, "Car", 50.0, 3.0, -8.0), (3, "Car", 25.0, 6.0, 0.0),
            (4, "Pedestrian", 15.0, -6.0, 1.2), (5, "Pedestrian", 19.0, -7.5, -1.2),
        ):  # fmt: skip
            size = (4.2, 1.8, 1.5) if label == "Car" else (0.8, 0.7, 1.75)
            yaw = np.pi if speed < 0 else 0.0
            rows.append((frame, name, label, [x + speed * frame / 10, y, -0.9, *size, yaw]))
    pixels = np.array([[100.0 * row[1], 100.0, 100.0 * row[1] + 60, 160.0] for row in rows])
    return TrackedBoxes(
        frames=np.array([row[0] for row in rows], np.int64),
        ids=np.array([row[1] for row in rows], np.int64),
        labels=tuple(row[2] for row in rows),
        boxes_m=np.array([row[3] for row in rows]),
        boxes_px=pixels,
    )


def _write_detections(path: Path, found: TrackedBoxes) -> None:
    kitti = to_kitti_boxes(found.boxes_m)
    pixels = np.nan_to_num(found.boxes_px, nan=500.0)
    lines = []
    for row, label in enumerate(found.labels):
        numbers = (*pixels[row], found.scores[row], *kitti[row], 0.0)
        words = [str(found.frames[row]), str(_TYPES[label]), *(f"{v:.4f}" for v in numbers)]
        lines.append(",".join(words) + "\n")
    path.write_text("".join(lines))


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with labels, a detector's files by class, and two sequences without a partner."""
    folder = tmp_path_factory.mktemp("street")
    for name in ("labels", "cars", "people"):
        (folder / name).mkdir()
    truth = _street()
    found = noisy_detections(truth, LEVELS["easy"], 0)
    write_kitti_tracks(folder / "labels" / "0003.txt", truth)
    text = (folder / "labels" / "0003.txt").read_text().replace(" -1 -1 ", " 0 0 ")
    (folder / "labels" / "0003.txt").write_text(text)
    (folder / "labels" / "0009.txt").write_text(text)
    _write_detections(folder / "cars" / "0003.txt", found.labelled("Car"))
    _write_detections(folder / "cars" / "0007.txt", found.labelled("Car"))
    _write_detections(folder / "people" / "0003.txt", found.labelled("Pedestrian"))
    return folder


def test_detections_are_tracked_written_and_scored(run: Run, street: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    sides = ("--detections", street / "cars", "--detections", street / "people")
    labels = ("--labels", street / "labels")
    document = _json(
        run("eval", "tracks", *sides, *labels, "--format", "kitti", "--out", out, "--json")
    )
    car, person = (document["by_class"][label] for label in ("Car", "Pedestrian"))
    assert set(car) == {"3d_0.25", "3d_0.50", "3d_0.70", "2d_0.50"}
    assert car["3d_0.25"]["num_objects"] == 3 * _FRAMES
    assert person["3d_0.25"]["num_objects"] == 2 * _FRAMES
    assert car["3d_0.25"]["mota"] > 0.8
    assert car["3d_0.25"]["switches_over_gaps"] == 0
    assert car["3d_0.25"]["samota"] >= car["3d_0.70"]["samota"]
    assert document["speed"]["frames"] == 2 * _FRAMES
    assert document["speed"]["frames_per_second"] > 0
    assert document["sequences"] == ["0003"]
    assert document["notes"] == [
        "not scored, without labels: sequence 0007",
        "not scored, without detections: sequence 0009",
    ]
    written = read_kitti_tracks(out / "tracks" / "0003.txt")
    assert set(written.labels) == {"Car", "Pedestrian"}
    assert np.isfinite(written.scores).all()
    assert (out / "tracks" / "0007.txt").is_file()
    ended = json.loads((out / "run.json").read_text())
    assert ended["config"]["coast_frames"] == 2
    assert len(ended["inputs"]) == 4
    assert json.loads((out / "scores.json").read_text()) == document
    assert "data:image/svg+xml" in (out / "report.html").read_text()
    # Others may score what was written, and come to the same.
    again = _json(run("eval", "tracks", "--tracks", out / "tracks", *labels, "--json"))
    for name, figures in car.items():
        assert again["by_class"]["Car"][name]["mota"] == pytest.approx(figures["mota"], abs=1e-6)


def test_logits_and_probabilities_give_the_same_tracks(
    run: Run, street: Path, tmp_path: Path
) -> None:
    found = read_kitti_detections([street / "cars" / "0003.txt"])
    likely = np.clip(found.scores, 0.001, 0.999)
    logits = np.log(likely / (1 - likely))
    (tmp_path / "logits").mkdir()
    _write_detections(tmp_path / "logits" / "0003.txt", replace(found, scores=logits))
    call = ("eval", "tracks", "--labels", street / "labels", "--detections")
    document = _json(run(*call, tmp_path / "logits", "--out", tmp_path / "a", "--json"))
    assert any("are logits" in note for note in document["notes"])
    plain = _json(run(*call, street / "cars", "--out", tmp_path / "b", "--json"))
    assert not any("are logits" in note for note in plain["notes"])
    made, same = (read_kitti_tracks(tmp_path / name / "tracks" / "0003.txt") for name in ("a", "b"))
    np.testing.assert_allclose(made.boxes_m, same.boxes_m, atol=1e-3)
    assert made.scores.max() > 1.0 >= same.scores.max()


def test_hindsight_and_settings_change_the_tracks(run: Run, street: Path, tmp_path: Path) -> None:
    call = ("eval", "tracks", "--detections", street / "cars", "--labels", street / "labels")
    known = _json(run(*call, "--json"))["by_class"]["Car"]["3d_0.25"]
    live = (*call, "--online")
    online = _json(run(*live, "--json"))["by_class"]["Car"]["3d_0.25"]
    seen = _json(run(*live, "--coast", "0", "--json"))["by_class"]["Car"]["3d_0.25"]
    assert known["num_misses"] < online["num_misses"] < seen["num_misses"]
    settings = tmp_path / "tracker.yaml"
    settings.write_text("classes: {car: {keep_score: 2.0}}\n")
    none = run(*call, "--config", settings, "--json")
    assert _json(none)["by_class"]["Car"]["3d_0.25"]["recall"] == 0.0
    assert any("below the score" in reason for reason in _json(none)["dropped"])
    settings.write_text("clases: {}\n")
    done = run(*call, "--config", settings)
    assert done.exit_code == 2
    assert "Did you mean 'classes'" in done.stderr


def test_a_motchallenge_file(run: Run, shared_data: Path) -> None:
    folder = shared_data / "mot" / "motmetrics_tud"
    wanted = json.loads((folder / "expected_motmetrics.json").read_text())["TUD-Campus"]
    sides = (
        "--tracks", folder / "TUD-Campus" / "test.txt",
        "--labels", folder / "TUD-Campus" / "gt.txt",
    )  # fmt: skip
    document = _json(run("eval", "tracks", *sides, "--format", "mot", "--json"))
    assert set(document) >= _KEYS
    for name in _KEYS & set(wanted):
        assert document[name] == pytest.approx(wanted[name], abs=1e-8), name
    text = run("eval", "tracks", *sides).stdout
    assert "0.5265" in text
    assert "verdict: good" in text


def _moments(truth: Path, T_odom_map: Transform, slower: float) -> Iterator[Tracks]:
    """Yield the true objects as tracks in another frame, each 0.3 m off, and too slow."""
    objects = read_drive_truth(truth).objects
    turn = float(np.arctan2(T_odom_map.rotation[1, 0], T_odom_map.rotation[0, 0]))
    for stamp_ns in np.unique(objects.frames):
        now = objects.select(objects.frames == stamp_ns)
        boxes = now.boxes_m.copy()
        boxes[:, :3] = T_odom_map.apply(now.boxes_m[:, :3] + np.array([0.3, 0.0, 0.0]))
        boxes[:, 6] += turn
        speeds = now.velocities_mps - np.array([slower, 0.0])
        count = len(now)
        yield Tracks(
            stamp_ns=int(stamp_ns),
            frame_id="odom",
            ids=now.ids,
            boxes_m=boxes,
            velocities_mps=speeds @ T_odom_map.rotation[:2, :2].T,
            labels=now.labels,
            label_probabilities=np.ones(count),
            states=("full",) * count,
            position_sd_m=np.ones(count),
            velocity_sd_mps=np.ones(count),
            observed=np.ones(count, dtype=bool),
        )


@pytest.fixture(scope="module")
def tracked(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with tracks and poses in a frame of its own."""
    folder = tmp_path_factory.mktemp("tracked")
    poses = read_poses(drive / "truth" / "poses.parquet")
    matrix = np.array([[0.6, -0.8, 0, 40], [0.8, 0.6, 0, -7], [0, 0, 1, 1.5], [0, 0, 0, 1.0]])
    T_odom_map = Transform("odom", "map", matrix)
    own = Trajectory("odom", "base_link", poses.stamps_ns, matrix @ poses.matrices)
    write_parquet(folder / "poses.parquet", POSES, [pose_rows(own)])
    rows = [track_rows(moment) for moment in _moments(drive / "truth", T_odom_map, 0.5)]
    write_parquet(folder / "tracks.parquet", TRACKS, rows)
    return folder


def test_a_run_in_another_frame_against_the_truth(run: Run, drive: Path, tracked: Path) -> None:
    document = _json(run("eval", "tracks", tracked, "--labels", drive / "truth", "--json"))
    assert (document["recall"], document["precision"]) == (1.0, 1.0)
    assert document["num_switches"] == 0
    small = document["by_class"]["pedestrian"]
    assert small["motp"] == pytest.approx(0.3 / 4, abs=1e-6)
    assert document["velocity_rmse_mps"] == pytest.approx(0.5, abs=1e-6)
    assert set(document["by_class"]) >= {"car"}
    placed = np.array(document["T_truth_run"]) @ np.array([40.0, -7.0, 1.5, 1.0])
    np.testing.assert_allclose(placed, [0, 0, 0, 1], atol=1e-6)
    text = run("eval", "tracks", tracked, "--labels", drive).stdout
    assert "'odom' lies" in text


def test_an_object_under_another_name_is_found_but_not_right(
    run: Run, drive: Path, tracked: Path, tmp_path: Path
) -> None:
    table = pq.read_table(tracked / "tracks.parquet")
    place = table.column_names.index("label")
    unknown = table.set_column(place, "label", pa.array(["unknown"] * len(table)))
    pq.write_table(unknown, tmp_path / "tracks.parquet")
    (tmp_path / "poses.parquet").write_bytes((tracked / "poses.parquet").read_bytes())
    document = _json(run("eval", "tracks", tmp_path, "--labels", drive / "truth", "--json"))
    assert (document["recall"], document["recall_any_label"]) == (0.0, 1.0)
    assert any("labelled 'unknown'" in reason for reason in document["dropped"])


def test_tracks_without_poses_must_be_in_the_frame_of_the_truth(
    run: Run, drive: Path, tracked: Path, tmp_path: Path
) -> None:
    table = pq.read_table(tracked / "tracks.parquet")
    pq.write_table(table, tmp_path / "tracks.parquet")
    done = run("eval", "tracks", tmp_path, "--labels", drive / "truth")
    assert done.exit_code == 3
    assert "tracks are in 'odom' and there is no poses.parquet" in " ".join(done.stderr.split())
    named = table.set_column(2, "frame_id", pa.array(["map"] * len(table)))
    pq.write_table(named, tmp_path / "tracks.parquet")
    document = _json(run("eval", "tracks", tmp_path, "--labels", drive / "truth", "--json"))
    assert document["recall"] < 0.1  # they are not where they say
    assert "are taken to be in 'map' as they are" in document["notes"][0]


def test_frames_are_aligned_by_all_poses() -> None:
    stamps = np.arange(4, dtype=np.int64) * 100
    matrices = np.tile(np.eye(4), (4, 1, 1))
    matrices[:, 0, 3] = np.arange(4)
    truth = Trajectory("map", "base_link", stamps, matrices)
    noisy = matrices.copy()
    noisy[:, 1, 3] = [0.1, -0.1, 0.1, -0.1]
    placed = align_frames(Trajectory("odom", "base_link", stamps, noisy), truth)
    np.testing.assert_allclose(placed.matrix, np.eye(4), atol=1e-12)


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        ([], 2, "give one of RUN, --detections and --tracks"),
        (["--tracks", "gt.txt", "--detections", "d"], 2, "give one of RUN"),
        (["--tracks", "gt.txt", "--online"], 2, "--online needs --detections"),
        (["--detections", "d", "--coast", "1"], 2, "--coast needs --online"),
        (["--tracks", "gt.txt", "--coast", "1"], 2, "--coast needs --detections"),
        (["--detections", "d", "--format", "mot"], 2, "--format mot is for --tracks"),
        (["run", "--format", "mot"], 2, "leave --format out"),
        (["--detections", "nowhere"], 3, "is no folder with files of sequences"),
        (["--tracks", "nowhere.txt"], 3, "cannot be read"),
        (["nowhere"], 3, "holds no truth of a drive"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    run: Run, tmp_path: Path, options: list[str], code: int, message: str
) -> None:
    labels = tmp_path / "gt.txt"
    labels.write_text("1,1,0,0,9,9,1\n")
    done = run("eval", "tracks", *options, "--labels", labels)
    assert done.exit_code == code, done.output
    assert message in " ".join(done.stderr.split())
    assert not done.stdout


def test_nothing_to_track_ends_with_4(run: Run, tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("1,1,0,0,9,9,0\n")
    (tmp_path / "made.txt").write_text("1,1,0,0,9,9,1\n")
    sides = ("--tracks", tmp_path / "made.txt", "--labels", tmp_path / "gt.txt")
    done = run("eval", "tracks", *sides, "--json")
    assert done.exit_code == 4
    assert json.loads(done.stdout)["verdict"] == "bad"
    assert json.loads(done.stdout)["mota"] is None


def test_sequences_whose_names_do_not_meet_are_refused(run: Run, street: Path) -> None:
    done = run("eval", "tracks", "--tracks", street / "labels", "--labels", street / "labels")
    assert done.exit_code == 3
    assert "has tracks without a score" in done.stderr
    done = run("eval", "tracks", "--detections", street / "people", "--labels", street / "cars")
    assert done.exit_code == 3
    assert "line 1 has 1 columns" in done.stderr
