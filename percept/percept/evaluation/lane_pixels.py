"""Lanes in pixels by the rules of the TuSimple lane benchmark.

Lanes are given by their u at common rows (`h_samples`), negative where they are not. A point is
right within 20 px / cos(angle) of the lane's own direction; a lane of the labels is found when the
best of ours is right at 85 % of the rows. Rows at which neither has a lane are right, too.
Accuracy is the mean of the best shares, at most four lanes an image; FP is the share of ours that
find none, FN the share of the labels that are not found (tusimple-benchmark, doc/lane_detection).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict

__all__ = ["ImageLanes", "PixelLaneScores", "lanes_of_mask", "sample_line", "score_pixel_lanes"]

_F64 = NDArray[np.float64]
_RIGHT_PX, _MATCHED, _MOST_LANES, _SPARE_LANES = 20.0, 0.85, 4, 2
_ABSENT = -2.0
_ROW_STEP_PX = 10
_FEWEST_ROWS = 3
_FEW_IMAGES = 30


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageLanes:
    """Lanes of one image.

    Attributes:
        image: Its name.
        rows_px: (R,) float64 v of the rows.
        lanes_px: (L, R) float64 u of each lane at the rows; negative where it is not.
    """

    image: str
    rows_px: _F64
    lanes_px: _F64


@dataclass(frozen=True, slots=True)
class PixelLaneScores:
    """Scores by image: accuracy, false positives and false negatives, as shares.

    Attributes:
        by_image: The three by the image's name.
        ego_rows: Rows of the labels of the two lanes beside the middle of the image.
        ego_right: Of these, the rows at which one of ours is within 20 px, level.
        dropped: What was left out, by reason.
    """

    by_image: Mapping[str, tuple[float, float, float]]
    ego_rows: int
    ego_right: int
    dropped: Counter[str] = field(default_factory=Counter)

    @property
    def verdict(self) -> Verdict:
        """How far the figures can be trusted; it does not judge the results."""
        if not self.by_image:
            return Verdict.BAD
        return Verdict.DOUBTFUL if self.why else Verdict.GOOD

    @property
    def why(self) -> tuple[str, ...]:
        """Reasons for the verdict."""
        if not self.by_image:
            return ("no image has both results and labels",)
        if len(self.by_image) < _FEW_IMAGES:
            return (f"{len(self.by_image)} images are few, from {_FEW_IMAGES} on figures count",)
        return ()

    def document(self) -> dict[str, Any]:
        """Return all figures by name; None where there is nothing to divide by."""
        names = ("accuracy", "fp", "fn")
        sums = np.array(list(self.by_image.values())).reshape(-1, 3)
        means = sums.mean(axis=0).tolist() if len(sums) else [None] * 3
        return {
            "images": len(self.by_image),
            **dict(zip(names, means, strict=True)),
            "ego_rows": self.ego_rows,
            "ego_share": self.ego_right / self.ego_rows if self.ego_rows else None,
            "by_image": {
                image: dict(zip(names, one, strict=True)) for image, one in self.by_image.items()
            },
            "verdict": str(self.verdict),
            "why": list(self.why),
            "dropped": dict(self.dropped),
        }


def score_pixel_lanes(
    results: Sequence[ImageLanes],
    labels: Sequence[ImageLanes],
    widths_px: Mapping[str, int] | None = None,
) -> PixelLaneScores:
    """Score lanes image by image, by the names of the images.

    Args:
        results: Ours, at the rows of the labels or others: they are interpolated.
        labels: The truth.
        widths_px: Widths of images, to know the two lanes beside the middle; without one the
            middle is not known and `ego_rows` stays 0.
    """
    ours = {one.image: one for one in results}
    dropped: Counter[str] = Counter()
    by_image, rows, right = {}, 0, 0
    for truth in labels:
        found = ours.get(truth.image)
        if found is None:
            dropped["labelled images without a result"] += 1
            continue
        lanes = _at_rows(found, truth.rows_px)
        by_image[truth.image] = _score_image(lanes, truth)
        width = (widths_px or {}).get(truth.image)
        if width is not None:
            pair = _ego_lanes(truth.lanes_px, (width - 1) / 2)
            rows += int((pair >= 0).sum())
            right += _rows_right(lanes, pair)
    known = {one.image for one in labels}
    strangers = sum(one.image not in known for one in results)
    if strangers:
        dropped["results of images without labels"] = strangers
    return PixelLaneScores(by_image, rows, right, dropped)


def sample_line(points_px: _F64, rows_px: _F64) -> _F64:
    """Return u (R,) of a line (K, 2) at rows (R,); negative where it does not reach."""
    order = np.argsort(points_px[:, 1], kind="stable")
    u, v = points_px[order, 0], points_px[order, 1]
    if not len(v):
        return np.full(len(rows_px), _ABSENT)
    inside = (rows_px >= v[0]) & (rows_px <= v[-1])
    return np.where(inside, np.interp(rows_px, v, u), _ABSENT)


def lanes_of_mask(mask: NDArray[np.uint8], image: str) -> ImageLanes:
    """Return the lanes of an instance mask (H, W): one value for each lane, 0 for the ground.

    At every tenth row from the highest lane on, a lane lies in the middle of its pixels.
    """
    shown = np.flatnonzero(mask.any(axis=1))
    first = int(shown[0]) if len(shown) else mask.shape[0]
    rows = np.arange(-(-first // _ROW_STEP_PX) * _ROW_STEP_PX, mask.shape[0], _ROW_STEP_PX)
    lanes = []
    for value in np.unique(mask[mask > 0]).tolist():
        pixels = [np.flatnonzero(mask[row] == value) for row in rows]
        lane = np.array([p.mean() if len(p) else _ABSENT for p in pixels])
        if (lane >= 0).sum() >= _FEWEST_ROWS:
            lanes.append(lane)
    return ImageLanes(
        image=image,
        rows_px=rows.astype(np.float64),
        lanes_px=np.array(lanes, dtype=np.float64).reshape(-1, len(rows)),
    )


def _at_rows(lanes: ImageLanes, rows_px: _F64) -> _F64:
    if np.array_equal(lanes.rows_px, rows_px):
        return lanes.lanes_px
    sampled = [
        sample_line(np.column_stack([lane, lanes.rows_px])[lane >= 0], rows_px)
        for lane in lanes.lanes_px
    ]
    return np.array(sampled).reshape(-1, len(rows_px))


def _score_image(lanes: _F64, truth: ImageLanes) -> tuple[float, float, float]:
    """Return accuracy, FP and FN of an image."""
    real = truth.lanes_px
    if len(lanes) > len(real) + _SPARE_LANES:
        return 0.0, 0.0, 1.0
    if not len(real):
        return 0.0, float(len(lanes) > 0), 0.0
    best = np.array([_best_share(lanes, lane, truth.rows_px) for lane in real])
    matched = int((best >= _MATCHED).sum())
    missed, total = len(real) - matched, float(best.sum())
    if len(real) > _MOST_LANES:
        missed, total = max(missed - 1, 0), total - float(best.min())
    counted = min(len(real), _MOST_LANES)
    false = max(len(lanes) - matched, 0) / len(lanes) if len(lanes) else 0.0
    return total / counted, false, missed / counted


def _best_share(lanes: _F64, lane: _F64, rows_px: _F64) -> float:
    """Return the largest share of rows at which one of ours is right for a lane."""
    if not len(lanes):
        return 0.0
    shown = lane >= 0
    slope = np.polyfit(rows_px[shown], lane[shown], 1)[0] if shown.sum() > 1 else 0.0
    gate_px = _RIGHT_PX * float(np.hypot(1.0, slope))  # 20 px / cos(angle)
    apart = np.abs(_far_if_absent(lanes) - _far_if_absent(lane))
    return float((apart < gate_px).mean(axis=1).max())


def _far_if_absent(lanes: _F64) -> _F64:
    """Put what is not there beyond reach of what is, and on what is not there, either."""
    return np.where(lanes >= 0, lanes, -1e4)


def _ego_lanes(lanes: _F64, middle_px: float) -> _F64:
    """Return the lanes (0 to 2, R) nearest to the middle of the image on its left and right.

    By where they are at their lowest row.
    """
    shown = [lane for lane in lanes if (lane >= 0).any()]
    ends = np.array([lane[lane >= 0][-1] for lane in shown]) - middle_px
    chosen = []
    for side in (-1.0, 1.0):
        beside = np.flatnonzero(ends * side > 0)
        if len(beside):
            chosen.append(shown[beside[np.argmin(np.abs(ends[beside]))]])
    return np.array(chosen).reshape(-1, lanes.shape[1])


def _rows_right(lanes: _F64, truth: _F64) -> int:
    """Count rows of lanes at which the one of ours that fits each best is within 20 px."""
    right = 0
    for lane in truth:
        shown = lane >= 0
        apart = np.abs(_far_if_absent(lanes[:, shown]) - lane[shown])
        right += int((apart < _RIGHT_PX).sum(axis=1).max(initial=0))
    return right
