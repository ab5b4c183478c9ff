"""How far the places of a rig's LiDARs can be trusted, each by itself and all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.evidence import USABLE, RigEvidence, RigGraph, usable_edges
from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.result import (
    LidarCalibration,
    LidarExtrinsic,
    worst_verdict,
)
from percept.calib.lidars.rig_graph import (
    adjust_poses,
    closing_loops,
    culprit,
    maximum_spanning_tree,
    place_along,
    relative_motion,
)
from percept.calib.lidars.start import exchanged_names, worse_than_start
from percept.calib.lidars.words import (
    advice,
    agreeing,
    pair_entry,
    reasons,
    sentence,
    share_agreeing,
    weak_directions,
    why_of,
)
from percept.calib.limits import LidarLimits
from percept.core.results import Verdict

__all__ = ["conclude"]

_F64 = NDArray[np.float64]


def conclude(evidence: RigEvidence) -> LidarCalibration:
    """Place all sensors, and judge each of them and the whole."""
    graph = _joined(evidence)
    extrinsics = []
    for name in evidence.others:
        if name in graph.placed:
            extrinsic = _placed(evidence, graph, name)
        else:
            extrinsic = _unplaced(evidence, name)
        extrinsics.append(extrinsic)
    for name, why in exchanged_names(graph.poses, evidence.start, evidence.limits).items():
        number = evidence.others.index(name)
        extrinsics[number] = _lowered(
            extrinsics[number], Verdict.DOUBTFUL, why, "Check which cloud belongs to which name"
        )
    verdict = worst_verdict(extrinsic.verdict for extrinsic in extrinsics)
    if evidence.scenes.doubts:
        verdict = worst_verdict((verdict, Verdict.DOUBTFUL))
    return LidarCalibration(
        reference=evidence.reference,
        extrinsics=tuple(extrinsics),
        loops=graph.loops,
        verdict=verdict,
        why=tuple(reasons(evidence, graph, extrinsics)),
        advice=tuple(advice(evidence, extrinsics)),
        scenes=len(evidence.scenes.clouds),
        pairs=tuple(pair_entry(names, pair) for names, pair in evidence.found.items()),
        dropped=dict(evidence.scenes.dropped),
    )


def _joined(evidence: RigEvidence) -> RigGraph:
    """Join the registrations: take out a wrong one, place along the tree, adjust what agrees."""
    edges = usable_edges(evidence.found)
    limits, root = evidence.limits, evidence.reference
    loops = tuple(loop for loop, _ in closing_loops(edges, root, limits))
    wrong = None
    if not all(loop.agrees for loop in loops):
        wrong = culprit(edges, root, limits)
        edges = [edge for edge in edges if edge is not wrong]
    placed = place_along(maximum_spanning_tree(edges, root), root)
    poses = {name: placement.T_root_sensor for name, placement in placed.items()}
    covariances = {name: placement.covariance for name, placement in placed.items()}
    inside = [edge for edge in edges if edge.target in placed]
    agree = wrong is not None or all(loop.agrees for loop in loops)
    if agree and len(inside) > len(placed) - 1:
        adjusted = adjust_poses(inside, poses, root)
        poses |= adjusted.T_root_sensor
        covariances |= adjusted.covariance
    return RigGraph(placed, poses, covariances, loops, wrong)


def _placed(evidence: RigEvidence, graph: RigGraph, name: str) -> LidarExtrinsic:
    """Return the extrinsic of a sensor that registrations join with the reference."""
    placement = graph.placed[name]
    pairs = [evidence.found[edge.target, edge.source] for edge in placement.edges]
    sd = np.sqrt(np.diag(graph.covariances[name]))
    moved_m, turned_deg = _leave_one_out(graph, placement.path, pairs)
    extrinsic = LidarExtrinsic(
        sensor=name,
        T_reference_sensor=graph.poses[name],
        sd_translation_m=sd[3:],
        sd_rotation_deg=np.degrees(sd[:3]),
        leave_one_out_translation_m=moved_m,
        leave_one_out_rotation_deg=turned_deg,
        rms_m=max(pair.rms_m for pair in pairs),
        overlap=min(pair.overlap for pair in pairs),
        scenes_agreeing=agreeing(min(pairs, key=share_agreeing)),
        weak_directions=weak_directions(placement, pairs),
        verdict=worst_verdict(pair.verdict for pair in pairs),
        why=why_of(placement, pairs),
        advice=tuple(text for pair in pairs for text in pair.advice),
        path=placement.path,
        T_reference_start=evidence.start.get(name),
        rivals=_rivals(pairs[0]) if len(pairs) == 1 else (),
    )
    extrinsic = _judged_by_loops(extrinsic, graph, evidence.limits)
    extrinsic = _judged_by_direct_view(extrinsic, evidence)
    worse = worse_than_start(
        placement.path, graph.poses, evidence.scenes, evidence.start, evidence.limits
    )
    return extrinsic if worse is None else _lowered(extrinsic, Verdict.BAD, *worse)


def _unplaced(evidence: RigEvidence, name: str) -> LidarExtrinsic:
    """Return what there is of a sensor that no registration joins with the reference.

    The failed registration with the reference is kept, so that a person can look at it; its
    verdict says that it is not to be used.
    """
    pair = evidence.found.get((evidence.reference, name))
    nothing = np.full(3, np.nan)
    if pair is None:
        return LidarExtrinsic(
            sensor=name,
            T_reference_sensor=None,
            sd_translation_m=nothing,
            sd_rotation_deg=nothing,
            leave_one_out_translation_m=None,
            leave_one_out_rotation_deg=None,
            rms_m=np.nan,
            overlap=0.0,
            scenes_agreeing="0/0",
            weak_directions=(),
            verdict=Verdict.BAD,
            why=f"no scene has points of '{name}' and of a sensor that is placed",
            advice=(f"Check that '{name}' delivers points at the same time as the others",),
            T_reference_start=evidence.start.get(name),
        )
    tried = [t for t, source in evidence.found if source == name and t != evidence.reference]
    also = f"; nor could it be placed by way of {', '.join(tried)}" if tried else ""
    moved_m, turned_deg = pair.leave_one_out or (None, None)
    return LidarExtrinsic(
        sensor=name,
        T_reference_sensor=pair.T_target_source,
        sd_translation_m=pair.sd_translation_m,
        sd_rotation_deg=pair.sd_rotation_deg,
        leave_one_out_translation_m=moved_m,
        leave_one_out_rotation_deg=turned_deg,
        rms_m=pair.rms_m,
        overlap=pair.overlap,
        scenes_agreeing=agreeing(pair),
        weak_directions=pair.weak_directions,
        verdict=pair.verdict,
        why=f"{sentence(pair)}{also}",
        advice=pair.advice,
        path=(evidence.reference, name),
        T_reference_start=evidence.start.get(name),
        rivals=_rivals(pair),
    )


def _leave_one_out(
    graph: RigGraph, path: Sequence[str], pairs: Sequence[PairRegistration]
) -> tuple[float | None, float | None]:
    """Return the largest move (m) and turn (deg) along a path when one scene is left out.

    Those of the steps add up at worst, and a turn of one moves all that hangs on it.
    """
    end = graph.poses[path[-1]][:3, 3]
    total_m, total_deg = 0.0, 0.0
    for name, pair in zip(path[1:], pairs, strict=True):
        if pair.leave_one_out is None:
            return None, None
        move_m, turn_deg = pair.leave_one_out
        arm_m = np.linalg.norm(end - graph.poses[name][:3, 3])
        total_m += move_m + float(np.radians(turn_deg) * arm_m)
        total_deg += turn_deg
    return total_m, total_deg


def _rivals(pair: PairRegistration) -> tuple[_F64, ...]:
    return tuple(rival.T_target_source for rival in pair.rivals if rival.close)


def _judged_by_loops(
    extrinsic: LidarExtrinsic, graph: RigGraph, limits: LidarLimits
) -> LidarExtrinsic:
    """Lower a sensor's verdict where a round trip over it does not close."""
    wrong = graph.left_out
    if wrong is not None:
        if extrinsic.sensor not in (wrong.target, wrong.source):
            return extrinsic
        return _lowered(
            extrinsic,
            Verdict.DOUBTFUL,
            f"the registration {wrong.name} contradicts all others and was left out",
            f"Look at {wrong.name} in the report: what makes it fit where it should not",
        )
    torn = [loop for loop in graph.loops if not loop.agrees and extrinsic.sensor in loop.path]
    if not torn:
        return extrinsic
    worst = max(torn, key=lambda loop: loop.surprise)
    gross = worst.translation_m > limits.loop_gross_m or worst.rotation_deg > limits.loop_gross_deg
    return _lowered(
        extrinsic,
        Verdict.BAD if gross else Verdict.DOUBTFUL,
        f"the round trip {'-'.join(worst.path)} misses by {100 * worst.translation_m:.1f} cm and "
        f"{worst.rotation_deg:.2f} deg, {worst.surprise:.1f} times what its spread lets expect; "
        "one of its registrations is wrong",
        "Add scenes with more structure near the vehicle, or check whether a sensor was moved",
    )


def _judged_by_direct_view(extrinsic: LidarExtrinsic, evidence: RigEvidence) -> LidarExtrinsic:
    """Lower the verdict of a chain where the reference sees the sensor's view and disagrees.

    A chain may settle which of several places is right; it may not talk away a registration that
    had enough to see and failed.
    """
    direct = evidence.found.get((evidence.reference, extrinsic.sensor))
    T, limits = extrinsic.T_reference_sensor, evidence.limits
    if len(extrinsic.path) < 3 or direct is None or direct.verdict in USABLE or T is None:
        return extrinsic
    if direct.T_target_source is None or direct.overlap < limits.overlap_worth_a_loop:
        return extrinsic
    motions = [relative_motion(T, place) for place in (direct.T_target_source, *_rivals(direct))]
    one_of_them = any(
        np.degrees(np.linalg.norm(motion[:3])) < limits.same_rotation_deg
        and np.linalg.norm(motion[3:]) < limits.same_translation_m
        for motion in motions
    )
    if direct.verdict is Verdict.AMBIGUOUS and one_of_them:
        return extrinsic
    names = evidence.reference, extrinsic.sensor
    return _lowered(
        extrinsic,
        Verdict.DOUBTFUL,
        f"registered with '{names[0]}' it failed: {sentence(direct)}",
        f"Look at the pictures of '{names[0]}' and '{names[1]}'",
    )


def _lowered(extrinsic: LidarExtrinsic, verdict: Verdict, why: str, advice: str) -> LidarExtrinsic:
    """Return the extrinsic with a verdict no better than another one, and its reason first."""
    return replace(
        extrinsic,
        verdict=worst_verdict((extrinsic.verdict, verdict)),
        why=f"{why}; {extrinsic.why}",
        advice=(advice, *extrinsic.advice),
    )
