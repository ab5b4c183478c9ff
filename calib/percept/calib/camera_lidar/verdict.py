"""When a camera-LiDAR calibration is good, doubtful, bad or ambiguous; the limits are elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.degeneracy import BoardSpread, shortcomings
from percept.calib.camera_lidar.result import Estimate
from percept.calib.camera_lidar.spread import Split
from percept.calib.limits import CameraLidarLimits
from percept.core.results import Verdict

__all__ = ["Facts", "judge"]

_MORE = "Add poses: ten or more, turned 20 to 40 deg each way, at different distances"
_MOVED_GAIN = 3.0
_RANK = {Verdict.GOOD: 0, Verdict.DOUBTFUL: 1, Verdict.BAD: 2, Verdict.AMBIGUOUS: 3}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Facts:
    """What the verdict rests on.

    Attributes:
        pairs: Pairs given.
        sighted: Pairs in which both sensors found the board.
        used: Pairs that agree.
        rival: Agreement with another transform, as a share of that with this one.
        mistake: A usual mistake that explains disagreement, and its remedy.
        sd_rotation_deg, sd_translation_m: (3,) standard deviations.
        splits: Halves that were solved apart, by name.
        spread: Where the boards stood.
        board_scale, focal_scale: What the LiDAR says about either.
        centre_off_deg: What it says about the principal point, as an angle right and down.
        pattern_off_m: How far the pattern lies off the plate's middle, along columns and rows.
        lens_fits_better: Whether other intrinsics explain the data better than another board.
        corner_rms_px, point_rms_m: Residuals.
        plate_found: Sides of the plate over those given (width, height), and how far they may
            be off.
        moved_at: The pair at which a run of pairs that were left out begins or ends, at the
            beginning or the end of all.
        worse_than_initial: Whether the transform that was given fits the pairs better.
    """

    pairs: int
    sighted: int
    used: int
    rival: float
    mistake: tuple[str, str] | None
    sd_rotation_deg: NDArray[np.float64]
    sd_translation_m: NDArray[np.float64]
    splits: dict[str, Split | None] = field(default_factory=dict)
    spread: BoardSpread
    board_scale: Estimate
    focal_scale: Estimate
    centre_off_deg: tuple[Estimate, Estimate]
    pattern_off_m: tuple[Estimate, Estimate]
    lens_fits_better: bool
    corner_rms_px: float
    point_rms_m: float
    plate_found: tuple[Estimate, Estimate]
    moved_at: str | None = None
    worse_than_initial: bool = False


@dataclass(frozen=True, slots=True)
class _Finding:
    verdict: Verdict
    reason: str
    advice: str


def judge(
    facts: Facts, limits: CameraLidarLimits | None = None
) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict, its reasons with the weightiest first, and advice."""
    limits = limits or CameraLidarLimits()
    found = [*_mistakes(facts, limits), *_number(facts, limits)]
    if facts.used >= limits.fewest_pairs_doubtful and facts.mistake is None:
        # With less, all of this would only say the same in other words.
        found += [
            *_gauge(facts, limits),
            *_halves(facts, limits),
            *_spread(facts, limits),
            *_residuals(facts, limits),
        ]
    if not found:
        sd_mm = 1000 * facts.sd_translation_m
        why = (
            f"{facts.used} pairs agree; standard deviations are "
            f"{facts.sd_rotation_deg.max():.2f} deg and {sd_mm.max():.0f} mm at most, "
            "and halves of the pairs give the same transform"
        )
        return Verdict.GOOD, (why,), ()
    found.sort(key=lambda f: -_RANK[f.verdict])
    advice = tuple(dict.fromkeys(f.advice for f in found))
    return found[0].verdict, tuple(f.reason for f in found), advice


def _graded(
    value: float, good: float, doubtful: float, reason: str, advice: str
) -> Iterator[_Finding]:
    """Yield a finding where a value is above its limits, or no number."""
    if not value <= good:
        verdict = Verdict.DOUBTFUL if value <= doubtful else Verdict.BAD
        yield _Finding(verdict, reason, advice)


def _number(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    share = facts.used / max(facts.sighted, 1)
    if facts.rival >= limits.rival_share and share >= limits.share_doubtful:
        half_turn = ": the board looks the same after half a turn" if facts.used < 3 else ""
        yield _Finding(
            Verdict.AMBIGUOUS,
            f"another transform brings as many pairs together{half_turn}",
            _MORE,
        )
    yield from _graded(
        -share,
        -limits.share_good,
        -limits.share_doubtful,
        f"only {facts.used} of {facts.sighted} pairs with a board agree with each other",
        "Check that each image and cloud are of one moment, and that no sensor moved",
    )
    yield from _graded(
        -facts.used,
        -limits.fewest_pairs_good,
        -limits.fewest_pairs_doubtful,
        f"only {facts.used} of {facts.pairs} pairs can be used"
        if facts.used < facts.pairs
        else f"{facts.used} pair{'s are' if facts.used > 1 else ' is'} too few",
        _MORE,
    )


def _mistakes(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    if facts.mistake is not None:
        yield _Finding(Verdict.BAD, *facts.mistake)
    if facts.worse_than_initial:
        yield _Finding(
            Verdict.BAD,
            "the transform that was given fits the pairs better than the one found",
            "Keep the one that was given; check the pairs that were left out",
        )
    if facts.moved_at is not None:
        yield _Finding(
            Verdict.DOUBTFUL,
            f"the pairs on one side of '{facts.moved_at}' all disagree with the others: a sensor "
            "may have moved",
            "Check the mounting, and record again in one go",
        )
    for side, found in zip(("wide", "high"), facts.plate_found, strict=True):
        if abs(found.value - 1) > limits.plate_good + 2 * found.sd:
            yield _Finding(
                Verdict.DOUBTFUL,
                f"the plate seems {found.value:.2f} times as {side} as given",
                "Measure the plate's outer edges",
            )


def _gauge(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    """Judge the board's size and the lens, which fewer pairs cannot tell from the transform."""
    if facts.used < limits.fewest_pairs_good or facts.rival >= limits.rival_share:
        return
    yield from _pattern(facts, limits)
    if facts.lens_fits_better:
        yield from _lens(facts, limits)
    else:
        yield from _scale(
            facts.board_scale,
            limits,
            "the board seems {:.3f} times as large as given",
            "Measure a square of the board; if it is right, check the intrinsics",
        )


def _pattern(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    for way, off in zip(("columns", "rows"), facts.pattern_off_m, strict=True):
        if off.sd > limits.pattern_sd_m:
            yield _Finding(
                Verdict.DOUBTFUL,
                f"whether the pattern lies off the plate's middle along its {way} is only known "
                f"to {1000 * off.sd:.0f} mm",
                "Turn the board in the image by 30 deg or more in some poses",
            )
        elif abs(off.value) > max(limits.pattern_good_m, limits.scale_z * off.sd):
            yield _Finding(
                Verdict.DOUBTFUL,
                f"the pattern seems to lie {1000 * abs(off.value):.0f} mm off the plate's middle, "
                f"along its {way}, or beams of the LiDAR point elsewhere than said",
                "Measure the margins of the pattern on the plate, and centre it",
            )


def _lens(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    advice = "Calibrate the camera first, with `percept calib camera`"
    words = "the focal length seems {:.3f} times that of the intrinsics"
    yield from _scale(facts.focal_scale, limits, words, advice)
    ways = (("to the right", "to the left"), ("downwards", "upwards"))
    for (ahead, back), off in zip(ways, facts.centre_off_deg, strict=True):
        if abs(off.value) > limits.scale_z * off.sd:
            yield from _graded(
                abs(off.value),
                limits.centre_good_deg,
                limits.centre_bad_deg,
                f"the principal point seems off by {abs(off.value):.2f} deg "
                f"{ahead if off.value > 0 else back}",
                advice,
            )


def _scale(
    estimate: Estimate, limits: CameraLidarLimits, words: str, advice: str
) -> Iterator[_Finding]:
    off = abs(estimate.value - 1)
    if off > limits.scale_z * estimate.sd:
        yield from _graded(
            off, limits.scale_good, limits.scale_bad, words.format(estimate.value), advice
        )


def _halves(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    for name, split in facts.splits.items():
        if split is None:
            continue
        away = np.abs(split.step) > np.array(
            [np.radians(limits.halves_floor_deg)] * 3 + [limits.halves_floor_m] * 3
        )
        beyond = bool((away & (np.abs(split.z) > limits.halves_z)).any())
        large = (
            split.rotation_deg > limits.halves_good_deg
            or split.translation_m > limits.halves_good_m
        )
        if beyond or large:
            moved = name.startswith("the first") and split.gain > _MOVED_GAIN * _least_gain(facts)
            yield _Finding(
                Verdict.DOUBTFUL,
                f"{name} differ by {split.rotation_deg:.2f} deg and "
                f"{1000 * split.translation_m:.0f} mm"
                + (", more than their spread allows" if beyond else "")
                + (": a sensor may have moved" if moved else ""),
                "Check the mounting, and record again in one go" if moved else _MORE,
            )


def _least_gain(facts: Facts) -> float:
    """Return the least gain of any split, or what noise alone gives: seven more unknowns."""
    return max(min(s.gain for s in facts.splits.values() if s is not None), 7.0)


def _spread(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    for reason, advice in shortcomings(facts.spread, limits):
        yield _Finding(Verdict.DOUBTFUL, reason, advice)
    worst = int(np.argmax(facts.sd_rotation_deg))
    yield from _graded(
        float(facts.sd_rotation_deg[worst]),
        limits.sd_rotation_good_deg,
        limits.sd_rotation_doubtful_deg,
        f"the turn about the camera's {_axis(worst)} is only known to "
        f"{facts.sd_rotation_deg[worst]:.2f} deg",
        _MORE,
    )
    worst = int(np.argmax(facts.sd_translation_m))
    yield from _graded(
        float(facts.sd_translation_m[worst]),
        limits.sd_translation_good_m,
        limits.sd_translation_doubtful_m,
        f"the place along the camera's {_axis(worst)} is only known to "
        f"{1000 * facts.sd_translation_m[worst]:.0f} mm",
        _MORE,
    )


def _axis(k: int) -> str:
    return ("x (right)", "y (down)", "z (forward)")[k]


def _residuals(facts: Facts, limits: CameraLidarLimits) -> Iterator[_Finding]:
    yield from _graded(
        facts.corner_rms_px,
        limits.corner_good_px,
        limits.corner_doubtful_px,
        f"corners lie {facts.corner_rms_px:.1f} px from where the intrinsics put them",
        "Check that the intrinsics belong to this camera and image size",
    )
    yield from _graded(
        facts.point_rms_m,
        limits.point_good_m,
        limits.point_doubtful_m,
        f"points lie {1000 * facts.point_rms_m:.0f} mm from the boards' planes",
        "Check the LiDAR, and that the board stood still and is flat",
    )
