"""Calibration against what a user would pick, on the real sets beside the checkout.

    python tests/benchmarks/bench_calib.py --data ../shared/data

Everything runs in one process on one core, interleaved; the ratios are what counts. Reading files
is outside of every clock.

- Intrinsics: the script of OpenCV's tutorial (`findChessboardCorners`, `cornerSubPix`,
  `calibrateCamera`) against finding the boards and `calibrate_camera`, which fits three lens
  models, leaves views out, and measures how far the result can be trusted.
- LiDAR pairs: Open3D's ICP over three voxel sizes, point to plane and generalised, begun at the
  right answer, against `calibrate_lidars`, which gets no guess.
- Camera to LiDAR: the features of the ACFR set that its own tool extracted, and what that tool made
  of them.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib import calibrate_camera, calibrate_camera_lidar, calibrate_lidars
from percept.calib.board_in_cloud.find import BoardInCloud, find_boards
from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.detection import BoardView, detect_board
from percept.calib.camera_lidar.calibrate import BoardPair
from percept.calib.formats import read_intrinsics
from percept.core.cameras import Camera
from percept.datasets import read_point_cloud

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_ACFR_SIZE_M = (0.85, 0.61)
_VOXELS_AND_GATES_M = ((0.3, 2.0), (0.15, 1.0), (0.1, 0.5))

_F64 = NDArray[np.float64]
_U8 = NDArray[np.uint8]
Scene = dict[str, _F64]


def main() -> None:
    """Run all sections and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    names = ("numpy", "numba", "open3d")
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    print(f"one core; OpenCV {cv2.__version__}, {versions}")
    print_intrinsics(arguments.data, arguments.repeat)
    print_lidar_pairs(arguments.data, arguments.repeat)
    print_camera_lidar(arguments.data / "camera_lidar" / "acfr_vlp")


def interleaved(calls: dict[str, Callable[[], object]], repeat: int) -> dict[str, float]:
    """Return the median seconds of each call, one after the other, after a warm-up."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for round_number in range(repeat + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if round_number:
                times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def print_times(title: str, times: dict[str, float]) -> None:
    """Print seconds, and each as a multiple of percept's."""
    ours = times["percept"]
    for name, seconds in times.items():
        print(f"{title:<22}{name:<26}{seconds:7.2f} s {seconds / ours:7.2f}x")


# ---- intrinsics


def print_intrinsics(data: Path, repeat: int) -> None:
    print("\n== intrinsics: the same images; x is time over percept's")
    folder = data / "intrinsics"
    sets = {
        "opencv_samples": (folder / "opencv_samples", "left*.jpg", Checkerboard(9, 6, 0.025)),
        "opencalib 15x17": (folder / "opencalib_board15x17", "*.jpg", Checkerboard(15, 17, 0.05)),
        "acfr": (data / "camera_lidar/acfr_vlp/images", "*.jpg", Checkerboard(7, 5, 0.095)),
    }
    for title, (where, pattern, board) in sets.items():
        paths = sorted(where.glob(pattern))
        images = [as_grey(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in paths]
        corners = opencv_corners(images, board)
        views = percept_views(images, board)
        calls: dict[str, Callable[[], object]] = {
            "percept": partial(percept_camera, images, board),
            "OpenCV": partial(opencv_script, images, board),
            "percept, finding": partial(percept_views, images, board),
            "OpenCV, finding": partial(opencv_corners, images, board),
            "percept, solving": partial(calibrate_camera, views, board),
            "OpenCV, solving": partial(opencv_camera, corners, images, board),
        }
        print_times(title, interleaved(calls, repeat))
        result = calibrate_camera(views, board)
        rms, K = opencv_camera(corners, images, board)
        ours = "no camera" if result.fit is None else f"rms {result.fit.rms_px:.3f} px"
        print(f"  percept: {len(views)} of {len(images)} boards, {ours}, {result.verdict}")
        print(f"    {result.why[0]}")
        if result.fit is not None:
            fx, _, cx, cy = result.fit.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
            print(f"    {result.fit.camera.model}: fx {fx:.2f} cx {cx:.2f} cy {cy:.2f}")
        print(f"  OpenCV: {len(corners)} boards, rms {rms:.3f} px, no verdict")
        print(f"    pinhole: fx {K[0, 0]:.2f} cx {K[0, 2]:.2f} cy {K[1, 2]:.2f}")


def as_grey(image: NDArray[Any] | None) -> _U8:
    if image is None:
        raise SystemExit("an image of the data cannot be read")
    return image.astype(np.uint8)


def percept_views(images: Sequence[_U8], board: Checkerboard) -> list[BoardView]:
    found = (detect_board(image, board, name=f"{n}") for n, image in enumerate(images))
    return [view for view in found if isinstance(view, BoardView)]


def percept_camera(images: Sequence[_U8], board: Checkerboard) -> object:
    return calibrate_camera(percept_views(images, board), board)


def opencv_script(images: Sequence[_U8], board: Checkerboard) -> object:
    return opencv_camera(opencv_corners(images, board), images, board)


def opencv_corners(images: Sequence[_U8], board: Checkerboard) -> list[NDArray[np.float32]]:
    """Return the corners (N, 1, 2) by image, as OpenCV's tutorial finds them."""
    found = []
    enough = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
    for image in images:
        is_found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows))
        if is_found:
            refined = cv2.cornerSubPix(image, corners, (11, 11), (-1, -1), enough)
            found.append(refined.astype(np.float32))
    return found


def opencv_camera(
    corners: Sequence[NDArray[np.float32]], images: Sequence[_U8], board: Checkerboard
) -> tuple[float, _F64]:
    points = board.corners_board().astype(np.float32)
    size = (images[0].shape[1], images[0].shape[0])
    # OpenCV makes the matrix and the coefficients where it gets None; its types say otherwise.
    solve: Any = cv2.calibrateCamera
    rms, K, *_ = solve([points] * len(corners), list(corners), size, None, None)
    return float(rms), np.asarray(K, dtype=np.float64)


# ---- LiDAR pairs


def print_lidar_pairs(data: Path, repeat: int) -> None:
    print("\n== LiDAR pairs: percept without a guess, Open3D from the right answer")
    for title, scenes, truths in lidar_pairs(data / "lidar2lidar"):
        calls: dict[str, Callable[[], object]] = {
            "percept": partial(calibrate_lidars, scenes, "target"),
            "Open3D point to plane": partial(open3d_icp, scenes, truths, "plane"),
            "Open3D generalised": partial(open3d_icp, scenes, truths, "generalised"),
        }
        print_times(title, interleaved(calls, repeat))
        result = calibrate_lidars(scenes, "target")
        found = result.transforms().get("source")
        off = "no place" if found is None else _offs([found] * len(truths), truths)
        print(f"  percept: {off}; {result.verdict}")
        for kind in ("plane", "generalised"):
            print(f"  Open3D {kind}: {_offs(open3d_icp(scenes, truths, kind), truths)}; no verdict")


def lidar_pairs(folder: Path) -> list[tuple[str, list[Scene], list[_F64]]]:
    """Return the name, the scenes, and by scene the answer of another tool or of the maker."""
    rig, av2, kitti = (folder / n for n in ("opencalib_rig", "av2_rig_7fab2350", "small_gicp_pair"))
    answers = json.loads((rig / "reference_gicp.json").read_text())
    pairs = []
    for side in ("left", "right"):
        names = sorted(path for path in rig.iterdir() if path.is_dir())
        scenes = [_scene(next(s.glob("top*.pcd")), next(s.glob(f"{side}*.pcd"))) for s in names]
        truths = [_from_degrees(answers[side][name]) for name in sorted(answers[side])]
        pairs.append((f"OpenCalib {side}", scenes, truths[: len(scenes)]))
    factory = np.array(json.loads((av2 / "ground_truth.json").read_text())["T_up_from_down"])
    pairs.append(("AV2", [_scene(av2 / "sweep0/up.pcd", av2 / "sweep0/down.pcd")], [factory]))
    truth = np.loadtxt(kitti / "T_target_source.txt")
    pairs.append(("small_gicp", [_scene(kitti / "target.ply", kitti / "source.ply")], [truth]))
    return pairs


def _scene(target: Path, source: Path) -> Scene:
    paths = {"target": target, "source": source}
    return {name: read_point_cloud(p).points_xyz.astype(np.float64) for name, p in paths.items()}


def _from_degrees(values: Sequence[float]) -> _F64:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", values[:3], degrees=True).as_matrix()
    T[:3, 3] = values[3:]
    return T


def open3d_icp(scenes: Sequence[Scene], starts: Sequence[_F64], kind: str) -> list[_F64]:
    """Register each scene by itself, coarse to fine, as Open3D's documentation shows it."""
    import open3d as o3d

    icp = o3d.pipelines.registration
    found = []
    for scene, start in zip(scenes, starts, strict=True):
        clouds = {
            n: o3d.geometry.PointCloud(o3d.utility.Vector3dVector(p)) for n, p in scene.items()
        }
        T = start
        for voxel_m, gate_m in _VOXELS_AND_GATES_M:
            target, source = (clouds[n].voxel_down_sample(voxel_m) for n in ("target", "source"))
            for cloud in (target, source):
                near = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel_m, max_nn=30)
                cloud.estimate_normals(near)
            if kind == "plane":
                plane = icp.TransformationEstimationPointToPlane()
                done = icp.registration_icp(source, target, gate_m, T, plane)
            else:
                general = icp.TransformationEstimationForGeneralizedICP()
                done = icp.registration_generalized_icp(source, target, gate_m, T, general)
            T = done.transformation
        found.append(np.asarray(T))
    return found


def _offs(found: Sequence[_F64], truths: Sequence[_F64]) -> str:
    """Say how far transforms are from the answers."""
    told = []
    for T, truth in zip(found, truths, strict=True):
        turned = np.degrees(Rotation.from_matrix(T[:3, :3].T @ truth[:3, :3]).magnitude())
        told.append(f"{100 * np.linalg.norm(T[:3, 3] - truth[:3, 3]):.1f} cm {turned:.2f} deg")
    return "off by " + ", ".join(told)


# ---- camera to LiDAR


def print_camera_lidar(folder: Path) -> None:
    print("\n== camera to LiDAR: 30 poses of the ACFR set, from images and raw clouds")
    board, camera = Checkerboard(7, 5, 0.095), read_intrinsics(folder / "camera_info.yaml").camera()
    names = [f"pose{number}" for number in range(1, 31)]
    clouds = [read_point_cloud(folder / "clouds" / f"{n}.pcd").points_xyz for n in names]
    images = [as_grey(cv2.imread(str(folder / "images" / f"{n}.jpg"), 0)) for n in names]
    find_boards(clouds[:2], names[:2], _ACFR_SIZE_M)  # compiles
    times = [time.perf_counter()]
    views = [detect_board(image, board, name=n) for n, image in zip(names, images, strict=True)]
    times.append(time.perf_counter())
    boards = find_boards(clouds, names, _ACFR_SIZE_M)
    times.append(time.perf_counter())
    pairs = [
        BoardPair(name, view, found)
        for name, view, found in zip(names, views, boards, strict=True)
        if isinstance(view, BoardView) and isinstance(found, BoardInCloud)
    ]
    result = calibrate_camera_lidar(pairs, camera, board, _ACFR_SIZE_M)
    times.append(time.perf_counter())
    parts = zip(("images", "clouds", "solving"), np.diff(times), strict=True)
    print(f"  {times[-1] - times[0]:.1f} s: " + ", ".join(f"{n} {s:.1f} s" for n, s in parts))
    if result.T_camera_lidar is None:
        print(f"  no transform: {result.why}")
        return
    offset = 0.0 if result.range_offset_m is None else result.range_offset_m.value
    px, mm = acfr_metric(folder, camera, result.T_camera_lidar, offset)
    print(f"  {len(pairs)} pairs, {result.verdict}: {px:.2f} px, {mm:.2f} mm from the features")
    print("  the authors' own genetic algorithm: 4.83 px, 9.25 mm (90 s, as published)")


def acfr_metric(
    folder: Path, camera: Camera, T_camera_lidar: _F64, offset_m: float
) -> tuple[float, float]:
    """Return the mean distance of board centres that the ACFR tool saw in image and cloud."""
    lines = (folder / "features_poses_1_to_30.csv").read_text().split()
    rows = np.array([[float(v) for v in line.split(",")] for line in lines]).reshape(30, 19, 3)
    in_camera, in_lidar = rows[:, 0] / 1000, rows[:, 6] / 1000
    in_lidar = in_lidar * (1 + offset_m / np.linalg.norm(in_lidar, axis=1, keepdims=True))
    moved = in_lidar @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
    apart_px = camera.project(moved)[0] - camera.project(in_camera)[0]
    apart_m = np.linalg.norm(moved - in_camera, axis=1)
    return float(np.linalg.norm(apart_px, axis=1).mean()), 1000 * float(apart_m.mean())


if __name__ == "__main__":
    main()
