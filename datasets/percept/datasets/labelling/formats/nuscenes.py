"""nuScenes, as its development kit opens it: 13 tables of JSON, images, scans and a map a drive.

Schema: github.com/nutonomy/nuscenes-devkit, docs/schema_nuscenes.md. All samples are keyframes;
the scan is in the vehicle's frame, so that `LIDAR_TOP` sits in its origin.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.nuscenes_boxes import AnnotationTables
from percept.datasets.labelling.formats.nuscenes_map import DriveMap
from percept.datasets.labelling.formats.nuscenes_tables import (
    LIDAR,
    SensorTables,
    Table,
    TableFiles,
    category_table,
    chain,
    pose_parts,
    token,
    visibility_table,
)
from percept.datasets.labelling.formats.scenes import Scene, scenes_of
from percept.datasets.labelling.formats.solid_needs import check_solid_needs, rectified_file
from percept.datasets.labelling.labelled_set import SPLITS, Keyframe, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["VERSION", "export_nuscenes"]

VERSION = "v1.0-trainval"
"""Folder of the tables, which the development kit asks for."""

_NAME = "nuscenes"
_TABLES = (
    "attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample",
    "sample_annotation", "sample_data", "scene", "sensor", "visibility",
)  # fmt: skip
_OPENING = (
    "nuScenes tables and files, for `nuscenes-devkit` and what builds on it:",
    "",
    "```python",
    f'nusc = NuScenes(version="{VERSION}", dataroot="nuscenes")',
    "```",
    "",
    "- A scene is a stretch of a drive in one split; `splits.json` lists the scenes of each. All",
    "  samples are keyframes, chosen by time, distance and turn: the time between two may differ.",
    "- `LIDAR_TOP` is all LiDARs in one cloud in the vehicle's frame (`ego`), its place is the",
    "  origin; the ring of a point is 0. Images are without distortion.",
    "- Boxes stand where the points of the scan are. `score` and `source` of an annotation are not",
    "  of nuScenes: they say which network it is from; the attribute `prelabel.<source>` does too.",
    "- The `description` of a category is the class name here. nuScenes's own names are used where",
    "  it has one; to draw others, pass `colormap` to `NuScenes`.",
    "- The global frame is the drive's own, moved by `global_offset_m` of `log.json` so that it is",
    "  positive as the map needs it. The map shows where the vehicle was, and nothing else.",
)


def export_nuscenes(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as nuScenes tables.

    Args:
        labelled: The set.
        folder: The folder to fill.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If there is no scan or no pose, or a camera has no lens, place or rectified
            image.
    """
    check_solid_needs(labelled, _NAME, poses=True)
    for name in ("maps", VERSION, f"samples/{LIDAR}"):
        (folder / name).mkdir(parents=True)
    writer = _Writer(labelled, folder)
    scenes = scenes_of(one for one in labelled.keyframes if writer.takes(one))
    if not scenes:
        raise InputError("no keyframe has both a scan and a known place", where=labelled.name)
    for scene in scenes:
        writer.add(scene)
    writer.finish()
    names = {s: [scene.name for scene in scenes if scene.split == s] for s in SPLITS}
    (folder / "splits.json").write_text(json.dumps(names, indent=1) + "\n", encoding="utf-8")
    told = writer.losses()
    write_readme(folder, "nuScenes", _OPENING, told)
    return told


class _Writer:
    """Writes files and tables scene by scene."""

    def __init__(self, labelled: LabelledSet, folder: Path) -> None:
        self._labelled = labelled
        self._folder = folder
        self._counts: Counter[str] = Counter()
        self._maps: dict[str, DriveMap] = {}
        self._tables = TableFiles(folder / VERSION, _TABLES)
        self._sensors = SensorTables()
        self._boxes = AnnotationTables()

    def takes(self, keyframe: Keyframe) -> bool:
        """Return whether a keyframe has all that a sample needs; count it if not."""
        if keyframe.scan is None:
            self._counts["keyframes without a scan are left out"] += 1
        elif keyframe.T_world_base is None:
            self._counts["keyframes whose place is not known are left out"] += 1
        return keyframe.scan is not None and keyframe.T_world_base is not None

    def add(self, scene: Scene) -> None:
        """Add a scene: its samples, files and annotations."""
        samples = [_sample_row(keyframe, scene) for keyframe in scene.keyframes]
        chain(samples)
        channels: dict[str, Table] = {}
        poses: Table = []
        for keyframe in scene.keyframes:
            if keyframe.T_world_base is None:
                continue
            T_global_base = self._map_of(scene.drive).place(keyframe.T_world_base)
            points = self._write_points(keyframe)
            self._boxes.add(keyframe, scene.name, T_global_base, points)
            for channel, row, pose in self._files(keyframe, T_global_base):
                channels.setdefault(channel, []).append(row)
                poses.append(pose)
        for rows in channels.values():
            chain(rows)
            self._tables.add({"sample_data": rows})
        log = self._labelled.drives[scene.drive].log
        self._tables.add(
            {
                "scene": [_scene_row(scene, samples, log)],
                "sample": samples,
                "ego_pose": poses,
                **self._boxes.scene_tables(),
            }
        )

    def finish(self) -> None:
        """Write the tables that all scenes share, and the maps."""
        drives, maps = self._labelled.drives, self._maps
        self._tables.add(
            {
                **self._sensors.tables(),
                "attribute": self._boxes.attribute_table(),
                "category": category_table(self._labelled.categories),
                "visibility": visibility_table(),
                "log": [one.log_record(drives[name]) for name, one in maps.items()],
                "map": [one.map_record() for one in maps.values()],
            }
        )
        self._tables.finish()
        for one in maps.values():
            if not one.draw(self._folder):
                self._counts["maps are too large for a picture: render without underlay_map"] += 1

    def losses(self) -> tuple[str, ...]:
        """Return what the tables cannot hold, as sentences."""
        return (
            "2D boxes and their numbers: nuScenes makes them by projecting 3D boxes.",
            "Velocities: the development kit takes them from the samples before and after.",
            "Which LiDAR measured a point; times below a microsecond.",
            *(f"{count} {what}." for what, count in self._counts.items() if count),
        )

    def _map_of(self, drive: str) -> DriveMap:
        if drive not in self._maps:
            places = [
                one.T_world_base.translation_m[:2]
                for one in self._labelled.keyframes
                if one.drive == drive and one.T_world_base is not None
            ]
            self._maps[drive] = DriveMap.around(drive, np.array(places))
        return self._maps[drive]

    def _write_points(self, keyframe: Keyframe) -> NDArray[np.float32]:
        """Write a scan as nuScenes has it, and return its points."""
        if keyframe.scan is None:
            return np.zeros((0, 5), np.float32)
        points = np.fromfile(self._labelled.folder / keyframe.scan.file, dtype="<f4").reshape(-1, 4)
        rows = np.column_stack([points, np.zeros(len(points), "<f4")])  # the ring is not known
        rows.tofile(self._folder / _scan_file(keyframe))
        return rows

    def _files(
        self, keyframe: Keyframe, T_global_base: Transform
    ) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
        """Place the files of a keyframe; yield channels and rows of `sample_data`, `ego_pose`."""
        if keyframe.scan is not None:
            file = {"filename": _scan_file(keyframe), "fileformat": "pcd", "width": 0, "height": 0}
            placed = self._sensors.lidar(keyframe.drive)
            row = _data_row(keyframe, keyframe.scan.stamp_ns, placed, file)
            yield LIDAR, row, _pose_row(row, T_global_base)
        for view in camera_views(self._labelled, keyframe):
            if not view.moved:
                self._counts["images are placed as if the vehicle stood since the scan"] += 1
            channel, file = self._place_image(view)
            placed = self._sensors.camera(keyframe.drive, view)
            row = _data_row(keyframe, view.frame.stamp_ns, placed, file)
            yield channel, row, _pose_row(row, T_global_base @ view.T_then_base.inverse())

    def _place_image(self, view: CameraView) -> tuple[str, dict[str, Any]]:
        """Return the channel of an image and what `sample_data` says of its file."""
        source = PurePosixPath(rectified_file(view.frame, _NAME))
        channel = self._sensors.channel(view.sensor.name)
        target = f"samples/{channel}/{view.frame.stem}{source.suffix}"
        place_file(self._labelled.folder / source, self._folder / target)
        width, height = view.frame.image_size
        kind = source.suffix[1:]
        return channel, {"filename": target, "fileformat": kind, "width": width, "height": height}


def _data_row(
    keyframe: Keyframe, stamp_ns: int, placed: str, file: dict[str, Any]
) -> dict[str, Any]:
    """Return a row of `sample_data`; its pose has the same token."""
    key = token("sample_data", file["filename"])
    return {
        "token": key,
        "sample_token": _sample_token(keyframe),
        "ego_pose_token": key,
        "calibrated_sensor_token": placed,
        "timestamp": stamp_ns // 1000,
        "is_key_frame": True,
        **file,
    }


def _pose_row(data: dict[str, Any], place: Transform) -> dict[str, Any]:
    return {"token": data["token"], "timestamp": data["timestamp"], **pose_parts(place)}


def _sample_token(keyframe: Keyframe) -> str:
    return token("sample", keyframe.drive, keyframe.stamp_ns)


def _sample_row(keyframe: Keyframe, scene: Scene) -> dict[str, Any]:
    return {
        "token": _sample_token(keyframe),
        "timestamp": keyframe.stamp_ns // 1000,
        "scene_token": token("scene", scene.name),
    }


def _scene_row(scene: Scene, samples: Table, log: str) -> dict[str, Any]:
    return {
        "token": token("scene", scene.name),
        "name": scene.name,
        "description": f"{log}, {scene.split}",
        "log_token": token("log", scene.drive),
        "nbr_samples": len(samples),
        "first_sample_token": samples[0]["token"],
        "last_sample_token": samples[-1]["token"],
    }


def _scan_file(keyframe: Keyframe) -> str:
    return f"samples/{LIDAR}/{keyframe.drive}_{LIDAR}_{keyframe.stamp_ns}.pcd.bin"
