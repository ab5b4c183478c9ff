"""The run behind `percept dataset import`: from a tool's files to the tables of a data set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.core.results import Verdict
from percept.datasets.labelling.corrections.corrected import (
    Corrected,
    CorrectedFormat,
    corrected_format,
    read_corrected,
)
from percept.datasets.labelling.set_schemas import ABOUT, TABLES
from percept.datasets.labelling.set_tables import read_set, write_set

__all__ = ["ImportRequest", "run_import"]

_OUTPUTS = (ABOUT, *(f"{name}.parquet" for name in TABLES))
_MOST_INPUTS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportRequest:
    """What the command line asked for; a format of None is told by looking at the files."""

    labels: Path
    of: Path
    out: Path
    label_format: str | None
    force: bool


def run_import(request: ImportRequest) -> dict[str, Any]:
    """Read the labels and write the tables.

    Returns:
        The content of `run.json`.

    Raises:
        PerceptError: If the labels, the set or the folder cannot be used.
    """
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        with progress_bar("reading labels", None):
            name = cast("CorrectedFormat", request.label_format or corrected_format(request.labels))
            corrected = read_corrected(request.labels, name, read_set(request.of))
        about = request.of / ABOUT
        folder.begin([about, *corrected.files])
        write_set(replace(corrected.labelled, folder=folder.path))
        verdict, why = _judged(corrected.dropped)
        return folder.finish(
            config={"format": name, "labels": str(request.labels), "of": str(request.of)},
            inputs=[about, *corrected.files[:_MOST_INPUTS]],
            counts=_counts(corrected),
            dropped=corrected.dropped,
            verdict=verdict,
            why=why,
            notes=corrected.notes,
        )


def _counts(corrected: Corrected) -> dict[str, int]:
    labelled = corrected.labelled
    frames = [frame for _, frame in labelled.frames()]
    return {
        "files": len(corrected.files),
        "images": len(frames),
        "keyframes": len(labelled.keyframes),
        "boxes_2d": sum(len(frame.boxes) for frame in frames),
        "boxes_3d": sum(len(one.solids) for one in labelled.keyframes),
    }


def _judged(dropped: Mapping[str, int]) -> tuple[Verdict, tuple[str, ...]]:
    """Return doubtful where an image, or something that the files say, is not in the tables."""
    if not dropped:
        return Verdict.GOOD, ("every image and every box came back",)
    return Verdict.DOUBTFUL, tuple(f"{number:,} {reason}" for reason, number in dropped.items())
