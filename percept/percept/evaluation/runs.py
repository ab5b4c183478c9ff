"""A finished run against the truth tables of a drive."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.results import Detections3D
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, matrix_from_quat_xyzw
from percept.evaluation.detections import DetectionScores, Match, match_detections

__all__ = ["read_poses", "score_run"]

_FEWEST_POINTS = 10
_LARGEST_STAMP_DIFFERENCE_NS = 60_000_000
_SIZES = ("length", "width", "height", "yaw_rad")


def score_run(
    run: Path, truth: Path, frame: str = "base_link", fewest_points: int = _FEWEST_POINTS
) -> DetectionScores:
    """Match the detections of a run with the objects of a drive, scan by scan.

    Truth is taken at the stamp nearest to each scan and brought into the detections' frame by
    the true pose. An object on which all LiDARs together had fewer than `fewest_points` returns
    could not be found: neither it nor a detection on it counts.

    Args:
        run: Run folder of `percept detect` with `detections_3d.parquet`.
        truth: Folder with `objects.parquet` and `poses.parquet`.
        frame: Frame that the detections must be in.
        fewest_points: Returns from which an object counts.

    Raises:
        InputError: If the detections are in another frame or no stamp fits the truth.
    """
    detections = pq.read_table(run / "detections_3d.parquet")
    frames = set(detections["frame_id"].to_pylist()) - {frame}
    if frames:
        raise InputError(
            f"detections are in {', '.join(sorted(frames))}, truth needs {frame}",
            where=run,
            remedy="Detect with --rig",
        )
    objects = pq.read_table(truth / "objects.parquet")
    poses = read_poses(truth / "poses.parquet")
    matches: list[Match] = []
    for stamp_ns, boxes in _by_stamp(detections):
        rows = _rows_near(objects, stamp_ns)
        T_map_base = poses.at(stamp_ns)
        if rows is None or T_map_base is None:
            continue
        truth_boxes = _boxes(rows, T_map_base.inverse())
        hidden = rows["points"].to_numpy() < fewest_points
        labels = rows["label"].to_pylist()
        matches += match_detections(
            _detections(boxes, stamp_ns, frame), truth_boxes, labels, hidden
        ).matches
    if not matches:
        raise InputError("no scan fits the truth in time", where=run)
    return DetectionScores(tuple(matches))


def read_poses(path: Path) -> Trajectory:
    """Read `poses.parquet` (`stamp_ns, x, y, z, qx, qy, qz, qw`) as T_map_base."""
    table = pq.read_table(path)
    column = {name: table[name].to_numpy() for name in table.column_names}
    matrices = np.tile(np.eye(4), (len(table), 1, 1))
    quats = np.column_stack([column[name] for name in ("qx", "qy", "qz", "qw")])
    matrices[:, :3, :3] = [matrix_from_quat_xyzw(quat) for quat in quats]
    matrices[:, :3, 3] = np.column_stack([column[name] for name in ("x", "y", "z")])
    return Trajectory("map", "base_link", column["stamp_ns"], matrices)


def _by_stamp(table: pa.Table) -> Iterator[tuple[int, pa.Table]]:
    stamps = table["stamp_ns"].to_numpy()
    for stamp_ns in np.unique(stamps):
        yield int(stamp_ns), table.filter(pa.array(stamps == stamp_ns))


def _rows_near(objects: pa.Table, stamp_ns: int) -> pa.Table | None:
    stamps = objects["stamp_ns"].to_numpy()
    if not len(stamps):
        return None
    nearest = stamps[np.argmin(np.abs(stamps - stamp_ns))]
    if abs(int(nearest) - stamp_ns) > _LARGEST_STAMP_DIFFERENCE_NS:
        return None
    return objects.filter(pa.array(stamps == nearest))


def _boxes(rows: pa.Table, T_base_map: Transform) -> NDArray[np.float64]:
    """Return boxes (K, 7) in the base frame; yaw is laid into its x-y plane."""
    centres = T_base_map.apply(_columns(rows, ("x", "y", "z")))
    sizes = _columns(rows, _SIZES)
    heading = np.column_stack([np.cos(sizes[:, 3]), np.sin(sizes[:, 3]), np.zeros(len(sizes))])
    turned = heading @ T_base_map.rotation.T
    sizes[:, 3] = np.arctan2(turned[:, 1], turned[:, 0])
    return np.column_stack([centres, sizes])


def _detections(rows: pa.Table, stamp_ns: int, frame: str) -> Detections3D:
    return Detections3D(
        stamp_ns,
        "run",
        frame,
        _columns(rows, ("x", "y", "z", *_SIZES)),
        tuple(rows["label"].to_pylist()),
        rows["confidence"].to_numpy(),
        rows["mean_intensity"].to_numpy(),
        rows["points"].to_numpy(),
    )


def _columns(rows: pa.Table, names: tuple[str, ...]) -> NDArray[np.float64]:
    columns: list[NDArray[Any]] = [rows[name].to_numpy() for name in names]
    return np.column_stack(columns).astype(np.float64)
