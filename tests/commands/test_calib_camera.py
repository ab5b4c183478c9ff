"""`percept calib camera` as a user runs it, on drawn images of a board."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from typer.testing import Result

from percept.core.cameras import make_camera
from percept.core.rig import load_rig
from percept.core.samples import CameraImage
from percept.datasets.write import LogWriter

Run = Callable[..., Result]

_SIZE = (640, 480)
_K = np.array([[520.0, 0, 322], [0, 520, 241], [0, 0, 1]])
_BOARD = "checkerboard:7x5:0.04"


def _printed() -> NDArray[np.uint8]:
    """Return 8 x 6 squares of 60 px with a white border of 60 px."""
    squares = np.kron(np.indices((6, 8)).sum(axis=0) % 2, np.ones((60, 60))) * 215 + 20
    return np.pad(squares, 60, constant_values=235).astype(np.uint8)


def _photograph(
    place: tuple[float, float, float], turn: tuple[float, float, float]
) -> NDArray[np.uint8]:
    """Return what the camera sees of the board; the lens has no distortion."""
    R = cv2.Rodrigues(np.array(turn))[0]
    metres = 0.04 / 60
    to_board = np.array([[metres, 0, -300 * metres], [0, metres, -240 * metres], [0, 0, 1]])
    H = _K @ np.column_stack([R[:, :2], place]) @ to_board
    image = cv2.warpPerspective(
        _printed(), H, _SIZE, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT, borderValue=110
    )
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), dtype=np.uint8)


@pytest.fixture(scope="module")
def photographs() -> list[NDArray[np.uint8]]:
    places = [(x, y, 0.62) for x in (-0.2, 0.0, 0.2) for y in (-0.13, 0.0, 0.13)]
    places += [(0.0, 0.0, 0.5), (0.1, 0.05, 0.8), (-0.1, -0.05, 0.7)]
    turns = [(0.5, 0.0, 0.1), (-0.5, 0.1, 0.0), (0.0, 0.5, 0.1), (0.1, -0.5, 0.0)]
    return [_photograph(place, turns[k % 4]) for k, place in enumerate(places)]


@pytest.fixture(scope="module")
def folder(photographs: list[NDArray[np.uint8]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("shots")
    for number, image in enumerate(photographs):
        cv2.imwrite(str(place / f"shot{number}.png"), image)
    cv2.imwrite(str(place / "shot98.png"), np.random.default_rng(0).integers(0, 255, (480, 640)))
    (place / "shot99.png").write_bytes(b"this is no image")
    (place / "notes.txt").write_text("not an image by its name")
    return place


def test_images_give_a_camera_a_report_and_a_rig(folder: Path, run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = run(
        "calib", "camera", "--images", folder, "--board", _BOARD, "--camera", "front",
        "--undistort", "--out", out, "--json",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stdout, done.stderr)
    document = json.loads(done.stdout)
    assert document == json.loads((out / "calibration.json").read_text())
    assert document["verdict"] in ("good", "doubtful")
    names = [view["name"] for view in document["views"] if view["used"]]
    assert names == [f"shot{k}.png" for k in range(12)]  # by number, not by letter
    reasons = {v["name"]: v["reason"] for v in document["views"] if not v["used"]}
    assert "cannot be read" in reasons["shot99.png"]
    assert reasons["shot98.png"]
    np.testing.assert_allclose(document["K"], _K, atol=6)
    sensor = load_rig(out / "rig.yaml").cameras()["front"]
    assert sensor.T_base_sensor is None
    assert sensor.camera().image_size == _SIZE
    report = (out / "report.html").read_text()
    assert document["advice"][0] in report
    assert report.index("What to do") < report.index("Where the boards were")
    assert report.index("Where the boards were") < report.index("Residuals")
    assert json.loads((out / "run.json").read_text())["counts"]["used"] == 12
    assert (out / "view.rrd").stat().st_size > 1000
    assert len(list((out / "undistorted").iterdir())) == 13
    with np.load(out / "maps.npz", allow_pickle=False) as maps:
        assert maps["map_x"].shape == (480, 640)


def test_the_wrong_board_gives_no_rig_and_says_what_to_count(
    folder: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    done = run(
        "calib", "camera", "--images", folder / "shot[0-3].png", "--board",
        "checkerboard:12x9:0.04", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 4
    assert "no checkerboard of 12x9" in done.stdout
    assert "count the inner corners" in done.stdout
    assert not (out / "rig.yaml").exists()
    assert (out / "report.html").exists()
    assert json.loads((out / "calibration.json").read_text())["K"] is None


def test_a_rig_that_was_given_is_updated(folder: Path, run: Run, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    pose = {"translation_m": [1.0, 0.0, 1.5], "quat_xyzw": [0.5, -0.5, 0.5, -0.5]}
    sensor = {
        "kind": "camera", "topic": "/front", "frame": "front_optical", "image_size": [640, 480],
        "model": "pinhole", "K": [400.0, 400.0, 320.0, 240.0], "distortion": [],
        "T_base_sensor": pose,
    }  # fmt: skip
    lidar = {"kind": "lidar", "frame": "top"}
    rig.write_text(yaml.safe_dump({"sensors": {"front": sensor, "top": lidar}}))
    before = rig.read_bytes()
    out = tmp_path / "run"
    done = run(
        "calib", "camera", "--images", folder, "--board", _BOARD, "--initial", rig,
        "--model", "pinhole", "--out", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "front: 12 of 14 views used" in done.stdout
    updated = load_rig(out / "rig.yaml")
    front = updated.cameras()["front"]
    assert (front.topic, front.frame, front.model) == ("/front", "front_optical", "pinhole")
    assert front.K[0] == pytest.approx(520, abs=6)
    assert front.T_base_sensor is not None
    np.testing.assert_allclose(front.T_base_sensor.translation_m, [1, 0, 1.5])
    assert list(updated.lidars()) == ["top"]
    assert rig.read_bytes() == before


def test_a_log_is_thinned_to_its_still_images(
    photographs: list[NDArray[np.uint8]], run: Run, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    stamp = 1_700_000_000_000_000_000
    with LogWriter(log, "mcap") as writer:
        for image in photographs[:6]:
            for _ in range(4):  # the board is held still for four images
                stamp += 100_000_000
                writer.write(
                    CameraImage(
                        topic="/cam/image", stamp_ns=stamp, log_time_ns=stamp, frame="cam",
                        pixels=np.repeat(image[..., None], 3, axis=2), encoding="bgr8",
                    )
                )  # fmt: skip
    config = tmp_path / "c.yaml"
    config.write_text("most_images: 6\n")
    out = tmp_path / "run"
    done = run(
        "calib", "camera", "--bag", log, "--board", _BOARD, "--config", config, "--out", out,
    )  # fmt: skip
    assert done.exit_code in (0, 4), done.stderr
    assert "24 images looked at, the board searched in 6" in done.stdout
    counts = json.loads((out / "run.json").read_text())["counts"]
    assert counts["used"] == 6
    wrong = run("calib", "camera", "--bag", log, "--topic", "/x", "--board", _BOARD,
                "--out", tmp_path / "no")  # fmt: skip
    assert wrong.exit_code == 3
    assert "/cam/image" in wrong.stderr


def test_exactly_the_bad_view_of_the_opencv_samples_is_left_out(
    shared_data: Path, run: Run, tmp_path: Path
) -> None:
    folder = shared_data / "intrinsics" / "opencv_samples"
    done = run(
        "calib", "camera", "--images", folder / "left*.jpg", "--board", "checkerboard:9x6:0.025",
        "--out", tmp_path / "run", "--json",
    )  # fmt: skip
    document = json.loads(done.stdout)
    left_out = {v["name"]: v["reason"] for v in document["views"] if not v["used"]}
    assert list(left_out) == ["left02.jpg"]
    assert left_out["left02.jpg"].startswith("outlier")
    stored = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    assert document["rms_px"] <= stored.getNode("avg_reprojection_error").real()


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--images", "nowhere/*.png", "--board", _BOARD], 3, "no image there"),
        (["--board", _BOARD], 2, "either --images or --bag"),
        (["--images", ".", "--board", "checkerboard:7by5"], 2, "checkerboard:7by5"),
        (["--images", ".", "--board", _BOARD, "--start", "2"], 2, "belong to --bag"),
    ],
)
def test_bad_calls_are_one_line(
    arguments: list[str], code: int, text: str, run: Run, tmp_path: Path
) -> None:
    done = run("calib", "camera", *arguments, "--out", tmp_path / "run")
    assert done.exit_code == code
    assert len(done.stderr.strip().splitlines()) == 1
    assert text in done.stderr
    assert not (tmp_path / "run").exists()


def test_the_drawn_camera_is_a_camera() -> None:
    camera = make_camera("pinhole", _SIZE, _K, [])
    assert camera.project(np.array([[0.0, 0, 1]]))[0].tolist() == [[322.0, 241.0]]


def test_the_settings_in_the_docs_are_the_defaults() -> None:
    from percept.cli.calib.camera_run import CameraRunConfig

    page = (Path(__file__).resolve().parents[2] / "docs" / "calib-camera.md").read_text()
    block = page.partition("## Settings\n\n```yaml\n")[2].partition("```")[0]
    values = yaml.safe_load(block)
    assert set(values) == set(CameraRunConfig.model_fields)
    assert CameraRunConfig.model_validate(values) == CameraRunConfig()


def test_the_limits_in_the_docs_are_those_of_the_code() -> None:
    from percept.calib.limits import CameraLimits

    page = (Path(__file__).resolve().parents[2] / "docs" / "calib-camera.md").read_text()
    limits = CameraLimits()
    for row in (
        f"without a board | {limits.unseen_doubtful:.0%} | {limits.unseen_bad:.0%} |",
        f"views differ, median | {limits.difference_good:.1%} | {limits.difference_bad:.0%} |",
        f"pixel, median | {limits.sd_good:.2%} | {limits.sd_bad:.1%} |",
        f"focal length | {limits.focal_good:.1%} | {limits.focal_bad:.0%} |",
        f"rms | {limits.rms_doubtful_px:g} px | {limits.rms_bad_px:g} px |",
        f"fewer than | {limits.few_views} | {limits.fewest_views} |",
    ):
        assert row.replace("%", " %") in page, row
