"""Prints what the nuScenes devkit reads: `read_nuscenes.py FOLDER`."""

from __future__ import annotations

import json
import sys
from typing import Any

from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import Box, LidarPointCloud


def _read(folder: str) -> list[dict[str, Any]]:
    tables = NuScenes("v1.0-trainval", folder, verbose=False)
    return [_sample(tables, sample) for sample in tables.sample]


def _sample(tables: NuScenes, sample: dict[str, Any]) -> dict[str, Any]:
    scene = tables.get("scene", sample["scene_token"])
    log = tables.get("log", scene["log_token"])
    return {
        "stamp_us": sample["timestamp"],
        "scene": scene["name"],
        "log": log["logfile"],
        "global_offset_m": log["global_offset_m"],
        "boxes": {token: _box(tables, tables.get_box(token)) for token in sample["anns"]},
        "sensors": {
            channel: _sensor(tables, token, sample["anns"])
            for channel, token in sample["data"].items()
        },
    }


def _box(tables: NuScenes, box: Box) -> dict[str, Any]:
    annotation = tables.get("sample_annotation", box.token)
    instance = tables.get("instance", annotation["instance_token"])
    return {
        "instance": instance["token"],
        "category": box.name,
        "label": tables.get("category", instance["category_token"])["description"],
        "points": annotation["num_lidar_pts"],
        **_place(box),
    }


def _place(box: Box) -> dict[str, Any]:
    return {
        "centre": box.center.tolist(),
        "size_wlh": box.wlh.tolist(),
        "rotation": box.rotation_matrix.tolist(),
    }


def _sensor(tables: NuScenes, token: str, annotations: list[str]) -> dict[str, Any]:
    """Return a sensor's file, and all boxes of the sample in its frame by the devkit's chain."""
    data = tables.get("sample_data", token)
    file, boxes, matrix = tables.get_sample_data(token, selected_anntokens=annotations)
    lidar = data["sensor_modality"] == "lidar"
    points = LidarPointCloud.from_file(file).points if lidar else None
    return {
        "stamp_us": data["timestamp"],
        "file": file,
        "matrix": None if matrix is None else matrix.tolist(),
        "points": None if points is None else points.T[:, :4].tolist(),
        "boxes": {box.token: _place(box) for box in boxes},
    }


if __name__ == "__main__":
    json.dump(_read(sys.argv[1]), sys.stdout)
