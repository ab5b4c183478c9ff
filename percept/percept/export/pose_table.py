"""Where the vehicle was, as a table: `poses.parquet`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.errors import GeometryError, InputError
from percept.core.trajectory import Trajectory
from percept.export.table_reader import column, columns, has_column, read_batches, texts

__all__ = ["POSES", "pose_rows", "read_poses"]

_POSITION = ("x", "y", "z")
_QUAT_XYZW = ("qx", "qy", "qz", "qw")
_SHORTEST_QUATERNION = 1e-6

POSES = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("frame_id", pa.string()),
        ("child_frame_id", pa.string()),
        *((name, pa.float64()) for name in (*_POSITION, *_QUAT_XYZW)),
        ("after_gap", pa.bool_()),
    ]
)
"""Columns of `poses.parquet`: where the frame `child_frame_id` is in the frame `frame_id`, m.

`after_gap` is true where nothing is known between a pose and the one before.
"""


def pose_rows(trajectory: Trajectory) -> pa.RecordBatch:
    """Return all poses as rows with the schema `POSES`; quaternions have w >= 0."""
    count = len(trajectory)
    turns = Rotation.from_matrix(trajectory.matrices[:, :3, :3])
    values = [
        trajectory.stamps_ns,
        [trajectory.target] * count,
        [trajectory.source] * count,
        *trajectory.matrices[:, :3, 3].T,
        *turns.as_quat(canonical=True).T,
        _after_gap(trajectory),
    ]
    arrays = [pa.array(v, type=field.type) for v, field in zip(values, POSES, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=POSES)


def read_poses(path: Path) -> Trajectory:
    """Return the poses of a `poses.parquet`.

    A table without the column `after_gap`, as other programs may write it, has no gaps.

    Raises:
        InputError: If the file is no such table, is empty, has several frames, stamps that do
            not rise, or a quaternion that is no rotation.
    """
    has_gaps = has_column(path, "after_gap")
    schema = POSES if has_gaps else POSES.remove(POSES.get_field_index("after_gap"))
    batches = list(read_batches(path, schema))
    if not sum(len(batch) for batch in batches):
        raise InputError("holds no pose", where=path)
    rows = pa.concat_batches(batches)
    frames = {*zip(texts(rows, "frame_id"), texts(rows, "child_frame_id"), strict=True)}
    if len(frames) > 1:
        raise InputError("holds the poses of several frames", where=path)
    quats_xyzw = columns(rows, _QUAT_XYZW)
    if (np.linalg.norm(quats_xyzw, axis=1) < _SHORTEST_QUATERNION).any():
        raise InputError("holds a quaternion that is no rotation", where=path)
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(quats_xyzw).as_matrix()
    matrices[:, :3, 3] = columns(rows, _POSITION)
    stamps_ns, gaps_ns = column(rows, "stamp_ns"), np.zeros((0, 2), dtype=np.int64)
    if has_gaps:
        ends = np.flatnonzero(column(rows, "after_gap")[1:]) + 1
        gaps_ns = np.column_stack([stamps_ns[ends - 1], stamps_ns[ends]])
    target, source = frames.pop()
    try:
        return Trajectory(target, source, stamps_ns, matrices, gaps_ns)
    except GeometryError as error:
        raise InputError(error.what, where=path) from error


def _after_gap(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return (N,) whether a gap lies between each pose and the one before."""
    stamps = trajectory.stamps_ns
    between = stamps[:-1] + np.diff(stamps) // 2  # one time inside suffices: gaps end at poses
    return np.concatenate([[False], ~trajectory.covers(between)])
