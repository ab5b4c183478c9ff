"""When each sensor and detector of a run delivered, from its tables."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from percept.export.image_table import IMAGES_2D
from percept.export.scan_table import read_scans
from percept.export.table_reader import read_batches

__all__ = ["run_events"]

_LOOKS = pa.schema([IMAGES_2D.field(name) for name in ("stamp_ns", "camera", "model")])


def run_events(run: Path) -> dict[str, list[int]]:
    """Return the stamps of what was delivered, by name, for `run_health`.

    LiDARs stand under their own names, and what a network saw of a camera under `camera model`.
    Images at which a network failed are left out, so that its silence shows.

    Args:
        run: Folder with the tables of a run.

    Raises:
        InputError: If a table is damaged.
    """
    events: dict[str, list[int]] = {}
    scans, images = run / "scans_3d.parquet", run / "images_2d.parquet"
    if scans.is_file():
        for scan, _ in read_scans(scans):
            events.setdefault(scan.sensor, []).append(scan.stamp_ns)
    if images.is_file():
        for batch in read_batches(images, _LOOKS, may_lack=("model",)):
            for look in batch.to_pylist():
                if look["model"] is not None:
                    name = f"{look['camera']} {look['model']}"
                    events.setdefault(name, []).append(look["stamp_ns"])
    return events
