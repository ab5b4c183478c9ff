"""Rows of nuScenes tables that many others refer to."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from percept.core.class_words import common_word
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.datasets.labelling.formats.camera_views import CameraView
from percept.datasets.labelling.names import safe_name

__all__ = [
    "LIDAR",
    "SensorTables",
    "Table",
    "TableFiles",
    "category_table",
    "chain",
    "pose_parts",
    "token",
    "visibility_table",
    "visibility_token",
]

Table = list[dict[str, Any]]
"""Rows of a table."""

LIDAR = "LIDAR_TOP"
"""Channel of the scans; the development kit draws this one."""

_CATEGORIES = {
    "animal": "animal",
    "barrier": "movable_object.barrier",
    "bicycle": "vehicle.bicycle",
    "bus": "vehicle.bus.rigid",
    "car": "vehicle.car",
    "cone": "movable_object.trafficcone",
    "construction_vehicle": "vehicle.construction",
    "motorcycle": "vehicle.motorcycle",
    "pedestrian": "human.pedestrian.adult",
    "trailer": "vehicle.trailer",
    "truck": "vehicle.truck",
}
_VISIBLE_FROM = (0.4, 0.6, 0.8)
_VISIBILITIES = ("v0-40", "v40-60", "v60-80", "v80-100")


def token(*key: object) -> str:
    """Return the token of what a key names: 32 hexadecimal digits, the same in every run."""
    text = "\0".join(str(part) for part in key)
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()


def chain(rows: Table) -> None:
    """Link rows to the ones before and after them, by `prev` and `next`; the ends have ``""``."""
    tokens = ["", *(row["token"] for row in rows), ""]
    for row, before, after in zip(rows, tokens, tokens[2:], strict=False):
        row["prev"], row["next"] = before, after


def category_table(categories: Sequence[str]) -> Table:
    """Return the table of classes: nuScenes's name where it has one, and ours beside it.

    Of two classes for which it has one name, the first gets it.
    """
    rows: Table = []
    for index, label in enumerate(categories):
        name = _CATEGORIES.get(common_word(label), label)
        if any(row["name"] == name for row in rows):
            name = label
        rows.append(
            {
                "token": token("category", label),
                "name": name,
                "description": label,
                "index": index,
            }
        )
    return rows


def visibility_table() -> Table:
    """Return the table of how much of an object is visible, with nuScenes's tokens 1 to 4."""
    return [
        {
            "token": str(number),
            "level": level,
            "description": f"visibility of the whole object is {level[1:]} %",
        }
        for number, level in enumerate(_VISIBILITIES, 1)
    ]


def visibility_token(visible: float) -> str:
    """Return the token of a visible share 0..1; empty where it is NaN."""
    return "" if np.isnan(visible) else str(1 + int(np.digitize(visible, _VISIBLE_FROM)))


def pose_parts(place: Transform) -> dict[str, list[float]]:
    """Return `translation` in metres and `rotation` w, x, y, z."""
    x, y, z, w = quat_xyzw_from_matrix(place.rotation).tolist()
    return {"translation": place.translation_m.tolist(), "rotation": [w, x, y, z]}


class TableFiles:
    """Writes tables as JSON piece by piece, so that no table has to fit into memory.

    Args:
        folder: Where the files go, one a table.
        names: All tables; one without rows is empty.
    """

    def __init__(self, folder: Path, names: Iterable[str]) -> None:
        self._files = {name: folder / f"{name}.json" for name in names}
        self._begun: set[str] = set()

    def add(self, tables: Mapping[str, Table]) -> None:
        """Append rows to tables."""
        for name, rows in tables.items():
            with self._files[name].open("a", encoding="utf-8") as file:
                for row in rows:
                    file.write(",\n" if name in self._begun else "[\n")
                    file.write(json.dumps(row, ensure_ascii=False, allow_nan=False))
                    self._begun.add(name)

    def finish(self) -> None:
        """Write the ends of all files."""
        for name, path in self._files.items():
            with path.open("a", encoding="utf-8") as file:
                file.write("\n]\n" if name in self._begun else "[]\n")


class SensorTables:
    """The tables of sensors and of where they sit in each drive's vehicle."""

    def __init__(self) -> None:
        self._sensors: dict[str, dict[str, Any]] = {}
        self._places: dict[str, dict[str, Any]] = {}
        self._channels: dict[str, str] = {}

    def channel(self, camera: str) -> str:
        """Return the channel of a camera: `CAM_FRONT` of `front`, which no other camera has."""
        if camera not in self._channels:
            name = re.sub(r"[^A-Z0-9]+", "_", safe_name(camera).upper()).strip("_")
            name = name if name.startswith("CAM_") else f"CAM_{name}"
            while name in self._channels.values():
                name += "_"
            self._channels[camera] = name
        return self._channels[camera]

    def lidar(self, drive: str) -> str:
        """Return the token of the scans' place, which is the vehicle's own."""
        return self._add(drive, LIDAR, "lidar", Transform.identity("ego", LIDAR), [])

    def camera(self, drive: str, view: CameraView) -> str:
        """Return the token of the place of the camera of an image."""
        K = view.sensor.camera().K.tolist()
        return self._add(drive, self.channel(view.sensor.name), "camera", view.T_base_camera, K)

    def tables(self) -> dict[str, Table]:
        """Return `sensor` and `calibrated_sensor`."""
        return {
            "sensor": list(self._sensors.values()),
            "calibrated_sensor": list(self._places.values()),
        }

    def _add(
        self, drive: str, channel: str, modality: str, place: Transform, K: list[list[float]]
    ) -> str:
        sensor = token("sensor", channel)
        self._sensors[sensor] = {"token": sensor, "channel": channel, "modality": modality}
        placed = token("calibrated_sensor", drive, channel)
        if placed not in self._places:
            self._places[placed] = {
                "token": placed,
                "sensor_token": sensor,
                **pose_parts(place),
                "camera_intrinsic": K,
            }
        return placed
