"""Plain tables with the files that they name, in one folder that can be taken elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.labelled_set import LabelledSet
from percept.datasets.labelling.placing import place_file
from percept.datasets.labelling.set_tables import write_set

__all__ = ["export_parquet"]

_OPENING = (
    "Tables that pandas, Polars, DuckDB and Arrow read; files are named relative to this folder:",
    "",
    "```python",
    "import pandas",
    "",
    'boxes = pandas.read_parquet("boxes_2d.parquet")',
    'boxes = boxes.merge(pandas.read_parquet("frames.parquet"), on="frame")',
    "```",
    "",
    "- `frames`: a row for each image; `keyframes`: for each moment, with the vehicle's place and",
    "  the scan; `boxes_2d` (by `frame`, pixels of the recorded image from the outer edge of the",
    "  first) and `boxes_3d` (by `keyframe`, metres and rad in the vehicle's base frame).",
    "- `dataset.json`: classes in their order, drives, cameras with their lenses and places.",
    "- A scan is rows of float32 x, y, z, intensity in the base frame.",
    "- What is not known is null. A box without `source` was drawn by a person.",
)


def export_parquet(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as tables; `read_set` reads the folder back as it was.

    Args:
        labelled: The set.
        folder: The folder to fill.

    Returns:
        What the format cannot hold: nothing.

    Raises:
        OSError: If the folder cannot be written.
    """
    for file in _files(labelled):
        place_file(labelled.folder / file, folder / file)
    write_set(replace(labelled, folder=folder))
    write_readme(folder, "Tables", _OPENING, ())
    return ()


def _files(labelled: LabelledSet) -> list[str]:
    """Return each file of the set once: a rectified image may be the recorded one."""
    files = {keyframe.scan.file: None for keyframe in labelled.keyframes if keyframe.scan}
    for _, frame in labelled.frames():
        files[frame.file] = None
        if frame.rectified_file is not None:
            files[frame.rectified_file] = None
    return list(files)
