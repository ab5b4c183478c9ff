"""`percept map check` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from made_map import ROAD, MadeMap
from typer.testing import Result

from percept.hdmap.check import NOT_IMPLEMENTED, RULES

Run = Callable[..., Result]


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """A map with a speed limit that is none, and twelve stop lines that nothing refers to."""
    made = MadeMap()
    made.lane(0, 50, 0, 3.5, **{**ROAD, "speed_limit": "fast"})
    for x in range(12):
        made.line((x, 0), (x, 3.5), type="stop_line")
    return made.written(tmp_path)


def test_a_sound_map_ends_well(run: Run, tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 3.5)
    result = run("map", "check", made.written(tmp_path))
    assert result.exit_code == 0, result.output
    assert (
        f"1 lanelets, 2 line strings and 0 regulatory elements to {len(RULES)} rules: no issue"
        in (result.stdout)
    )


def test_issues_as_one_document(run: Run, broken: Path) -> None:
    result = run("map", "check", broken, "--json")
    assert result.exit_code == 4
    issues = json.loads(result.stdout)["issues"]
    assert len(issues) == 13
    first = issues[0]
    assert set(first) == {
        "issue_code", "rule", "severity", "primitive", "primitive_id", "message",
    }  # fmt: skip
    assert first["issue_code"] == "Lane.SpeedLimitValidity-001"
    assert first["rule"] == "mapping.lane.speed_limit_validity"
    assert (first["severity"], first["primitive"]) == ("Error", "lanelet")
    assert f"lanelet {first['primitive_id']} " in first["message"]


def test_issues_by_rule_for_people(run: Run, broken: Path) -> None:
    result = run("map", "check", broken)
    assert result.exit_code == 4
    lines = result.stdout.splitlines()
    assert lines[0] == "mapping.lane.speed_limit_validity: 1"
    assert "  StopLine.MissingRegulatoryElements-001  Error  12" in lines
    assert sum(" is a stop line " in line for line in lines) == 10
    assert "    and 2 more; --json lists all" in lines
    assert "13 issues (13 Error)" in lines[-1]


def test_only_the_rules_that_are_named(run: Run, broken: Path) -> None:
    result = run("map", "check", broken, "--json", "--rule", "mapping.lane.lanelet_geometry")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {"issues": []}
    names = ("mapping.lane.lanelet_geometry", "mapping.lane.speed_limit_validity")
    flags = [part for name in names for part in ("--rule", name)]
    assert len(json.loads(run("map", "check", broken, "--json", *flags).stdout)["issues"]) == 1


def test_the_list_of_rules(run: Run) -> None:
    result = run("map", "check", "--list-rules", "--json")
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert [rule["name"] for rule in document["rules"]] == [rule.name for rule in RULES]
    by_name = {rule["name"]: rule for rule in document["rules"]}
    sharing = by_name["mapping.lane.border_sharing"]
    assert sharing["codes"] == ["Lane.BorderSharing-001", "Lane.BorderSharing-002"]
    assert sharing["requirements"] == ["vm-01-03", "vm-01-04"]
    assert sharing["severity"] == "Error"
    left_out = [(rule.name, list(rule.codes)) for rule in NOT_IMPLEMENTED]
    assert [(rule["name"], rule["codes"]) for rule in document["not_implemented"]] == left_out
    for_people = run("map", "check", "--list-rules").stdout
    assert all(rule.name in for_people for rule in RULES)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, "no map is given"),
        (["MAP", "--rule", "mapping.lane.none"], 2, "--list-rules"),
        (["MAP", "--origin", "north"], 2, "LAT,LON"),
        (["NOWHERE"], 3, "cannot be read"),
        (["DRIVE"], 3, "is OpenDRIVE; the rules are for Lanelet2 maps"),
    ],
)
def test_what_cannot_be_checked_is_one_line(
    run: Run, broken: Path, tmp_path: Path, arguments: list[str], code: int, words: str
) -> None:
    drive = tmp_path / "road.xodr"
    drive.write_text('<OpenDRIVE><header revMajor="1" revMinor="7"/></OpenDRIVE>')
    places = {"MAP": broken, "DRIVE": drive, "NOWHERE": tmp_path / "none.osm"}
    result = run("map", "check", *(places.get(word, word) for word in arguments))
    assert result.exit_code == code
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


def test_the_page_names_every_rule_as_the_command_does() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "map-check.md").read_text("utf-8")
    rows = [[cell.strip() for cell in line.split(" | ")] for line in page.splitlines()]
    named = {row[1].split("`")[1]: row for row in rows if len(row) == 4 and "`" in row[1]}
    codes = {code.code: code for rule in RULES for code in rule.codes}
    assert set(named) == set(codes)
    for number, code in codes.items():
        row = named[number]
        assert row[2:] == [code.primitive, f"{code.remedy} |"]
        assert (f"({code.severity})" in row[1]) == (code.severity != "Error")
    for rule in RULES:
        needs = f" ({', '.join(rule.requirements)})" if rule.requirements else ""
        assert f"| `{rule.name}`{needs}: {rule.looks_for[0].lower()}{rule.looks_for[1:]} |" in page
    for missing in NOT_IMPLEMENTED:
        assert f"| `{missing.name}` | {', '.join(f'`{code}`' for code in missing.codes)} |" in page


def test_a_point_that_is_nowhere_is_one_line(run: Run, tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 1e300, 0, 3.5)
    result = run("map", "check", made.written(tmp_path))
    assert result.exit_code == 3
    assert "='1e+300' is no place on earth" in result.stderr
