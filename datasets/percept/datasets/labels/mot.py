"""MOTChallenge text: `frame, id, left, top, width, height, confidence, ...`, a line a box."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from percept.core.errors import InputError
from percept.core.tracked_boxes import TrackedBoxes
from percept.datasets.labels.number_rows import as_numbers, as_whole, frame_order, text_rows

__all__ = ["read_mot"]

_FEWEST_COLUMNS = 6
_LABEL = "object"


def read_mot(path: Path, *, labels: bool) -> tuple[TrackedBoxes, Counter[str]]:
    """Read a file of labels or of tracks.

    Args:
        path: The file.
        labels: Whether it is labels, of which a confidence of 0 says that they do not count.

    Returns:
        The boxes, all of one class, and what was left out, by reason.

    Raises:
        InputError: If a line is none of the format; it names the file and the line.
    """
    frames: list[int] = []
    ids: list[int] = []
    lines: list[int] = []
    boxes: list[list[float]] = []
    dropped: Counter[str] = Counter()
    for line, words in text_rows(path, ","):
        if len(words) < _FEWEST_COLUMNS:
            raise InputError(
                f"line {line} has {len(words)} columns; MOTChallenge has frame, id, left, top, "
                "width, height and more, with commas between",
                where=path,
            )
        left, top, width, height, *rest = as_numbers(words[2:], path, line)
        if width <= 0 or height <= 0:
            raise InputError(f"line {line}: a box of negative or no size", where=path)
        if labels and rest and rest[0] == 0:
            dropped["labels marked as not to be scored"] += 1
            continue
        frames.append(as_whole(words[0], "frame", path, line))
        ids.append(as_whole(words[1], "id", path, line))
        lines.append(line)
        boxes.append([left, top, left + width, top + height, rest[0] if rest else np.nan])
    order = frame_order(frames, ids, lines, path)
    table = np.array(boxes, np.float64).reshape(-1, 5)[order]
    found = TrackedBoxes(
        frames=np.array(frames, np.int64)[order],
        ids=np.array(ids, np.int64)[order],
        labels=(_LABEL,) * len(order),
        boxes_px=table[:, :4],
        scores=table[:, 4],
    )
    return found, dropped
