"""ASAM OpenLABEL 1.0.0: a JSON file for each stretch of a drive, with 2D and 3D boxes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.openlabel_objects import SceneObjects
from percept.datasets.labelling.formats.openlabel_sensors import SceneSensors
from percept.datasets.labelling.formats.scenes import Scene, scenes_of
from percept.datasets.labelling.labelled_set import Drive, Keyframe, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["export_openlabel"]

_Json = dict[str, Any]
_OPENING = (
    "OpenLABEL 1.0.0: `<split>/<drive>-<number>.json` holds a stretch of a drive that is in one",
    "split. Open a file with whatever reads OpenLABEL, such as VCD:",
    "",
    "```python",
    "from vcd import core",
    "",
    "labels = core.OpenLABEL()",
    'labels.load_from_file("train/<drive>-0.json", validation=True)',
    "```",
    "",
    "- `uri` of a stream of a frame is its image or scan, relative to the JSON file. A scan is",
    "  rows of float32 x, y, z, intensity in the vehicle's base frame.",
    "- Times are nanoseconds, as text, which numbers of JSON cannot hold. `keyframe` of a frame is",
    "  its row of `../keyframes.parquet`.",
    "- A `bbox` is in the recorded image, with its distortion, and counts pixels from the outer",
    "  edge of the first; camera matrices count from its centre, as in OpenCV.",
    "- A `cuboid` is in the base frame at the frame's time: centre x, y, z, quaternion x, y, z, w,",
    "  then length, width, height.",
    "- Transforms of a frame lead from the base frame into each camera at the time of its image,",
    "  and into the frame that does not move.",
    "- An object is what has one track id and one class in a drive. Attributes of boxes: `box`,",
    "  `confidence`, `source` (none: a person drew it), `track_id`, `truncated`, `occluded`,",
    "  `box_3d` (the `box` of its cuboid), `points`, `velocity_mps`.",
)
_LOSSES = (
    "The order of classes: OpenLABEL knows classes by name only.",
    "Why a keyframe was chosen, its score, and positions on the earth.",
)


def export_openlabel(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as OpenLABEL: `<split>/<scene>.json`, `images`, `scans`.

    Args:
        labelled: The set.
        folder: The folder to fill.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If a camera has the name of another coordinate system.
    """
    for scene in scenes_of(labelled.keyframes):
        file = folder / scene.split / f"{scene.name}.json"
        file.parent.mkdir(exist_ok=True)
        text = json.dumps(_document(labelled, scene), ensure_ascii=False, allow_nan=False)
        file.write_text(text + "\n", encoding="utf-8")
    for keyframe in labelled.keyframes:
        for source in _files(keyframe):
            place_file(labelled.folder / source, folder / source)
    write_readme(folder, "OpenLABEL 1.0.0", _OPENING, _LOSSES)
    return _LOSSES


def _files(keyframe: Keyframe) -> list[str]:
    scan = [] if keyframe.scan is None else [keyframe.scan.file]
    return [*(frame.file for frame in keyframe.frames), *scan]


def _document(labelled: LabelledSet, scene: Scene) -> _Json:
    drive = labelled.drives[scene.drive]
    sensors, objects = SceneSensors(drive, scene.keyframes), SceneObjects(drive)
    frames = {
        str(number): {
            "frame_properties": sensors.of_frame(keyframe),
            "objects": objects.add(number, keyframe),
        }
        for number, keyframe in enumerate(scene.keyframes)
    }
    content: _Json = {
        "metadata": _metadata(labelled, scene, drive),
        "coordinate_systems": sensors.coordinate_systems(),
        "streams": sensors.streams(),
        "objects": objects.described(),
        "frame_intervals": [{"frame_start": 0, "frame_end": len(frames) - 1}],
        "frames": frames,
    }
    return {"openlabel": content}


def _metadata(labelled: LabelledSet, scene: Scene, drive: Drive) -> _Json:
    return {
        "schema_version": "1.0.0",
        "name": f"{labelled.name} {scene.name}",
        "tagged_file": drive.log,
        "split": scene.split,
        "licence": labelled.licence,
        "anonymised": list(labelled.anonymised),
        "created": labelled.created,
        "models": dict(drive.models),
    }
