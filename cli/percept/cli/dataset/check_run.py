"""The run behind `percept dataset check`: from a folder to what is wrong, and a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.datasets.labelling.check.dataset import CheckResult, check_dataset
from percept.export.dataset_check_report import dataset_check_report
from percept.export.report import write_report

__all__ = ["check_document", "run_check"]

_OUTPUTS = ("check.json", "report.html")


def run_check(folder: Path, out: Path | None, *, force: bool) -> CheckResult:
    """Check a folder; write a report where one is wanted.

    Raises:
        PerceptError: If the folder holds no data set, or the report cannot be written.
    """
    if out is None:
        with progress_bar("checking", None):
            return check_dataset(folder)
    with RunFolder(out, force=force, outputs=_OUTPUTS) as run:
        with progress_bar("checking", None):
            result = check_dataset(folder)
        run.begin([folder])
        document = check_document(result)
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        (run.path / "check.json").write_text(text, encoding="utf-8")
        write_report(run.path / "report.html", dataset_check_report(result, folder))
        run.finish(
            config={},
            inputs=(),
            counts=document["counts"],
            dropped={},
            verdict=result.verdict,
            why=result.why,
        )
    return result


def check_document(result: CheckResult) -> dict[str, Any]:
    """Return a result as `--json` prints it."""
    return {
        "verdict": str(result.verdict),
        "why": list(result.why),
        "problems": [one._asdict() for one in result.problems],
        "histogram": {label: dict(row) for label, row in result.histogram.items()},
        "counts": {
            **result.counts,
            "images_by_split": dict(result.images),
            "formats": {name: dict(one) for name, one in result.formats.items()},
            "problems": dict(result.found),
        },
    }
