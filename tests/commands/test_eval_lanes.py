"""`percept eval lanes` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import Result

from percept.core.trajectory import Trajectory
from percept.datasets.synthetic.drive import MAP_ORIGIN, START_NS, Drive, DriveConfig
from percept.datasets.synthetic.lanelet_map import make_map
from percept.datasets.synthetic.truth import write_markings, write_poses

Run = Callable[..., Result]

STAMPS = [START_NS + k * 100_000_000 for k in range(10)]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trajectory]:
    """The truth of a drive without its log, and its poses."""
    folder = tmp_path_factory.mktemp("street")
    drive = Drive(DriveConfig(seed=2, cameras=()))
    poses = drive.ego.trajectory(np.arange(START_NS, START_NS + 10**9, 5_000_000))
    (folder / "truth").mkdir()
    write_markings(make_map(drive.world, MAP_ORIGIN, range(2)), folder / "truth/markings.geojson")
    write_poses(poses, folder / "truth" / "poses.parquet")
    return folder, poses


def seen(poses: Trajectory, stamp_ns: int, shift_m: float) -> dict[str, Any]:
    """What lies at y = -3.5 and -7 before the vehicle, moved to the left."""
    T_map_base = poses.at(stamp_ns)
    assert T_map_base is not None
    x0 = float(T_map_base.translation_m[0])
    lines = []
    for side, y, kind in (("left", -3.5, "dashed"), ("right", -7.0, "solid")):
        x = x0 + np.arange(5.0, 14.0)
        points = np.column_stack([x, np.full(len(x), y + shift_m), np.zeros(len(x))])
        points_m = T_map_base.inverse().apply(points)[:, :2]
        lines.append({"side": side, "points_m": points_m.tolist(), "type": kind, "colour": "white"})
    return {"stamp_ns": stamp_ns, "lines": lines}


def test_lines_in_metres(run: Run, street: tuple[Path, Trajectory], tmp_path: Path) -> None:
    folder, poses = street
    results, out = tmp_path / "seen", tmp_path / "out"
    results.mkdir()
    text = "\n".join(json.dumps(seen(poses, stamp_ns, 0.1)) for stamp_ns in STAMPS)
    (results / "lanes.json").write_text(text)
    done = run("eval", "lanes", results, "--truth", folder, "--out", out)
    assert done.exit_code == 0, done.output
    assert "10 images; both lines of the lane in 1.000" in done.stdout
    assert "type right for 1.000" in done.stdout
    scores = json.loads((out / "scores.json").read_text())
    assert scores["lateral_error_m"]["10-15"]["mean_m"] == pytest.approx(0.1, abs=2e-3)
    assert scores["colour_share"] == 1.0
    assert scores["verdict"] == "doubtful"
    assert "Lanes against the road" in (out / "report.html").read_text()
    command = ("eval", "lanes", results / "lanes.json", "--truth", folder / "truth", "--json")
    assert json.loads(run(*command).stdout) == scores


def test_lanes_in_pixels(run: Run, tmp_path: Path) -> None:
    rows = list(range(200, 710, 10))
    label = {"raw_file": "clips/1/20.jpg", "h_samples": rows, "lanes": [[500] * 51, [900] * 51]}
    labels, results = tmp_path / "labels.json", tmp_path / "results.json"
    labels.write_text(json.dumps(label))
    ours = {"image": "20.jpg", "lines": [{"points_px": [[505, 719], [505, 190]]}]}
    results.write_text(json.dumps(ours))
    said = json.loads(run("eval", "lanes", results, "--truth", labels, "--json").stdout)
    assert (said["accuracy"], said["fp"], said["fn"]) == (0.5, 0.0, 0.5)
    done = run("eval", "lanes", labels, "--truth", labels, "--out", tmp_path / "out")
    assert "clips/1/20.jpg     1.000  0.000  0.000" in done.stdout
    assert "Lanes against labels in pixels" in (tmp_path / "out" / "report.html").read_text()


def test_lanes_against_masks(run: Run, tmp_path: Path) -> None:
    mask = np.zeros((720, 1280), np.uint8)
    mask[300:, 495:506], mask[300:, 895:906] = 20, 70
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "0000.png"), mask)
    points = [{"points_px": [[u, 719], [u, 250]]} for u in (500, 890)]
    results = tmp_path / "results.json"
    results.write_text(json.dumps({"image": "images/0000.png", "lines": points}))
    done = run("eval", "lanes", results, "--truth", tmp_path / "masks")
    assert done.exit_code == 0, done.output
    assert "the two lines of the lane: 1.000 of 84 rows within 20 px" in done.stdout


def test_what_cannot_be_scored_is_said_in_one_line(
    run: Run, street: tuple[Path, Trajectory], tmp_path: Path
) -> None:
    results = tmp_path / "lanes.json"
    results.write_text('{"lines": []}')
    (tmp_path / "empty").mkdir()
    for arguments, said in (
        ((results, "--truth", street[0]), "has no stamp_ns"),
        ((results, "--truth", tmp_path / "empty"), "neither a synthetic drive"),
        ((results, "--truth", tmp_path / "none.json"), "none.json: cannot be read"),
        ((tmp_path / "empty", "--truth", street[0]), "lanes.json: cannot be read"),
    ):
        done = run("eval", "lanes", *arguments)
        assert done.exit_code == 3, done.output
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
