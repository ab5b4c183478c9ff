"""The issues that a published validator expects of its own maps, against those that are found."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from percept.hdmap import HdMap, load_map
from percept.hdmap.check import RULES, check_map

__all__ = ["FOLDER", "RuleScore", "score_rules"]

FOLDER = "hdmap/lanelet2_validator"
Issue = tuple[str, int]


@dataclass(slots=True)
class RuleScore:
    """How the issues of one rule meet what is expected over all of its maps.

    Attributes:
        maps: Maps that the rule is held to.
        right: Issues found that are expected: same number, same primitive, as often.
        wrong: Maps with what was found there and not expected.
        missed: Maps with what was expected there and not found.
    """

    maps: int = 0
    right: int = 0
    wrong: dict[str, Counter[Issue]] = field(default_factory=lambda: defaultdict(Counter))
    missed: dict[str, Counter[Issue]] = field(default_factory=lambda: defaultdict(Counter))

    @property
    def precision(self) -> float:
        """Share of what is found that is expected; 1 where nothing is found."""
        wrong = sum(counts.total() for counts in self.wrong.values())
        return self.right / (self.right + wrong) if self.right + wrong else 1.0

    @property
    def recall(self) -> float:
        """Share of what is expected that is found; 1 where nothing is expected."""
        missed = sum(counts.total() for counts in self.missed.values())
        return self.right / (self.right + missed) if self.right + missed else 1.0


def score_rules(folder: Path) -> dict[str, RuleScore | None]:
    """Hold each map to the rule that an issue is expected of.

    Args:
        folder: The maps and `expected_issues.json`.

    Returns:
        A score for each rule by name; None of one that is not implemented.
    """

    @cache
    def loaded(name: str) -> HdMap:
        return load_map(folder / name, anywhere=True)

    prefixes = {rule.name: rule.codes[0].code[:-3] for rule in RULES}
    scores: dict[str, RuleScore | None] = {}
    for row in json.loads((folder / "expected_issues.json").read_text(encoding="utf-8")):
        rule, name = row["validator"], row["map"]
        if rule not in prefixes:
            scores[rule] = None
            continue
        expected = Counter(
            (f"{prefixes[rule]}{issue['code']:03d}", issue["primitive_id"])
            for issue in row["expected_issues"]
        )
        issues = check_map(loaded(name), [rule])
        found = Counter((issue.issue_code, issue.primitive_id) for issue in issues)
        score = scores.setdefault(rule, RuleScore())
        if score is not None:
            _add(score, name, expected, found)
    return scores


def _add(score: RuleScore, name: str, expected: Counter[Issue], found: Counter[Issue]) -> None:
    score.maps += 1
    score.right += (expected & found).total()
    score.wrong[name] += found - expected
    score.missed[name] += expected - found
