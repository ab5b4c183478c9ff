"""`percept calib check` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import Result

from percept.calib.check import lidar as check_lidar
from percept.calib.check.result import AXES, Control, Measurement
from percept.core.results import Verdict
from percept.core.rig import CameraSensor, LidarSensor, Rig, rig_as_yaml
from percept.core.transform import Transform, rotation_from_rpy

Matrix = NDArray[np.float64]
Run = Callable[..., Result]

_NAMES = ("top", "left", "right")


def _pose(x: float, y: float, z: float, yaw: float) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(0.05, 0.1, yaw)
    T[:3, 3] = x, y, z
    return T


_RIG = {
    "top": _pose(1, 0, 2, 0),
    "left": _pose(1, 0.7, 1.7, 1.4),
    "right": _pose(1, -0.7, 1.7, -1.4),
}


def _rig_file(path: Path, shift_m: float = 0.0) -> Path:
    """Write the rig, the left LiDAR this far too much to the left."""
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for name, T in _RIG.items():
        given = T.copy()
        given[1, 3] += shift_m if name == "left" else 0.0
        place = Transform("base_link", name, given)
        sensors[name] = LidarSensor(name, f"/{name}", name, place)
    K = (500.0, 500.0, 319.5, 239.5)
    place = Transform("base_link", "cam", np.eye(4))
    sensors["cam"] = CameraSensor("cam", None, "cam", (640, 480), "pinhole", K, (0.0,) * 5, place)
    path.write_text(rig_as_yaml(Rig("base_link", sensors)))
    return path


@pytest.fixture
def clouds(tmp_path: Path) -> list[str]:
    """Options with two scenes of the three LiDARs."""
    rng = np.random.default_rng(0)
    options = []
    for scene in (1, 2):
        for name in _NAMES:
            path = tmp_path / f"{scene}_{name}.npy"
            np.save(path, rng.uniform(-20, 20, size=(900, 3)).astype(np.float32))
            options += ["--cloud", f"{name}={path}"]
    return options


def _measure(
    _scenes: Any, _places: Any, _config: Any, _limits: Any, pair: tuple[str, str]
) -> Measurement:
    """Stand for a registration: finds every LiDAR where it really is."""
    return Measurement(
        against=pair[0],
        sensor=pair[1],
        T_against_sensor=np.linalg.inv(_RIG[pair[0]]) @ _RIG[pair[1]],
        covariance=np.diag([1e-4] * 3 + [0.002] * 3) ** 2,
        controls={n: Control(0.05, 0.05, held_out=True, detected=True) for n in AXES},
        kind="lidar",
        scenes=2,
        confirmed=True,
        verdict=Verdict.GOOD,
        why=("Both scenes agree.",),
    )


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_lidar, "_measure", _measure)


@pytest.mark.usefixtures("made_up")
def test_a_rig_that_holds_is_good(run: Run, tmp_path: Path, clouds: list[str]) -> None:
    rig, out = _rig_file(tmp_path / "rig.yaml"), tmp_path / "out"
    done = run("calib", "check", "--rig", rig, *clouds, "--out", out, "--json")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["verdict"] == "good"
    assert document["moved"] == []
    assert list(document["not_checked"]) == ["cam"]
    assert len(document["sensors"]) == 3
    for entry in document["sensors"]:
        assert set(entry["axes"].values()) == {"holds"}
        assert len(entry["delta_translation_m"]) == len(entry["sd_rotation_deg"]) == 3
    assert json.loads((out / "calibration.json").read_text()) == document
    written = {path.name for path in out.iterdir()}
    assert written == {"calibration.json", "report.html", "view.rrd", "run.json"}
    record = json.loads((out / "run.json").read_text())
    assert (record["verdict"], record["exit_code"]) == ("good", 0)
    assert record["inputs"][0]["path"] == str(rig)


@pytest.mark.usefixtures("made_up")
def test_a_moved_sensor_is_bad_and_named_everywhere(
    run: Run, tmp_path: Path, clouds: list[str]
) -> None:
    rig, out = _rig_file(tmp_path / "rig.yaml", 0.06), tmp_path / "out"
    done = run("calib", "check", "--rig", rig, *clouds, "--out", out)
    assert done.exit_code == 4
    assert "-6.0 of 2.0 MOVED" in done.stdout
    assert "'left' moved: -6.0 cm along y" in done.stdout
    document = json.loads((out / "calibration.json").read_text())
    assert document["moved"] == ["left"]
    (correction,) = document["corrections"]
    assert correction["delta_translation_m"] == pytest.approx([0, -0.06, 0])
    assert correction["off_at_20_m_px"] == pytest.approx(500 * 0.06 / 20)
    assert not (out / "rig.yaml").exists()
    assert "left" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "one of --bag, --cloud"),
        (["--bag", "a.mcap", "--cloud", "top=a.pcd"], "one of --bag, --cloud"),
        (["--pair", "a.jpg=a.pcd"], "need the board"),
        (["--cloud", "top=a.pcd", "--board", "checkerboard:7x5:0.1"], "--board needs images"),
        (["--cloud", "top=a.pcd", "--topic", "top=/top"], "go with --bag"),
        (["--cloud", "top=a.pcd", "--camera", "cam"], "go with --board"),
        (["--cloud", "top"], "NAME=PATH"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    run: Run, tmp_path: Path, options: list[str], words: str
) -> None:
    rig = _rig_file(tmp_path / "rig.yaml")
    done = run("calib", "check", "--rig", rig, *options, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_lidar_that_the_rig_does_not_know_is_left_out_and_said(
    run: Run, tmp_path: Path, clouds: list[str]
) -> None:
    rig = _rig_file(tmp_path / "rig.yaml")
    text = rig.read_text().replace("left", "port").replace("right", "starboard")
    rig.write_text(text)
    done = run("calib", "check", "--rig", rig, *clouds, "--out", tmp_path / "out")
    assert done.exit_code == 4  # short of data
    assert "no two sensors" in done.stderr
