"""What makes tracks doubtful: the rules of `percept detect` and `percept track`.

| limit | verdict |
|---|---|
| tracks of scans, and nothing tells where the vehicle was | doubtful |
| the poses are doubtful | doubtful |
| more than a tenth of the scans without a pose | doubtful |
| all scans without a pose, in `percept track` | bad |
| no track at all in scans that have poses | doubtful |
| a map was given, and the lights are followed without it | doubtful |
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
        tracks: How many tracks there are.
        images: Images in which lights were followed.
        why_no_map: Why that was without the map that was given; empty where it was not.
        poseless: Scans without a pose of their time and frame.
        source: What the poses were made from; empty where there are none.
        poses_verdict: How far they can be trusted.
        poses_why: Why.
    """

    scans: int
    tracks: int = 0
    images: int = 0
    why_no_map: str = ""
    poseless: int = 0
    source: str = ""
    poses_verdict: Verdict = Verdict.GOOD
    poses_why: tuple[str, ...] = ()


def judge_tracks(facts: TrackFacts) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict on tracks, its reasons, and advice."""
    doubts, advice = track_doubts(facts)
    if doubts:
        lost = facts.scans and facts.poseless >= facts.scans
        verdict = Verdict.BAD if lost else Verdict.DOUBTFUL
        return verdict, tuple(doubts), tuple(advice)
    from_poses = f" with poses from {facts.source}" if facts.source else ""
    parts = [f"{facts.scans} scans"] * bool(facts.scans)
    parts += [f"{facts.images} images"] * bool(facts.images)
    return Verdict.GOOD, (f"{' and '.join(parts)} were followed{from_poses} without a doubt",), ()


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
        doubts.append(
            f"{facts.poseless} of {facts.scans} scans have no pose in the frame of the tracks"
        )
        advice.append("See gaps and frames of the poses with `percept odometry`")
    elif facts.scans and not facts.tracks:
        doubts.append(f"not one track in {facts.scans} scans")
        advice.append("See in the report what was left out, and why")
    if facts.why_no_map:
        doubts.append(f"lights are followed without the map: {facts.why_no_map}")
        advice.append("Give the map of this place with its --origin, and poses in its frame")
    return doubts, advice
