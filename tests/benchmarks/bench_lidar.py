"""LiDAR stages against other libraries, and against labels, on the real scans.

    python tests/benchmarks/bench_lidar.py --data ../shared/data

Everything runs in one process on one core, interleaved, so that a busy machine slows all alike;
the ratios are what counts. Scenes are levelled by the estimated mounting, as `percept detect` does.

Each library gets the arrays that its documentation shows, made before the clock starts, and its
clock stops when it has said which points are ground: `linefit` gets x, y, z; Patchwork++ gets
x, y, z and intensity, and a second time without intensity, which spares it one of its steps.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.datasets import read_point_cloud
from percept.evaluation import (
    SegmentationScores,
    ground_scores,
    score_clusters,
)
from percept.lidar import (
    BoxConfig,
    ClusterConfig,
    GroundConfig,
    cluster_points,
    estimate_mounting,
    fit_boxes,
    segment_ground,
)

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_KITTI_CLASSES = ("Pedestrian", "Cyclist", "Car")
_LINEFIT_TOML = Path(__file__).parents[1] / "parity" / "linefit.toml.in"

Cloud = NDArray[np.float32]
# A level scan (N, 4) with intensity in 0..1, which Patchwork++ uses, and the height over ground.
Scans = dict[str, tuple[Cloud, float]]


@dataclass(frozen=True)
class Scene:
    """A scan with truth boxes (K, 7), both level, the sensor `height_m` over the ground."""

    name: str
    points: Cloud
    height_m: float
    boxes_m: NDArray[np.float64]
    labels: list[str]
    ground: NDArray[np.uint8] | None = None


def main() -> None:
    """Run all sections and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--repeat", type=int, default=7)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print_machine()
    scans = read_scans(arguments.data)
    print_ground(scans, arguments.repeat)
    print_clusters(scans, min(arguments.repeat, 3))
    print_whole_path(scans, min(arguments.repeat, 3))
    print_labelled(list(read_scenes(arguments.data)))


def print_machine() -> None:
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    names = ("numpy", "numba", "linefit", "pypatchworkpp", "open3d", "scikit-learn")
    print(f"{cpu}, one core; Python {platform.python_version()}, ", end="")
    print(", ".join(f"{name} {version(name)}" for name in names))


# ---- timing


def interleaved(calls: dict[str, Callable[[], object]], repeat: int) -> dict[str, list[float]]:
    """Return milliseconds of each call, one after the other, `repeat` times, after a warm-up."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for round_number in range(repeat + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if round_number:
                times[name].append((time.perf_counter() - start) * 1e3)
    return times


def print_times(title: str, times: dict[str, list[float]]) -> None:
    ours = times["percept"]
    for name, values in times.items():
        ratio = f"{statistics.median(values) / statistics.median(ours):7.1f}x"
        print(
            f"{title:<24}{name:<17}min {min(values):8.1f} ms  "
            f"median {statistics.median(values):8.1f} ms {ratio}"
        )


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Send what C++ prints to nowhere."""
    kept = os.dup(1)
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def linefit_engine(config: GroundConfig) -> Any:
    import linefit

    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(_LINEFIT_TOML.read_text().format(c=config))
        file.flush()
        return linefit.ground_seg(file.name)


def patchwork_engine(height_m: float) -> Any:
    import pypatchworkpp

    parameters = pypatchworkpp.Parameters()
    parameters.sensor_height = height_m
    parameters.verbose = False
    return pypatchworkpp.patchworkpp(parameters)


def patchwork_ground(engine: Any, points: Cloud) -> Any:
    """Return the indices of the ground points."""
    engine.estimateGround(points)
    return engine.getGroundIndices()


def open3d_cloud(points: NDArray[np.floating]) -> Any:
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))


def print_ground(scans: Scans, repeat: int) -> None:
    print("\nGround, one thread, the same parameters for linefit")
    different = total = 0
    for name, (points, height_m) in scans.items():
        config = GroundConfig(sensor_height_m=height_m)
        xyz = np.ascontiguousarray(points[:, :3])
        with silent():
            linefit = linefit_engine(config)
            times = interleaved(
                {
                    "percept": partial(segment_ground, points, config),
                    "linefit": partial(linefit.run, xyz),
                    "pypatchworkpp": partial(patchwork_ground, patchwork_engine(height_m), points),
                    " .. no intensity": partial(patchwork_ground, patchwork_engine(height_m), xyz),
                },
                repeat,
            )
            expected = linefit.run(xyz).astype(bool)
        different += int((expected != segment_ground(points, config)).sum())
        total += len(points)
        print_times(f"{name} ({len(points)})", times)
    print(f"labels that differ from linefit: {different} of {total}")


def print_clusters(scans: Scans, repeat: int) -> None:
    from sklearn.cluster import DBSCAN
    from sklearn.metrics import adjusted_rand_score

    print("\nClusters of the points off the ground, single linkage at 0.5 m")
    for name, (points, height_m) in scans.items():
        objects = points[~segment_ground(points, GroundConfig(sensor_height_m=height_m)), :3]
        config = ClusterConfig(tolerance_m=0.5)
        dbscan = DBSCAN(eps=0.5, min_samples=1, algorithm="kd_tree")
        times = interleaved(
            {
                "percept": partial(cluster_points, objects, config),
                "open3d": partial(open3d_cloud(objects).cluster_dbscan, 0.5, 1),
                "scikit-learn": partial(dbscan.fit, objects.astype(np.float64)),
            },
            repeat,
        )
        rand = adjusted_rand_score(dbscan.labels_, cluster_points(objects, config))
        print_times(f"{name} ({len(objects)})", times)
        print(f"{'':<24}adjusted Rand index against scikit-learn {rand:.6f}")


def print_whole_path(scans: Scans, repeat: int) -> None:
    print("\nGround, clusters and boxes; the others: pypatchworkpp and Open3D DBSCAN, no boxes")
    for name, (points, height_m) in scans.items():
        with silent():
            times = interleaved(
                {
                    "percept": partial(ours, points, height_m),
                    "others": partial(theirs, points, patchwork_engine(height_m)),
                },
                repeat,
            )
        print_times(f"{name} ({len(points)})", times)


def ours(points: Cloud, height_m: float) -> None:
    objects = points[~segment_ground(points, GroundConfig(sensor_height_m=height_m)), :3]
    fit_boxes(objects, cluster_points(objects, ClusterConfig()), BoxConfig())


def theirs(points: Cloud, patchwork: Any) -> None:
    patchwork.estimateGround(points)
    open3d_cloud(points[patchwork.getNongroundIndices(), :3]).cluster_dbscan(0.5, 1)


def print_labelled(scenes: list[Scene]) -> None:
    print("\nLabelled scenes, default settings: boxes with 20 points or more off the ground")
    scores = SegmentationScores()
    for scene in scenes:
        ground = segment_ground(scene.points, GroundConfig(sensor_height_m=scene.height_m))
        ids = np.full(len(scene.points), -1, np.int32)
        ids[~ground] = cluster_points(scene.points[~ground], ClusterConfig())
        part = score_clusters(scene.points, ids, scene.boxes_m, scene.labels)
        scores += part
        line = f"{scene.name:<28}height {scene.height_m:.2f} m, {len(part.objects):3d} boxes, "
        print(f"{line}found {part.recall():.2f}, ground {ground.mean():.2f}")
        if scene.ground is not None:
            far = np.hypot(scene.points[:, 0], scene.points[:, 1]) > 2.7
            print(f"{'':<28}{ground_scores(ground, scene.ground == 1, far & (scene.ground < 2))}")
    print(scores)


# ---- data


def read_scans(data: Path) -> Scans:
    """Return one scan of each kind; the last two are small, where fixed costs tell."""
    paths = {
        "KITTI 00": data / "odometry/kitti00_velodyne/000000.bin",
        "KITTI object": data / "scenes/kitti_object/training/velodyne/000001.bin",
        "AV2": next(iter(sorted((data / "scenes/av2/7fab2350/converted").glob("*.bin")))),
        "OpenCalib top": data / "lidar2lidar/opencalib_rig/0001/top.pcd",
        "Multi-LiCa": data / "lidar2lidar/multi_lica/points_horizontal.pcd",
        "KITTI 07": data / "odometry/kitti07_dump/000001/points.bin",
    }
    scans = {}
    for name, path in paths.items():
        cloud = read_point_cloud(path)
        points, height_m, _ = levelled(cloud.points_xyz)
        intensity = np.zeros(len(cloud)) if cloud.intensity is None else cloud.intensity
        intensity = intensity / (255.0 if intensity.max() > 1.0 else 1.0)
        scans[name] = (np.column_stack([points, intensity]).astype(np.float32), height_m)
    return scans


def read_cloud(path: Path) -> Cloud:
    return read_point_cloud(path).points_xyz


def levelled(points: Cloud) -> tuple[Cloud, float, NDArray[np.float64]]:
    """Return the points in the level frame, the height over the ground, and the rotation."""
    mounting = estimate_mounting([points])
    level = mounting.T_level_sensor
    return level.apply(points).astype(np.float32), mounting.height_m, level.rotation


def scene_of(
    name: str,
    points: Cloud,
    boxes_m: NDArray[np.float64],
    labels: list[str],
    ground: NDArray[np.uint8] | None = None,
) -> Scene:
    level_points, height_m, rotation = levelled(points)
    forward = np.stack(
        [np.cos(boxes_m[:, 6]), np.sin(boxes_m[:, 6]), np.zeros(len(boxes_m))], axis=1
    )
    forward = forward @ rotation.T
    level_boxes = boxes_m.copy()
    level_boxes[:, :3] = boxes_m[:, :3] @ rotation.T
    level_boxes[:, 6] = np.arctan2(forward[:, 1], forward[:, 0])
    return Scene(name, level_points, height_m, level_boxes, labels, ground)


def read_scenes(data: Path) -> Iterator[Scene]:
    """Yield the labelled scenes, levelled."""
    root = data / "scenes/kitti_object/training"
    for number in ("000000", "000001"):
        points = read_cloud(root / f"velodyne/{number}.bin")
        rows = [line.split() for line in (root / f"label_2/{number}.txt").read_text().splitlines()]
        rows = [row for row in rows if row[0] != "DontCare"]
        values = np.array([row[8:15] for row in rows], dtype=np.float64)
        camera = values[:, [3, 4, 5, 2, 0, 1, 6]]  # h w l x y z ry to x y z l h w ry
        T_camera_lidar = kitti_calibration(root / f"calib/{number}.txt")
        boxes = boxes_from_camera(camera, T_camera_lidar)
        yield scene_of(f"KITTI {number}", points, boxes, [row[0] for row in rows])
    entry = json.loads((data / "scenes/kitti_000008/000008.json").read_text())["data_list"][0]
    instances = [e for e in entry["instances"] if e["bbox_label_3d"] >= 0]
    camera = np.array([e["bbox_3d"] for e in instances])
    boxes = boxes_from_camera(camera, np.array(entry["images"]["CAM2"]["lidar2cam"]))
    labels = [_KITTI_CLASSES[e["bbox_label_3d"]] for e in instances]
    yield scene_of(
        "KITTI 000008", read_cloud(data / "scenes/kitti_000008/000008.bin"), boxes, labels
    )
    for path in sorted((data / "scenes/av2/7fab2350/converted").glob("*.bin")):
        marks = json.loads(path.with_suffix(".boxes.json").read_text())
        boxes = np.array([[*e["center"], *e["lwh"], e["yaw"]] for e in marks])
        ground = np.fromfile(path.with_suffix(".ground.u8"), np.uint8)
        labels = [e["category"] for e in marks]
        yield scene_of(f"AV2 {path.stem[-9:]}", read_cloud(path), boxes, labels, ground)
    marks = json.loads((data / "scenes/sustechpoints/label/000965.json").read_text())
    boxes = np.array(
        [
            [
                *(e["psr"][k][a] for k in ("position", "scale") for a in "xyz"),
                e["psr"]["rotation"]["z"],
            ]
            for e in marks
        ]
    )
    points = read_cloud(data / "scenes/sustechpoints/lidar/000965.pcd")
    yield scene_of("SUSTechPOINTS 000965", points, boxes, [e["obj_type"] for e in marks])


def kitti_calibration(path: Path) -> NDArray[np.float64]:
    """Return T_rectified-camera_lidar (4, 4) of a KITTI object calibration."""
    lines = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    rectify, T_camera_lidar = np.eye(4), np.eye(4)
    rectify[:3, :3] = np.array(lines["R0_rect"].split(), dtype=np.float64).reshape(3, 3)
    T_camera_lidar[:3] = np.array(lines["Tr_velo_to_cam"].split(), dtype=np.float64).reshape(3, 4)
    return rectify @ T_camera_lidar


def boxes_from_camera(
    camera: NDArray[np.float64], T_camera_lidar: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn (K, 7) x, y, z of the bottom, l, h, w, ry in the camera frame into LiDAR boxes."""
    T_lidar_camera = np.linalg.inv(T_camera_lidar)
    x, bottom, z, length, height, width, yaw = camera.T
    centres = np.stack([x, bottom - height / 2.0, z, np.ones_like(x)], axis=1) @ T_lidar_camera.T
    forward = np.stack([np.cos(yaw), np.zeros_like(yaw), -np.sin(yaw)], axis=1)
    forward = forward @ T_lidar_camera[:3, :3].T
    yaw_lidar = np.arctan2(forward[:, 1], forward[:, 0])
    return np.column_stack([centres[:, :3], length, width, height, yaw_lidar])


if __name__ == "__main__":
    main()
