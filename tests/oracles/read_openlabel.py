"""Prints what independent programs read in OpenLABEL files: `read_openlabel.py FILE...`.

Each file must obey the standard's schema and be taken by two libraries; VCD then reads the boxes.
"""

from __future__ import annotations

import json
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
from kognic.openlabel.models import OpenLabelAnnotation
from vcd import core, scl

_SCHEMA = files("kognic.openlabel.schemas").joinpath("openlabel-1-0-0.json")


def _read(path: Path) -> dict[str, Any]:
    text = path.read_text("utf-8")
    jsonschema.validate(json.loads(text), json.loads(_SCHEMA.read_text("utf-8")))
    OpenLabelAnnotation.model_validate_json(text)
    labels = core.OpenLABEL()
    labels.load_from_file(str(path), validation=True)
    scene = scl.Scene(labels)
    numbers = core.FrameIntervals(labels.get_frame_intervals().get_dict()).get_outer()
    first, last = numbers["frame_start"], numbers["frame_end"]
    return {"frames": [_frame(labels, scene, number) for number in range(first, last + 1)]}


def _frame(labels: core.OpenLABEL, scene: scl.Scene, number: int) -> dict[str, Any]:
    properties = labels.get_frame(number)["frame_properties"]
    uids = labels.get_frame(number)["objects"]
    return {
        "keyframe": properties["keyframe"],
        "stamp_ns": properties["timestamp"],
        "streams": {
            name: {"uri": one["uri"], "stamp_ns": one["stream_properties"]["sync"]["timestamp"]}
            for name, one in properties["streams"].items()
        },
        "objects": [_object(labels, scene, uid, number) for uid in uids],
    }


def _object(labels: core.OpenLABEL, scene: scl.Scene, uid: str, number: int) -> dict[str, Any]:
    described = labels.get_object(uid)
    found: dict[str, Any] = {"uid": uid, "label": described["type"], "bbox": [], "cuboid": []}
    for name, pointer in described["object_data_pointers"].items():
        spans = [(one["frame_start"], one["frame_end"]) for one in pointer["frame_intervals"]]
        if not any(start <= number <= end for start, end in spans):
            continue
        data = labels.get_object_data(uid, name, number)
        attributes = {
            one["name"]: one["val"] for kind in data["attributes"].values() for one in kind
        }
        box = {"system": data["coordinate_system"], "val": data["val"], **attributes}
        if pointer["type"] == "cuboid":
            box |= _placed(labels, scene, box, number)
        found[pointer["type"]].append(box)
    return found


def _placed(
    labels: core.OpenLABEL, scene: scl.Scene, cuboid: dict[str, Any], number: int
) -> dict[str, Any]:
    """Return the centre in the frame that does not move, and in the images that see it."""
    centre = np.array([*cuboid["val"][:3], 1.0])[:, None]
    systems = labels.get_root()["coordinate_systems"]
    world = next(name for name, one in systems.items() if one["type"] == "scene_cs")
    placed = scene.transform_points3d_4xN(centre, cuboid["system"], world, number)
    pixels = {}
    for name, one in systems.items():
        if one["type"] == "sensor_cs":
            points, seen = scene.project_points3d_4xN(centre, cuboid["system"], name, number)
            if seen[0]:
                pixels[name] = points[:2, 0].tolist()
    return {"world": placed[:3, 0].tolist(), "pixels": pixels}


if __name__ == "__main__":
    json.dump([_read(Path(name)) for name in sys.argv[1:]], sys.stdout)
