"""Tables of boxes: `detections_2d.parquet` of a run, `truth/boxes_2d.parquet` of a drive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from percept.core.errors import InputError, UsageError
from percept.core.labels import LabelSet
from percept.datasets.labels.boxes import BoxRows, as_number

__all__ = ["read_box_table", "table_file"]

_NEEDED = ("stamp_ns", "camera", "label", "x1_px", "y1_px", "x2_px", "y2_px")
_OPTIONAL = ("confidence", "range_m", "visible", "model", "primary")
_TABLES = ("detections_2d.parquet", "boxes_2d.parquet", "truth/boxes_2d.parquet")
_IMAGES = "images_2d.parquet"


def _is_text(kind: pa.DataType) -> bool:
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    kinds = (pa.types.is_string, pa.types.is_large_string, pa.types.is_null)
    return any(fits(kind) for fits in kinds)


_TYPES: dict[str, Callable[[pa.DataType], bool]] = {
    "stamp_ns": pa.types.is_integer,
    "primary": pa.types.is_boolean,
    **dict.fromkeys(("camera", "label", "model", "failure"), _is_text),
}


def table_file(path: Path) -> Path | None:
    """Return the table of 2D boxes at a path or in the folder there, or None."""
    if path.is_file():
        return path if path.suffix == ".parquet" else None
    return next((path / name for name in _TABLES if (path / name).is_file()), None)


def read_box_table(path: Path, *, model: str | None = None) -> LabelSet:
    """Read a table of boxes; images are named `camera/stamp_ns`.

    `images_2d.parquet` beside it says which images were looked at, by which network; without it
    only those with boxes are known, and the set is not complete. Images of one camera with one
    stamp cannot be told apart, and are left out.

    Args:
        path: The table, or a folder that holds it under its usual name.
        model: The network whose boxes to take. None takes all, but of those that several
            networks found in one image only the most confident (`primary`).

    Raises:
        InputError: If there is no such table, or it is none of boxes.
        UsageError: If no network of the table has that name.
    """
    file = table_file(path)
    if file is None:
        raise InputError(f"holds none of {', '.join(_TABLES)}", where=path)
    table = _read(file, _NEEDED, _OPTIONAL)
    looks = _looks(file.with_name(_IMAGES))
    table, notes = _of_model(table, model, {name for _, name in looks or ()}, file)
    dropped: Counter[str] = Counter()
    listed = None if looks is None else _listed(looks, model, dropped)
    rows = {name: BoxRows(file, dropped) for name in listed or ()}
    for entry in (row for batch in table.to_batches() for row in batch.to_pylist()):
        if entry["stamp_ns"] is None or entry["camera"] is None or entry["label"] is None:
            dropped["rows without a stamp, camera or label"] += 1
            continue
        name = f"{entry['camera']}/{entry['stamp_ns']}"
        if name not in rows and listed is not None:
            dropped[f"boxes in images that {_IMAGES} does not list"] += 1
            continue
        _add(rows.setdefault(name, BoxRows(file, dropped)), entry)
    return LabelSet(
        images=tuple(boxes.image(name) for name, boxes in rows.items()),
        complete=listed is not None,
        dropped=dict(dropped),
        notes=notes,
        files=(file,),
    )


def _add(rows: BoxRows, entry: dict[str, Any]) -> None:
    x1, y1, x2, y2 = (as_number(entry[name]) for name in _NEEDED[3:])
    rows.add(
        entry["label"],
        (x1, y1, x2, y2),
        confidence=as_number(entry["confidence"]) if "confidence" in entry else None,
        range_m=as_number(entry.get("range_m")),
        visible=as_number(entry.get("visible")),
    )


def _read(file: Path, needed: tuple[str, ...], optional: tuple[str, ...]) -> pa.Table:
    try:
        names = pq.read_schema(file).names
        missing = [name for name in needed if name not in names]
        if missing:
            raise InputError(
                f"is no table of 2D boxes: it has no column {', '.join(missing)}", where=file
            )
        table = pq.read_table(file, columns=[*needed, *(n for n in optional if n in names)])
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"cannot be read as Parquet ({error})", where=file) from error
    for name, fits in _TYPES.items():
        if name in table.column_names and not fits(table.schema.field(name).type):
            raise InputError(f"column {name} has the wrong type", where=file)
    return table


def _of_model(
    table: pa.Table, model: str | None, looking: Iterable[str | None], file: Path
) -> tuple[pa.Table, tuple[str, ...]]:
    """Return the rows of one network, or of all without what another found better.

    Args:
        table: All rows.
        model: The network that is wanted.
        looking: Networks that looked at images; one of them may have found nothing.
        file: The table's file.
    """
    if "model" not in table.column_names:
        if model is not None:
            raise UsageError(f"names no models, so not '{model}' either", where=file)
        return table, ()
    models = sorted({*table["model"].to_pylist(), *looking} - {None})
    if model is not None:
        if model not in models:
            raise UsageError(f"has no model '{model}'", where=file, remedy=f"Models: {models}")
        return table.filter(pc.equal(table["model"], model)), ()
    if len(models) < 2 or "primary" not in table.column_names:
        return table, ()
    kept = table.filter(table["primary"])
    return kept, (
        f"boxes of {', '.join(models)} together: {len(table) - len(kept)} that another model found "
        "with more confidence are left out; --model scores one alone",
    )


def _looks(file: Path) -> Counter[tuple[str, str | None]] | None:
    """Return how often each network looked at an image of each name, in order; None if unknown."""
    if not file.is_file():
        return None
    table = _read(file, ("stamp_ns", "camera"), ("model", "failure"))
    unknown = [None] * len(table)
    columns = {"model": unknown, "failure": unknown, **table.to_pydict()}
    rows = zip(*(columns[n] for n in ("camera", "stamp_ns", "model", "failure")), strict=True)
    return Counter(
        (f"{camera}/{stamp_ns}", model) for camera, stamp_ns, model, failure in rows if not failure
    )


def _listed(
    looks: Counter[tuple[str, str | None]], model: str | None, dropped: Counter[str]
) -> list[str]:
    """Return the images that a network looked at, or any of them, in order."""
    wanted = {
        look: count for look, count in looks.items() if model is None or look[1] in (model, None)
    }
    twice = {name for (name, _), count in wanted.items() if count > 1}
    if twice:
        dropped["images with the camera and the stamp of another"] += len(twice)
    return [name for name in dict.fromkeys(name for name, _ in wanted) if name not in twice]
