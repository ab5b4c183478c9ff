"""`percept calib camera-lidar` as a user runs it, on rendered images and cast clouds."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import typer
import yaml
from numpy.typing import NDArray
from typer.testing import Result

from percept.calib.camera_lidar.problem import moved_pose, pose_step
from percept.cli.app import app
from percept.cli.calib.camera_lidar_run import CameraLidarRunConfig
from percept.core.rig import load_rig

Run = Callable[..., Result]
_F64 = NDArray[np.float64]

_ROOT = Path(__file__).resolve().parents[2]
_SIZE = (960, 600)
_K = np.array([[700.0, 0, 479.5], [0, 700.0, 299.5], [0, 0, 1]])
_PLATE_M = (0.9, 0.7)
_SQUARE_M = 0.1
_T_CAMERA_LIDAR = moved_pose(
    np.array([[0, -1.0, 0, 0.1], [0, 0, -1, -0.2], [1, 0, 0, -0.1], [0, 0, 0, 1]]),
    np.array([0.02, -0.03, 0.01, 0, 0, 0]),
)
_BOARD = ("--board", "checkerboard:7x5:0.1", "--board-size", "0.9x0.7")


def _texture(pixels_per_m: int = 1000) -> NDArray[np.uint8]:
    """Return the printed plate: 8 x 6 squares in the middle of a white plate."""
    width, height = (round(side * pixels_per_m) for side in _PLATE_M)
    plate = np.full((height, width), 235, np.uint8)
    row, column = np.mgrid[0:height, 0:width]
    x = (column + 0.5) / pixels_per_m - (_PLATE_M[0] - 8 * _SQUARE_M) / 2
    y = (row + 0.5) / pixels_per_m - (_PLATE_M[1] - 6 * _SQUARE_M) / 2
    inside = (x > 0) & (y > 0) & (x < 8 * _SQUARE_M) & (y < 6 * _SQUARE_M)
    dark = ((x // _SQUARE_M + y // _SQUARE_M) % 2 == 0) & inside
    plate[dark] = 25
    return plate


def _render(T_camera_plate: _F64) -> NDArray[np.uint8]:
    """Return the image of the plate before a grey wall, smoothed as a lens does."""
    texture = _texture()
    to_plate = np.array([[1e-3, 0, -_PLATE_M[0] / 2], [0, 1e-3, -_PLATE_M[1] / 2], [0, 0, 1]])
    # Pixel centres of the texture lie half a step inside it.
    to_plate[:2, 2] += 5e-4
    H = 4 * _K @ np.column_stack([T_camera_plate[:3, :2], T_camera_plate[:3, 3]]) @ to_plate
    H[2] /= 4
    shift = np.array([[1, 0, 1.5], [0, 1, 1.5], [0, 0, 1]])
    size = (4 * _SIZE[0], 4 * _SIZE[1])
    large = cv2.warpPerspective(texture, shift @ H, size, borderValue=110)
    small = cv2.resize(large, _SIZE, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), 0.6), dtype=np.uint8)


def _cast(T_camera_plate: _F64, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return what a LiDAR with 40 beams sees of the plate and of a wall 7 m ahead."""
    azimuth = np.radians(np.arange(-45, 45, 0.25))
    elevation = np.radians(np.linspace(-20, 20, 40))
    a, e = (grid.ravel() for grid in np.meshgrid(azimuth, elevation))
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    T = np.linalg.inv(_T_CAMERA_LIDAR) @ T_camera_plate
    distance = (T[:3, 3] @ T[:3, 2]) / (rays @ T[:3, 2])
    on_plate = (rays * distance[:, None] - T[:3, 3]) @ T[:3, :2]
    hit = (np.abs(on_plate) < np.array(_PLATE_M) / 2).all(axis=1) & (distance > 0)
    range_m = np.where(hit, distance, 7.0 / rays[:, 0]) + rng.normal(0, 0.005, len(rays))
    return (rays * range_m[:, None]).astype(np.float32)


def _poses(count: int) -> list[_F64]:
    rng = np.random.default_rng(1)
    poses = []
    for k in range(count):
        T = moved_pose(
            np.eye(4), np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.6, 0.6), 0, 0, 0])
        )
        depth = 2.0 + 0.25 * (k % 7)
        T[:3, 3] = [depth * rng.uniform(-0.3, 0.3), depth * rng.uniform(-0.12, 0.12), depth]
        poses.append(T)
    return poses


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ten images and clouds, pairs.csv and camera.yaml."""
    folder = tmp_path_factory.mktemp("capture")
    rng = np.random.default_rng(0)
    rows = ["image,cloud"]
    for k, T in enumerate(_poses(10)):
        noise = rng.normal(0, 1.5, _SIZE[::-1])
        image = np.clip(_render(T) + noise, 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"view{k}.png"), image)
        np.save(folder / f"scan{k}.npy", _cast(T, rng))
        rows.append(f"view{k}.png,scan{k}.npy")
    (folder / "pairs.csv").write_text("\n".join(rows) + "\n")
    info = {
        "image_width": _SIZE[0],
        "image_height": _SIZE[1],
        "distortion_model": "plumb_bob",
        "camera_matrix": {"rows": 3, "cols": 3, "data": _K.ravel().tolist()},
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0] * 5},
    }
    (folder / "camera.yaml").write_text(yaml.safe_dump(info))
    return folder


@pytest.fixture(scope="module")
def finished(run: Run, capture: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The run folder over all pairs, and the JSON that was printed."""
    out = tmp_path_factory.mktemp("runs") / "run"
    done = run(
        "calib", "camera-lidar", "--pairs", capture / "pairs.csv", *_BOARD, "--json",
        "--intrinsics", capture / "camera.yaml", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return out, json.loads(done.stdout)


def test_the_truth_comes_back_from_files(finished: tuple[Path, Any]) -> None:
    _, document = finished
    step = pose_step(np.array(document["T_camera_lidar"]), _T_CAMERA_LIDAR)
    assert document["verdict"] == "good", document["why"]
    assert np.degrees(np.linalg.norm(step[:3])) < 0.15
    assert np.linalg.norm(step[3:]) < 0.008
    assert [pair["used"] for pair in document["pairs"]] == [True] * 10
    assert document["point_to_board_mm"] < 15
    keys = {"reprojection_px", "sd_translation_m", "sd_rotation_deg", "odd_even", "advice"}
    assert keys | {"range_offset_mm", "why"} <= set(document)


def test_the_folder_holds_all_outputs(finished: tuple[Path, Any]) -> None:
    out, document = finished
    names = {"run.json", "calibration.json", "report.html", "view.rrd", "rig.yaml"}
    assert {path.name for path in out.iterdir()} == names
    assert json.loads((out / "calibration.json").read_text()) == document
    recorded = json.loads((out / "run.json").read_text())
    assert recorded["verdict"] == "good"
    assert len(recorded["inputs"]) == 20
    rig = load_rig(out / "rig.yaml")
    assert rig.base_frame == "lidar"
    placed = rig.sensors["camera"].T_base_sensor
    assert placed is not None
    np.testing.assert_allclose(placed.inverse().matrix, document["T_camera_lidar"], atol=1e-9)


def test_the_report_says_it_all_in_order(finished: tuple[Path, Any]) -> None:
    text = (finished[0] / "report.html").read_text()
    titles = re.findall(r"<h2>(.*?)</h2>", text)
    assert titles[0] == "The cloud in the image"
    assert titles[-1] == "Residuals"
    assert text.index("<strong>good</strong>") < text.index("<h2>")
    assert text.count("data:image/") >= 12
    assert "T_lidar_camera" in text


def test_a_rig_is_updated_and_its_lidar_stays(
    run: Run, capture: Path, finished: tuple[Path, Any], tmp_path: Path
) -> None:
    text = (finished[0] / "rig.yaml").read_text()
    content = yaml.safe_load(text)
    content["base_frame"] = "base_link"
    content["sensors"]["lidar"]["T_base_sensor"]["translation_m"] = [1.0, 2.0, 3.0]
    content["sensors"]["camera"]["T_base_sensor"]["translation_m"] = [9.0, 9.0, 9.0]
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(content))
    done = run(
        "calib", "camera-lidar", "--pairs", capture / "pairs.csv", *_BOARD,
        "--initial", tmp_path / "rig.yaml", "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "intrinsics: those of 'camera' in the rig" in done.stdout
    rig = load_rig(tmp_path / "run" / "rig.yaml")
    T_base_lidar, T_base_camera = (rig.sensors[n].T_base_sensor for n in ("lidar", "camera"))
    assert T_base_lidar is not None
    assert T_base_camera is not None
    assert T_base_lidar.translation_m.tolist() == [1.0, 2.0, 3.0]
    found = (T_base_camera.inverse() @ T_base_lidar).matrix
    np.testing.assert_allclose(found, finished[1]["T_camera_lidar"], atol=1e-4)


def test_one_pair_ends_with_4_and_without_a_rig(run: Run, capture: Path, tmp_path: Path) -> None:
    done = run(
        "calib", "camera-lidar", "--pair", f"{capture / 'view0.png'}={capture / 'scan0.npy'}",
        *_BOARD, "--intrinsics", capture / "camera.yaml", "--out", tmp_path / "run",
    )  # fmt: skip
    assert done.exit_code == 4
    assert "ambiguous" in done.stdout
    assert not (tmp_path / "run" / "rig.yaml").exists()
    assert (tmp_path / "run" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ((), 2, "one of --pair, --pairs and --bag is needed"),
        (("--pair", "a.png"), 2, "not of the form IMAGE=CLOUD"),
        (("--pair", "a.png=b.pcd"), 3, "no such file"),
        (("--pair", "a.png=b.pcd", "--start", "1"), 2, "go with --bag"),
        (("--pairs", "{capture}/camera.yaml"), 2, "columns image and cloud"),
        (("--pairs", "{capture}/pairs.csv"), 2, "intrinsics are not known"),
        (("--pairs", "{capture}/pairs.csv", "--board-size", "0.7x0.9"), 2, "--board-size 0.9x0.7"),
        (("--pairs", "{capture}/pairs.csv", "--board-size", "large"), 2, "WxH"),
    ],
)
def test_wrong_usage_is_one_line(
    arguments: tuple[str, ...], code: int, message: str, run: Run, capture: Path, tmp_path: Path
) -> None:
    given = [argument.format(capture=capture) for argument in arguments]
    board = _BOARD[:2] if "--board-size" in given else _BOARD
    done = run("calib", "camera-lidar", *board, *given, "--out", tmp_path / "run")
    assert done.exit_code == code, done.output
    errors = done.stderr.strip().splitlines()
    assert len(errors) == 1
    assert message in errors[0]
    assert not (tmp_path / "run").exists()


# ---- its page


def _page() -> str:
    return (_ROOT / "docs" / "calib-camera-lidar.md").read_text(encoding="utf-8")


def test_the_page_names_every_option() -> None:
    group: Any = typer.main.get_command(app)
    command = group.commands["calib"].commands["camera-lidar"]
    options = {name for p in command.params for name in p.opts if name.startswith("--")}
    assert not [option for option in options if f"`{option}" not in _page()]


def test_the_settings_of_the_page_are_the_defaults() -> None:
    blocks = re.findall(r"^```yaml\n(.*?)^```$", _page(), re.MULTILINE | re.DOTALL)
    values = yaml.safe_load(blocks[0])
    assert CameraLidarRunConfig.model_validate(values) == CameraLidarRunConfig()
    assert values["calibration"].keys() == CameraLidarRunConfig().calibration.model_dump().keys()
