"""The verdict on a LiDAR pair: every reason for doubt is looked for, and the worst one decides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.free_space import Agreement
from percept.calib.lidars.pair_candidates import difference
from percept.calib.lidars.pair_result import Rival
from percept.calib.lidars.pair_spread import Spread, WeakDirection
from percept.calib.limits import LidarLimits
from percept.core.results import Verdict

__all__ = ["Evidence", "judge"]

_F64 = NDArray[np.float64]
_MORE = "Add scenes with more structure near the vehicle, in the view that both share"
_Reason = tuple[Verdict, str, str]  # what follows, why, and what to do (or nothing)
_NUMBERS = {2: "Two", 3: "Three", 4: "Four"}
_ORDER = (Verdict.BAD, Verdict.AMBIGUOUS, Verdict.DOUBTFUL)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What the verdict rests on.

    Attributes:
        T: (4, 4) the answer, `T_target_source`.
        names: What the scenes are called, by index.
        agreement: Of the answer, over all scenes.
        rivals: Other places that were judged.
        votes: Scenes whose own best answer it is.
        used: Scenes that were used.
        left_out: Reasons of the others.
        weak: Directions that are determined badly.
        spread: Jackknife, and each scene's own solution.
    """

    T: _F64
    names: Sequence[str]
    agreement: Agreement
    rivals: Sequence[Rival]
    votes: tuple[int, ...]
    used: tuple[int, ...]
    left_out: Mapping[int, str]
    weak: Sequence[WeakDirection]
    spread: Spread


def judge(
    evidence: Evidence, limits: LidarLimits
) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict, its reasons, and what to do, most important first."""
    checks = (_overlap, _free_space, _weak, _rivals, _votes, _moved, _faults, _spread, _scenes)
    reasons = [reason for check in checks for reason in check(evidence, limits)]
    reasons.sort(key=lambda reason: _ORDER.index(reason[0]))
    if reasons:
        advice = dict.fromkeys(advice for _, _, advice in reasons if advice)
        return reasons[0][0], tuple(text for _, text, _ in reasons), tuple(advice)
    found = evidence.agreement
    why = (
        f"All {len(evidence.used)} scenes found this place on their own; {found.share:.0%} of the "
        f"structure that both must see agrees within 0.1 m and {found.violation:.1%} contradicts."
    )
    return Verdict.GOOD, (why,), ()


def _overlap(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    found = evidence.agreement
    if found.seen < limits.fewest_seen:
        yield (
            Verdict.BAD,
            f"The clouds do not overlap: only {found.seen} points off the ground are in sight of "
            "both.",
            "Record a place with walls, cars or poles in the view that both share",
        )
    elif found.share < limits.least_share or found.sharpness < limits.least_sharpness:
        yield (
            Verdict.BAD,
            f"Only {found.share:.0%} of the structure that both must see agrees within 0.1 m "
            f"({found.sharpness:.0%} of what is within 0.5 m): the clouds do not show the same "
            "place, or were not taken at the same time.",
            "Check that the clouds of a scene belong together",
        )


def _free_space(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    share = evidence.agreement.violation
    if share >= limits.violation_doubtful:
        yield (
            Verdict.BAD if share >= limits.violation_bad else Verdict.DOUBTFUL,
            f"{share:.0%} of one sensor's structure stands where the other one looked through.",
            "Keep people and traffic away, and look for moving objects in the pictures",
        )


def _rivals(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    del limits
    close = [rival for rival in evidence.rivals if rival.close]
    if close:
        number = _NUMBERS.get(len(close) + 1, str(len(close) + 1))
        yield (
            Verdict.AMBIGUOUS,
            f"{number} places explain the scenes about equally: {_place(evidence.T)} "
            f"({evidence.agreement.share:.0%} agree, {evidence.agreement.violation:.1%} "
            f"contradict) and {_place(close[0].T_target_source)} ({close[0].share:.0%}, "
            f"{close[0].violation:.1%}): what they show is symmetric.",
            "Add a scene without symmetry, such as a corner, a gate or parked vehicles",
        )


def _place(T: _F64) -> str:
    x, y, z = T[:3, 3]
    yaw = np.degrees(np.arctan2(T[1, 0], T[0, 0]))
    return f"x {x:.2f} y {y:.2f} z {z:.2f} m, yaw {yaw:.0f} deg"


def _votes(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    del limits
    agreeing, count = len(evidence.votes), len(evidence.used)
    if agreeing == count:
        return
    others = ", ".join(evidence.names[i] for i in evidence.used if i not in evidence.votes)
    yield (
        Verdict.DOUBTFUL if 2 * agreeing > count else Verdict.AMBIGUOUS,
        f"Scene {others} found another place on its own ({agreeing} of {count} scenes agree): it "
        "shows too little, is symmetric, or does not belong to the others.",
        "Add scenes without symmetry, with walls, poles or vehicles that both see",
    )


def _moved(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    """Look for scenes whose own solution lies far from the others'."""
    spread = evidence.spread
    count = len(evidence.used)
    if count < 2:
        return
    far = np.zeros((count, count), dtype=bool)
    for i in range(count):
        for j in range(i):
            moved, turned = difference(spread.scene_transforms[i], spread.scene_transforms[j])
            both = spread.scene_covariances[i] + spread.scene_covariances[j]
            sd_turn = np.degrees(np.sqrt(np.trace(both[:3, :3])))
            sd_move = np.sqrt(np.trace(both[3:, 3:]))
            far[i, j] = far[j, i] = moved > max(
                limits.moved_sd * sd_move, limits.moved_translation_m
            ) or turned > max(limits.moved_sd * sd_turn, limits.moved_rotation_deg)
    if not far.any():
        return
    odd = np.flatnonzero(far.sum(axis=1) == far.sum(axis=1).max())
    names = " and ".join(evidence.names[evidence.used[k]] for k in odd)
    yield (
        Verdict.BAD,
        f"Scene {names}: the scenes' own answers differ far beyond their spreads: a sensor moved "
        "between them, or the clouds of a scene were not taken at the same time.",
        "Use only scenes since the sensors were last touched, taken while nothing moved",
    )


def _weak(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    for direction in evidence.weak:
        undetermined = direction.ratio < limits.weak_bad
        word = "does not determine" if undetermined else "hardly determines"
        yield (
            Verdict.BAD if undetermined else Verdict.DOUBTFUL,
            f"What both see {word} {direction.name} (information {direction.ratio:.3f} of the "
            "strongest direction).",
            "Add a scene with surfaces across that direction",
        )


def _faults(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    """Look for sensors that measure wrongly in the same way everywhere."""
    offset, tilt = evidence.spread.offset, evidence.spread.tilt
    if offset.exceeds(limits.offset_doubtful_m, limits.fault_sd):
        yield (
            Verdict.DOUBTFUL,
            f"The source measures {100 * abs(offset.value):.1f} cm (sd {100 * offset.sd:.1f}) too "
            f"{'far' if offset.value > 0 else 'near'}, compared with the target.",
            "Check the ranges of both LiDARs against a wall at a known distance",
        )
    if tilt.exceeds(np.radians(limits.tilt_doubtful_deg), limits.fault_sd):
        degrees, sd = np.degrees([abs(tilt.value), tilt.sd])
        yield (
            Verdict.DOUBTFUL,
            f"The source's beams seem to be {degrees:.2f} deg (sd {sd:.2f}) too "
            f"{'high' if tilt.value > 0 else 'low'}: its beam table or model may be wrong.",
            "Check that its driver is set to the right model and calibration file",
        )


def _spread(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    move, turn = evidence.spread.translation_m.max(), evidence.spread.rotation_deg.max()
    text = f"The standard deviation is {100 * move:.1f} cm and {turn:.2f} deg."
    if not (move <= limits.sd_translation_doubtful_m and turn <= limits.sd_rotation_doubtful_deg):
        yield Verdict.BAD, text, _MORE
    elif move > limits.sd_translation_good_m or turn > limits.sd_rotation_good_deg:
        yield Verdict.DOUBTFUL, text, _MORE


def _scenes(evidence: Evidence, limits: LidarLimits) -> Iterator[_Reason]:
    del limits
    if len(evidence.used) == 1:
        yield (
            Verdict.DOUBTFUL,
            "One scene only: agreement between scenes could not be tested.",
            "Record two or more other places, so that the answers can be compared",
        )
    for index, reason in evidence.left_out.items():
        yield Verdict.DOUBTFUL, f"Scene {evidence.names[index]} was left out: {reason}.", ""
