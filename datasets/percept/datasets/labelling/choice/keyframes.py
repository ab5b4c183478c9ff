"""Which moments of a log become keyframes: from stamps and poses alone, nothing is decoded.

A new keyframe is due when the vehicle has moved or turned far enough since the last one, or when
enough time has passed. A vehicle that stands gets one by time only; those whose pictures did not
change are found as duplicates when they are decoded (`selection`).
"""

from __future__ import annotations

from bisect import bisect, insort
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.settings import Settings
from percept.core.trajectory import Trajectory
from percept.datasets.labelling.choice.evidence import FrameEvidence, label_counts, strength

__all__ = ["Instant", "InstantReason", "KeyframeConfig", "choose_instants"]

InstantReason = Literal["first", "time", "distance", "turn", "evidence"]
"""Why a moment was chosen."""


class KeyframeConfig(Settings):
    """When a new keyframe is due.

    Attributes:
        every_s: After this time at the latest.
        distance_m: When the vehicle is this far from where it was; needs poses.
        turn_deg: When the vehicle has turned by this; needs poses.
        min_gap_s: Never sooner than this after another.
        evidence_least: A moment whose evidence is at least this strong, 0..1, is chosen besides.
        evidence_share: Of those, so many at most for each that is due anyway.
        evidence_gap_s: Such a moment is this far from all others.
    """

    every_s: float = Field(default=2.0, gt=0, le=1e6)
    distance_m: float = Field(default=5.0, gt=0)
    turn_deg: float = Field(default=15.0, gt=0, le=180)
    min_gap_s: float = Field(default=0.2, ge=0, le=1e6)
    evidence_least: float = Field(default=0.4, ge=0, le=1)
    evidence_share: float = Field(default=0.25, ge=0, le=1e6)
    evidence_gap_s: float = Field(default=0.4, ge=0, le=1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """A moment that becomes a keyframe.

    Attributes:
        stamp_ns: The moment: one of the stamps that were offered.
        reason: Why it was chosen.
        score: How strong its evidence is, 0..1; 0 without.
    """

    stamp_ns: int
    reason: InstantReason
    score: float = 0.0


def choose_instants(
    stamps_ns: NDArray[np.int64],
    poses: Trajectory | None,
    config: KeyframeConfig,
    evidence: Sequence[FrameEvidence] = (),
    earlier_ns: NDArray[np.int64] | None = None,
) -> tuple[Instant, ...]:
    """Choose the moments of one log.

    Nothing but the log itself and those before it decide, so that later logs change nothing.

    Args:
        stamps_ns: (N,) int64 moments to choose from, such as the stamps of the scans; in any
            order.
        poses: `T_world_base`, in a frame that does not move; None where not known. Distance and
            turn count between moments that have a pose.
        config: Settings.
        evidence: What is known of moments of this log, in any order. Each belongs to the nearest
            stamp; classes are rare or not within this log.
        earlier_ns: (M,) int64 moments that were chosen for logs before this one. One of them that
            is a stamp of this log too is taken instead of the moment that is due, if it is nearer
            than half the step: of what was recorded in two logs, such as a part that was cut out
            of another, the same images are then chosen, and found to be duplicates.

    Returns:
        The chosen moments in the order of time, the first stamp among them; none without stamps.
    """
    stamps = np.unique(np.asarray(stamps_ns, dtype=np.int64))
    shared = np.flatnonzero(np.isin(stamps, [] if earlier_ns is None else earlier_ns))
    chosen = _due(stamps, poses, config, shared)
    strengths = _strengths(stamps, evidence, config)
    for index in _strong(stamps, sorted(chosen), strengths, config):
        chosen[index] = "evidence"
    return tuple(
        Instant(stamp_ns=int(stamps[i]), reason=chosen[i], score=float(strengths[i]))
        for i in sorted(chosen)
    )


def _due(
    stamps: NDArray[np.int64],
    poses: Trajectory | None,
    config: KeyframeConfig,
    shared: NDArray[np.intp],
) -> dict[int, InstantReason]:
    """Return the indices of the stamps that are due, each with its reason."""
    if not len(stamps):
        return {}
    places, known = np.zeros((len(stamps), 4, 4)), np.zeros(len(stamps), bool)
    if poses is not None:
        places, known = poses.poses_at(stamps)
    soonest = np.searchsorted(stamps, stamps + round(config.min_gap_s * 1e9))
    latest = np.searchsorted(stamps, stamps + round(config.every_s * 1e9))
    due: dict[int, InstantReason] = {0: "first"}
    last = 0
    while True:
        first = max(int(soonest[last]), last + 1)
        index = max(first, int(latest[last]))
        moved = None
        if known[last]:
            moved = _moved(places[first:index], known[first:index], places[last], config)
        if moved is not None:
            index = first + moved[0]
        index = _shared_near(shared, last, first, index)
        if index >= len(stamps):
            return due
        due[index] = "time" if moved is None else moved[1]
        last = index


def _shared_near(shared: NDArray[np.intp], last: int, first: int, due: int) -> int:
    """Return the shared index that stands for the due one: the nearest within half a step."""
    place = int(np.searchsorted(shared, due))
    near = [int(i) for i in shared[max(place - 1, 0) : place + 1] if i >= first]
    best = min(near, key=lambda i: abs(i - due), default=due)
    return best if 2 * abs(best - due) <= due - last else due


def _moved(
    places: NDArray[np.float64],
    known: NDArray[np.bool_],
    last: NDArray[np.float64],
    config: KeyframeConfig,
) -> tuple[int, InstantReason] | None:
    """Return the first place (M, 4, 4) that is far or turned enough from the last, and which."""
    far = np.linalg.norm(places[:, :3, 3] - last[:3, 3], axis=1) >= config.distance_m
    # The trace of the rotation between two attitudes is 1 + 2 cos of its angle.
    cosines = (np.sum(places[:, :3, :3] * last[:3, :3], axis=(1, 2)) - 1.0) / 2.0
    turned = cosines <= np.cos(np.radians(config.turn_deg))
    found = np.flatnonzero((far | turned) & known)
    if not len(found):
        return None
    return int(found[0]), "distance" if far[found[0]] else "turn"


def _strengths(
    stamps: NDArray[np.int64], evidence: Sequence[FrameEvidence], config: KeyframeConfig
) -> NDArray[np.float64]:
    """Return (N,) how strong the strongest evidence is that belongs to each stamp."""
    strengths = np.zeros(len(stamps))
    if not len(stamps):
        return strengths
    counts = label_counts(evidence)
    for moment in evidence:
        right = min(int(np.searchsorted(stamps, moment.stamp_ns)), len(stamps) - 1)
        left = max(right - 1, 0)
        near = min(left, right, key=lambda i: abs(int(stamps[i]) - moment.stamp_ns))
        if abs(int(stamps[near]) - moment.stamp_ns) <= config.evidence_gap_s * 1e9:
            strengths[near] = max(strengths[near], strength(moment, counts))
    return strengths


def _strong(
    stamps: NDArray[np.int64],
    due: list[int],
    strengths: NDArray[np.float64],
    config: KeyframeConfig,
) -> list[int]:
    """Return the stamps of strong evidence that lie apart from all others, strongest first."""
    most = int(config.evidence_share * len(due))
    gap_ns = config.evidence_gap_s * 1e9
    taken = [int(stamps[i]) for i in due]
    extra: list[int] = []
    for index in np.lexsort((stamps, -strengths)):
        if len(extra) >= most or strengths[index] < config.evidence_least:
            break
        stamp = int(stamps[index])
        place = bisect(taken, stamp)
        if all(abs(stamp - other) >= gap_ns for other in taken[max(place - 1, 0) : place + 1]):
            insort(taken, stamp)
            extra.append(int(index))
    return extra
