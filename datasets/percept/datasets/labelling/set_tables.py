"""A labelled set as tables: written for people and other tools, and read back as it was."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from percept.core.rig import Rig, rig_as_mapping
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.core.whole_file import whole_file
from percept.datasets.labelling.labelled_set import LabelledSet
from percept.datasets.labelling.set_reading import read_set
from percept.datasets.labelling.set_schemas import ABOUT, BOXES_3D, POSE, TABLES

__all__ = ["read_set", "write_set"]


def write_set(labelled: LabelledSet) -> None:
    """Write the tables and `dataset.json` of a set into its folder, each whole.

    Raises:
        OSError: If the folder cannot be written.
    """
    folder = labelled.folder
    rows = {
        "frames": _frame_rows(labelled),
        "keyframes": _keyframe_rows(labelled),
        "boxes_2d": _image_box_rows(labelled),
        "boxes_3d": _solid_rows(labelled),
    }
    for name, schema in TABLES.items():
        with (
            whole_file(folder / f"{name}.parquet") as path,
            pq.ParquetWriter(path, schema, compression="zstd", store_schema=False) as writer,
        ):
            for batch in _batches(rows[name], schema):
                writer.write_batch(batch)
    with whole_file(folder / ABOUT) as path:
        path.write_text(json.dumps(_record(labelled), indent=2, ensure_ascii=False) + "\n", "utf-8")


def _record(labelled: LabelledSet) -> dict[str, Any]:
    drives = {
        drive.name: {
            "log": drive.log,
            "fingerprint": drive.fingerprint,
            "start_ns": drive.start_ns,
            "rig": rig_as_mapping(Rig(drive.base_frame, dict(drive.cameras))),
            "lidars": list(drive.lidars),
            "models": dict(drive.models),
        }
        for drive in labelled.drives.values()
    }
    return {
        "name": labelled.name,
        "categories": list(labelled.categories),
        "licence": labelled.licence,
        "anonymised": list(labelled.anonymised),
        "created": labelled.created,
        "drives": drives,
    }


def _batches(
    rows: Iterable[Mapping[str, Any]], schema: pa.Schema, size: int = 16_384
) -> Iterator[pa.RecordBatch]:
    pending: list[Mapping[str, Any]] = []
    for row in rows:
        pending.append(row)
        if len(pending) == size:
            yield pa.RecordBatch.from_pylist(pending, schema=schema)
            pending = []
    if pending:
        yield pa.RecordBatch.from_pylist(pending, schema=schema)


def _frame_rows(labelled: LabelledSet) -> Iterator[dict[str, Any]]:
    for keyframe, frame in labelled.frames():
        yield {
            "frame": frame.frame,
            "keyframe": keyframe.keyframe,
            "log": labelled.drives[keyframe.drive].log,
            "drive": keyframe.drive,
            "stamp_ns": frame.stamp_ns,
            "offset_ns": frame.offset_ns,
            "camera": frame.camera,
            "file": frame.file,
            "rectified_file": frame.rectified_file,
            "width_px": frame.image_size[0],
            "height_px": frame.image_size[1],
            "split": keyframe.split,
            "latitude": _known(keyframe.latitude),
            "longitude": _known(keyframe.longitude),
            **_pose_cells(frame.vehicle_place),
        }


def _keyframe_rows(labelled: LabelledSet) -> Iterator[dict[str, Any]]:
    for one in labelled.keyframes:
        scan = one.scan
        yield {
            "keyframe": one.keyframe,
            "drive": one.drive,
            "stamp_ns": one.stamp_ns,
            "split": one.split,
            "latitude": _known(one.latitude),
            "longitude": _known(one.longitude),
            "reason": one.reason,
            "score": one.score,
            "frame_id": None if one.T_world_base is None else one.T_world_base.target,
            **_pose_cells(one.T_world_base),
            "scan_file": None if scan is None else scan.file,
            "scan_stamp_ns": None if scan is None else scan.stamp_ns,
            "scan_points": None if scan is None else scan.points,
            "scan_offsets_ns": None if scan is None else json.dumps(dict(scan.offsets_ns)),
        }


def _image_box_rows(labelled: LabelledSet) -> Iterator[dict[str, Any]]:
    for _, frame in labelled.frames():
        boxes = frame.boxes
        for i, (x1, y1, x2, y2) in enumerate(boxes.boxes_px.tolist()):
            track, solid = int(boxes.track_ids[i]), int(boxes.solids[i])
            yield {
                "box": int(boxes.ids[i]),
                "frame": frame.frame,
                "x1_px": x1,
                "y1_px": y1,
                "x2_px": x2,
                "y2_px": y2,
                "label": boxes.labels[i],
                "confidence": _known(boxes.confidences[i]),
                "source": boxes.sources[i],
                "track_id": track if track >= 0 else None,
                "box_3d": solid or None,
                "truncated": _known(boxes.truncated[i]),
                "occluded": _known(boxes.occluded[i]),
            }


def _solid_rows(labelled: LabelledSet) -> Iterator[dict[str, Any]]:
    places = BOXES_3D.names[2:9]
    for one in labelled.keyframes:
        solids = one.solids
        for i, box in enumerate(solids.boxes_m.tolist()):
            track, points = int(solids.track_ids[i]), int(solids.points[i])
            yield {
                "box": int(solids.ids[i]),
                "keyframe": one.keyframe,
                **dict(zip(places, box, strict=True)),
                "label": solids.labels[i],
                "confidence": _known(solids.confidences[i]),
                "source": solids.sources[i],
                "track_id": track if track >= 0 else None,
                "vx": _known(solids.velocities_mps[i, 0]),
                "vy": _known(solids.velocities_mps[i, 1]),
                "points": points if points >= 0 else None,
            }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _pose_cells(pose: Transform | None) -> dict[str, float | None]:
    if pose is None:
        return {f"base_{name}": None for name in POSE}
    numbers = [*pose.translation_m.tolist(), *quat_xyzw_from_matrix(pose.rotation).tolist()]
    return {f"base_{name}": value for name, value in zip(POSE, numbers, strict=True)}
