"""Data that invite a wrong calibration: none ends good with a wrong answer.

The cases are in `hostile/`, their table in `hostile_table.py` and in docs/hostile-cases.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from concurrent.futures import Future

import pytest
from hostile.case import Case, Miss, Outcome
from hostile_table import HOSTILE_CASES, PAGE, key, page, running

Running = Mapping[str, Future[Outcome]]


@pytest.fixture(scope="module")
def outcomes(request: pytest.FixtureRequest) -> Iterator[Running]:
    """What comes of the cases whose tests were chosen; the page needs all of them."""
    chosen = {item.name for item in request.session.items}
    whole = test_the_page_lists_what_percept_says.__name__ in chosen
    cases = [case for case in HOSTILE_CASES if whole or f"[{key(case)}]" in "".join(chosen)]
    with running(cases) as futures:
        yield futures


@pytest.mark.parametrize("case", HOSTILE_CASES, ids=key)
def test_no_hostile_case_ends_with_a_wrong_answer(case: Case, outcomes: Running) -> None:
    outcome = outcomes[key(case)].result()
    assert not outcome.wrong(), (outcome.said, outcome.why)
    assert outcome.said in case.allowed, outcome


def test_the_table_is_long_and_its_names_are_distinct() -> None:
    assert len({key(case) for case in HOSTILE_CASES}) == len(HOSTILE_CASES) > 60


def test_the_page_lists_what_percept_says(outcomes: Running) -> None:
    text = PAGE.read_text(encoding="utf-8")
    made = page(text, {name: future.result() for name, future in outcomes.items()})
    assert _without_figures(text) == _without_figures(made)


def _without_figures(text: str) -> list[str]:
    """Return the lines without the numbers of the reasons, which another processor may round."""
    return [re.sub(r"-?\d+(\.\d+)?", "#", line) for line in text.splitlines()]


@pytest.mark.parametrize(
    ("said", "error", "sd", "wrong"),
    [
        ("good", 0.04, 0.001, 1),
        ("good", 0.04, 0.02, 0),
        ("good", 0.02, 0.001, 0),
        ("good", float("nan"), 0.02, 1),
        ("doubtful", 0.04, 0.001, 0),
        ("doubtful", 0.2, 0.001, 1),
        ("bad", 9.0, 0.001, 0),
    ],
)
def test_what_counts_as_wrong(said: str, error: float, sd: float, wrong: int) -> None:
    miss = Miss("translation (m)", error, sd, 0.03, 0.1)
    assert len(Outcome(said, "", (miss,)).wrong()) == wrong
