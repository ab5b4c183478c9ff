"""All hostile cases, and the page of the documentation that lists them.

Write the page anew with `.venv/bin/python tests/truth/hostile_table.py`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from hostile.camera_cases import CAMERA_CASES
from hostile.camera_lidar_cases import CAMERA_LIDAR_CASES
from hostile.case import Case, Outcome
from hostile.command_cases import COMMAND_CASES
from hostile.lidar_cases import LIDAR_CASES

__all__ = ["HOSTILE_CASES", "PAGE", "key", "page", "running"]

HOSTILE_CASES: tuple[Case, ...] = tuple(
    case
    for kind in ("lidar", "camera", "camera-lidar")
    for case in (*LIDAR_CASES, *CAMERA_CASES, *CAMERA_LIDAR_CASES, *COMMAND_CASES)
    if case.kind == kind
)
PAGE = Path(__file__).resolve().parents[2] / "docs" / "hostile-cases.md"

_WORKERS = 2
_LONGEST = 150


def key(case: Case) -> str:
    """Return the name by which a case is chosen: its kind and its name."""
    return f"{case.kind}: {case.name}"


@contextmanager
def running(cases: Sequence[Case]) -> Iterator[Mapping[str, Future[Outcome]]]:
    """Run cases on two processors; a warning of numpy's is an error."""
    pool = ProcessPoolExecutor(
        _WORKERS, get_context("spawn"), warnings.simplefilter, ("error", RuntimeWarning)
    )
    try:
        yield {key(case): pool.submit(case.outcome) for case in cases}
    finally:
        pool.shutdown(cancel_futures=True)


def page(text: str, outcomes: Mapping[str, Outcome]) -> str:
    """Return the page's text with its tables made anew."""
    for kind in ("lidar", "camera", "camera-lidar"):
        rows = [_row(c, outcomes[key(c)]) for c in HOSTILE_CASES if c.kind == kind]
        table = "\n".join(["| case | what is wrong | percept says |", "|---|---|---|", *rows])
        mark = f"<!-- made by tests/truth/hostile_table.py: {kind} -->"
        before, found, rest = text.partition(mark)
        if not found:
            raise ValueError(f"no place for the table of {kind}")
        text = f"{before}{mark}\n{table}\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    return text


def _row(case: Case, outcome: Outcome) -> str:
    cells = (case.name, case.wrong, f"**{outcome.said}**: {_in_short(outcome.why)}")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _in_short(why: str) -> str:
    """Return the first sentence of a reason, without what follows a semicolon or a long list."""
    first = re.split(r"\. (?=[A-Z])|; ", why.removeprefix("error: "))[0].rstrip(".")
    if len(first) <= _LONGEST:
        return first
    return first[:_LONGEST].rpartition(" ")[0].rstrip(",:(") + " ..."


def main() -> None:
    """Write the page."""
    with running(HOSTILE_CASES) as futures:
        outcomes = {name: future.result() for name, future in futures.items()}
    text = page(PAGE.read_text(encoding="utf-8"), outcomes)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
