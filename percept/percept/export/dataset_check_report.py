"""The report of `percept dataset check`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from percept.datasets.labelling.check.dataset import CheckResult
from percept.datasets.labelling.check.problems import CODES
from percept.export.report import Block, ReportContent, Section, Table

__all__ = ["dataset_check_report"]

_EXAMPLES = 20


def dataset_check_report(result: CheckResult, folder: Path) -> ReportContent:
    """Return the report of a check: the problems by kind with examples, and what is in the set.

    Args:
        result: What was found.
        folder: The folder that was checked.
    """
    sections = [Section("What was found", tuple(_kinds(result)))]
    sections += [
        Section(f"{code}: {CODES[code].means}", (_examples(result, code),)) for code in result.found
    ]
    sections.append(Section("What is in it", tuple(_contents(result))))
    return ReportContent(
        title=f"Check of {folder.resolve().name}",
        verdict=result.verdict,
        why=result.why,
        advice=tuple(
            f"{CODES[code].remedy} ({code})."
            for code in result.found
            if CODES[code].severity != "info"
        ),
        sections=tuple(section for section in sections if section.blocks),
        subtitle=f"{folder}: {result.counts['files']} files",
    )


def _kinds(result: CheckResult) -> Iterator[Block]:
    rows = tuple(
        (CODES[code].severity, code, f"{number:,}", CODES[code].means)
        for code, number in result.found.items()
    )
    if rows:
        yield Table(("severity", "code", "number", "means"), rows)


def _examples(result: CheckResult, code: str) -> Table:
    rows = [(one.where, one.message) for one in result.problems if one.code == code]
    shown = rows[:_EXAMPLES]
    number = result.found[code]
    caption = f"{len(shown)} of {number:,}" if number > len(shown) else ""
    return Table(("where", "what"), tuple(shown), caption)


def _contents(result: CheckResult) -> Iterator[Block]:
    splits = list(dict.fromkeys(split for row in result.histogram.values() for split in row))
    rows = tuple((split, f"{number:,}") for split, number in result.images.items())
    yield Table(("split", "images"), rows)
    parts = tuple(
        (name, *(f"{one[key]:,}" for key in ("images", "boxes")))
        for name, one in result.formats.items()
    )
    yield Table(("part", "images", "boxes in images"), parts)
    if splits:
        yield Table(
            ("class", *splits),
            tuple(
                (label, *(f"{row.get(split, 0):,}" for split in splits))
                for label, row in result.histogram.items()
            ),
            "Boxes in images by class and split",
        )
