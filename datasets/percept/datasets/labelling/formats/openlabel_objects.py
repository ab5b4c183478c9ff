"""The objects of an OpenLABEL file: which boxes are one object, and what is said of each box."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from percept.datasets.labelling.labelled_set import (
    Drive,
    ImageBoxes,
    Keyframe,
    LabelledFrame,
    SolidBoxes,
)

__all__ = ["SceneObjects"]

_Json = dict[str, Any]
_Key = tuple[str, int]
_CUBOID = "cuboid"
_SPACE = uuid.UUID("6f7b1a3e-52a4-4c39-9d3c-4a1f0d8c2b75")
_TYPES: dict[type, str] = {str: "text", list: "vec"}


@dataclass(slots=True)
class _Pointer:
    kind: str
    frames: list[int] = field(default_factory=list)
    attributes: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class _Object:
    name: str
    label: str
    frames: list[int] = field(default_factory=list)
    data: dict[str, _Pointer] = field(default_factory=dict)

    def point(self, number: int, kind: str, content: _Json) -> None:
        """Note that a frame has this content of the object."""
        pointer = self.data.setdefault(content["name"], _Pointer(kind))
        for frames in (self.frames, pointer.frames):
            if number not in frames[-1:]:
                frames.append(number)
        for type_, attributes in content["attributes"].items():
            pointer.attributes.update({attribute["name"]: type_ for attribute in attributes})


class SceneObjects:
    """Gathers the objects of frames, one after the other.

    Boxes of one track id and class are one object, and so are a 2D box and the 3D box that it
    names. The same object has the same id in all files of a drive.

    Args:
        drive: The drive that the frames are of.
    """

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._objects: dict[str, _Object] = {}

    def add(self, number: int, keyframe: Keyframe) -> _Json:
        """Return the `objects` of a frame.

        Args:
            number: The frame's; larger than those before.
            keyframe: Its boxes.
        """
        objects: _Json = {}
        solids = keyframe.solids
        owners = {int(one): _key(solids, row) for row, one in enumerate(solids.ids)}
        for row, label in enumerate(solids.labels):
            data = _cuboid(solids, row, self._drive.base_frame)
            self._put(objects, number, _key(solids, row), label, ("cuboid", data))
        for frame in keyframe.frames:
            for row, label in enumerate(frame.boxes.labels):
                key = _key(frame.boxes, row)
                if key[0] != "track":
                    key = owners.get(int(frame.boxes.solids[row]), key)
                self._put(objects, number, key, label, ("bbox", _rectangle(frame, row)))
        return objects

    def described(self) -> _Json:
        """Return the `objects` of the file: names, classes, and where their boxes are."""
        return {
            uid: {
                "name": one.name,
                "type": one.label,
                "frame_intervals": _intervals(one.frames),
                "object_data_pointers": {
                    name: {
                        "type": pointer.kind,
                        "frame_intervals": _intervals(pointer.frames),
                        "attribute_pointers": pointer.attributes,
                    }
                    for name, pointer in one.data.items()
                },
            }
            for uid, one in self._objects.items()
        }

    def _put(
        self, objects: _Json, number: int, key: _Key, label: str, data: tuple[str, _Json]
    ) -> None:
        kind, content = data
        uid = str(uuid.uuid5(_SPACE, f"{self._drive.name}/{key[0]}/{key[1]}/{label}"))
        held = objects.setdefault(uid, {"object_data": {}})["object_data"].setdefault(kind, [])
        if any(other["name"] == content["name"] for other in held):
            # Readers find boxes by name; only a broken track has two in one image.
            content["name"] += f"_{len(held)}"
        held.append(content)
        one = self._objects.setdefault(uid, _Object(f"{label} {key[0]} {key[1]}", label))
        one.point(number, kind, content)


def _key(boxes: ImageBoxes | SolidBoxes, row: int) -> _Key:
    """Return what a box's object goes by as long as nothing but the box is known."""
    track = int(boxes.track_ids[row])
    own = "box" if isinstance(boxes, ImageBoxes) else "solid"
    return ("track", track) if track >= 0 else (own, int(boxes.ids[row]))


def _rectangle(frame: LabelledFrame, row: int) -> _Json:
    boxes = frame.boxes
    x1, y1, x2, y2 = boxes.boxes_px[row].tolist()
    own = {
        "box_3d": int(boxes.solids[row]) or None,
        "truncated": _known(boxes.truncated[row]),
        "occluded": _known(boxes.occluded[row]),
    }
    return {
        "name": f"bbox_{frame.camera}",
        "val": [(x1 + x2) / 2, (y1 + y2) / 2, x2 - x1, y2 - y1],
        "coordinate_system": frame.camera,
        "attributes": _attributes(_shared(boxes, row) | own),
    }


def _cuboid(solids: SolidBoxes, row: int, base_frame: str) -> _Json:
    x, y, z, length, width, height, yaw = solids.boxes_m[row].tolist()
    velocity = solids.velocities_mps[row]
    points = int(solids.points[row])
    own = {
        "points": points if points >= 0 else None,
        "velocity_mps": velocity.tolist() if np.isfinite(velocity).all() else None,
    }
    turn = [0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))]
    return {
        "name": _CUBOID,
        "val": [x, y, z, *turn, length, width, height],
        "coordinate_system": base_frame,
        "attributes": _attributes(_shared(solids, row) | own),
    }


def _shared(boxes: ImageBoxes | SolidBoxes, row: int) -> _Json:
    track = int(boxes.track_ids[row])
    return {
        "box": int(boxes.ids[row]),
        "confidence": _known(boxes.confidences[row]),
        "source": boxes.sources[row] or None,
        "track_id": track if track >= 0 else None,
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _attributes(values: Mapping[str, Any]) -> _Json:
    """Return values by their types; None is left out."""
    typed: _Json = {}
    for name, value in values.items():
        if value is not None:
            kind = _TYPES.get(type(value), "num")
            typed.setdefault(kind, []).append({"name": name, "val": value})
    return typed


def _intervals(frames: Iterable[int]) -> list[_Json]:
    """Return rising numbers as closed intervals."""
    intervals: list[_Json] = []
    for number in frames:
        if intervals and intervals[-1]["frame_end"] == number - 1:
            intervals[-1]["frame_end"] = number
        else:
            intervals.append({"frame_start": number, "frame_end": number})
    return intervals
