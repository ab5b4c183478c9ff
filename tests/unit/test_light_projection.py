"""Lights of the map in images: which are looked for, and where they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from percept.core.errors import ConfigError, GeometryError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.hdmap import MapLight
from percept.lights.projection import ProjectionConfig, project_lights

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
AT_HOME = Transform.identity("map", "base_link")


def camera(model: str = "pinhole", distortion: tuple[float, ...] = ()) -> CameraSensor:
    """One that looks along +x from 1.5 m above the origin."""
    matrix = np.eye(4)
    matrix[:3, :3] = OPTICAL
    matrix[2, 3] = 1.5
    place = Transform("base_link", "cam", matrix)
    K = (500.0, 500.0, 319.5, 199.5)
    return CameraSensor("cam", None, "cam", (640, 400), model, K, distortion, place)


def light(x: float, y: float, z: float = 4.0, *, yaw_deg: float = 180.0, name: int = 1) -> MapLight:
    """One of 0.4 x 1.0 m whose lower middle is at x, y, z, and that faces along the yaw."""
    cos, sin = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    right = np.array([-sin, cos, 0.0])  # as who stands before it sees it
    low = np.array([x, y, z])
    corners = [low - 0.2 * right, low + 0.2 * right]
    corners += [corner + np.array([0, 0, 1.0]) for corner in reversed(corners)]
    return MapLight(light_id=name, corners_map=np.array(corners), facing=np.array([cos, sin, 0.0]))


def test_boxes_are_where_the_lens_puts_the_corners() -> None:
    distortion = (-0.2, 0.05, 0.001, -0.002, 0.0)
    cam = camera("pinhole", distortion)
    near = light(25.0, 5.0)
    found = project_lights([near], AT_HOME, cam)
    matrix = np.array([[500.0, 0, 319.5], [0, 500.0, 199.5], [0, 0, 1]])
    points = (near.corners_map - [0, 0, 1.5]) @ OPTICAL
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(distortion))[0]
    pixels = pixels.reshape(-1, 2) + 0.5
    np.testing.assert_allclose(
        found.boxes_px, [[*pixels.min(axis=0), *pixels.max(axis=0)]], atol=0.02
    )
    assert found.ids.tolist() == [1]
    assert found.range_m[0] == pytest.approx(np.linalg.norm([25, 5, 3.0]))
    assert found.inside.tolist() == [1.0]


def test_the_pose_moves_the_lights() -> None:
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # looks along +y
    matrix[:3, 3] = [100, 50, 0]
    found = project_lights(
        [light(100, 80, yaw_deg=-90.0)], Transform("map", "base_link", matrix), camera()
    )
    here = project_lights([light(30, 0)], AT_HOME, camera())
    np.testing.assert_allclose(found.boxes_px, here.boxes_px, atol=1e-9)


def test_only_lights_in_range_that_face_us_and_are_in_the_image() -> None:
    lights = [
        light(40, 0, name=1),
        light(170, 0, name=2),  # too far
        light(40, 2, yaw_deg=0.0, name=3),  # from behind
        light(40, 4, yaw_deg=180 - 60, name=4),
        light(40, 4, yaw_deg=180 - 88, name=5),  # from the side
        light(-40, 0, yaw_deg=0.0, name=6),  # behind the camera
        light(20, 30, name=7),  # outside the image
        light(140, -2, name=8),  # too small
    ]
    assert project_lights(lights, AT_HOME, camera()).ids.tolist() == [1, 4]
    all_sizes = ProjectionConfig(min_height_px=0.0)
    assert project_lights(lights, AT_HOME, camera(), all_sizes).ids.tolist() == [1, 4, 8]
    far = ProjectionConfig(range_m=300.0, min_height_px=2.0)
    assert project_lights(lights, AT_HOME, camera(), far).ids.tolist() == [1, 2, 4, 8]
    assert len(project_lights([], AT_HOME, camera())) == 0


def test_a_light_at_the_border_is_partly_inside() -> None:
    half = light(10, 10 * 319.5 / 500)
    found = project_lights([half], AT_HOME, camera())
    assert found.inside[0] == pytest.approx(0.5, abs=0.03)
    assert found.boxes_px[0, 0] < 0 < found.boxes_px[0, 2]


def test_a_lens_that_folds_back_shows_no_ghosts() -> None:
    folding = camera("pinhole", (-0.45, 0.0, 0.0, 0.0, 0.0))
    widest = folding.camera().widest_rad
    angle = np.degrees(widest) + 12
    ghost = light(10, 10 * float(np.tan(np.radians(angle))))
    assert len(project_lights([ghost], AT_HOME, folding)) == 0


def test_uncertainty_grows_with_the_angle_and_falls_with_the_distance() -> None:
    lights = [light(20, 0, name=1), light(60, 0, name=2)]
    found = project_lights(lights, AT_HOME, camera())
    assert found.shared_sd_px == pytest.approx(500 * np.radians(0.7))
    np.testing.assert_allclose(found.own_sd_px, 500 * 0.3 / found.range_m)
    sure = ProjectionConfig(rotation_sd_deg=0.1, position_sd_m=0.1)
    assert project_lights(lights, AT_HOME, camera(), sure).shared_sd_px < 1


def test_what_does_not_meet_is_refused() -> None:
    cam = camera()
    nowhere = CameraSensor("cam", None, "cam", cam.image_size, cam.model, cam.K, (), None)
    with pytest.raises(ConfigError, match="'cam' has no T_base_sensor"):
        project_lights([], AT_HOME, nowhere)
    with pytest.raises(GeometryError, match="do not meet"):
        project_lights([], Transform.identity("map", "rear_axle"), cam)
