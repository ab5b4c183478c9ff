"""Single point cloud files: PCD, PLY, npy, and the bare float32 files of KITTI and its kin."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError, RecordingError
from percept.core.samples import PointCloud
from percept.datasets.decoding.point_records import cloud_from_records
from percept.datasets.files.file_stamps import stamp_in_name
from percept.datasets.files.pcd import read_pcd

__all__ = ["CLOUD_SUFFIXES", "cloud_from_file", "read_point_cloud"]

_COLUMN_NAMES = ("x", "y", "z", "intensity", "ring")
_NUSCENES_SUFFIX = ".pcd.bin"
_CLEAR_STRUCTURE = 0.1


def read_point_cloud(path: Path, notes: Counter[str] | None = None) -> PointCloud:
    """Read one point cloud file.

    The stamp comes from a name with 16 or more digits, otherwise it is 0; the topic and the
    frame are the name of the file without its suffix.

    Args:
        path: The file.
        notes: Counter for what could not be used, by reason, such as per-point times that make
            no sense; points that are not finite are counted in the cloud.

    Raises:
        RecordingError: If the file is missing or of another kind.
        DecodeError: If it cannot be decoded.
    """
    if not path.exists():
        raise RecordingError("does not exist", where=path, remedy="Check the path")
    if path.suffix.lower() not in CLOUD_SUFFIXES or not path.is_file():
        raise RecordingError(
            "no point cloud file",
            where=path,
            remedy=f"Give one of {', '.join(CLOUD_SUFFIXES)}",
        )
    stamp_ns = stamp_in_name(path)
    counted = Counter() if notes is None else notes
    return cloud_from_file(path, counted, topic=path.stem, stamp_ns=stamp_ns, frame=path.stem)


def cloud_from_file(
    path: Path, notes: Counter[str], *, topic: str, stamp_ns: int | None, frame: str
) -> PointCloud:
    """Read one point cloud file as a sample.

    Args:
        path: The file.
        notes: Counts what could not be used, by reason.
        topic: Name of the stream.
        stamp_ns: Its time; None where the file has none: then the stamp is 0 and stands for
            the earliest point.
        frame: Coordinate frame.

    Raises:
        DecodeError: If it cannot be decoded.
    """
    try:
        records = _READERS[path.suffix.lower()](path, notes)
    except OSError as error:
        raise DecodeError(f"cannot be read ({error.strerror})", where=path) from error
    try:
        return cloud_from_records(
            records,
            notes,
            topic=topic,
            stamp_ns=stamp_ns or 0,
            log_time_ns=stamp_ns or 0,
            frame=frame,
            stamp_is_known=stamp_ns is not None,
        )
    except DecodeError as error:
        raise DecodeError(error.what, where=path) from error


def _read_ply(path: Path, _: Counter[str]) -> NDArray[np.void]:
    import plyfile

    try:
        content = plyfile.PlyData.read(str(path))
        vertices = content["vertex"].data
    except (plyfile.PlyParseError, KeyError, ValueError, UnicodeDecodeError) as error:
        raise DecodeError(f"no PLY file with vertices ({error})", where=path) from error
    records: NDArray[np.void] = np.array(vertices)
    return records


def _read_npy(path: Path, _: Counter[str]) -> NDArray[np.void]:
    try:
        table = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise DecodeError(f"no array of numbers ({error})", where=path) from error
    if not isinstance(table, np.ndarray):
        raise DecodeError("an archive, not an array of numbers", where=path)
    if table.dtype.names:
        return np.array(table).reshape(-1)
    if table.ndim != 2 or table.shape[1] < 3 or table.dtype.kind not in "fiu":
        raise DecodeError(
            f"points are (N, 3) or (N, 4) numbers, not {table.shape} {table.dtype}", where=path
        )
    return _named_columns(np.array(table[:, :4]))


def _read_bin(path: Path, _: Counter[str]) -> NDArray[np.void]:
    size = path.stat().st_size
    if size == 0:
        raise DecodeError("the file is empty", where=path)
    if size % 4:
        raise DecodeError(f"{size} bytes are no float32 numbers", where=path)
    values = np.fromfile(path, dtype="<f4")
    columns = 5 if path.name.endswith(_NUSCENES_SUFFIX) else _column_count(values, path)
    if len(values) % columns:
        raise DecodeError(f"{len(values)} numbers are no rows of {columns}", where=path)
    return _named_columns(values.reshape(-1, columns))


def _column_count(values: NDArray[np.float32], path: Path) -> int:
    """Tell rows of x y z from rows of x y z intensity, which the file does not say.

    Read at the right width, the columns differ in mean magnitude; at a wrong one each column
    is a mixture of all. Four is taken where nothing speaks clearly against it.
    """
    widths = [width for width in (4, 3) if len(values) % width == 0]
    if not widths:
        raise DecodeError(
            f"{len(values)} numbers are neither rows of 4 (x y z intensity) nor of 3 (x y z)",
            where=path,
        )
    if len(widths) == 1:
        return widths[0]
    by_four, by_three = (_column_spread(values.reshape(-1, width)) for width in (4, 3))
    return 3 if by_three > max(_CLEAR_STRUCTURE, 2 * by_four) else 4


def _column_spread(table: NDArray[np.float32]) -> float:
    """Return how much the mean magnitudes of the columns differ, relative to their mean."""
    finite = np.where(np.isfinite(table), np.abs(table), 0).astype(np.float64)
    magnitudes = finite.mean(axis=0)
    mean = float(magnitudes.mean())
    return float(magnitudes.std()) / mean if mean > 0 else 0.0


def _named_columns(table: NDArray[np.generic]) -> NDArray[np.void]:
    dtype = np.dtype([(name, table.dtype) for name in _COLUMN_NAMES[: table.shape[1]]])
    return np.ascontiguousarray(table).view(dtype).reshape(-1)


_READERS: dict[str, Callable[[Path, Counter[str]], NDArray[np.void]]] = {
    ".bin": _read_bin,
    ".npy": _read_npy,
    ".pcd": read_pcd,
    ".ply": _read_ply,
}

CLOUD_SUFFIXES = tuple(_READERS)
"""Suffixes of the point cloud files that are read."""
