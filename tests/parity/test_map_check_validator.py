"""Rules against the issues that a published validator expects of its own maps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from map_check_oracle import FOLDER, RuleScore, score_rules

from percept.hdmap import load_map
from percept.hdmap.check import NOT_IMPLEMENTED, RULES, check_map

_LEAST = 0.95
# The validator's list says regulatory element, its page on the rule says lanelet.
_CONTRADICTED = "Intersection.RightOfWayWithTrafficLights-002"


@pytest.fixture(scope="module")
def folder(shared_data: Path) -> Path:
    """The maps and what is expected of them."""
    maps = shared_data / FOLDER
    if not maps.is_dir():
        pytest.skip(f"the validator's maps ({FOLDER}) are not among the shared data")
    return maps


@pytest.fixture(scope="module")
def scores(folder: Path) -> dict[str, RuleScore | None]:
    return score_rules(folder)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_what_is_expected_is_found_and_nothing_else(
    scores: dict[str, RuleScore | None], rule: object
) -> None:
    (name,) = (one.name for one in RULES if one is rule)
    score = scores.get(name)
    if score is None:
        pytest.skip("no issue is expected of this rule on any of the maps")
    assert score.precision >= _LEAST, dict(score.wrong)
    assert score.recall >= _LEAST, dict(score.missed)


def test_rules_that_are_not_implemented_are_named(scores: dict[str, RuleScore | None]) -> None:
    missing = {name for name, score in scores.items() if score is None}
    assert missing <= {rule.name for rule in NOT_IMPLEMENTED}


def test_numbers_are_those_of_the_validator(folder: Path) -> None:
    published = json.loads((folder / "issues_info.json").read_text(encoding="utf-8"))
    ours = {code.code: code for rule in RULES for code in rule.codes}
    left_out = {code for rule in NOT_IMPLEMENTED for code in rule.codes}
    for number, code in ours.items():
        if number in published:
            assert code.severity.lower() == published[number]["severity"].lower(), number
            if number != _CONTRADICTED:
                assert code.primitive == published[number]["primitive"], number
    assert set(published) <= set(ours) | left_out
    assert not set(ours) & left_out


def test_the_whole_sample_map_keeps_all_but_one_rule(folder: Path) -> None:
    issues = check_map(load_map(folder / "sample_map.osm"))
    # Four of its crosswalks have no stop line, which is worth a word and no error.
    assert {issue.issue_code for issue in issues} <= {"Crosswalk.RegulatoryElementDetails-003"}
