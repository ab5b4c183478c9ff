"""`percept calib lidar` as a user runs it. Registrations are made up where only the rest counts."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from typer.testing import Result

from percept.calib.lidars import calibrate as lidar_lidar
from percept.calib.lidars.pair import LidarCalibrationConfig
from percept.calib.lidars.pair_result import PairRegistration, Rival
from percept.core.results import Verdict
from percept.core.rig import LidarSensor, Rig, load_rig, rig_as_yaml
from percept.core.samples import PointCloud
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.write import LogWriter

Matrix = NDArray[np.float64]
Run = Callable[..., Result]

_SIZES = {"top": 900, "left": 801, "right": 702}


def _pose(x: float, y: float, z: float, yaw: float = 0.0) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(0.05, 0.1, yaw)
    T[:3, 3] = x, y, z
    return T


_RIG = {
    "top": np.eye(4),
    "left": _pose(0.1, 0.7, -0.3, 1.4),
    "right": _pose(0.1, -0.7, -0.3, -1.4),
}


class Pairs:
    """Stands for `register_views`: knows the sensors by the numbers of their points."""

    def __init__(self) -> None:
        self.verdict = Verdict.GOOD
        self.guesses: list[Any] = []

    def __call__(
        self, scenes: Any, _config: Any, initial: Any = None, **_named: Any
    ) -> PairRegistration:
        names = {size: name for name, size in _SIZES.items()}
        target, source = (names[len(cloud)] for cloud in scenes[0])
        self.guesses.append(initial)
        T = np.linalg.inv(_RIG[target]) @ _RIG[source]
        return PairRegistration(
            T_target_source=T,
            scene_T_target_source=(T,) * len(scenes),
            sd_translation_m=np.full(3, 0.002),
            sd_rotation_deg=np.full(3, 0.03),
            leave_one_out=(0.001, 0.02) if len(scenes) > 1 else None,
            rms_m=0.02,
            overlap=0.4,
            overlap_05=0.6,
            scenes_agreeing=(len(scenes), len(scenes)),
            weak_directions=(),
            information=np.diag(np.array([5e-4] * 3 + [0.002] * 3) ** -2.0),
            structure_share=0.5,
            free_space_violation=0.01,
            range_offset_m=0.001,
            range_offset_sd_m=0.005,
            rivals=(Rival(T @ _pose(0, 0, 0, np.pi), 0.4, 0.01, 1, close=True),)
            if self.verdict is Verdict.AMBIGUOUS
            else (),
            verdict=self.verdict,
            why=("The made-up reason.",),
            advice=(),
            dropped_points={},
            scenes_left_out={},
        )


@pytest.fixture
def pairs(monkeypatch: pytest.MonkeyPatch) -> Pairs:
    stand_in = Pairs()
    monkeypatch.setattr(lidar_lidar, "register_views", stand_in)
    monkeypatch.setattr(lidar_lidar, "view_of", lambda cloud, _config: cloud)
    monkeypatch.setattr(lidar_lidar, "_shared_view", lambda *_: 0.5)
    return stand_in


def _room(name: str, seed: int) -> Matrix:
    """Return the walls of a room, as large as the seed, in a sensor's frame."""
    rng = np.random.default_rng([seed, _SIZES[name]])
    half = np.array([6 + 2 * seed, 5 + seed, 1.5])
    points = rng.uniform(-1, 1, size=(_SIZES[name], 3)) * half
    side = rng.integers(0, 4, size=len(points))
    points[side == 0, 0], points[side == 1, 0] = half[0], -half[0]
    points[side == 2, 1], points[side == 3, 1] = half[1], -half[1]
    T = np.linalg.inv(_RIG[name])
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clouds")
    for name in _SIZES:
        for scene in range(3):
            np.save(folder / f"{name}{scene}.npy", _room(name, scene).astype(np.float32))
    return folder


def _flags(folder: Path, names: Any = tuple(_SIZES), scenes: int = 3) -> list[str]:
    return [
        part
        for scene in range(scenes)
        for name in names
        for part in ("--cloud", f"{name}={folder / f'{name}{scene}.npy'}")
    ]


def test_clouds_become_a_rig_a_report_and_a_document(
    run: Run, clouds: Path, tmp_path: Path, pairs: Pairs
) -> None:
    del pairs
    out = tmp_path / "run"
    result = run("calib", "lidar", *_flags(clouds), "--out", out)
    assert result.exit_code == 0, result.output
    assert "reference: top (the first one that was named)" in result.stdout
    assert "verdict: good" in result.stdout
    assert {p.name for p in out.iterdir()} == {
        "run.json", "calibration.json", "report.html", "view.rrd", "rig.yaml",
    }  # fmt: skip
    rig = load_rig(out / "rig.yaml")
    assert rig.base_frame == "top"
    for name, T in _RIG.items():
        assert _place(rig, name).source == name
        assert np.allclose(_place(rig, name).matrix, T, atol=1e-9)
    recorded = json.loads((out / "run.json").read_text())
    assert recorded["verdict"] == "good"
    assert recorded["counts"] == {"scenes": 3, "sensors": 3}
    assert len(recorded["inputs"]) == 9
    page = (out / "report.html").read_text()
    assert page.index("GOOD".lower()) < page.index("<img")
    assert "point_top = T_top_left point_left" in page
    assert "point_left = T_left_top point_top" in page
    assert page.count("<img") >= 6


def test_json_is_the_document_alone(run: Run, clouds: Path, tmp_path: Path, pairs: Pairs) -> None:
    del pairs
    out = tmp_path / "run"
    result = run("calib", "lidar", *_flags(clouds), "--reference", "left", "--out", out, "--json")
    document = json.loads(result.stdout)
    assert document == json.loads((out / "calibration.json").read_text())
    assert document["reference"] == "left"
    assert [entry["sensor"] for entry in document["extrinsics"]] == ["top", "right"]
    found = np.array(document["extrinsics"][0]["T_reference_sensor"])
    assert np.allclose(found, np.linalg.inv(_RIG["left"]), atol=1e-9)
    path = document["loops"][0]["path"]
    assert (len(path), path[0], path[-1]) == (4, "left", "left")


@pytest.mark.parametrize("verdict", [Verdict.BAD, Verdict.AMBIGUOUS])
def test_a_result_that_is_not_to_be_used_leaves_no_rig(
    run: Run, clouds: Path, tmp_path: Path, pairs: Pairs, verdict: Verdict
) -> None:
    pairs.verdict = verdict
    out = tmp_path / "run"
    result = run("calib", "lidar", *_flags(clouds, ("top", "left")), "--out", out)
    assert result.exit_code == 4
    assert "no rig.yaml was written" in result.stdout
    assert not (out / "rig.yaml").exists()
    assert json.loads((out / "run.json").read_text())["exit_code"] == 4
    if verdict is Verdict.AMBIGUOUS:
        assert "Places that fit as well" in (out / "report.html").read_text()


def _start_rig(folder: Path) -> Path:
    T_base_top = Transform("base_link", "lidar_roof", _pose(1.0, 0.0, 1.9, 0.02))
    guess = Transform("base_link", "side", T_base_top.matrix @ _RIG["left"] @ _pose(0.1, 0, 0, 0.5))
    sensors = {
        "top": LidarSensor("top", "/top/points", "lidar_roof", T_base_top),
        "left": LidarSensor("left", "/left/points", "side", guess),
        "rear": LidarSensor("rear", None, "rear", Transform("base_link", "rear", _pose(-2, 0, 1))),
    }
    path = folder / "start.yaml"
    path.write_text(rig_as_yaml(Rig("base_link", dict(sensors))))
    return path


def _place(rig: Rig, name: str) -> Transform:
    place = rig.sensors[name].T_base_sensor
    assert place is not None
    return place


def test_a_given_rig_is_a_guess_and_is_updated(
    run: Run, clouds: Path, tmp_path: Path, pairs: Pairs
) -> None:
    start = _start_rig(tmp_path)
    before = start.read_bytes()
    out = tmp_path / "run"
    result = run("calib", "lidar", *_flags(clouds), "--initial", start, "--out", out)
    assert result.exit_code == 0, result.output
    assert start.read_bytes() == before
    given, found = load_rig(start), load_rig(out / "rig.yaml")
    assert np.allclose(pairs.guesses[0], _RIG["left"] @ _pose(0.1, 0, 0, 0.5))
    for name in ("top", "rear"):
        assert np.allclose(_place(found, name).matrix, _place(given, name).matrix)
    left = _place(found, "top").inverse() @ _place(found, "left")
    assert np.allclose(left.matrix, _RIG["left"], atol=1e-9)
    assert found.base_frame == "base_link"
    assert found.sensors["left"].topic == "/left/points"
    assert found.sensors["right"].frame == "right"


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        ([], 2, "one of --cloud and --bag"),
        (["--cloud", "top=x.pcd", "--bag", "y.bag"], 2, "one of --cloud and --bag"),
        (["--cloud", "top"], 2, "NAME=PATH"),
        (["--cloud", "top=missing.pcd", "--cloud", "left=missing.pcd"], 3, "missing.pcd"),
        (["--cloud", "top={top0}"], 2, "only LiDAR"),
        (["--cloud", "top={top0}", "--cloud", "left={top0}"], 3, "same cloud"),
        (
            ["--cloud", "top={top0}", "--cloud", "top={top1}", "--cloud", "left={left0}"],
            2,
            "top 2, left 1",
        ),
        (["--cloud", "top={top0}", "--cloud", "left={left0}", "--reference", "roof"], 2, "roof"),
        (["--cloud", "top={top0}", "--topic", "left=/x"], 2, "--topic goes with --bag"),
        (["--cloud", "top={top0}", "--start", "1"], 2, "go with --bag"),
        (["--cloud", "top={top0}", "--cloud", "left={left0}", "--config", "{odd}"], 2, "voxel_m"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    run: Run, clouds: Path, tmp_path: Path, flags: list[str], code: int, message: str
) -> None:
    odd = tmp_path / "odd.yaml"
    odd.write_text("voxel: 0.2\n")
    names = {p.stem: str(p) for p in clouds.iterdir()} | {"odd": str(odd)}
    out = tmp_path / "run"
    result = run("calib", "lidar", *(flag.format(**names) for flag in flags), "--out", out)
    assert result.exit_code == code, result.output
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_a_rig_without_the_lidars_is_refused(
    run: Run, clouds: Path, tmp_path: Path, pairs: Pairs
) -> None:
    del pairs
    flags = _flags(clouds, ("left", "right"))
    start = _start_rig(tmp_path)
    result = run("calib", "lidar", *flags, "--initial", start, "--out", tmp_path / "run")
    assert result.exit_code == 2
    assert "has no place of 'left' and of another LiDAR" in result.stderr


def test_a_cloud_of_nothing_but_nan_is_named(
    run: Run, clouds: Path, tmp_path: Path, pairs: Pairs
) -> None:
    del pairs
    empty = tmp_path / "empty.npy"
    np.save(empty, np.full((100, 3), np.nan, np.float32))
    flags = [*_flags(clouds, ("top", "left"), 1), "--cloud", f"right={empty}"]
    result = run("calib", "lidar", *flags, "--out", tmp_path / "run")
    assert result.exit_code == 4
    assert "no scene has points of 'right'" in result.stdout
    assert "clouds of right without a point" in result.stdout


# ---- the page


def test_the_page_has_every_setting_with_its_value() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "calib-lidar.md").read_text()
    (block,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.M | re.S)
    values = yaml.safe_load(block)
    assert LidarCalibrationConfig.model_validate(values) == LidarCalibrationConfig()
    assert set(values) == set(LidarCalibrationConfig.model_fields)
    assert all(f"`{name}`" in page for name in values)


# ---- logs


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of three stops, a second each, with three LiDARs."""
    path = tmp_path_factory.mktemp("log") / "stops.mcap"
    with LogWriter(path, "mcap") as writer:
        for scan in range(45):
            for name in _SIZES:
                stamp_ns = 1_700_000_000_000_000_000 + scan * 100_000_000
                writer.write(_scan(name, scan, stamp_ns))
    return path


def _scan(name: str, scan: int, stamp_ns: int) -> PointCloud:
    place, step = divmod(scan, 15)
    # Between the stops the rooms go by.
    seed = place if step < 12 else 10 + scan
    points = _room(name, seed)
    return PointCloud(
        topic=f"/{name}/points",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        frame=f"lidar_{name}",
        points_xyz=points.astype(np.float32),
    )


def test_a_log_becomes_scenes_with_the_frames_of_its_headers(
    run: Run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[Any] = []

    def calibrate(scenes: Any, reference: str, *rest: Any) -> Any:
        del rest
        taken.extend([scenes, reference])
        raise KeyboardInterrupt

    from percept.cli.calib import lidar_run as calib_lidar_run

    monkeypatch.setattr(calib_lidar_run, "calibrate_lidars", calibrate)
    result = run("calib", "lidar", "--bag", log, "--out", tmp_path / "run")
    assert result.exit_code == 130, result.output
    scenes, reference = taken
    assert len(scenes) == 3
    assert set(scenes[0]) == {"lidar_top", "lidar_left", "lidar_right"}
    assert reference == "lidar_top"
    assert not (tmp_path / "run").exists()


def test_topics_of_a_log_can_be_named(
    run: Run, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in = _AnyPair()
    monkeypatch.setattr(lidar_lidar, "register_views", stand_in)
    monkeypatch.setattr(lidar_lidar, "view_of", lambda cloud, _config: cloud)
    topics = ["--topic", "side=/left/points", "--topic", "roof=/top/points"]
    out = tmp_path / "run"
    result = run("calib", "lidar", "--bag", log, *topics, "--end", "3", "--out", out)
    assert result.exit_code == 0, result.output
    assert "reference: side (the first one that was named)" in result.stdout
    rig = load_rig(out / "rig.yaml")
    assert rig.base_frame == "lidar_left"
    assert rig.sensors["roof"].topic == "/top/points"
    assert rig.sensors["roof"].frame == "lidar_top"
    wrong = run("calib", "lidar", "--bag", log, "--topic", "a=/no", "--out", tmp_path / "b")
    assert wrong.exit_code == 3
    assert "/top/points" in wrong.stderr


class _AnyPair(Pairs):
    def __call__(
        self, scenes: Any, _config: Any, initial: Any = None, **_named: Any
    ) -> PairRegistration:
        known = [(np.zeros((_SIZES[name], 3))) for name in ("left", "top")]
        return super().__call__([known] * len(scenes), _config, initial)
