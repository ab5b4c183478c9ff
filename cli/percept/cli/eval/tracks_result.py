"""What a scoring of tracks is asked for, and what it comes to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from percept.core.results import Verdict
from percept.core.tracked_boxes import TrackedBoxes

__all__ = ["TrackEvalRequest", "TrackEvalRun"]

_FEW_OBJECTS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackEvalRequest:
    """What the command line asked for; see the options of `percept eval tracks`."""

    run: Path | None
    detections: tuple[Path, ...]
    tracks: Path | None
    labels: Path
    file_format: str | None
    online: bool
    coast: int | None
    config: Path | None
    out: Path | None
    force: bool


@dataclass(slots=True, eq=False, kw_only=True)
class TrackEvalRun:
    """What a scoring came to.

    Attributes:
        document: What `--json` prints.
        rows: Name of each class, or class and overlap, and its figures.
        objects: Boxes of the truth that count, over all classes.
        inputs: Files that were read.
        dropped: What was left out, by reason.
        notes: What else a user should know, as sentences.
        config: The resolved configuration.
        curves: By name the points (recall, MOTA, scaled MOTA).
        tracks: By sequence the tracks that were made here.
    """

    document: dict[str, Any]
    rows: dict[str, Mapping[str, float | None]]
    objects: int
    inputs: list[Path]
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    config: Mapping[str, Any] = field(default_factory=dict)
    curves: dict[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    tracks: dict[str, TrackedBoxes] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        """How far the figures can be trusted; it does not judge the tracker."""
        if not self.objects:
            return Verdict.BAD
        return Verdict.DOUBTFUL if self.why else Verdict.GOOD

    @property
    def why(self) -> list[str]:
        """Reasons for the verdict."""
        if not self.objects:
            return ["there is no object to track"]
        if self.objects < _FEW_OBJECTS:
            return [
                f"{self.objects} boxes of objects are few, from {_FEW_OBJECTS} on figures count"
            ]
        return []
