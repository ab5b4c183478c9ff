"""A labelled set read back from its tables, which may come from strangers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic import ValidationError

from percept.core.errors import InputError
from percept.core.rig import parse_rig
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import (
    SPLITS,
    Drive,
    ImageBoxes,
    Keyframe,
    KeyScan,
    LabelledFrame,
    LabelledSet,
    SolidBoxes,
)
from percept.datasets.labelling.set_schemas import (
    ABOUT,
    BOXES_2D,
    BOXES_3D,
    POSE,
    TABLES,
    DriveRecord,
    SetRecord,
)

__all__ = ["read_set"]

_MOST_BYTES = 64 << 20


def read_set(folder: Path) -> LabelledSet:
    """Read back what `write_set` wrote.

    Raises:
        InputError: If the folder holds no set, or a damaged one.
    """
    record = _read_record(folder / ABOUT)
    drives = {name: _drive(name, one, folder) for name, one in record.drives.items()}
    tables = {name: _read(folder / f"{name}.parquet", schema) for name, schema in TABLES.items()}
    boxes = _grouped(tables["boxes_2d"], "frame")
    solids = _grouped(tables["boxes_3d"], "keyframe")
    frames: dict[int, list[LabelledFrame]] = {}
    try:
        for row in _rows(tables["frames"]):
            base = drives[row["drive"]].base_frame
            found = boxes.get(row["frame"])
            frames.setdefault(row["keyframe"], []).append(_frame(row, base, found))
        keyframes = tuple(
            _keyframe(row, drives, frames.get(row["keyframe"], []), solids.get(row["keyframe"]))
            for row in _rows(tables["keyframes"])
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"holds tables that do not fit together ({type(error).__name__}: {error})", where=folder
        ) from error
    return LabelledSet(
        folder=folder,
        name=record.name,
        categories=record.categories,
        drives=drives,
        keyframes=keyframes,
        licence=record.licence,
        anonymised=record.anonymised,
        created=record.created,
    )


def _read_record(path: Path) -> SetRecord:
    if not path.is_file():
        raise InputError(
            "holds no data set",
            where=path.parent,
            remedy="Give the --out folder of `percept dataset prepare`",
        )
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError("is too large to be the record of a data set", where=path)
        return SetRecord.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        first = str(error).splitlines()[0]
        raise InputError(
            f"cannot be read as the record of a data set ({first})", where=path
        ) from error


def _drive(name: str, record: DriveRecord, folder: Path) -> Drive:
    rig = parse_rig(record.rig, where=folder / ABOUT)
    return Drive(
        name=name,
        log=record.log,
        fingerprint=record.fingerprint,
        start_ns=record.start_ns,
        base_frame=rig.base_frame,
        cameras=rig.cameras(),
        lidars=record.lidars,
        models=record.models,
    )


def _pose_of(row: Mapping[str, Any], target: str, source: str) -> Transform | None:
    numbers = [row[f"base_{name}"] for name in POSE]
    if None in numbers:
        return None
    return Transform.from_quat_xyzw(target, source, numbers[:3], numbers[3:])


def _read(path: Path, schema: pa.Schema) -> pa.Table:
    if not path.is_file():
        raise InputError("is missing", where=path, remedy="Prepare the data set again")
    try:
        return pq.read_table(path, columns=schema.names).select(schema.names).cast(schema)
    except (pa.ArrowException, OSError, KeyError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"cannot be read as a table of a data set ({first})", where=path
        ) from error


def _rows(table: pa.Table) -> Iterator[dict[str, Any]]:
    for batch in table.to_batches(max_chunksize=16_384):
        yield from batch.to_pylist()


def _grouped(table: pa.Table, key: str) -> dict[int, pa.Table]:
    """Return the rows of each value of a column, in their order."""
    table = table.sort_by(key)
    keys, starts = np.unique(table[key].to_numpy(), return_index=True)
    ends = [*starts[1:].tolist(), len(table)]
    return {
        number: table.slice(start, end - start)
        for number, start, end in zip(
            keys.tolist(), starts.tolist(), ends[: len(keys)], strict=True
        )
    }


def _numbers(rows: pa.Table, names: Iterable[str]) -> NDArray[np.float64]:
    columns = [rows[name].to_numpy(zero_copy_only=False) for name in names]
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])


def _integers(rows: pa.Table, name: str, missing: int) -> NDArray[np.int64]:
    filled: NDArray[np.int64] = rows[name].fill_null(missing).to_numpy()
    return filled


def _image_boxes(rows: pa.Table | None) -> ImageBoxes:
    if rows is None:
        return ImageBoxes.none()
    return ImageBoxes(
        ids=_integers(rows, "box", 0),
        boxes_px=_numbers(rows, BOXES_2D.names[2:6]),
        labels=tuple(rows["label"].to_pylist()),
        confidences=_numbers(rows, ["confidence"])[:, 0],
        sources=tuple(rows["source"].to_pylist()),
        track_ids=_integers(rows, "track_id", -1),
        solids=_integers(rows, "box_3d", 0),
        truncated=_numbers(rows, ["truncated"])[:, 0],
        occluded=_numbers(rows, ["occluded"])[:, 0],
    )


def _solid_boxes(rows: pa.Table | None) -> SolidBoxes:
    if rows is None:
        return SolidBoxes.none()
    return SolidBoxes(
        ids=_integers(rows, "box", 0),
        boxes_m=_numbers(rows, BOXES_3D.names[2:9]),
        labels=tuple(rows["label"].to_pylist()),
        confidences=_numbers(rows, ["confidence"])[:, 0],
        sources=tuple(rows["source"].to_pylist()),
        track_ids=_integers(rows, "track_id", -1),
        velocities_mps=_numbers(rows, ["vx", "vy"]),
        points=_integers(rows, "points", -1),
    )


def _frame(row: Mapping[str, Any], base: str, boxes: pa.Table | None) -> LabelledFrame:
    return LabelledFrame(
        frame=row["frame"],
        camera=row["camera"],
        stamp_ns=row["stamp_ns"],
        offset_ns=row["offset_ns"],
        file=_inside(row["file"]),
        rectified_file=None if row["rectified_file"] is None else _inside(row["rectified_file"]),
        image_size=(row["width_px"], row["height_px"]),
        boxes=_image_boxes(boxes),
        vehicle_place=_pose_of(row, base, base),
    )


def _keyframe(
    row: Mapping[str, Any],
    drives: Mapping[str, Drive],
    frames: list[LabelledFrame],
    solids: pa.Table | None,
) -> Keyframe:
    if row["split"] not in SPLITS:
        raise ValueError(f"'{row['split']}' is no split")
    base = drives[row["drive"]].base_frame
    return Keyframe(
        keyframe=row["keyframe"],
        drive=row["drive"],
        stamp_ns=row["stamp_ns"],
        split=row["split"],
        latitude=np.nan if row["latitude"] is None else row["latitude"],
        longitude=np.nan if row["longitude"] is None else row["longitude"],
        reason=row["reason"],
        score=row["score"],
        T_world_base=_pose_of(row, row["frame_id"] or "", base),
        frames=tuple(frames),
        scan=_scan(row),
        solids=_solid_boxes(solids),
    )


def _scan(row: Mapping[str, Any]) -> KeyScan | None:
    if row["scan_file"] is None:
        return None
    return KeyScan(
        stamp_ns=row["scan_stamp_ns"],
        offset_ns=row["scan_stamp_ns"] - row["stamp_ns"],
        file=_inside(row["scan_file"]),
        points=row["scan_points"],
        offsets_ns=json.loads(row["scan_offsets_ns"]),
    )


def _inside(name: str) -> str:
    """Return the name of a file if it stays in the folder: tables come from strangers too."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError(f"file '{name}' is outside the folder")
    return name
