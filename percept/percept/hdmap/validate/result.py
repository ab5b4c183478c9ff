"""What a validation of a map says."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from percept.core.map_findings import Discrepancy
from percept.core.results import Verdict

__all__ = ["ElementCoverage", "StretchOffset", "Validation"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementCoverage:
    """How well a stretch of an element of the map was seen.

    Attributes:
        map_element_id: Line string.
        along_m: From its start to the start of the stretch.
        length_m: Length of the stretch.
        observed_share: Share of its length that enough looks saw.
        visits: The most visits of one of its places.
        reason: Why the rest was not seen: `out of view`, `occluded`, `too far`, `too dark`;
            empty where all of it was seen.
    """

    map_element_id: int
    along_m: float
    length_m: float
    observed_share: float
    visits: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StretchOffset:
    """How far the paint lay off the map over some 10 m of a drive.

    Attributes:
        drive: Number of the drive.
        along_m: Way since the start of the drive.
        x_m: Where the vehicle was in the map frame.
        y_m: The same.
        yaw_rad: Where it headed in the map frame.
        lateral_m: How far paint lay to the left of the map's lines, seen from the vehicle.
        heading_rad: By how much it was turned to the left.
        sd_m: Spread of `lateral_m`.
        lines: How many lines agreed, fading ones in parts; 0 where none was seen yet.
        ambiguous: Whether another shift had nearly as many lines.
    """

    drive: int
    along_m: float
    x_m: float
    y_m: float
    yaw_rad: float
    lateral_m: float
    heading_rad: float
    sd_m: float
    lines: float
    ambiguous: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Validation:
    """Where road and map disagree, and how much of the map was seen at all.

    Attributes:
        discrepancies: Findings, the surest first.
        coverage: Stretches of the elements near the drives.
        offsets: Shift of the poses against the map along the drives.
        counts: What was looked at and found, by what it is.
        dropped: What was left out and why.
        notes: What a reader should know, as sentences.
        verdict: How far it can be trusted.
        why: The reason.
    """

    discrepancies: tuple[Discrepancy, ...]
    coverage: tuple[ElementCoverage, ...]
    offsets: tuple[StretchOffset, ...]
    counts: Counter[str]
    dropped: Counter[str]
    notes: tuple[str, ...]
    verdict: Verdict
    why: str
