"""The run behind `percept dataset diff`: from two sets of tables to figures and a report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.results import Verdict
from percept.core.settings import load_settings
from percept.datasets.labelling.corrections.compare import DiffConfig, SetDiff, compare_sets
from percept.datasets.labelling.corrections.diff_figures import ClassFigures
from percept.datasets.labelling.set_schemas import ABOUT, TABLES
from percept.datasets.labelling.set_tables import read_set
from percept.export.label_diff_report import label_diff_report
from percept.export.label_diff_table import write_diff_tables
from percept.export.report import write_report

__all__ = ["DiffRequest", "DiffRun", "run_diff"]

_OUTPUTS = ("diff.parquet", "diff_3d.parquet", "diff.json", "report.html")
_FEW_BOXES = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class DiffRequest:
    """What the command line asked for; see the options of `percept dataset diff`."""

    a: Path
    b: Path
    out: Path
    flags: Mapping[str, Any]
    config: Path | None
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class DiffRun:
    """What a run came to: the figures, how far they can be trusted, and what `--json` prints."""

    diff: SetDiff
    verdict: Verdict
    why: tuple[str, ...]
    document: dict[str, Any]


def run_diff(request: DiffRequest) -> DiffRun:
    """Read both sets, compare them, and fill the run folder.

    Raises:
        PerceptError: If a set, a setting or the folder cannot be used.
    """
    config = load_settings(DiffConfig, request.config, dict(request.flags))
    inputs = [
        folder / name
        for folder in (request.a, request.b)
        for name in (ABOUT, *(f"{table}.parquet" for table in TABLES))
    ]
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        with progress_bar("comparing", None):
            diff = compare_sets(read_set(request.a), read_set(request.b), config)
        folder.begin(inputs)
        verdict, why = _judged(diff)
        document = _document(diff, verdict, why)
        _write(folder, request, config, DiffRun(diff, verdict, why, document), inputs)
    return DiffRun(diff, verdict, why, document)


def _write(
    folder: RunFolder, request: DiffRequest, config: DiffConfig, run: DiffRun, inputs: list[Path]
) -> None:
    write_diff_tables(folder.path, run.diff)
    text = json.dumps(run.document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    (folder.path / "diff.json").write_text(text, encoding="utf-8")
    settings = config.model_dump(mode="json")
    report = label_diff_report(
        run.diff,
        folders=(request.a, request.b),
        verdict=run.verdict,
        why=run.why,
        inputs=[describe_input(path) for path in inputs],
        settings=settings,
    )
    write_report(folder.path / "report.html", report)
    folder.finish(
        config=settings,
        inputs=inputs,
        counts={key: run.document[key] for key in ("images", "keyframes", "boxes_2d", "boxes_3d")},
        dropped=run.diff.dropped,
        verdict=run.verdict,
        why=run.why,
        notes=run.diff.notes,
    )


def _document(diff: SetDiff, verdict: Verdict, why: tuple[str, ...]) -> dict[str, Any]:
    return {
        "verdict": str(verdict),
        "why": list(why),
        "images": len(diff.images),
        "keyframes": len(diff.moments),
        "boxes_2d": diff.total.document(),
        "by_class": _by_class(diff.by_class),
        "boxes_3d": diff.solids_total.document(),
        "by_class_3d": _by_class(diff.solids_by_class),
        "dropped": dict(diff.dropped),
        "notes": list(diff.notes),
    }


def _by_class(figures: Mapping[str, ClassFigures]) -> dict[str, Any]:
    return {label: one.document() for label, one in figures.items()}


def _judged(diff: SetDiff) -> tuple[Verdict, tuple[str, ...]]:
    """Return how far the figures can be trusted, and why."""
    boxes = diff.total.in_a + diff.total.in_b + diff.solids_total.in_a + diff.solids_total.in_b
    if not boxes:
        return Verdict.BAD, ("neither has a box in the images that both have",)
    doubts = [f"{number:,} {reason}" for reason, number in diff.dropped.items()]
    if diff.total.in_b < _FEW_BOXES:
        doubts.append(f"B has {diff.total.in_b} 2D boxes: its precision and recall mean little")
    if doubts:
        return Verdict.DOUBTFUL, tuple(doubts)
    return Verdict.GOOD, (f"all {len(diff.images):,} images are in both",)
