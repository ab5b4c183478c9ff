"""KITTI's tracking text: labels, a detector's boxes, and tracks written for others to score.

KITTI's camera frame has x to the right, y down and z forward, and gives a box by the centre of
its bottom. Here boxes have x forward, y to the left and z up, from the same origin, and are given
by their centre.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.tracked_boxes import TrackedBoxes
from percept.datasets.labels.number_rows import as_numbers, as_whole, frame_order, text_rows

__all__ = [
    "DONT_CARE",
    "from_kitti_boxes",
    "read_kitti_detections",
    "read_kitti_tracks",
    "to_kitti_boxes",
    "write_kitti_tracks",
]

DONT_CARE = "DontCare"
"""The class of regions in which nobody labelled."""

_COLUMNS = 17
_DETECTION_COLUMNS = 15
_TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
_DIGITS = 6
_UNKNOWN_PLACE = [-1000.0] * 3

_F64 = NDArray[np.float64]
_Row = tuple[int, int, int, str, list[float]]  # line, frame, id, class, numbers


def read_kitti_tracks(path: Path) -> TrackedBoxes:
    """Read labels (`label_02/NNNN.txt`) or tracks, which have a score as an 18th column.

    Regions of `DontCare` have the id -1 and no box in space; where KITTI's numbers for an unknown
    box stand (size -1, place -1000) there is none either.

    Raises:
        InputError: If a line is none of the format; it names the file and the line.
    """
    return _table(_track_rows(path), path)


def read_kitti_detections(paths: Iterable[Path]) -> TrackedBoxes:
    """Read a detector's boxes of one sequence; every id is -1.

    A line is `frame,type,x1,y1,x2,y2,score,h,w,l,x,y,z,rot_y,alpha`; type 1 is a pedestrian, 2 a
    car and 3 a cyclist.

    Args:
        paths: The files of the sequence, such as one for each class.

    Raises:
        InputError: If a line is none of the format; it names the file and the line.
    """
    tables = [_table(_detection_rows(path), path) for path in paths]
    frames = np.concatenate([table.frames for table in tables])
    labels = [label for table in tables for label in table.labels]
    order = np.argsort(frames, kind="stable")
    return TrackedBoxes(
        frames=frames[order],
        ids=np.full(len(order), -1, np.int64),
        labels=tuple(labels[row] for row in order),
        boxes_px=np.concatenate([table.boxes_px for table in tables])[order],
        boxes_m=np.concatenate([table.boxes_m for table in tables])[order],
        scores=np.concatenate([table.scores for table in tables])[order],
    )


def write_kitti_tracks(path: Path, tracks: TrackedBoxes) -> None:
    """Write tracks as KITTI's tracking text, with the score as the last column.

    Truncation and occlusion, which no tracker knows, are -1, and so is a box in the image that
    is not known. Without scores there is no such column.
    """
    lines = []
    kitti = to_kitti_boxes(tracks.boxes_m)
    boxes_px = np.nan_to_num(tracks.boxes_px, nan=-1.0)
    for row, label in enumerate(tracks.labels):
        alpha = _wrapped(kitti[row, 6] - math.atan2(kitti[row, 3], kitti[row, 5]))
        numbers = np.array([alpha, *boxes_px[row], *kitti[row], tracks.scores[row]])
        words = (f"{value:.{_DIGITS}f}" for value in numbers[np.isfinite(numbers)])
        lines.append(f"{tracks.frames[row]} {tracks.ids[row]} {label} -1 -1 {' '.join(words)}\n")
    path.write_text("".join(lines), encoding="utf-8")


def from_kitti_boxes(boxes: _F64) -> _F64:
    """Return boxes (R, 7) centre, length, width, height, yaw; x forward, y left, z up.

    Args:
        boxes: (R, 7) float64 height, width, length, and x, y, z of the centre of the bottom in
            the camera's frame, in metres, and the turn about its y axis in rad.
    """
    height, width, length, x, y, z, rotation = boxes.T
    yaw = _wrapped(-rotation - math.pi / 2)
    return np.column_stack([z, -x, height / 2 - y, length, width, height, yaw])


def to_kitti_boxes(boxes_m: _F64) -> _F64:
    """Return boxes as KITTI has them; the reverse of `from_kitti_boxes`."""
    x, y, z, length, width, height, yaw = boxes_m.T
    rotation = _wrapped(-yaw - math.pi / 2)
    return np.column_stack([height, width, length, -y, height / 2 - z, x, rotation])


def _wrapped(angle: _F64 | float) -> _F64:
    return np.asarray(np.pi - np.mod(np.pi - angle, 2 * np.pi))  # (-pi, pi]


def _track_rows(path: Path) -> Iterator[_Row]:
    for line, words in text_rows(path):
        if len(words) not in (_COLUMNS, _COLUMNS + 1):
            raise InputError(
                f"line {line} has {len(words)} columns; KITTI's tracking labels have {_COLUMNS} "
                "with spaces between, and tracks a score after them",
                where=path,
            )
        frame = as_whole(words[0], "frame", path, line)
        name = as_whole(words[1], "id", path, line)
        values = as_numbers(words[3:], path, line)
        yield line, frame, name, words[2], [*values, *[math.nan] * (_COLUMNS - 2 - len(values))]


def _detection_rows(path: Path) -> Iterator[_Row]:
    for line, words in text_rows(path, ","):
        if len(words) != _DETECTION_COLUMNS:
            raise InputError(
                f"line {line} has {len(words)} columns; a detection has {_DETECTION_COLUMNS}: "
                "frame,type,x1,y1,x2,y2,score,h,w,l,x,y,z,rot_y,alpha",
                where=path,
            )
        frame = as_whole(words[0], "frame", path, line)
        kind = as_whole(words[1], "type", path, line)
        if kind not in _TYPES:
            raise InputError(
                f"line {line}: type {kind} is none of 1 pedestrian, 2 car, 3 cyclist", where=path
            )
        values = as_numbers(words[2:], path, line)
        box_px, score, box, alpha = values[:4], values[4], values[5:12], values[12]
        yield line, frame, -1, _TYPES[kind], [0, 0, alpha, *box_px, *box, score]


def _table(rows: Iterator[_Row], path: Path) -> TrackedBoxes:
    """Return rows whose numbers are truncated, occluded, alpha, 2D box, 3D box, score."""
    read = [_checked(row, path) for row in rows]
    order = frame_order([r[1] for r in read], [r[2] for r in read], [r[0] for r in read], path)
    values = np.array([r[4] for r in read], np.float64).reshape(-1, 15)[order]
    labels = tuple(read[row][3] for row in order)
    boxes_m = from_kitti_boxes(values[:, 7:14])
    known = [label != DONT_CARE and _has_box(v) for label, v in zip(labels, values, strict=True)]
    boxes_m[~np.array(known, bool)] = np.nan
    return TrackedBoxes(
        frames=np.array([r[1] for r in read], np.int64)[order],
        ids=np.array([r[2] for r in read], np.int64)[order],
        labels=labels,
        boxes_px=values[:, 3:7],
        boxes_m=boxes_m,
        scores=values[:, 14],
        truncated=values[:, 0].astype(np.int64),
        occluded=values[:, 1].astype(np.int64),
    )


def _checked(row: _Row, path: Path) -> _Row:
    line, frame, _, label, values = row
    if frame < 0:
        raise InputError(f"line {line}: frame {frame} is negative", where=path)
    if label != DONT_CARE and _has_box(values) and min(values[7:10]) <= 0:
        raise InputError(f"line {line}: a box of negative or no size", where=path)
    return row


def _has_box(values: Sequence[float] | _F64) -> bool:
    return list(values[10:13]) != _UNKNOWN_PLACE
