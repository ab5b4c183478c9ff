"""What the view of a calibration holds, read back by rerun's own reader and checker."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader

from percept.core.cameras import Camera, make_camera
from percept.core.errors import GeometryError
from percept.core.transform import Transform
from percept.export.calibration.view import write_calibration_view
from percept.export.palette import sensor_colour

_TURN = [0.5, -0.5, 0.5, -0.5]
_T_VIEW_CAMERA = Transform.from_quat_xyzw("base_link", "front", [1.0, 0.2, 1.5], _TURN)
_SQUARE = np.array([[4.0, 0, 0], [4, 1, 0], [4, 1, 1], [4, 0, 1]])


def _camera(size: tuple[int, int] = (1300, 900)) -> Camera:
    K = np.array([[700.0, 0, 640], [0, 710, 450], [0, 0, 1]])
    return make_camera("pinhole", size, K, [-0.3, 0.1, 0.001, 0.002, 0])


def _rows(path: Path) -> dict[str, dict[str, Any]]:
    """Return what was logged, by entity and column."""
    found: dict[str, dict[str, Any]] = {}
    for chunk in RrdReader(path).stream():
        for name, values in chunk.to_record_batch().to_pydict().items():
            known = [value for value in values if value is not None]
            found.setdefault(chunk.entity_path, {})[name] = known[0] if known else None
    return found


def _clouds(count: int = 50) -> dict[str, np.ndarray]:
    points = np.random.default_rng(0).uniform(-5, 5, (count, 3))
    return {"top": points, "left/rear": np.vstack([points + 1, [[np.nan, 0, 0]]])}


def test_clouds_cameras_and_boards_are_where_they_belong(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    clouds = _clouds()
    image = np.full((900, 1300, 3), 90, np.uint8)
    write_calibration_view(
        path,
        clouds=clouds,
        before={"top": clouds["top"]},
        images={"front": image},
        cameras={"front": (_camera(), _T_VIEW_CAMERA)},
        boards={"scene 1": _SQUARE},
    )
    rows = _rows(path)
    positions = rows["/after/clouds/top"]["Points3D:positions"]
    assert np.allclose(positions, clouds["top"], atol=1e-5)
    left = rows["/after/clouds/left\\/rear"]
    assert len(left["Points3D:positions"]) == 50  # without the NaN
    red, green, blue = sensor_colour(1)
    assert left["Points3D:colors"] == [(red << 24) + (green << 16) + (blue << 8) + 255]
    assert np.allclose(rows["/before/clouds/top"]["Points3D:positions"], positions)
    camera = rows["/after/cameras/front"]
    assert np.allclose(camera["Transform3D:translation"], [[1.0, 0.2, 1.5]])
    assert np.allclose(np.abs(camera["Transform3D:quaternion"]), 0.5)
    plane = rows["/after/cameras/front/image"]
    assert plane["Pinhole:resolution"] == [[640.0, 443.0]]
    K = np.array(plane["Pinhole:image_from_camera"]).reshape(3, 3).T  # by columns
    assert K[0, 0] == pytest.approx(700 * 640 / 1300, rel=1e-6)
    strip = rows["/after/boards/scene\\ 1"]["LineStrips3D:strips"][0]
    assert np.allclose(strip, [*_SQUARE, _SQUARE[0]])
    assert "left/rear: 50 points, all drawn" in rows["/notes"]["TextDocument:text"][0]
    assert list(tmp_path.iterdir()) == [path]


def test_the_image_is_drawn_without_its_distortion(tmp_path: Path) -> None:
    # A dot where the distorted camera sees a direction must be where an ideal one sees it.
    camera = _camera()
    ray = np.array([[-0.45, 0.3, 1.0]])
    at_px, _ = camera.project(ray)
    image = np.zeros((900, 1300), np.uint8)
    cv2.circle(image, (round(at_px[0, 0]), round(at_px[0, 1])), 8, (255,), -1)
    path = tmp_path / "view.rrd"
    write_calibration_view(
        path, clouds={}, images={"front": image}, cameras={"front": (camera, _T_VIEW_CAMERA)}
    )
    plane = _rows(path)["/after/cameras/front/image"]
    jpeg = np.frombuffer(bytes(plane["EncodedImage:blob"][0]), np.uint8)
    drawn = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE)
    assert drawn is not None
    rows, columns = np.nonzero(drawn > 128)
    K = np.array(plane["Pinhole:image_from_camera"]).reshape(3, 3).T
    expected = K @ ray[0]
    assert [columns.mean(), rows.mean()] == pytest.approx(expected[:2].tolist(), abs=0.6)


def test_large_clouds_are_thinned_and_the_file_stays_small(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    write_calibration_view(path, clouds=_clouds(250_000))
    rows = _rows(path)
    assert len(rows["/after/clouds/top"]["Points3D:positions"]) == 83_334
    assert "one in 3 is drawn" in rows["/notes"]["TextDocument:text"][0]
    assert path.stat().st_size < 5e6


def test_the_file_is_sound_and_the_same_each_time(tmp_path: Path) -> None:
    code = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    for name in ("a.rrd", "b.rrd"):
        write_calibration_view(tmp_path / name, clouds=_clouds(), boards={"b": _SQUARE})
    for arguments in (["verify", "a.rrd"], ["compare", "a.rrd", "b.rrd"]):
        command = [sys.executable, "-c", code, "rrd", *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True)
        assert done.returncode == 0, done.stderr


def test_nothing_is_a_view_too(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    write_calibration_view(path, clouds={"top": np.zeros((0, 3))})
    assert "top: 0 points" in _rows(path)["/notes"]["TextDocument:text"][0]


def test_what_does_not_fit_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    image = np.zeros((10, 10), np.uint8)
    with pytest.raises(GeometryError, match="front need the camera's model"):
        write_calibration_view(path, clouds={}, images={"front": image})
    cameras = {"front": (_camera(), _T_VIEW_CAMERA)}
    with pytest.raises(GeometryError, match="10x10 and the camera 1300x900"):
        write_calibration_view(path, clouds={}, images={"front": image}, cameras=cameras)
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        write_calibration_view(path, clouds={"top": np.zeros((3, 2))})
    assert not list(tmp_path.iterdir())
