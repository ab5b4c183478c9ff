"""`percept calib export` as a user runs it: files of every format, and one line when it cannot."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import yaml
from typer.testing import Result

from percept.calib.formats import FORMATS
from percept.cli.calib import export as calib_export
from percept.core.rig import load_rig

Run = Callable[..., Result]

_RIG = """
base_frame: base_link
sensors:
  lidar_top: {kind: lidar, topic: /top, frame: lidar_top, T_base_sensor: {translation_m: [1, 0, 2],
              quat_xyzw: [0, 0, 0, 1]}}
  cam_front: {kind: camera, frame: cam_front, image_size: [640, 480], model: pinhole,
              K: [500, 500, 320, 240], distortion: [-0.1, 0.01, 0, 0, 0],
              T_base_sensor: {translation_m: [1.5, 0, 1.5], quat_xyzw: [-0.5, 0.5, -0.5, 0.5]}}
  lidar_new: {kind: lidar, frame: lidar_new}
"""
_RESULT = {
    "verdict": "doubtful",
    "why": ["one scene only"],
    "extrinsics": [
        {
            "sensor": "left",
            "verdict": "doubtful",
            "sd_translation_m": [0.001, 0.002, None],
            "sd_rotation_deg": [0.01, 0.02, 0.03],
        }
    ],
}


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "in" / "rig.yaml"
    path.parent.mkdir()
    path.write_text(_RIG)
    return path


def _expect(done: Result, code: int, *texts: str) -> None:
    assert done.exit_code == code, (done.stdout, done.stderr)
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("error: ")
    for text in texts:
        assert text in line
    assert done.stdout == ""


def _snapshot(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "run.json"
    }


@pytest.mark.parametrize("rig_format", list(FORMATS))
def test_every_format_is_written_and_always_the_same(
    rig_format: str, rig: Path, run: Run, tmp_path: Path
) -> None:
    before = rig.read_bytes()
    outs = [tmp_path / name for name in ("a", "b")]
    for out in outs:
        done = run("calib", "export", rig, "--format", rig_format, "--out", out, "--json")
        assert done.exit_code == 0, done.stderr
        document = json.loads(done.stdout)
        content = json.loads((out / "run.json").read_text())
        assert sorted(document["files"]) == sorted(_snapshot(out))
        assert content["config"] == {"format": rig_format}
        assert (content["counts"]["lidars"], content["counts"]["cameras"]) == (2, 1)
        assert any("lidar_new" in reason for reason in content["dropped"]) == (rig_format != "rig")
    assert _snapshot(outs[0]) == _snapshot(outs[1])
    assert rig.read_bytes() == before


def test_people_are_told_what_is_left_out(rig: Path, run: Run, tmp_path: Path) -> None:
    done = run("calib", "export", rig, "--format", "ros-tf", "--out", tmp_path / "out")
    assert done.exit_code == 0
    assert "mind: lidar_new has no T_base_sensor: left out" in done.stderr
    assert str(tmp_path / "out" / "static_transforms.launch.py") in done.stdout
    assert "verdict: good: the numbers are written as they were given" in done.stdout


def test_the_verdict_and_spread_of_the_calibration_come_along(
    rig: Path, run: Run, tmp_path: Path
) -> None:
    (rig.parent / "calibration.json").write_text(json.dumps(_RESULT))
    # The folder of the run does as well as the file.
    done = run("calib", "export", rig.parent, "--format", "autoware", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert "verdict: doubtful" in done.stdout
    text = (tmp_path / "out" / "sensor_kit_calibration.yaml").read_text()
    sha256 = hashlib.sha256(rig.read_bytes()).hexdigest()[:16]
    assert re.search(rf"^# written by percept [\d.]+ from rig\.yaml, sha256 {sha256}$", text, re.M)
    assert "# calibration: doubtful: one scene only" in text
    spread = "0.001 0.002 unknown m, 0.01 0.02 0.03 deg"
    assert f"# left: doubtful, standard deviations {spread}" in text
    assert not re.search(r"\b20\d\d-\d\d", text)  # no date: the same rig gives the same file


def test_a_rig_of_a_bad_calibration_says_so(rig: Path, run: Run, tmp_path: Path) -> None:
    (rig.parent / "calibration.json").write_text(json.dumps({"verdict": "bad", "why": ["x"]}))
    done = run("calib", "export", rig, "--format", "urdf", "--out", tmp_path / "out")
    assert done.exit_code == 4
    assert "calibration: bad" in (tmp_path / "out" / "rig.urdf").read_text()


@pytest.mark.parametrize(
    ("rig_format", "name"),
    [("urdf", "rig.urdf"), ("ros-tf", "static_transforms.yaml"),
     ("autoware", "sensor_kit_calibration.yaml")],
)  # fmt: skip
def test_a_file_of_another_tool_becomes_a_rig(
    rig_format: str, name: str, rig: Path, run: Run, tmp_path: Path
) -> None:
    run("calib", "export", rig, "--format", rig_format, "--out", tmp_path / "there")
    back = tmp_path / "back"
    done = run("calib", "export", tmp_path / "there" / name, "--format", "rig", "--out", back)
    assert done.exit_code == 0, done.stderr
    found = load_rig(back / "rig.yaml")
    place = found.sensors["lidar_top"].T_base_sensor
    assert place is not None
    assert np.allclose(place.translation_m, [1, 0, 2])
    assert "cam_front" in done.stderr  # has no intrinsics there, and is named


def test_force_takes_away_what_an_earlier_export_left(rig: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run("calib", "export", rig, "--format", "kalibr", "--out", out).exit_code == 0
    (out / "notes.txt").write_text("mine")
    _expect(run("calib", "export", rig, "--format", "urdf", "--out", out), 2, "is not empty")
    done = run("calib", "export", rig, "--format", "urdf", "--out", out, "--force")
    assert done.exit_code == 0, done.stderr
    assert sorted(p.name for p in out.iterdir()) == ["notes.txt", "rig.urdf", "run.json"]


def test_force_takes_no_folder_away(rig: Path, run: Run, tmp_path: Path) -> None:
    mine = tmp_path / "out" / "cam_front" / "mine.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    out = tmp_path / "out"
    done = run("calib", "export", rig, "--format", "kitti", "--out", out, "--force")
    assert done.exit_code == 0, done.stderr
    assert mine.read_text() == "mine"
    assert (out / "cam_front" / "lidar_top" / "calib.txt").is_file()


def test_a_file_in_the_place_of_a_folder_is_one_line(rig: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "cam_front").write_text("in the way")
    done = run("calib", "export", rig, "--format", "kitti", "--out", out, "--force")
    _expect(done, 2, "cam_front", "cannot be written")
    assert not (out / "run.json").exists()


def test_the_rig_itself_is_never_written_over(rig: Path, run: Run) -> None:
    before = rig.read_bytes()
    for rig_format in ("rig", "urdf"):
        done = run("calib", "export", rig, "--format", rig_format, "--out", rig.parent, "--force")
        _expect(done, 2, "would be written over", "Give another --out")
    assert rig.read_bytes() == before
    assert list(rig.parent.iterdir()) == [rig]


@pytest.mark.parametrize(
    ("text", "rig_format", "code", "said"),
    [
        ("sensors: {a: {kind: lidar, frame: a}}", "ros-tf", 2, "no sensor of the rig has a T_base"),
        ("sensors: {a: {kind: lidar, frame: a}}", "opencv", 2, "neither cameras nor known"),
        ("sensors: {a: {kind: sonar, frame: a}}", "urdf", 2, "'sensors.a'"),
        ("nonsense", "urdf", 3, "no calibration that percept knows"),
        ("<robot name='x'>", "rig", 3, "is not XML"),
        ("<!DOCTYPE x []><robot/>", "rig", 3, "document type"),
    ],
)
def test_bad_input_is_one_line(
    text: str, rig_format: str, code: int, said: str, run: Run, tmp_path: Path
) -> None:
    path = tmp_path / "some.file"
    path.write_text(text)
    done = run("calib", "export", path, "--format", rig_format, "--out", tmp_path / "out")
    _expect(done, code, said)
    assert not (tmp_path / "out").exists()


def test_a_run_without_a_rig_and_a_file_that_is_not_there(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("calib", "export", tmp_path, "--format", "urdf", "--out", out)
    _expect(done, 3, "has no rig.yaml", "good or doubtful")
    done = run("calib", "export", tmp_path / "none.yaml", "--format", "urdf", "--out", out)
    _expect(done, 3, "cannot be read")


def test_a_result_that_is_none_is_refused(rig: Path, run: Run, tmp_path: Path) -> None:
    for text, said in (("{", "is not JSON"), ('{"verdict": "fine"}', "no result")):
        (rig.parent / "calibration.json").write_text(text)
        done = run("calib", "export", rig, "--format", "urdf", "--out", tmp_path / "out")
        _expect(done, 3, "calibration.json", said)


def test_a_format_that_is_none_is_a_usage_error(rig: Path, run: Run, tmp_path: Path) -> None:
    done = run("calib", "export", rig, "--format", "yaml", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "ros-camera-info" in done.stderr


def test_the_page_names_every_format_and_option() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "calib-export.md").read_text()
    rows = re.findall(r"^\| `([a-z-]+)` \| `", page, re.MULTILINE)
    assert rows == list(FORMATS) == list(get_args(calib_export._Format))
    assert all(option in page for option in ("--format", "--out", "--force", "--json"))


def test_the_rig_of_the_page_is_a_rig(tmp_path: Path, run: Run) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "calib-export.md").read_text()
    (block,) = re.findall(r"^```yaml\n(sensor_kit.*?)^```$", page, re.MULTILINE | re.DOTALL)
    path = tmp_path / "sensor_kit_calibration.yaml"
    path.write_text(block)
    assert yaml.safe_load(block)
    done = run("calib", "export", path, "--format", "rig", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert "lidar_top" in load_rig(tmp_path / "out" / "rig.yaml").sensors
