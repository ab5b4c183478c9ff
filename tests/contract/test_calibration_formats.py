"""Exported calibrations, read back by readers that are not percept's."""

from __future__ import annotations

import re
import subprocess
import sys
import types
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.calib.formats import FORMATS, export_rig, import_rig
from percept.core.errors import ConfigError, InputError, UsageError
from percept.core.rig import CameraSensor, LidarSensor, Rig, load_rig
from percept.core.transform import Transform, matrix_from_quat_xyzw, rotation_from_rpy

_F64 = NDArray[np.float64]
_BASE = "base_link"
_SIZE = (1280, 720)
_K = (700.0, 705.0, 640.5, 350.25)
_BROWN = (-0.31, 0.12, 0.001, -0.002, 0.0)
_FISHEYE = (-0.05, -0.078, 0.096, -0.0515)
_RATIONAL = (0.5, 0.1, 0.001, 0.002, 0.01, 0.8, 0.2, 0.03)
_PLACES = ("ros-tf", "urdf", "autoware")  # formats that carry LiDARs and come back


def _place(frame: str, xyz: list[float], rpy_deg: list[float], base: str = _BASE) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*np.radians(rpy_deg))
    matrix[:3, 3] = xyz
    return Transform(base, frame, matrix)


def _lidar(name: str, xyz: list[float], rpy_deg: list[float]) -> LidarSensor:
    return LidarSensor(name, f"/{name}/points", name, _place(name, xyz, rpy_deg))


def _camera(
    name: str,
    xyz: list[float],
    rpy_deg: list[float],
    model: str = "pinhole",
    distortion: tuple[float, ...] = _BROWN,
) -> CameraSensor:
    place = _place(name, xyz, rpy_deg)
    return CameraSensor(name, None, name, _SIZE, model, _K, distortion, place)


def _rig() -> Rig:
    sensors: list[LidarSensor | CameraSensor] = [
        _lidar("lidar_top", [1.0, 0.1, 1.9], [1, -2, 3]),
        _lidar("lidar_left", [1.1, 0.8, 1.5], [-4.2, 45.2, 92.1]),
        _camera("cam_front", [1.6, 0.0, 1.5], [-90, 0, -90]),
        _camera("cam_left", [1.5, 0.5, 1.5], [-91, 2, -30], "fisheye", _FISHEYE),
    ]
    return Rig(_BASE, {sensor.name: sensor for sensor in sensors})


def _written(rig: Rig, rig_format: str, folder: Path) -> Path:
    for name, text in export_rig(rig, rig_format, about=("percept 0", "verdict: good")).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def _known(rig: Rig, name: str) -> Transform:
    place = rig.sensors[name].T_base_sensor
    assert place is not None
    return place


# ---- OpenCV


def test_opencv_reads_its_files(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "opencv", tmp_path)
    for name, camera in rig.cameras().items():
        storage = cv2.FileStorage(str(tmp_path / f"{name}.yml"), cv2.FILE_STORAGE_READ)
        K = storage.getNode("camera_matrix").mat()
        distortion = storage.getNode("distortion_coefficients").mat()
        assert K is not None
        assert distortion is not None
        assert np.array_equal(K, camera.camera().K)
        points = np.random.default_rng(0).uniform([-2, -1, 4], [2, 1, 9], (30, 3))
        project: Any = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
        pixels = project(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, distortion)[0]
        assert np.allclose(pixels.reshape(-1, 2), camera.camera().project(points)[0], atol=1e-6)
        assert storage.getNode("image_width").real() == _SIZE[0]
        assert storage.getNode("fisheye_model").real() == (camera.model == "fisheye")
    storage = cv2.FileStorage(str(tmp_path / "extrinsics.yml"), cv2.FILE_STORAGE_READ)
    transforms = storage.getNode("transforms")
    assert transforms.size() == 4
    entry = transforms.at(1)
    assert entry.getNode("child").string() == "lidar_left"
    assert entry.getNode("parent").string() == _BASE
    forth, back = entry.getNode("T_parent_child").mat(), entry.getNode("T_child_parent").mat()
    assert forth is not None
    assert np.allclose(forth, _known(rig, "lidar_left").matrix)
    assert np.allclose(forth @ back, np.eye(4))


# ---- ROS


def test_camera_info_has_the_keys_of_ros_and_opencv_projects_alike(tmp_path: Path) -> None:
    rig = _rig()
    rig.sensors["rational"] = _camera("rational", [0, 0, 1], [-90, 0, -90], "rational", _RATIONAL)
    _written(rig, "ros-camera-info", tmp_path)
    models = {
        "cam_front": "plumb_bob",
        "cam_left": "equidistant",
        "rational": "rational_polynomial",
    }
    points = np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 9], (30, 3))
    for name, model in models.items():
        info = yaml.safe_load((tmp_path / f"{name}.yaml").read_text())
        assert info["distortion_model"] == model
        assert (info["image_width"], info["image_height"]) == _SIZE
        K = np.array(info["camera_matrix"]["data"]).reshape(3, 3)
        D = np.array(info["distortion_coefficients"]["data"])
        assert len(D) == {"plumb_bob": 5, "equidistant": 4, "rational_polynomial": 8}[model]
        project: Any = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
        pixels = project(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, D)[0]
        ours = rig.cameras()[name].camera().project(points)[0]
        assert np.allclose(pixels.reshape(-1, 2), ours, atol=1e-6)
        P = np.array(info["projection_matrix"]["data"]).reshape(3, 4)
        assert np.array_equal(P[:, :3], K)
        assert np.array_equal(np.reshape(info["rectification_matrix"]["data"], (3, 3)), np.eye(3))


def _tf_matrix(values: list[str]) -> _F64:
    """Return T_parent_child as tf2 understands x y z qx qy qz qw."""
    x, y, z, w = map(float, values[3:7])
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = list(map(float, values[:3]))
    return matrix


def _launched(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Run a launch file against stand-ins for ROS and return what it would start."""

    def module(name: str, **members: Any) -> None:
        made = types.ModuleType(name)
        made.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, made)

    module("launch", LaunchDescription=list)
    module("launch_ros")
    module("launch_ros.actions", Node=dict)
    space: dict[str, Any] = {}
    exec(compile(path.read_bytes(), str(path), "exec"), space)  # noqa: S102 - our own output
    nodes: list[dict[str, Any]] = space["generate_launch_description"]()
    return nodes


def test_static_transforms_say_the_same_three_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = _rig()
    _written(rig, "ros-tf", tmp_path)
    shell = (tmp_path / "static_transforms.sh").read_text()
    found: dict[str, list[_F64]] = {}
    for node in _launched(tmp_path / "static_transforms.launch.py", monkeypatch):
        assert (node["package"], node["executable"]) == ("tf2_ros", "static_transform_publisher")
        flags, values = node["arguments"][::2], node["arguments"][1::2]
        assert flags == ["--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw", "--frame-id",
                         "--child-frame-id"]  # fmt: skip
        assert values[7] == _BASE
        found[values[8]] = [_tf_matrix(values)]
        assert " ".join(node["arguments"]) in shell
        assert f"# rosrun tf2_ros static_transform_publisher {' '.join(values)}" in shell
    for entry in yaml.safe_load((tmp_path / "static_transforms.yaml").read_text())[
        "static_transforms"
    ]:
        seven = [entry["translation"][axis] for axis in "xyz"]
        seven += [entry["rotation"][axis] for axis in "xyzw"]
        found[entry["child_frame_id"]].append(_tf_matrix(list(map(str, seven))))
    assert list(found) == list(rig.sensors)
    for name, matrices in found.items():
        assert np.allclose(matrices, _known(rig, name).matrix, atol=1e-8)
    calls = _called(tmp_path / "static_transforms.sh")
    assert [call[:3] for call in calls] == [["run", "tf2_ros", "static_transform_publisher"]] * 4


def _called(script: Path) -> list[list[str]]:
    """Run a script with a stand-in for `ros2` and return the arguments of each call."""
    stand_in = "ros2() { printf '%s\\001' \"$@\"; printf '\\002'; }\n"
    one_by_one = script.read_text().replace(" &\n", "\n")
    done = subprocess.run(
        ["/bin/sh", "-c", stand_in + one_by_one], capture_output=True, text=True, check=True
    )
    return [call.split("\001")[:-1] for call in done.stdout.split("\002")[:-1]]


# ---- URDF and Autoware


def test_a_urdf_reader_finds_the_frames(tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    rig = _rig()
    _written(rig, "urdf", tmp_path)
    robot = yourdfpy.URDF.load(str(tmp_path / "rig.urdf"))
    assert robot.base_link == _BASE
    for name in rig.sensors:
        assert np.allclose(robot.get_transform(name, _BASE), _known(rig, name).matrix, atol=1e-8)


def _autoware_matrix(six: dict[str, float]) -> _F64:
    """Return a transform as URDF's xacro has it: fixed axes, roll first."""
    (cr, cp, cy), (sr, sp, sy) = (
        f([six["roll"], six["pitch"], six["yaw"]]) for f in (np.cos, np.sin)
    )
    matrix = np.eye(4)
    matrix[:3, :3] = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    matrix[:3, 3] = [six["x"], six["y"], six["z"]]
    return matrix


def test_autoware_places_camera_links_not_optical_frames(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "autoware", tmp_path)
    kit = yaml.safe_load((tmp_path / "sensor_kit_calibration.yaml").read_text())
    base = yaml.safe_load((tmp_path / "sensors_calibration.yaml").read_text())
    T_base_kit = _autoware_matrix(base["base_link"]["sensor_kit_base_link"])
    placed = kit["sensor_kit_base_link"]
    assert set(placed) == {"lidar_top_base_link", "lidar_left_base_link", "cam_front/camera_link",
                           "cam_left/camera_link"}  # fmt: skip
    left = T_base_kit @ _autoware_matrix(placed["lidar_left_base_link"])
    assert np.allclose(left, _known(rig, "lidar_left").matrix, atol=1e-8)
    # A camera that looks straight ahead has a link that is not turned.
    ahead = placed["cam_front/camera_link"]
    assert np.allclose([ahead["roll"], ahead["pitch"], ahead["yaw"]], 0, atol=1e-8)
    # x of the optical frame is -y of the link, y is -z, z is x.
    T_link_optical = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    for name in ("cam_front", "cam_left"):
        link = _autoware_matrix(placed[f"{name}/camera_link"])
        assert np.allclose(T_base_kit @ link @ T_link_optical, _known(rig, name).matrix, atol=1e-8)


def test_autoware_gets_no_vehicle_base_that_nobody_knows() -> None:
    place = _place("left", [0, 0.5, 0], [0, 45, 90], base="lidar_top")
    rig = Rig("lidar_top", {"left": LidarSensor("left", None, "left", place)})
    notes: Counter[str] = Counter()
    assert list(export_rig(rig, "autoware", notes=notes)) == ["sensor_kit_calibration.yaml"]
    assert "nothing says where 'lidar_top' sits" in next(iter(notes))


# ---- Kalibr and KITTI


def test_a_kalibr_chain_goes_from_camera_to_camera(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "kalibr", tmp_path)
    chain = yaml.safe_load((tmp_path / "camchain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1"]
    assert chain["cam0"]["distortion_model"] == "radtan"
    assert chain["cam0"]["distortion_coeffs"] == list(_BROWN[:4])
    assert chain["cam0"]["intrinsics"] == list(_K)
    assert chain["cam1"]["distortion_model"] == "equidistant"
    assert chain["cam1"]["resolution"] == list(_SIZE)
    # A point that both see: through the chain, and through the base.
    point_cam0 = np.array([0.3, -0.2, 5.0, 1.0])
    point_base = _known(rig, "cam_front").matrix @ point_cam0
    expected = np.linalg.solve(_known(rig, "cam_left").matrix, point_base)
    assert np.allclose(np.array(chain["cam1"]["T_cn_cnm1"]) @ point_cam0, expected)


def test_kalibr_knows_the_imu_where_the_rig_is_the_imus() -> None:
    place = _place("c", [0.1, 0.2, 0.3], [-90, 0, -80], base="imu0")
    rig = Rig("imu0", {"c": CameraSensor("c", "/c", "c", _SIZE, "pinhole", _K, _BROWN, place)})
    chain = yaml.safe_load(export_rig(rig, "kalibr")["camchain.yaml"])
    assert np.allclose(np.array(chain["cam0"]["T_cam_imu"]) @ place.matrix, np.eye(4))
    assert chain["cam0"]["rostopic"] == "/c"


def _kitti_values(path: Path) -> dict[str, _F64]:
    """Read a file as KITTI's devkit does."""
    pairs = (line.split(":", 1) for line in path.read_text().splitlines())
    return {name: np.array([float(value) for value in rest.split()]) for name, rest in pairs}


def test_kittis_product_of_matrices_is_our_projection(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "kitti", tmp_path)
    points = np.random.default_rng(0).uniform([3, -2, -1], [20, 2, 1], (50, 3))
    homogeneous = np.column_stack([points, np.ones(50)])
    folder = tmp_path / "cam_front" / "lidar_left"
    calib = _kitti_values(folder / "calib.txt")
    R0, Tr = np.eye(4), np.eye(4)
    R0[:3, :3] = calib["R0_rect"].reshape(3, 3)
    Tr[:3] = calib["Tr_velo_to_cam"].reshape(3, 4)
    T_lidar_base = np.vstack([calib["Tr_imu_to_velo"].reshape(3, 4), [0, 0, 0, 1]])
    image = homogeneous @ (calib["P2"].reshape(3, 4) @ R0 @ Tr @ T_lidar_base).T
    plain = CameraSensor("c", None, "c", _SIZE, "pinhole", _K, (), None)
    points_cam = _known(rig, "cam_front").inverse().apply(points)
    assert np.allclose(image[:, :2] / image[:, 2:], plain.camera().project(points_cam)[0])
    velo = _kitti_values(folder / "calib_velo_to_cam.txt")
    assert np.allclose(velo["R"].reshape(3, 3), Tr[:3, :3])
    assert np.allclose(velo["T"], Tr[:3, 3])
    cam = _kitti_values(folder / "calib_cam_to_cam.txt")
    assert np.allclose(cam["D_02"], _BROWN)
    assert np.allclose(cam["S_rect_02"], _SIZE)
    assert np.allclose(cam["P_rect_02"], calib["P2"])
    assert len(list(tmp_path.rglob("calib.txt"))) == 4


def test_a_real_kitti_calibration_is_read(shared_data: Path) -> None:
    folder = shared_data / "scenes" / "kitti_object" / "training"
    path = folder / "calib" / "000000.txt"
    notes: Counter[str] = Counter()
    rig = import_rig(path, notes)
    camera = rig.cameras()["cam2"]
    image = cv2.imread(str(folder / "image_2" / "000000.png"))
    assert image is not None
    assert camera.image_size == image.shape[1::-1]
    values = _kitti_values_of_benchmark(path)
    points = np.fromfile(folder / "velodyne" / "000000.bin", np.float32).reshape(-1, 4)[:2000, :3]
    points = points[points[:, 0] > 5].astype(np.float64)
    rect = np.eye(4)
    rect[:3, :3] = values["R0_rect"].reshape(3, 3)
    Tr = np.vstack([values["Tr_velo_to_cam"].reshape(3, 4), [0, 0, 0, 1]])
    homogeneous = np.column_stack([points, np.ones(len(points))])
    expected = homogeneous @ (values["P2"].reshape(3, 4) @ rect @ Tr).T
    ours = camera.camera().project(_known(rig, "cam2").inverse().apply(points))[0]
    assert np.allclose(ours, expected[:, :2] / expected[:, 2:], atol=0.01)
    assert any("image_0" in note for note in notes)


def _kitti_values_of_benchmark(path: Path) -> dict[str, _F64]:
    lines = [line for line in path.read_text().splitlines() if ":" in line]
    return {
        name: np.array([float(value) for value in rest.split()])
        for name, rest in (line.split(":", 1) for line in lines)
    }


# ---- back again


@given(
    quat=st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(
        lambda q: float(np.linalg.norm(q)) > 0.1
    ),
    xyz=st.lists(st.floats(-50, 50), min_size=3, max_size=3),
    lock=st.sampled_from([0, 1, -1]),
)
@settings(max_examples=60)
def test_every_place_survives_the_way_there_and_back(
    quat: list[float], xyz: list[float], lock: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    turn = matrix_from_quat_xyzw(quat)
    if lock:  # gimbal lock: roll and yaw are one
        turn = rotation_from_rpy(quat[0], lock * np.pi / 2, quat[1])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, xyz
    rig = Rig(_BASE, {"top": LidarSensor("top", None, "top", Transform(_BASE, "top", matrix))})
    folder = tmp_path_factory.mktemp("rig")
    for rig_format in (*_PLACES, "rig"):
        files = export_rig(rig, rig_format)
        for name, text in files.items():
            (folder / name).write_text(text)
        readable = [n for n in files if n.endswith(("urdf", "yaml")) and "sensors_" not in n]
        back = import_rig(folder / readable[0])
        assert list(back.sensors) == ["top"]
        assert back.base_frame == _BASE
        assert np.allclose(_known(back, "top").matrix, matrix, atol=2e-8), rig_format


def test_cameras_come_back_from_kalibr_and_the_rig_file(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "kalibr", tmp_path)
    back = import_rig(tmp_path / "camchain.yaml")
    between = _known(back, "cam0").inverse() @ _known(back, "cam1")
    expected = _known(rig, "cam_front").inverse() @ _known(rig, "cam_left")
    assert np.allclose(between.matrix, expected.matrix)
    assert back.cameras()["cam1"].distortion == _FISHEYE
    _written(rig, "rig", tmp_path)
    again = load_rig(tmp_path / "rig.yaml")
    assert export_rig(again, "rig") == export_rig(load_rig(tmp_path / "rig.yaml"), "rig")
    assert list(again.sensors) == list(rig.sensors)


def test_a_chain_with_an_imu_comes_back(tmp_path: Path) -> None:
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for index, angle in enumerate((-80.0, 10.0)):
        place = _place(f"cam{index}", [0.1 * index, 0.2, 0.3], [-90, 0, angle], base="imu0")
        sensors[place.source] = CameraSensor(
            place.source, "/c", place.source, _SIZE, "fisheye", _K, _FISHEYE, place
        )
    rig = Rig("imu0", sensors)
    _written(rig, "kalibr", tmp_path)
    back = import_rig(tmp_path / "camchain.yaml")
    assert back.base_frame == "imu0"
    for name in sensors:
        assert np.allclose(_known(back, name).matrix, _known(rig, name).matrix)


def test_a_kitti_calibration_comes_back_with_its_image(tmp_path: Path) -> None:
    rig = _rig()
    _written(rig, "kitti", tmp_path / "there")
    calib = tmp_path / "calib" / "000000.txt"
    calib.parent.mkdir()
    calib.write_bytes((tmp_path / "there" / "cam_left" / "lidar_top" / "calib.txt").read_bytes())
    with pytest.raises(InputError, match="says no image size"):
        import_rig(calib)
    (tmp_path / "image_2").mkdir()
    cv2.imwrite(str(tmp_path / "image_2" / "000000.png"), np.zeros(_SIZE[::-1], np.uint8))
    back = import_rig(calib)
    assert np.allclose(back.cameras()["cam2"].K, _K)
    T_lidar_camera = _known(rig, "lidar_top").inverse() @ _known(rig, "cam_left")
    assert np.allclose(_known(back, "cam2").matrix, T_lidar_camera.matrix, atol=1e-9)


# ---- what a format cannot hold


def test_what_is_left_out_is_named() -> None:
    rig = _rig()
    rig.sensors["lost"] = LidarSensor("lost", None, "lost", None)
    for rig_format in FORMATS:
        notes: Counter[str] = Counter()
        files = export_rig(rig, rig_format, notes=notes)
        assert any("lost" in note for note in notes) == (rig_format != "rig"), rig_format
        assert files


def test_a_model_that_does_not_fit_is_never_dropped_silently() -> None:
    rich = (-0.3, 0.1, 0.001, 0.002, 0.05)
    for model, distortion in (("pinhole", rich), ("rational", _RATIONAL)):
        rig = Rig(_BASE, {"c": _camera("c", [0, 0, 1], [0, 0, 0], model, distortion)})
        with pytest.raises(ConfigError, match=r"Kalibr has k1, k2, p1, p2.*opencv"):
            export_rig(rig, "kalibr")
        rig.sensors["top"] = _lidar("top", [0, 0, 2], [0, 0, 0])
        notes: Counter[str] = Counter()
        export_rig(rig, "kitti", notes=notes)
        assert any("undistort" in note for note in notes)
        assert any("cannot hold its rational" in note for note in notes) == (model == "rational")


@pytest.mark.parametrize("rig_format", [name for name in FORMATS if name != "rig"])
def test_nothing_to_write_is_an_error(rig_format: str) -> None:
    rig = Rig(_BASE, {"top": LidarSensor("top", None, "top", None)})
    with pytest.raises(ConfigError):
        export_rig(rig, rig_format)


def test_frames_and_formats_that_cannot_be_are_refused() -> None:
    rig = _rig()
    twin = _lidar("twin", [0, 0, 0], [0, 0, 0])
    rig.sensors["twin"] = LidarSensor("twin", None, "lidar_top", Transform(
        _BASE, "lidar_top", _known(Rig(_BASE, {"twin": twin}), "twin").matrix))  # fmt: skip
    for rig_format in ("ros-tf", "urdf"):
        with pytest.raises(ConfigError, match="two places"):
            export_rig(rig, rig_format)
    with pytest.raises(UsageError, match="no format 'yaml'"):
        export_rig(_rig(), "yaml")


def test_a_sensor_in_the_base_frame_needs_no_edge() -> None:
    top = LidarSensor("top", None, "top", Transform.identity("top", "top"))
    left = LidarSensor("left", None, "left", _place("left", [0, 1, 0], [0, 0, 90], base="top"))
    files = export_rig(Rig("top", {"top": top, "left": left}), "ros-tf")
    entries = yaml.safe_load(files["static_transforms.yaml"])["static_transforms"]
    assert [entry["child_frame_id"] for entry in entries] == ["left"]


# ---- strangers


_EVIL = (
    "../../etc/passwd",
    "a\nimport os",
    "x --> <!ENTITY & \"' </robot>",
    "$(touch /tmp/x); `id`",
    "# -*- coding: rot13 -*-",
    "{{yaml: [",
    "..",
    "\u2028\x85",
    "CON: %s %(x)s {0}",
)


@pytest.mark.parametrize("evil", _EVIL)
@pytest.mark.parametrize("rig_format", list(FORMATS))
def test_names_lead_nowhere(
    rig_format: str, evil: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    T_evil_cam, T_evil_lidar = (
        Transform(evil, kind + evil, _known(_rig(), "lidar_top").matrix) for kind in "cl"
    )
    camera = CameraSensor(
        T_evil_cam.source, evil, T_evil_cam.source, _SIZE, "pinhole", _K, _BROWN, T_evil_cam
    )
    lidar = LidarSensor(T_evil_lidar.source, evil, T_evil_lidar.source, T_evil_lidar)
    rig = Rig(evil, {camera.name: camera, lidar.name: lidar})
    if rig_format == "urdf" and not evil.isprintable():
        with pytest.raises(ConfigError, match="letters that XML"):
            export_rig(rig, rig_format)
        return
    files = export_rig(rig, rig_format, about=(evil,))
    for name in files:
        assert re.fullmatch(r"([A-Za-z0-9_-]+/)*[A-Za-z0-9_.-]+", name), name
        assert ".." not in name
    _written(rig, rig_format, tmp_path)
    for path in (p for p in tmp_path.rglob("*") if p.is_file()):
        if path.suffix == ".yaml":
            assert isinstance(yaml.safe_load(path.read_text()), dict)
        elif path.suffix == ".yml":
            assert cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ).isOpened()
        elif path.suffix == ".py":
            assert len(_launched(path, monkeypatch)) == 2
        elif path.suffix == ".sh":
            assert [call[-1] for call in _called(path)] == ["c" + evil, "l" + evil]
        elif path.suffix == ".urdf":
            back = import_rig(path)
            assert list(back.sensors) == ["l" + evil]


def test_a_urdf_with_a_document_type_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.urdf"
    path.write_text('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>')
    with pytest.raises(InputError, match="document type"):
        import_rig(path)
