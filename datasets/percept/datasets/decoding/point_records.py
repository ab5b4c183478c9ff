"""From a structured array of any layout to a `PointCloud`; what clouds of all files share."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.core.samples import PointCloud
from percept.datasets.decoding.point_times import (
    TIME_NAMES,
    TIME_PAIRS,
    UnclearTimesError,
    offsets_from_pair,
    offsets_ns,
)

__all__ = ["POINT_FIELDS", "cloud_from_records"]

_INTENSITY_NAMES = (
    "intensity",
    "intensities",
    "i",
    "reflectivity",
    "reflectance",
    "scalar_intensity",
)
_RING_NAMES = ("ring", "channel", "line", "laser_id", "laser_number", "laser")

POINT_FIELDS = frozenset(
    ("x", "y", "z", *_INTENSITY_NAMES, *_RING_NAMES, *TIME_NAMES, *sum(TIME_PAIRS, ()))
)
"""Names of the columns that are read; all others may be left out of the records."""


def cloud_from_records(
    records: NDArray[np.void],
    notes: Counter[str],
    *,
    topic: str,
    stamp_ns: int,
    log_time_ns: int,
    frame: str,
    stamp_is_known: bool = True,
) -> PointCloud:
    """Build a cloud from records; points that are not finite go with all their fields.

    Args:
        records: Structured array of any shape and byte order; fields `x`, `y`, `z` and, by the
            names in the wild, intensity, ring and time.
        notes: Counts what could not be used, by reason.
        topic: Name of the stream.
        stamp_ns: Time of the cloud.
        log_time_ns: Time of recording.
        frame: Coordinate frame.
        stamp_is_known: Whether per-point times can be compared with the stamp; otherwise the
            stamp stands for the earliest point.

    Raises:
        DecodeError: If there is no x, y or z.
    """
    names = set(records.dtype.names or ())
    if not {"x", "y", "z"} <= names:
        raise DecodeError(f"no x, y and z among the fields {sorted(names)}", where=topic)
    points_xyz = _points(records)
    keep = _finite_rows(points_xyz)
    dropped = 0 if keep is None else len(keep) - int(np.count_nonzero(keep))
    columns = _Columns(records, keep)
    offset_ns: NDArray[np.int64] | None = None
    try:
        offset_ns = _offsets(columns, stamp_ns if stamp_is_known else None)
    except UnclearTimesError as error:
        notes[f"{topic}: per-point times not used, {error}"] += 1
    return PointCloud(
        topic=topic,
        stamp_ns=stamp_ns,
        log_time_ns=log_time_ns,
        frame=frame,
        points_xyz=points_xyz if keep is None else points_xyz[keep],
        intensity=columns.first(_INTENSITY_NAMES, np.float32),
        offset_ns=offset_ns,
        ring=columns.first(_RING_NAMES, np.int32),
        dropped_nonfinite=dropped,
    )


class _Columns:
    """The kept rows of single columns, copied only when asked for."""

    def __init__(self, records: NDArray[np.void], keep: NDArray[np.bool_] | None) -> None:
        self._records = records
        self._keep = keep
        self.names = records.dtype.names or ()

    def column(self, name: str) -> NDArray[Any]:
        values = self._records[name].reshape(-1)
        return values if self._keep is None else values[self._keep]

    def first(self, names: tuple[str, ...], dtype: type[np.generic]) -> NDArray[Any] | None:
        name = next((name for name in names if name in self.names), None)
        if name is None:
            return None
        with np.errstate(invalid="ignore", over="ignore"):
            return self.column(name).astype(dtype)


def _points(records: NDArray[np.void]) -> NDArray[np.float32]:
    points = np.empty((records.size, 3), dtype=np.float32)
    # A double beyond the range of float32 becomes infinite and is dropped as such.
    with np.errstate(over="ignore"):
        for axis, name in enumerate("xyz"):
            points[:, axis] = records[name].reshape(-1)
    return points


def _finite_rows(points: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Return which rows are finite, or None where all are: the common case, and a fast one."""
    finite = np.isfinite(points)
    if finite.all():
        return None
    rows: NDArray[np.bool_] = finite[:, 0] & finite[:, 1] & finite[:, 2]
    return rows


def _offsets(columns: _Columns, stamp_ns: int | None) -> NDArray[np.int64] | None:
    for seconds, nanoseconds in TIME_PAIRS:
        if seconds in columns.names and nanoseconds in columns.names:
            return offsets_from_pair(columns.column(seconds), columns.column(nanoseconds), stamp_ns)
    name = next((name for name in TIME_NAMES if name in columns.names), None)
    return None if name is None else offsets_ns(columns.column(name), name, stamp_ns)
