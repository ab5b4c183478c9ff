"""Label Studio's JSON: tasks with the annotations of people."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from percept.core.errors import InputError
from percept.core.labels import LabelSet
from percept.datasets.labels.boxes import BoxRows, as_box_id, as_number, as_track_id

__all__ = ["is_label_studio", "label_studio_file", "read_label_studio"]

_FILE = "tasks.json"
_LARGEST_FILE_BYTES = 1 << 30
_LOOKED_AT_BYTES = 1 << 14
_LARGEST_SIDE = 100_000
_REMEDY = "Export the project as JSON, which has tasks with annotations"
_UPLOADED = re.compile(r"/data/upload/\d+/[0-9a-f]{8}-(?P<name>[^/]+)")
_BOX_ID = re.compile(r"(?:box)?[-_ ]?(\d{1,16})")
_Size = tuple[int, int]


def is_label_studio(path: Path) -> bool:
    """Return whether a JSON file begins like a list of tasks; COCO's results have other keys."""
    try:
        with path.open("rb") as file:
            begin = file.read(_LOOKED_AT_BYTES).removeprefix(b"\xef\xbb\xbf").lstrip()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    keys = (b'"annotations"', b'"predictions"', b'"data"')
    return begin.startswith(b"[") and b'"image_id"' not in begin and any(k in begin for k in keys)


def label_studio_file(path: Path) -> Path:
    """Return the file of tasks at a path, which may be the folder of an export."""
    return path / _FILE if path.is_dir() else path


def read_label_studio(path: Path) -> LabelSet:
    """Read what people drew: of each task the newest annotation that was not skipped.

    A task without an annotation has not been looked at: it is left out and counted, and its
    predictions are not read. The number of a box is its region's id, where that is a number as
    the export of a data set has it; `meta` of the region may have a `track_id`.

    Images are named by the address in the task's data, without what Label Studio puts before
    files that were uploaded.

    Raises:
        InputError: If the file is no list of tasks, or two tasks have one image.
    """
    file = label_studio_file(path)
    dropped: Counter[str] = Counter()
    rows: dict[str, BoxRows] = {}
    sizes: dict[str, _Size | None] = {}
    for task in _tasks(file):
        annotation = _newest(task, dropped)
        if annotation is None:
            continue
        name = _image_name(task, file)
        if name in rows:
            raise InputError(f"two tasks have the image '{name[:80]}'", where=file)
        rows[name] = BoxRows(file, dropped)
        sizes[name] = None
        for region in _regions(annotation):
            sizes[name] = _add(rows[name], region, dropped) or sizes[name]
    return LabelSet(
        images=tuple(boxes.image(name, sizes[name]) for name, boxes in rows.items()),
        dropped=dict(dropped),
        files=(file,),
    )


def _tasks(file: Path) -> list[dict[str, Any]]:
    try:
        if file.stat().st_size > _LARGEST_FILE_BYTES:
            raise InputError("is larger than 1 GiB", where=file, remedy="Split it")
        with file.open("rb") as stream:
            tasks = json.load(stream)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=file) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON ({error})", where=file) from error
    if not isinstance(tasks, list) or not all(isinstance(task, dict) for task in tasks):
        raise InputError("holds no list of tasks", where=file, remedy=_REMEDY)
    if tasks and not any({"data", "annotations"} & set(task) for task in tasks):
        raise InputError("holds no tasks with data and annotations", where=file, remedy=_REMEDY)
    return tasks


def _newest(task: Mapping[str, Any], dropped: Counter[str]) -> Mapping[str, Any] | None:
    annotations = task.get("annotations")
    entries = annotations if isinstance(annotations, list) else []
    done = [e for e in entries if isinstance(e, dict) and not e.get("was_cancelled")]
    if not done:
        dropped["tasks that nobody has annotated"] += 1
        return None
    if len(done) > 1:
        dropped["older annotations of a task"] += len(done) - 1
    # Times of one server, all in UTC and in one form, are in the order of their letters.
    newest: dict[str, Any] = max(
        done, key=lambda e: (_text(e, "updated_at"), as_number(e["id"]) if "id" in e else -1.0)
    )
    return newest


def _text(entry: Mapping[str, Any], key: str) -> str:
    value = entry.get(key)
    return value if isinstance(value, str) else ""


def _image_name(task: Mapping[str, Any], file: Path) -> str:
    data = task.get("data")
    texts = {k: v for k, v in data.items() if isinstance(v, str)} if isinstance(data, dict) else {}
    address = texts.get("image") or (next(iter(texts.values())) if len(texts) == 1 else "")
    if not address:
        raise InputError(
            f"task {str(task.get('id', '?'))[:20]} names no image in data.image",
            where=file,
            remedy=_REMEDY,
        )
    return _name_of(address)


def _name_of(address: str) -> str:
    """Return the file's name from an address such as `/data/local-files/?d=images/a.jpg`."""
    try:
        parts = urlsplit(address)
    except ValueError:
        return address
    uploaded = _UPLOADED.search(parts.path)
    if uploaded is not None:
        return unquote(uploaded["name"])
    local = parse_qs(parts.query).get("d")
    return local[0] if local else unquote(parts.path).lstrip("/")


def _regions(annotation: Mapping[str, Any]) -> list[dict[str, Any]]:
    result = annotation.get("result")
    return [r for r in result if isinstance(r, dict)] if isinstance(result, list) else []


def _add(rows: BoxRows, region: Mapping[str, Any], dropped: Counter[str]) -> _Size | None:
    """Add a region to its image, or count why not; return the size of the image if it says it."""
    value, size = region.get("value"), _size(region)
    if region.get("type") != "rectanglelabels" or not isinstance(value, dict):
        dropped["regions that are no boxes with a label"] += 1
        return size
    labels = value.get("rectanglelabels")
    if not isinstance(labels, list) or len(labels) != 1 or not isinstance(labels[0], str):
        dropped["regions without one label"] += 1
    elif size is None:
        dropped["regions without the size of the image"] += 1
    elif as_number(value.get("rotation", 0)) != 0 or region.get("image_rotation", 0) != 0:
        dropped["turned boxes"] += 1
    else:
        rows.add(
            labels[0],
            _corners(value, size),
            box_id=_box_id(region.get("id")),
            track_id=_track_id(region),
        )
    return size


def _corners(value: Mapping[str, Any], size: _Size) -> tuple[float, float, float, float]:
    """Return the corners in pixels: Label Studio gives x, y, width and height in percent."""
    x, y, w, h = (as_number(value.get(key)) / 100 for key in ("x", "y", "width", "height"))
    width, height = size
    return x * width, y * height, (x + w) * width, (y + h) * height


def _size(region: Mapping[str, Any]) -> _Size | None:
    sides = [as_number(region.get(f"original_{side}")) for side in ("width", "height")]
    if not all(math.isfinite(s) and 0 < s <= _LARGEST_SIDE and s.is_integer() for s in sides):
        return None
    return int(sides[0]), int(sides[1])


def _box_id(value: object) -> int:
    found = _BOX_ID.fullmatch(value) if isinstance(value, str) else None
    return as_box_id(found[1] if found else value)


def _track_id(region: Mapping[str, Any]) -> int:
    meta = region.get("meta")
    return as_track_id(meta.get("track_id")) if isinstance(meta, dict) else -1
