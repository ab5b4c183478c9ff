"""Samples, rigs, settings, cameras, results and errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import PinholeCamera
from percept.core.clock import iso_from_ns, ns_from_seconds
from percept.core.errors import ConfigError, GeometryError, PerceptError
from percept.core.results import Detections3D, Verdict
from percept.core.rig import load_rig, rig_as_yaml
from percept.core.samples import PointCloud
from percept.core.settings import Settings, load_settings
from percept.core.transform import Transform

_RIG = """
base_frame: base_link
sensors:
  top: {kind: lidar, topic: /top/points, frame: top,
        T_base_sensor: {translation_m: [1, 0, 1.8], quat_xyzw: [0, 0, 0, 1]}}
  left: {kind: lidar, frame: left}
  front: {kind: camera, frame: cam_front, image_size: [640, 400], model: pinhole,
          K: [500, 510, 320, 200], distortion: [-0.1, 0.01, 0.001, 0.002, 0]}
"""


def _cloud(points: NDArray[np.float32], **columns: Any) -> PointCloud:
    return PointCloud(
        topic="/top", stamp_ns=5, log_time_ns=7, frame="top", points_xyz=points, **columns
    )


def test_select_keeps_every_field_of_a_point_together() -> None:
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    cloud = _cloud(
        points, intensity=np.arange(4.0), offset_ns=np.arange(4) * 10, ring=np.arange(4) + 60
    )
    part = cloud.select(points[:, 0] > 4)
    assert part.intensity is not None
    assert part.offset_ns is not None
    assert part.ring is not None
    np.testing.assert_array_equal(part.points_xyz[:, 0], [6, 9])
    np.testing.assert_array_equal(part.intensity, [2, 3])
    np.testing.assert_array_equal(part.offset_ns, [20, 30])
    np.testing.assert_array_equal(part.ring, [62, 63])
    assert _cloud(points).select(np.array([0])).ring is None


@pytest.mark.parametrize(
    ("points", "columns", "text"),
    [
        (np.zeros((4, 2)), {}, "points are"),
        (np.full((1, 3), np.nan), {}, "finite"),
        (np.zeros((4, 3)), {"intensity": np.zeros(3)}, "intensity"),
    ],
    ids=["shape", "nan", "unaligned"],
)
def test_a_cloud_refuses_what_does_not_fit(
    points: NDArray[np.float32], columns: dict[str, Any], text: str
) -> None:
    with pytest.raises(GeometryError, match=text):
        _cloud(points.astype(np.float32), **columns)


def test_a_cloud_moves_only_through_a_transform_of_its_own_frame() -> None:
    cloud = _cloud(np.ones((1, 3), np.float32))
    matrix = np.eye(4)
    matrix[2, 3] = 1.8
    moved = cloud.transformed(Transform("base_link", "top", matrix))
    assert moved.frame == "base_link"
    np.testing.assert_allclose(moved.points_xyz, [[1, 1, 2.8]])
    with pytest.raises(GeometryError, match="frame 'top'"):
        cloud.transformed(Transform.identity("base_link", "left"))


def test_the_arrays_of_a_cloud_are_read_only_and_the_callers_are_not() -> None:
    points = np.zeros((1, 3), np.float32)
    cloud = _cloud(points)
    with pytest.raises(ValueError, match="read-only"):
        cloud.points_xyz[0, 0] = 1
    points[0, 0] = 0


def test_rig_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(_RIG)
    rig = load_rig(path)
    path.write_text(rig_as_yaml(rig))
    again = load_rig(path)
    assert list(again.lidars()) == ["top", "left"]
    assert list(again.cameras()) == ["front"]
    T_base_top = again.sensors["top"].T_base_sensor
    assert T_base_top is not None
    assert (T_base_top.target, T_base_top.source) == ("base_link", "top")
    assert again.sensors["left"].T_base_sensor is None
    for front in (rig.cameras()["front"], again.cameras()["front"]):
        assert front.image_size == (640, 400)
        assert front.distortion == (-0.1, 0.01, 0.001, 0.002, 0.0)
        K = front.pinhole().K
        assert K.tolist() == [[500.0, 0.0, 320.0], [0.0, 510.0, 200.0], [0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("frame: left", "frame: left, topik: /a", "Did you mean 'topic'"),
        ("quat_xyzw: [0, 0, 0, 1]", "quat_xyzw: [0, 0, 0, 2]", "quaternion length 2"),
        ("quat_xyzw: [0, 0, 0, 1]", "quat_xyzw: [0, 0, 1]", "at least 4"),
        ("kind: lidar, frame", "kind: radar, frame", "radar"),
        ("base_frame: base_link", "base_frame: [", "is not YAML"),
    ],
)
def test_a_wrong_rig_is_one_line_that_says_what_and_where(
    tmp_path: Path, old: str, new: str, text: str
) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(_RIG.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    assert text in str(caught.value)
    assert "rig.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


class _Inner(Settings):
    tolerance_m: float = 0.5


class _Outer(Settings):
    cluster: _Inner = _Inner()
    every: int = 1


def test_flags_win_over_the_file_and_the_file_over_defaults(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("cluster: {tolerance_m: 0.7}\nevery: 2\n")
    assert load_settings(_Outer, None) == _Outer()
    resolved = load_settings(_Outer, path, {"every": 3, "cluster": {"tolerance_m": None}})
    assert resolved == _Outer(cluster=_Inner(tolerance_m=0.7), every=3)


def test_an_unknown_key_names_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("cluster: {tolerence_m: 0.7}")
    with pytest.raises(ConfigError, match="Did you mean 'tolerance_m'") as caught:
        load_settings(_Outer, path)
    assert "cluster.tolerence_m" in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("text", ["- a\n", "!!python/object/apply:os.system [ls]\n", "a: &x [*x]"])
def test_yaml_that_is_no_mapping_or_not_safe_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError):
        load_settings(_Outer, path)


def test_projection_agrees_with_opencv_and_back() -> None:
    K = np.array([[500, 0, 320], [0, 510, 200], [0, 0, 1.0]])
    distortion = np.array([-0.2, 0.05, 0.001, -0.002, 0.01])
    camera = PinholeCamera((640, 400), K, distortion)
    points = np.random.default_rng(0).uniform([-3, -2, 6], [3, 2, 20], (200, 3))
    pixels, visible = camera.project(points)
    reference, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, distortion)
    np.testing.assert_allclose(pixels, reference[:, 0], atol=1e-9)
    assert visible.all()
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(
        rays, points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-9
    )


def test_the_image_ends_half_a_pixel_beyond_the_centres_of_its_outer_pixels() -> None:
    camera = PinholeCamera(
        (640, 400), np.array([[500, 0, 0], [0, 500, 0], [0, 0, 1.0]]), np.zeros(5)
    )
    edges = np.array([[-0.4, 0], [-0.6, 0], [639.4, 399.4], [639.6, 0], [0, 399.6]])
    _, visible = camera.project(np.column_stack([edges / 500, np.ones(5)]))
    assert visible.tolist() == [True, False, True, False, False]


def test_points_behind_the_camera_have_no_pixel() -> None:
    camera = PinholeCamera((640, 400), np.diag([500.0, 500, 1]), np.zeros(5))
    pixels, visible = camera.project(np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert np.isnan(pixels[0]).all()
    np.testing.assert_array_equal(visible, [False, True])


def test_detections_need_columns_of_one_length() -> None:
    with pytest.raises(GeometryError, match="detections need"):
        Detections3D(
            0, "top", "top", np.zeros((2, 7)), ("car",), np.zeros(1), np.zeros(1), np.zeros(1, int)
        )


@pytest.mark.parametrize(("verdict", "code"), list(zip(Verdict, (0, 0, 4, 4), strict=True)))
def test_only_good_and_doubtful_end_with_zero(verdict: Verdict, code: int) -> None:
    assert verdict.exit_code == code


def test_an_error_says_where_what_and_remedy() -> None:
    error = PerceptError("is empty", where="a.bag", remedy="Record again")
    assert str(error) == "a.bag: is empty. Record again."


def test_time_for_people() -> None:
    assert iso_from_ns(1_700_000_000_123_456_789) == "2023-11-14T22:13:20.123456Z"
    assert ns_from_seconds(0.1) == 100_000_000
