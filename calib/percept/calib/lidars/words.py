"""What the registrations of a rig say, in words and plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from percept.calib.lidars.evidence import RigEvidence, RigGraph
from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.result import SEVERITY, LidarExtrinsic, worst_verdict
from percept.calib.lidars.rig_graph import Placement
from percept.core.results import Verdict

__all__ = [
    "advice",
    "agreeing",
    "pair_entry",
    "reasons",
    "sentence",
    "share_agreeing",
    "weak_directions",
    "why_of",
]

_ONE_PLACE = "Record two or more other places, so that the answers can be compared"


def why_of(placement: Placement, pairs: Sequence[PairRegistration]) -> str:
    """Return the reason of the verdict; that of the weakest step where there are several."""
    worst = worst_verdict(pair.verdict for pair in pairs)
    reasons = [
        (edge, sentence(pair))
        for edge, pair in zip(placement.edges, pairs, strict=True)
        if pair.verdict is worst
    ]
    edge, text = reasons[0]
    if len(pairs) == 1:
        return text
    return f"placed by way of {', '.join(placement.path[1:-1])}; {edge.name}: {text}"


def sentence(pair: PairRegistration) -> str:
    """Return the reasons of a registration."""
    return " ".join(pair.why).rstrip(".")


def reasons(
    evidence: RigEvidence, graph: RigGraph, extrinsics: Sequence[LidarExtrinsic]
) -> list[str]:
    """Return the reasons of the whole: the sensors' from the worst on, then what is odd."""
    order = sorted(extrinsics, key=lambda e: -SEVERITY.index(e.verdict))
    reasons = [f"{e.sensor} ({e.verdict}): {e.why}" for e in order]
    reasons += evidence.scenes.doubts
    if graph.loops and all(loop.agrees for loop in graph.loops):
        worst = max(graph.loops, key=lambda loop: loop.surprise)
        every = "the round trip closes" if len(graph.loops) == 1 else "all round trips close"
        reasons.append(
            f"{every}: {'-'.join(worst.path)} misses by {100 * worst.translation_m:.1f} cm and "
            f"{worst.rotation_deg:.2f} deg"
        )
    return reasons


def advice(evidence: RigEvidence, extrinsics: Sequence[LidarExtrinsic]) -> list[str]:
    """Return what to do, the most useful first."""
    advice = [text for e in extrinsics if e.verdict is not Verdict.GOOD for text in e.advice]
    if len(evidence.scenes.clouds) == 1:
        advice.append(_ONE_PLACE)
    advice += [
        f"Add scenes that hold {', '.join(e.weak_directions)} of '{e.sensor}' better: walls at "
        "right angles, poles, kerbs and ground, near and far, in its view and its neighbour's"
        for e in extrinsics
        if e.weak_directions
    ]
    if any(e.verdict is Verdict.BAD for e in extrinsics):
        advice.append("Look at the pictures: do the clouds of one scene show the same place")
    return list(dict.fromkeys(advice))


def pair_entry(names: tuple[str, str], pair: PairRegistration) -> dict[str, Any]:
    """Return what a registration found as plain values."""
    found = pair.T_target_source
    return {
        "target": names[0],
        "source": names[1],
        "T_target_source": None if found is None else found.tolist(),
        "overlap": pair.overlap,
        "rms_m": pair.rms_m if np.isfinite(pair.rms_m) else None,
        "scenes_agreeing": agreeing(pair),
        "verdict": str(pair.verdict),
        "why": list(pair.why),
        "range_offset_m": pair.range_offset_m,
    }


def agreeing(pair: PairRegistration) -> str:
    """Return how many scenes agree, such as "5/6"."""
    return f"{pair.scenes_agreeing[0]}/{pair.scenes_agreeing[1]}"


def share_agreeing(pair: PairRegistration) -> float:
    """Return the share of the scenes that agree, 0 to 1."""
    return pair.scenes_agreeing[0] / max(pair.scenes_agreeing[1], 1)


def weak_directions(placement: Placement, pairs: Sequence[PairRegistration]) -> tuple[str, ...]:
    """Return the weak directions of all steps; those of a later step name its target's axes."""
    root = placement.path[0]
    texts = [
        text if edge.target == root else f"{text} of {edge.target}"
        for edge, pair in zip(placement.edges, pairs, strict=True)
        for text in pair.weak_directions
    ]
    return tuple(dict.fromkeys(texts))
