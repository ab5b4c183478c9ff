"""3D detections against truth boxes: recall, precision and class confusion by range."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.results import Detections3D
from percept.evaluation.bands import RANGE_BANDS, range_band

__all__ = ["DetectionScores", "Match", "match_detections"]

_LEAST_GATE_M = 1.0


@dataclass(frozen=True, slots=True)
class Match:
    """One truth box with its detection, or one of the two alone.

    Attributes:
        truth: Class of the truth box; None for a detection that is nothing.
        detected: Class of the detection; None for a truth box that was missed.
        range_m: Horizontal distance of the truth box, or of the detection where there is none.
        centre_error_m: Distance of the two centres in bird's-eye view; NaN without a pair.
    """

    truth: str | None
    detected: str | None
    range_m: float
    centre_error_m: float = float("nan")


@dataclass(frozen=True, slots=True)
class DetectionScores:
    """All matches, misses and false detections; adds up over frames."""

    matches: tuple[Match, ...] = ()

    def __add__(self, other: DetectionScores) -> DetectionScores:
        return DetectionScores(self.matches + other.matches)

    def within(self, band: str | None) -> DetectionScores:
        """Return the matches of one range band; None is all ranges."""
        return DetectionScores(
            tuple(m for m in self.matches if band in (None, range_band(m.range_m)))
        )

    def recall(self, label: str | None = None, *, same_class: bool = False) -> float:
        """Return the share of truth boxes (of a class) that were found; NaN when there are none.

        Args:
            label: A truth class; None is all.
            same_class: Whether a detection of another class does not count.
        """
        truths = [m for m in self.matches if m.truth is not None and label in (None, m.truth)]
        found = [m for m in truths if m.detected is not None]
        return _share(found, truths, same_class=same_class)

    def precision(self, label: str | None = None, *, same_class: bool = False) -> float:
        """Return the share of detections (of a class) that are a truth box; NaN of none.

        Args:
            label: A detected class; None is all.
            same_class: Whether a truth box of another class does not count.
        """
        made = [m for m in self.matches if m.detected is not None and label in (None, m.detected)]
        right = [m for m in made if m.truth is not None]
        return _share(right, made, same_class=same_class)

    def confusion(self) -> dict[tuple[str, str], int]:
        """Return how often each (truth class, detected class) was matched."""
        return dict(
            Counter(
                (m.truth, m.detected)
                for m in self.matches
                if m.truth is not None and m.detected is not None
            )
        )

    def __str__(self) -> str:
        rows = [
            f"{'class':<14}{'range':<10}{'truth':>6}{'made':>6}{'recall':>8}{'+class':>8}"
            f"{'precision':>11}{'+class':>8}"
        ]
        classes = {m.truth for m in self.matches} | {m.detected for m in self.matches}
        for label in [*sorted(name for name in classes if name is not None), None]:
            for band in (*RANGE_BANDS, None):
                part = self.within(band)
                truth = sum(m.truth is not None and label in (None, m.truth) for m in part.matches)
                made = sum(
                    m.detected is not None and label in (None, m.detected) for m in part.matches
                )
                if truth or made:
                    rows.append(
                        f"{label or 'all':<14}{band or 'all':<10}{truth:>6}{made:>6}"
                        f"{_as_text(part.recall(label)):>8}"
                        f"{_as_text(part.recall(label, same_class=True)):>8}"
                        f"{_as_text(part.precision(label)):>11}"
                        f"{_as_text(part.precision(label, same_class=True)):>8}"
                    )
        return "\n".join(rows)


def _as_text(share: float) -> str:
    return "-" if np.isnan(share) else f"{share:.2f}"


def _share(part: list[Match], whole: list[Match], *, same_class: bool) -> float:
    kept = [m for m in part if not same_class or m.truth == m.detected]
    return len(kept) / len(whole) if whole else float("nan")


def match_detections(
    detections: Detections3D,
    truth_boxes_m: NDArray[np.floating],
    truth_labels: Sequence[str],
    ignored: NDArray[np.bool_] | None = None,
) -> DetectionScores:
    """Match detections with truth boxes, the most confident first, each with the nearest left.

    A pair is allowed while its centres are at most max(1 m, half the truth box's diagonal) apart
    in bird's-eye view: a LiDAR sees the near side of an object, so that centres are biased by up
    to that. Classes play no part in matching; they are compared afterwards.

    Args:
        detections: Boxes of one scan.
        truth_boxes_m: (K, 7) in the frame of the detections.
        truth_labels: K class names.
        ignored: (K,) bool, truth boxes that nobody could find (hidden, too far): neither they
            nor the detections on them are counted. None ignores nothing.

    Raises:
        GeometryError: If the truth's columns have different lengths.
    """
    count = len(truth_labels)
    truth = np.asarray(truth_boxes_m, dtype=np.float64).reshape(-1, 7)
    ignored = np.zeros(count, bool) if ignored is None else ignored
    if len(truth) != count or len(ignored) != count:
        raise GeometryError(
            f"{len(truth)} truth boxes with {count} labels and {len(ignored)} ignore marks"
        )
    gates = np.maximum(np.hypot(truth[:, 3], truth[:, 4]) / 2.0, _LEAST_GATE_M)
    partner, errors = _greedy(detections, truth, gates)
    matches = []
    for row, label in enumerate(detections.labels):
        t = partner[row]
        if t < 0:
            matches.append(Match(None, label, _range(detections.boxes_m[row])))
        elif not ignored[t]:
            matches.append(Match(truth_labels[t], label, _range(truth[t]), float(errors[row])))
    matched = set(partner.tolist())
    missed = [t for t in range(count) if t not in matched and not ignored[t]]
    matches += [Match(truth_labels[t], None, _range(truth[t])) for t in missed]
    return DetectionScores(tuple(matches))


def _range(box_m: NDArray[np.float64]) -> float:
    return float(np.hypot(box_m[0], box_m[1]))


def _greedy(
    detections: Detections3D, truth: NDArray[np.float64], gates: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return each detection's truth row (-1 is none) and the distance to it."""
    partner = np.full(len(detections), -1)
    errors = np.full(len(detections), np.nan)
    free = np.ones(len(truth), bool)
    for row in np.argsort(-detections.confidences, kind="stable"):
        offsets = truth[:, :2] - detections.boxes_m[row, :2]
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        distances[~free | (distances > gates)] = np.inf
        if len(truth) and np.isfinite(distances.min()):
            partner[row] = np.argmin(distances)
            errors[row] = distances.min()
            free[partner[row]] = False
    return partner, errors
