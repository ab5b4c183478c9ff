"""States of traffic lights against truth: right, unknown, wrong, how late, and false flashes.

A moment counts where the truth says that a camera sees the light. What the results say at the
time nearest to it is held against it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from percept.core.clock import seconds_from_ns
from percept.core.errors import InputError
from percept.core.results import LightStates, Verdict
from percept.evaluation.light_series import LightPiece, LightSeries, light_pieces, light_series

__all__ = ["LightCounts", "LightScores", "score_lights"]

_LEAST_TOLERANCE_NS = 60_000_000
_LARGEST_GAP_NS = 500_000_000
_FEW_LIGHTS = 10
_FEW_MOMENTS = 300
_UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class LightCounts:
    """What was counted; of several lights it adds up.

    Attributes:
        moments: At which a camera sees the light.
        right: Of these, the state is that of the truth.
        unknown: The results say `unknown`.
        unreported: The results say nothing of the light.
        red_as_green: The truth is red and the results say green.
        at_a_change: Moments that were not counted, since the light changes between them and the
            nearest time of the results.
        false_flash: The results say that a steady light flashes.
        falsely_flashing: Steady lights of which they ever do.
        steady: Lights that are seen while they do not flash.
        delays_s: Of each change that is seen, how much later the results show it.
        late: Changes that they do not show before the next one, or before the light is gone.
        flash_delays_s: Of each flashing light, the time from when the results first name a
            camera that sees it until they say that it flashes.
        flash_missed: Flashing lights of which they never do.
    """

    moments: int = 0
    right: int = 0
    unknown: int = 0
    unreported: int = 0
    red_as_green: int = 0
    at_a_change: int = 0
    false_flash: int = 0
    falsely_flashing: int = 0
    steady: int = 0
    delays_s: tuple[float, ...] = ()
    late: int = 0
    flash_delays_s: tuple[float, ...] = ()
    flash_missed: int = 0

    def __add__(self, other: LightCounts) -> LightCounts:
        names = self.__dataclass_fields__
        return LightCounts(**{name: getattr(self, name) + getattr(other, name) for name in names})

    @property
    def wrong(self) -> int:
        """Moments at which the results name another state."""
        return self.moments - self.right - self.unknown - self.unreported

    def document(self) -> dict[str, Any]:
        """Return the figures by name; None where there is nothing to divide by."""
        return {
            "moments": self.moments,
            "state_accuracy": _share(self.right, self.moments),
            "known_accuracy": _share(self.right, self.right + self.wrong),
            "unknown_rate": _share(self.unknown + self.unreported, self.moments),
            "wrong": self.wrong,
            "unknown": self.unknown,
            "unreported": self.unreported,
            "red_as_green": self.red_as_green,
            "at_a_change": self.at_a_change,
            "changes": len(self.delays_s) + self.late,
            "changes_missed": self.late,
            "delay_median_s": _percentile(self.delays_s, 50),
            "delay_p95_s": _percentile(self.delays_s, 95),
            "flashing_lights": len(self.flash_delays_s) + self.flash_missed,
            "flash_missed": self.flash_missed,
            "flash_delay_median_s": _percentile(self.flash_delays_s, 50),
            "flash_delay_p95_s": _percentile(self.flash_delays_s, 95),
            "steady_lights": self.steady,
            "falsely_flashing_lights": self.falsely_flashing,
            "false_flash_moments": self.false_flash,
        }


@dataclass(frozen=True, slots=True)
class LightScores:
    """The counts of each light by its id in the map, and what was left out, by reason."""

    by_light: Mapping[int, LightCounts]
    dropped: Counter[str] = field(default_factory=Counter)

    @property
    def total(self) -> LightCounts:
        """The counts of all lights together."""
        return sum(self.by_light.values(), LightCounts())

    @property
    def verdict(self) -> Verdict:
        """How far the figures can be trusted; it does not judge the results."""
        if not self.total.moments:
            return Verdict.BAD
        return Verdict.DOUBTFUL if self.why else Verdict.GOOD

    @property
    def why(self) -> tuple[str, ...]:
        """Reasons for the verdict."""
        total = self.total
        if not total.moments:
            return ("there is no moment at which a camera sees a light",)
        why = []
        if total.unreported == total.moments:
            why.append("the results speak of none of these lights")
        if len(self.by_light) < _FEW_LIGHTS:
            why.append(f"{len(self.by_light)} lights are few, from {_FEW_LIGHTS} on figures count")
        if total.moments < _FEW_MOMENTS:
            why.append(f"{total.moments} moments are few, from {_FEW_MOMENTS} on figures count")
        return tuple(why)


def score_lights(
    truth: Iterable[LightStates],
    found: Iterable[LightStates],
    images_ns: Iterable[int] | None = None,
) -> LightScores:
    """Compare lights with the truth, by their ids in the map.

    Args:
        truth: What the lights showed and which cameras saw them; flashing lights have the
            colour that flashes, also while it is dark.
        found: The results.
        images_ns: Stamps of the images that the results rest on; None takes those of the
            results. Truth of before the first or after the last one does not count.

    Raises:
        InputError: If the results speak of lights, but of none that the truth has.
    """
    real, ours = light_series(truth), light_series(found)
    strangers = sorted(set(ours) - set(real))
    if ours and not set(ours) & set(real):
        raise InputError(
            f"lights cannot be scored: the results have {len(ours)} with ids of their own "
            f"({strangers[0]}, ...), and the truth goes by the ids of the map",
            remedy="Detect with --map",
        )
    dropped: Counter[str] = Counter()
    if strangers:
        dropped["lights that the truth does not have"] = len(strangers)
    stamps = np.unique(
        np.array(sorted(images_ns), np.int64)
        if images_ns is not None
        else np.concatenate([np.zeros(0, np.int64), *(s.stamps_ns for s in ours.values())])
    )
    nothing = LightSeries(np.zeros(0, np.int64), (), np.zeros(0, bool), np.zeros(0, bool))
    by_light = {}
    for light, series in real.items():
        kept = _within(series, stamps)
        outside = int(series.seen.sum() - kept.seen.sum())
        if outside:
            dropped["moments of the truth outside of the time of the results"] += outside
        if kept.seen.any():
            by_light[light] = _score(kept, ours.get(light, nothing), _tolerance_ns(stamps))
    return LightScores(by_light, dropped)


def _tolerance_ns(stamps: np.ndarray[Any, np.dtype[np.int64]]) -> int:
    """Return how far results may lie from a moment: a little over half of the usual interval."""
    if len(stamps) < 2:
        return _LEAST_TOLERANCE_NS
    return max(_LEAST_TOLERANCE_NS, round(0.6 * float(np.median(np.diff(stamps)))))


def _within(series: LightSeries, stamps: np.ndarray[Any, np.dtype[np.int64]]) -> LightSeries:
    if not len(stamps):
        return series
    slack = _tolerance_ns(stamps)
    rows = np.flatnonzero(
        (series.stamps_ns >= stamps[0] - slack) & (series.stamps_ns <= stamps[-1] + slack)
    )
    states = tuple(series.states[row] for row in rows)
    return LightSeries(series.stamps_ns[rows], states, series.flashing[rows], series.seen[rows])


def _score(truth: LightSeries, found: LightSeries, tolerance_ns: int) -> LightCounts:
    counts = LightCounts()
    for piece in light_pieces(truth, _LARGEST_GAP_NS):
        counts += _score_moments(truth, piece, found, tolerance_ns)
        if piece.changed:
            counts += _score_change(truth, piece, found)
    return counts + _score_flashing(truth, found)


def _score_moments(
    truth: LightSeries, piece: LightPiece, found: LightSeries, tolerance_ns: int
) -> LightCounts:
    seen: Any = Counter()
    for row in range(*piece.rows):
        stamp_ns = int(truth.stamps_ns[row])
        answer = found.nearest(stamp_ns, tolerance_ns)
        if answer is None:
            seen["unreported"] += 1
        elif _changes_between(truth, row, int(found.stamps_ns[answer])):
            seen["at_a_change"] += 1
            continue
        else:
            state = found.states[answer]
            seen["right"] += state == piece.state
            seen["unknown"] += state == _UNKNOWN
            seen["red_as_green"] += (piece.state, state) == ("red", "green")
            seen["false_flash"] += bool(found.flashing[answer]) and not piece.flashing
        seen["moments"] += 1
    return LightCounts(**seen)


def _changes_between(truth: LightSeries, row: int, stamp_ns: int) -> bool:
    """Return whether the moment on the other side of a time shows something else."""
    side = int(np.sign(stamp_ns - int(truth.stamps_ns[row])))
    other = row + side
    if side == 0 or not 0 <= other < len(truth.stamps_ns):
        return False
    shown = (truth.states[row], truth.flashing[row])
    return shown != (truth.states[other], truth.flashing[other])


def _score_change(truth: LightSeries, piece: LightPiece, found: LightSeries) -> LightCounts:
    """Return the delay of the change that begins a piece.

    The change is taken to be midway between two moments of the truth. Results that had the new
    state before show it at once, as far as times tell.
    """
    first, after = piece.rows
    before_ns, begin_ns = int(truth.stamps_ns[first - 1]), int(truth.stamps_ns[first])
    end_ns = int(truth.stamps_ns[after - 1]) + 1
    shown = found.first(before_ns, end_ns, found.shows(piece.state))
    if shown is None:
        return LightCounts(late=1)
    return LightCounts(delays_s=(seconds_from_ns(shown - (before_ns + begin_ns) // 2),))


def _score_flashing(truth: LightSeries, found: LightSeries) -> LightCounts:
    """Return how long it takes to say that a light flashes, or whether that is said wrongly.

    Once for a light: what flashes is seen to do so when it comes into view.
    """
    wrong = 0
    steady = truth.seen & ~truth.flashing
    if steady.any():
        said = found.stamps_ns[found.flashing]
        near = [int(np.argmin(np.abs(truth.stamps_ns - stamp))) for stamp in said]
        wrong = int(any(steady[row] for row in near))
    result = LightCounts(steady=int(steady.any()), falsely_flashing=wrong)
    flashes = truth.stamps_ns[truth.seen & truth.flashing]
    if not len(flashes):
        return result
    start_ns, end_ns = int(flashes[0]) - _LEAST_TOLERANCE_NS, int(flashes[-1]) + _LARGEST_GAP_NS
    seen_ns = found.first(start_ns, end_ns, found.seen)
    said_ns = None if seen_ns is None else found.first(seen_ns, end_ns, found.flashing)
    if seen_ns is None or said_ns is None:
        return result + LightCounts(flash_missed=1)
    return result + LightCounts(flash_delays_s=(seconds_from_ns(said_ns - seen_ns),))


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _percentile(values: tuple[float, ...], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None
