"""Intrinsics in the files of other tools: real ones, and every spelling."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from percept.calib.formats import export_rig, import_rig, read_intrinsics
from percept.core.errors import ConfigError, InputError, PerceptError
from percept.core.rig import CameraSensor, Rig

_K = (700.0, 705.0, 640.5, 350.25)
_K9 = "[700, 0, 640.5, 0, 705, 350.25, 0, 0, 1]"
_FLAT = f"width: 1280\nheight: 720\nK: {_K9}\n"
_CAMERAS = {
    "pinhole": (-0.31, 0.12, 0.001, -0.002, 0.0),
    "fisheye": (-0.05, -0.078, 0.096, -0.0515),
    "rational": (0.5, 0.1, 0.001, 0.002, 0.01, 0.8, 0.2, 0.03),
}


def _file(folder: Path, text: str, name: str = "front.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("model", list(_CAMERAS))
@pytest.mark.parametrize("rig_format", ["ros-camera-info", "opencv", "kalibr", "rig"])
def test_what_is_exported_is_read_again(rig_format: str, model: str, tmp_path: Path) -> None:
    camera = CameraSensor("c", None, "c", (1280, 720), model, _K, _CAMERAS[model], None)
    rig = Rig("base_link", {"c": camera})
    if (rig_format, model) == ("kalibr", "rational"):
        with pytest.raises(ConfigError):
            export_rig(rig, rig_format)
        return
    ((name, text),) = export_rig(rig, rig_format).items()
    back = read_intrinsics(_file(tmp_path, text, name))
    assert (back.model, back.K, back.image_size) == (model, _K, (1280, 720))
    assert back.distortion == pytest.approx(_CAMERAS[model], abs=0)
    assert back.name == ("cam0" if rig_format == "kalibr" else "c")


# ---- real files


def test_the_flat_info_of_a_real_fisheye(shared_data: Path) -> None:
    path = shared_data / "camera_lidar" / "acfr_vlp" / "camera_info.yaml"
    camera = read_intrinsics(path, "front")
    assert (camera.name, camera.model, camera.image_size) == ("front", "fisheye", (1920, 1208))
    assert camera.K == (1176.93, 1177.72, 962.275, 612.725)
    assert camera.distortion == (-0.0540096, -0.0784275, 0.0959641, -0.0515253)


def test_opencvs_own_answer(shared_data: Path) -> None:
    path = shared_data / "intrinsics" / "opencv_samples" / "left_intrinsics.yml"
    camera = read_intrinsics(path)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K = storage.getNode("camera_matrix").mat()
    assert K is not None
    assert np.array_equal(camera.camera().K, K)
    assert (camera.name, camera.model, camera.image_size) == (
        "left_intrinsics",
        "pinhole",
        (640, 480),
    )
    assert len(camera.distortion) == 5


@pytest.mark.parametrize(("scene", "height"), [("auto", 1200), ("manual", 1080)])
def test_opencalibs_json(scene: str, height: int, shared_data: Path) -> None:
    folder = shared_data / "camera_lidar" / "opencalib_proj" / scene
    camera = read_intrinsics(folder / "center_camera-intrinsic.json")
    assert (camera.name, camera.model) == ("center_camera", "pinhole")
    assert camera.image_size == (1920, height)
    assert camera.K[0] == pytest.approx(2113, abs=5)
    with pytest.raises(InputError, match="no camera intrinsics"):
        read_intrinsics(folder / "top_center_lidar-to-center_camera-extrinsic.json")


# ---- spellings


@pytest.mark.parametrize(
    ("lines", "model", "distortion"),
    [
        ("D: [-0.3, 0.1, 0, 0]\ndistortion_model: plumb_bob", "pinhole", (-0.3, 0.1, 0, 0, 0)),
        ("D: []\ndistortion_model: ''", "pinhole", (0,) * 5),
        ("", "pinhole", (0,) * 5),
        ("D: [0.1, 0.2, 0.3, 0.4]\ndistortion_model: equidistant", "fisheye", (0.1, 0.2, 0.3, 0.4)),
        ("D: [0.1, 0.2]\ndistortion_model: fisheye", "fisheye", (0.1, 0.2, 0, 0)),
        (
            "D: [1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 0, 0, 0]\ndistortion_model: rational_polynomial",
            "rational",
            (1, 2, 3, 4, 5, 6, 7, 8),
        ),
        (
            "D: [-0.3, 0.1, 0, 0, 0, 0, 0, 0]\ndistortion_model: rational_polynomial",
            "pinhole",
            (-0.3, 0.1, 0, 0, 0),
        ),
    ],
)
def test_the_models_of_ros(
    lines: str, model: str, distortion: tuple[float, ...], tmp_path: Path
) -> None:
    camera = read_intrinsics(_file(tmp_path, _FLAT + lines))
    assert (camera.name, camera.model, camera.frame) == ("front", model, "front")
    assert camera.distortion == distortion


def test_a_message_as_ros2_prints_it(tmp_path: Path) -> None:
    text = (
        "header:\n  stamp:\n    sec: 1\n  frame_id: cam_optical\nheight: 720\nwidth: 1280\n"
        f"distortion_model: plumb_bob\nd:\n- -0.1\n- 0.0\n- 0.0\n- 0.0\n- 0.0\nk: {_K9}\n---\n"
    )
    camera = read_intrinsics(_file(tmp_path, text))
    assert (camera.K, camera.frame) == (_K, "cam_optical")
    assert camera.distortion == (-0.1, 0, 0, 0, 0)


def test_one_of_several_cameras_is_chosen(tmp_path: Path) -> None:
    one = (
        "{camera_model: pinhole, intrinsics: [7, 7, 3, 3], distortion_model: none, "
        "distortion_coeffs: [], resolution: [8, 8]}"
    )
    path = _file(tmp_path, f"cam0: {one}\ncam1: {one}\n")
    assert read_intrinsics(path, "cam1").name == "cam1"
    with pytest.raises(InputError, match=r"2 cameras \(cam0, cam1\)"):
        read_intrinsics(path)
    with pytest.raises(InputError, match="no camera 'front'"):
        read_intrinsics(path, "front")


# ---- files that cannot be used


_BAD = {
    "no image size": f"K: {_K9}",
    "no camera matrix": "width: 8\nheight: 8\nK: [1, 0, 0, 0, 1, 0, 0, 0, 2]",
    "has a skew": "width: 8\nheight: 8\nK: [1, 0.5, 0, 0, 1, 0, 0, 0, 1]",
    "needs 9 numbers and has 2": "width: 8\nheight: 8\nK: [1, 2]",
    "no finite number": "width: 8\nheight: 8\nK: [.nan, 0, 0, 0, 1, 0, 0, 0, 1]",
    "no camera model 'fov'": _FLAT + "distortion_model: fov\nD: [1]",
    "thin prism": _FLAT + "D: [1, 2, 3, 4, 5, 6, 7, 8, 9]",
    "has 4 coefficients, not 5": _FLAT + "distortion_model: fisheye\nD: [1, 2, 3, 4, 5]",
    "no calibration that percept knows": "[1, 2]",
    "no camera intrinsics that percept knows": "a: 1",
    "is not YAML": "a: [1",
    "could not determine": "a: !!python/object/apply:os.system [ls]",
    "no camera model 'omni'": "cam0: {intrinsics: [1, 1, 1, 1], camera_model: omni}",
    "while parsing": "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: [",
}


@pytest.mark.parametrize("said", list(_BAD))
def test_bad_files_are_told_in_one_line(said: str, tmp_path: Path) -> None:
    path = _file(tmp_path, _BAD[said])
    with pytest.raises(InputError, match=said) as caught:
        read_intrinsics(path)
    assert str(path) in str(caught.value)
    with pytest.raises(PerceptError):
        import_rig(path)


def test_files_that_are_no_text_or_too_large_or_missing(tmp_path: Path) -> None:
    for name, content in (("a.yaml", b"\xff\xfe\x00\x01\x80"), ("b.yaml", b"#" * 5_000_000)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=r"no text|too large"):
            read_intrinsics(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read"):
        read_intrinsics(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"has no rig\.yaml"):
        import_rig(tmp_path)
    with pytest.raises(InputError, match="is not JSON"):
        read_intrinsics(_file(tmp_path, "{", "a.json"))


def test_deep_nesting_is_no_crash(tmp_path: Path) -> None:
    for name, text in (("a.json", "[" * 100_000), ("a.yaml", "[" * 20_000)):
        with pytest.raises(InputError):
            read_intrinsics(_file(tmp_path, text, name))


def test_a_list_of_lists_without_end_is_no_crash(tmp_path: Path) -> None:
    lines = ["a0: &a0 [1, 1]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 7)]
    path = _file(tmp_path, "\n".join([*lines, "width: 8", "height: 8", "K: *a6"]))
    with pytest.raises(InputError, match="far too many numbers"):
        read_intrinsics(path)
    # A list that holds itself.
    with pytest.raises(InputError):
        read_intrinsics(_file(tmp_path, "width: 8\nheight: 8\nK: &k [*k]"))


def test_intrinsics_alone_are_a_rig_without_places(tmp_path: Path) -> None:
    notes: Counter[str] = Counter()
    rig = import_rig(_file(tmp_path, _FLAT), notes)
    assert rig.cameras()["front"].T_base_sensor is None
    assert list(notes) == ["front: the file does not say where it sits"]


# ---- frames of other tools


def _edge(parent: str, child: str, w: float = 1.0) -> dict[str, object]:
    return {
        "frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": 0, "y": 0, "z": 1},
        "rotation": {"x": 0, "y": 0, "z": 0, "w": w},
    }


def _tree(w: float) -> str:
    edges = [_edge("base_link", "mast"), _edge("mast", "velodyne", w), _edge("mast", "cam_optical")]
    return json.dumps({"static_transforms": edges})  # which is YAML too


def test_a_tree_of_frames_is_followed_to_its_root(tmp_path: Path) -> None:
    notes: Counter[str] = Counter()
    rig = import_rig(_file(tmp_path, _tree(w=1)), notes)
    place = rig.sensors["velodyne"].T_base_sensor
    assert place is not None
    assert place.translation_m.tolist() == [0, 0, 2]
    assert list(rig.sensors) == ["velodyne"]
    assert "cam_optical" in next(iter(notes))
    with pytest.raises(InputError, match="no unit quaternion"):
        import_rig(_file(tmp_path, _tree(w=2)))


def _urdf(joints: str) -> str:
    links = "".join(f'<link name="{n}"/>' for n in ("base_link", "lidar", "wheel", "cam_optical"))
    return f'<?xml version="1.0"?>\n<robot name="car">{links}{joints}</robot>'


def _joint(child: str, kind: str = "fixed", parent: str = "base_link", origin: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>{origin}'
    return f'<joint name="{child}_joint" type="{kind}">{ends}</joint>'


def test_a_urdf_of_a_whole_car(tmp_path: Path) -> None:
    origin = '<origin xyz="1 2 3" rpy="0 0 1.5707963"/>'
    joints = _joint("lidar", origin=origin) + _joint("cam_optical") + _joint("wheel", "continuous")
    joints += "<transmission><joint name='wheel_joint'/></transmission>" + _joint(
        "hub", parent="wheel"
    )
    notes: Counter[str] = Counter()
    rig = import_rig(_file(tmp_path, _urdf(joints), "car.urdf"), notes)
    assert list(rig.sensors) == ["lidar"]
    place = rig.sensors["lidar"].T_base_sensor
    assert place is not None
    assert np.allclose(place.apply(np.array([[1.0, 0, 0]])), [[1, 3, 3]], atol=1e-6)
    assert len(notes) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot><joint", "is not XML"),
        ("<html/>", "no URDF"),
        (_urdf(""), "no tree"),
        (_urdf(_joint("cam_optical")), "has no LiDAR"),
        (_urdf(_joint("lidar", origin='<origin xyz="1 2"/>')), "needs 3 numbers"),
        (_urdf(_joint("lidar", origin='<origin xyz="a b c"/>')), "no number"),
        (_urdf(_joint("lidar") + _joint("lidar", parent="wheel")), "no tree"),
        (_urdf(_joint("lidar", parent="wheel") + _joint("wheel", parent="lidar")), "no tree"),
    ],
)
def test_bad_urdfs_are_told(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        import_rig(_file(tmp_path, text, "car.urdf"))


def test_json_keys_of_strangers_do_no_harm(tmp_path: Path) -> None:
    for content in ({"a": {"param_type": "intrinsic", "param": {}}}, {"a": 1}, {}, [1]):
        with pytest.raises(InputError):
            read_intrinsics(_file(tmp_path, json.dumps(content), "a.json"))
