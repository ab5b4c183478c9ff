"""The run behind `percept eval map`: from findings and planted changes to scores."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import InputError
from percept.evaluation.map_findings import (
    MapScores,
    PlacedFinding,
    planted_changes,
    score_findings,
)
from percept.export.discrepancy_table import read_discrepancies
from percept.export.map_evaluation_report import map_scores_report
from percept.export.report import write_report

__all__ = ["MapEvalRequest", "run_map_eval"]

_TABLE, _CHANGES = "discrepancies.parquet", "map_changes.json"
_OUTPUTS = ("scores.json", "report.html")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapEvalRequest:
    """What the command line asked for; see the options of `percept eval map`."""

    run: Path
    truth: Path
    out: Path | None
    force: bool


def run_map_eval(request: MapEvalRequest) -> tuple[MapScores, dict[str, Any]]:
    """Read both sides, score, and fill the run folder where one is wanted.

    Returns:
        The scores, and the document that `--json` prints.

    Raises:
        PerceptError: If a file or the folder cannot be used.
    """
    table = request.run / _TABLE if request.run.is_dir() else request.run
    changes = _changes_file(request.truth)
    with ExitStack() as stack:
        out = None
        if request.out is not None:
            out = RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            stack.enter_context(out)
        planted = planted_changes(_read_json(changes), changes)
        scores = score_findings(_findings(table), planted, _driven_km(table.parent))
        document = scores.document()
        if out is not None:
            out.begin([table, changes])
            _write(out, scores, document, [table, changes])
    return scores, document


def _changes_file(truth: Path) -> Path:
    if not truth.is_dir():
        return truth
    folder = truth / "truth"
    return (folder if folder.is_dir() else truth) / _CHANGES


def _findings(table: Path) -> list[PlacedFinding]:
    return [
        PlacedFinding(
            finding_id=row.finding_id,
            kind=row.kind,
            map_element_id=row.map_element_id,
            offset_m=row.offset_m,
            middle_m=(row.x_m, row.y_m),
            points_m=row.points_m,
            status=row.status,
        )
        for row in read_discrepancies(table)
    ]


def _driven_km(run: Path) -> float | None:
    """Return how far the vehicle drove as `run.json` says it, or None where it does not."""
    record = run / "run.json"
    if not record.is_file():
        return None
    content = _read_json(record)
    counts = content.get("counts") if isinstance(content, dict) else None
    way_m = counts.get("way_m") if isinstance(counts, dict) else None
    return way_m / 1000 if isinstance(way_m, int | float) else None


def _read_json(path: Path) -> object:
    try:
        content: object = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    except ValueError as error:
        raise InputError(f"is no JSON ({error})", where=path) from error
    return content


def _write(
    folder: RunFolder, scores: MapScores, document: dict[str, Any], inputs: list[Path]
) -> None:
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "scores.json").write_text(text, encoding="utf-8")
    report = map_scores_report(scores, inputs=[describe_input(path) for path in inputs])
    write_report(folder.path / "report.html", report)
    total = scores.total
    folder.finish(
        config={},
        inputs=inputs,
        counts={"planted": total.planted, "found": total.found, "false": total.false},
        dropped=scores.dropped,
        verdict=scores.verdict,
        why=scores.why,
    )
