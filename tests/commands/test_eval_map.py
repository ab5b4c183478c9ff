"""`percept eval map` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from percept.core.map_findings import Discrepancy, Kind
from percept.export.discrepancy_table import DISCREPANCIES, discrepancy_rows
from percept.export.tables import write_parquet

Run = Callable[..., Result]


def found(kind: Kind, element: int, x: float, y: float) -> Discrepancy:
    return Discrepancy(
        finding_id=f"{kind}-{element}-{x:g}",
        kind=kind,
        map_element_id=element,
        along_m=0.0,
        offset_m=0.58 if kind is Kind.MOVED else np.nan,
        length_m=20.0,
        sd_m=0.05,
        observations=9,
        visits=1,
        confidence=0.9,
        expected="",
        observed="",
        points_map=np.array([[x - 10, y, 0], [x + 10, y, 0]]),
        points_expected_map=np.zeros((0, 3)),
    )


def planted(kind: str, element: int, x: float, y: float) -> dict[str, Any]:
    return {"kind": kind, "map_element_id": element, "x": x, "y": y,
            "offset_m": 0.6 if kind == "moved" else None,
            "points": [[x - 15, y], [x + 15, y]]}  # fmt: skip


@pytest.fixture
def results(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    findings = [
        found(Kind.MOVED, 7, 75, -3.5),
        found(Kind.MISSING_IN_MAP, 0, 130, -7),
        found(Kind.COLOUR, 9, 40, 0),
    ]
    rows = discrepancy_rows(findings, {}, None)
    write_parquet(folder / "discrepancies.parquet", DISCREPANCIES, [rows])
    (folder / "run.json").write_text(json.dumps({"counts": {"way_m": 250.0}}))
    return folder


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    folder = tmp_path / "street" / "truth"
    folder.mkdir(parents=True)
    changes = [
        planted("moved", 7, 75, -3.5),
        planted("missing_in_map", 0, 135, -7),
        planted("type", 8, 105, 0),
    ]
    (folder / "map_changes.json").write_text(json.dumps(changes))
    return folder.parent


def test_a_run_against_its_planted_changes(
    run: Run, results: Path, truth: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = run("eval", "map", results, "--truth", truth, "--out", out)
    assert done.exit_code == 0, done.output
    assert "driven: 0.25 km, 4.00 false findings a km" in done.stdout
    assert "missed: type at 105.0, 0.0, element 8" in done.stdout
    assert "false: colour at 40.0, 0.0, element 9" in done.stdout
    assert "verdict: doubtful" in done.stdout
    scores = json.loads((out / "scores.json").read_text())
    assert (scores["planted"], scores["found"], scores["false"]) == (3, 2, 1)
    assert scores["by_kind"]["moved"]["offset_error_m"] == pytest.approx(0.02)
    assert "2 of 3 changes found" in (out / "report.html").read_text()
    assert json.loads((out / "run.json").read_text())["counts"]["planted"] == 3
    table = results / "discrepancies.parquet"
    said = run("eval", "map", table, "--truth", truth / "truth" / "map_changes.json", "--json")
    assert json.loads(said.stdout) == scores


def test_an_unchanged_map_is_scored_by_the_way(run: Run, results: Path, truth: Path) -> None:
    (truth / "truth" / "map_changes.json").write_text("[]")
    scores = json.loads(run("eval", "map", results, "--truth", truth, "--json").stdout)
    assert scores["false_per_km"] == 12.0
    assert scores["recall"] is None
    (results / "run.json").unlink()
    done = run("eval", "map", results, "--truth", truth)
    assert done.exit_code == 4
    assert "how far the vehicle drove is not known" in done.stdout


def test_what_cannot_be_scored_is_said_in_one_line(
    run: Run, results: Path, truth: Path, tmp_path: Path
) -> None:
    changes = truth / "truth" / "map_changes.json"
    broken = tmp_path / "broken.json"
    broken.write_text("{")
    for arguments, said in (
        ((results, "--truth", broken), "broken.json: is no JSON"),
        ((results, "--truth", tmp_path), "map_changes.json: cannot be read"),
        ((truth, "--truth", changes), "discrepancies.parquet: there is no such table"),
    ):
        done = run("eval", "map", *arguments)
        assert done.exit_code == 3, done.output
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
