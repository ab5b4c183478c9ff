"""What `percept lanes` was asked for, and what it found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.core.results import Verdict

__all__ = ["LaneRequest", "LaneRun"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneRequest:
    """What the command line asked for; see the options of `percept lanes`."""

    images: tuple[Path, ...]
    bags: tuple[Path, ...]
    topic: str | None
    rig: Path | None
    camera: str | None
    flags: dict[str, Any]
    model: Path | None
    every: int
    config: Path | None
    start_s: float | None
    end_s: float | None
    out: Path | None
    force: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneRun:
    """What a run found.

    Attributes:
        images: The JSON objects of the first images; those of a long log are not all kept.
        counts: What was found, in numbers.
        dropped: What was left out, by reason.
        verdict: How far the result can be trusted.
        why: Reasons for the verdict.
    """

    images: tuple[dict[str, Any], ...]
    counts: dict[str, int]
    dropped: dict[str, int]
    verdict: Verdict
    why: tuple[str, ...]
