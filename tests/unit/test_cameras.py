"""The laws that every camera model obeys, and parity with OpenCV's own projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import Camera, make_camera
from percept.core.errors import ConfigError, GeometryError

_K = np.array([[1000.0, 0, 960], [0, 1010, 540], [0, 0, 1]])
_MODELS = {
    "pinhole": [-0.3, 0.1, 0.001, -0.002, 0.0],
    "rational": [0.5, 0.2, 0.001, 0.002, 0.01, 0.9, 0.3, 0.02],
    "fisheye": [-0.05, -0.07, 0.09, -0.05],
}


def _points(seed: int = 0) -> NDArray[np.float64]:
    points = np.random.default_rng(seed).normal(size=(3000, 3)) * [1, 0.6, 1]
    points[:, 2] = np.abs(points[:, 2]) + 0.3
    return points


def _camera(model: str) -> Camera:
    return make_camera(model, (1920, 1080), _K, _MODELS[model])


@pytest.mark.parametrize("model", _MODELS)
def test_projection_is_that_of_opencv(model: str) -> None:
    camera, points, zero = _camera(model), _points(), np.zeros(3)
    pixels, seen = camera.project(points)
    if model == "fisheye":
        expected = cv2.fisheye.projectPoints(points[None], zero, zero, _K, camera.distortion)[0]
    else:
        expected = cv2.projectPoints(points, zero, zero, _K, camera.distortion)[0]
    assert seen.sum() > 1500
    np.testing.assert_allclose(pixels[seen], expected.reshape(-1, 2)[seen], atol=1e-9)


@pytest.mark.parametrize("model", _MODELS)
def test_rays_of_projected_points_lead_back_to_them(model: str) -> None:
    camera, points = _camera(model), _points(1)
    pixels, seen = camera.project(points)
    rays = points[seen] / np.linalg.norm(points[seen], axis=1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(pixels[seen]), rays, atol=1e-9)


def test_points_beyond_the_fold_are_not_seen_and_their_pixels_have_no_ray() -> None:
    camera = make_camera("pinhole", (4000, 4000), np.diag([1000.0, 1000, 1]), [-0.9])
    # r (1 - 0.9 r^2) is largest at r = 0.6086, 31.3 deg
    assert np.degrees(camera.widest_rad) == pytest.approx(31.3, abs=0.05)
    inside, beyond = np.tan(np.radians([[31.0], [32.0]]))
    points = np.array([[inside[0], 0, 1], [beyond[0], 0, 1]])
    assert camera.project(points)[1].tolist() == [True, False]
    assert np.isnan(camera.unproject(np.array([[450.0, 0]]))).all()  # 0.45 > 0.4057


@pytest.mark.parametrize(
    ("model", "distortion"), [("omni", []), ("pinhole", [0.0] * 8), ("fisheye", [0.0] * 5)]
)
def test_unknown_models_and_too_many_coefficients_are_refused(
    model: str, distortion: list[float]
) -> None:
    with pytest.raises(ConfigError):
        make_camera(model, (640, 480), _K, distortion)


def test_values_that_make_no_camera_are_refused() -> None:
    for K in (np.diag([-1.0, 1, 1]), np.full((3, 3), np.nan)):
        with pytest.raises(GeometryError):
            make_camera("pinhole", (640, 480), K, [])
