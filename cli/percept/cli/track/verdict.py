"""What makes tracks doubtful: the rules of `percept detect` and `percept track`.

| limit | verdict |
|---|---|
| tracks of scans, and nothing tells where the vehicle was | doubtful |
| the poses are doubtful | doubtful |
| more than a tenth of the scans at a time without a pose | doubtful |
"""

from __future__ import annotations

from dataclasses import dataclass

from percept.core.results import Verdict

__all__ = ["TrackFacts", "judge_tracks", "track_doubts"]

_LARGEST_POSELESS_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFacts:
    """What the verdict on tracks rests on.

    Attributes:
        scans: Scans that were tracked in; 0 for a run of cameras alone.
        poseless: How many of them are at a time without a pose.
        source: What the poses were made from; empty where there are none.
        poses_verdict: How far they can be trusted.
        poses_why: Why.
    """

    scans: int
    poseless: int = 0
    source: str = ""
    poses_verdict: Verdict = Verdict.GOOD
    poses_why: tuple[str, ...] = ()


def judge_tracks(facts: TrackFacts) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict on tracks, its reasons, and advice."""
    doubts, advice = track_doubts(facts)
    if doubts:
        return Verdict.DOUBTFUL, tuple(doubts), tuple(advice)
    from_poses = f" with poses from {facts.source}" if facts.source else ""
    return Verdict.GOOD, (f"{facts.scans} scans were tracked{from_poses} without a doubt",), ()


def track_doubts(facts: TrackFacts) -> tuple[list[str], list[str]]:
    """Return what is doubtful of tracks, and advice."""
    doubts, advice = [], []
    if facts.source and facts.poses_verdict is not Verdict.GOOD:
        doubts.append(f"poses from {facts.source} are doubtful: {'; '.join(facts.poses_why)}")
        advice.append("Look at them with `percept odometry`, or choose others with --poses")
    if facts.scans and not facts.source:
        doubts.append("nothing tells where the vehicle was: tracks are in its own frame")
        advice.append("See what `percept odometry` makes of the log, or use --no-track")
    if facts.poseless > _LARGEST_POSELESS_SHARE * facts.scans:
        doubts.append(f"{facts.poseless} of {facts.scans} scans are at a time without a pose")
        advice.append("See gaps in the poses with `percept odometry`")
    return doubts, advice
