"""Lanes in files: what `percept lanes` says, and labels in the ways of the TuSimple benchmark."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.evaluation.lane_pixels import ImageLanes, lanes_of_mask, sample_line
from percept.evaluation.lanes import SeenFrame, SeenLine

__all__ = [
    "is_tusimple",
    "lanes_of_documents",
    "masks_in",
    "named_alike",
    "read_documents",
    "read_mask_lanes",
    "seen_frames",
    "tusimple_lanes",
]

_F64 = NDArray[np.float64]
_LISTS = ("frames", "images")
_ROWS_PX = 10.0


def read_documents(path: Path) -> list[dict[str, Any]]:
    """Return the objects of a JSON file, one for each image.

    The file is one object with `lines`, an object with a list of them under `frames` or `images`,
    a list of them, or a line of JSON for each.

    Raises:
        InputError: If it cannot be read as such.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no text"
        raise InputError(f"cannot be read ({reason})", where=path) from error
    try:
        content = json.loads(text)
    except ValueError:
        content = _json_lines(text, path)
    if isinstance(content, dict):
        content = next((content[name] for name in _LISTS if name in content), [content])
    if not isinstance(content, list) or not all(isinstance(one, dict) for one in content):
        raise InputError("is no list of objects, one for each image", where=path)
    if not content:
        raise InputError("holds no image", where=path)
    return content


def _json_lines(text: str, path: Path) -> list[Any]:
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            found.append(json.loads(line))
        except ValueError as error:
            raise InputError(f"line {number} is no JSON ({error})", where=path) from error
    return found


def is_tusimple(documents: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether objects have `lanes` and `h_samples`."""
    return bool(documents) and all({"lanes", "h_samples"} <= one.keys() for one in documents)


def tusimple_lanes(documents: Sequence[Mapping[str, Any]], where: Path) -> list[ImageLanes]:
    """Return the lanes of TuSimple's label lines: `lanes`, `h_samples`, `raw_file`.

    Raises:
        InputError: If a line does not fit.
    """
    found = []
    for number, one in enumerate(documents):
        try:
            rows = np.array(one["h_samples"], dtype=np.float64)
            lanes = np.array(one["lanes"], dtype=np.float64).reshape(-1, len(rows))
            found.append(ImageLanes(image=str(one["raw_file"]), rows_px=rows, lanes_px=lanes))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"entry {number} has no lanes at its h_samples ({error})", where=where
            ) from error
    return found


def lanes_of_documents(documents: Sequence[Mapping[str, Any]], where: Path) -> list[ImageLanes]:
    """Return the lines of `percept lanes` in pixels, at every tenth row.

    Raises:
        InputError: If an object does not fit.
    """
    found = []
    for number, one in enumerate(documents):
        lines = [_points(line, "points_px", number, where) for line in _lines(one, number, where)]
        lowest = max((float(points[:, 1].max()) for points in lines if len(points)), default=0.0)
        rows = np.arange(0.0, lowest + _ROWS_PX, _ROWS_PX)
        lanes = [sample_line(points, rows) for points in lines]
        found.append(
            ImageLanes(
                image=_image_name(one),
                rows_px=rows,
                lanes_px=np.array(lanes).reshape(-1, len(rows)),
            )
        )
    return found


def seen_frames(documents: Sequence[Mapping[str, Any]], where: Path) -> list[SeenFrame]:
    """Return what `percept lanes` saw in metres, image by image.

    Raises:
        InputError: If an object does not fit, has no `stamp_ns`, or no line is in metres.
    """
    frames = [_frame(one, number, where) for number, one in enumerate(documents)]
    lines = [line for frame in frames for line in frame.lines]
    if lines and not any(len(line.points_m) for line in lines):
        raise InputError(
            "its lines are in pixels only", where=where, remedy="Run 'percept lanes' with --rig"
        )
    return frames


def _frame(one: Mapping[str, Any], number: int, where: Path) -> SeenFrame:
    stamp_ns = one.get("stamp_ns")
    if not isinstance(stamp_ns, int):
        raise InputError(
            f"entry {number} has no stamp_ns, so that no pose is known",
            where=where,
            remedy="Run 'percept lanes' on the log",
        )
    lines = tuple(
        SeenLine(
            side=str(line.get("side", "other")),
            points_m=_points(line, "points_m", number, where),
            type=str(line.get("type", "unknown")),
            colour=str(line.get("colour", "unknown")),
        )
        for line in _lines(one, number, where)
    )
    stops = one.get("stop_lines", [])
    distances = [stop.get("distance_m") for stop in stops if isinstance(stop, dict)]
    return SeenFrame(
        stamp_ns=stamp_ns,
        lines=lines,
        stop_lines_m=tuple(float(d) for d in distances if isinstance(d, int | float)),
    )


def _lines(one: Mapping[str, Any], number: int, where: Path) -> list[Mapping[str, Any]]:
    lines = one.get("lines")
    if not isinstance(lines, list) or not all(isinstance(line, dict) for line in lines):
        raise InputError(f"entry {number} has no lines", where=where)
    return lines


def _points(line: Mapping[str, Any], name: str, number: int, where: Path) -> _F64:
    try:
        points = np.array(line.get(name) or [], dtype=np.float64).reshape(-1, 2)
    except (TypeError, ValueError) as error:
        raise InputError(f"entry {number}: {name} are no points", where=where) from error
    if not np.isfinite(points).all():
        raise InputError(f"entry {number}: {name} are not finite", where=where)
    return points


def _image_name(one: Mapping[str, Any]) -> str:
    return str(one.get("image", one.get("raw_file", "")))


def named_alike(results: Sequence[ImageLanes], labels: Sequence[ImageLanes]) -> list[ImageLanes]:
    """Return results with the names that the labels have for the same images.

    Names that no label has are held against the labels' by what is left without folders and
    endings, where that is one of a kind; a single result belongs to a single label in any case.
    """
    if len(results) == len(labels) == 1:
        return [replace(results[0], image=labels[0].image)]
    exact = {one.image for one in labels}
    stems = Counter(Path(one.image).stem for one in labels)
    by_stem = {Path(one.image).stem: one.image for one in labels}
    return [
        one
        if one.image in exact or stems[Path(one.image).stem] != 1
        else replace(one, image=by_stem[Path(one.image).stem])
        for one in results
    ]


def masks_in(path: Path) -> list[Path]:
    """Return the PNG files of a folder, or the one that a path is."""
    return sorted(path.glob("*.png")) if path.is_dir() else [path]


def read_mask_lanes(paths: Sequence[Path]) -> tuple[list[ImageLanes], dict[str, int]]:
    """Read instance masks: one value for each lane, 0 for the ground.

    Returns:
        The lanes, and the widths of the masks by name.

    Raises:
        InputError: If a file is no image.
    """
    import cv2

    lanes, widths = [], {}
    for path in paths:
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            raise InputError("cannot be read as an image", where=path)
        lanes.append(lanes_of_mask(np.asarray(mask, dtype=np.uint8), path.name))
        widths[path.name] = int(mask.shape[1])
    return lanes, widths
