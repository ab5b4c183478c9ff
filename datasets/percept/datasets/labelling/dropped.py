"""Images that were looked at and are not in the set, with the reason."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from percept.core.whole_file import whole_file

__all__ = ["DROPPED", "DroppedFrame", "drop_counts", "write_dropped"]

DROPPED = pa.schema(
    [
        ("log", pa.string()),
        ("drive", pa.string()),
        ("stamp_ns", pa.int64()),
        ("camera", pa.string()),
        ("reason", pa.string()),
        ("of", pa.string()),
    ]
)
"""Columns of `dropped.parquet`: a row for each image that could have been chosen and was not.

`of` is the file of the set that a duplicate repeats; null for other reasons.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DroppedFrame:
    """An image that is not in the set.

    Attributes:
        log: The log as the user named it.
        drive: Name of its drive.
        camera: Name of the camera; empty for a scan alone.
        stamp_ns: When it was taken.
        reason: Why, such as `blurred`, `duplicate`, `margin`.
        of: For a duplicate the file of the set that it repeats, such as `images/<stem>.jpg`.
        picture: The image, blurred where that was asked for, as long as it is there; None where
            nobody decoded it.
        latitude: Degrees north; NaN where not known.
        longitude: Degrees east; NaN where not known.
    """

    log: str
    drive: str
    camera: str
    stamp_ns: int
    reason: str
    of: str = ""
    picture: Path | None = None
    latitude: float = math.nan
    longitude: float = math.nan


def drop_counts(dropped: Iterable[DroppedFrame]) -> dict[str, int]:
    """Return how many images were left out for each reason, the most frequent first."""
    return dict(Counter(one.reason for one in dropped).most_common())


def write_dropped(folder: Path, dropped: Sequence[DroppedFrame]) -> None:
    """Write `dropped.parquet` of a set, whole.

    Raises:
        OSError: If the folder cannot be written.
    """
    columns = {
        "log": [one.log for one in dropped],
        "drive": [one.drive for one in dropped],
        "stamp_ns": [one.stamp_ns for one in dropped],
        "camera": [one.camera for one in dropped],
        "reason": [one.reason for one in dropped],
        "of": [one.of or None for one in dropped],
    }
    table = pa.table(columns, schema=DROPPED)
    with whole_file(folder / "dropped.parquet") as path:
        pq.write_table(table, path, compression="zstd", store_schema=False)
