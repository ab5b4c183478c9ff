"""Candidate places of the source, from each scene's proposals to a ranking over all scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.free_space import Agreement, Seen, agreement, what_is_seen
from percept.calib.hypotheses import propose
from percept.calib.levelling import LevelPlane, find_planes
from percept.calib.limits import LidarLimits
from percept.calib.registration import Stage, Surface, refine, surface

__all__ = ["Candidate", "Scene", "difference", "is_same", "prepare_scene", "rank_candidates"]

_F64 = NDArray[np.float64]

_COARSE_M = 0.4
_MEDIUM_M = 0.2
_COARSE_PROBES = 1500
_PLANES = 3
_MEDIUM_PROBES = 5000
_COARSE = (Stage(2.0, 1.0, 5), Stage(1.0, 0.4, 6), Stage(0.5, 0.2, 8))
_MEDIUM = (Stage(0.5, 0.2, 8), Stage(0.3, 0.1, 6))
_PROPOSALS = 8  # refined for each scene
_KEPT = 4  # of each scene, and in the end


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One scene, prepared.

    Attributes:
        index: Its place among the scenes given.
        target: (N, 3) cloud of the target.
        source: (M, 3) cloud of the source.
        planes: Largest planes of target and source.
        coarse: (target, source) thinned to 0.4 m.
        medium: (target, source) thinned to 0.2 m.
        seen: What either of them saw.
    """

    index: int
    target: _F64
    source: _F64
    planes: tuple[list[LevelPlane], list[LevelPlane]]
    coarse: tuple[Surface, Surface]
    medium: tuple[Surface, Surface]
    seen: tuple[Seen, Seen]


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A refined place of the source.

    Attributes:
        T_target_source: (4, 4).
        scenes: Indices of the scenes whose own best answer it is.
        agreement: Of all scenes that it was judged on.
        score: Mean over these of agreement less contradiction, at most 1.
    """

    T_target_source: _F64
    scenes: tuple[int, ...]
    agreement: Agreement
    score: float


def prepare_scene(index: int, target: _F64, source: _F64) -> Scene:
    """Thin both clouds (N, 3), (M, 3), find their planes, and what each sensor looked through."""
    clouds = (target, source)
    planes = [find_planes(cloud, _PLANES) for cloud in clouds]
    coarse = [surface(cloud, _COARSE_M, _COARSE_PROBES) for cloud in clouds]
    medium = [surface(cloud, _MEDIUM_M, _MEDIUM_PROBES) for cloud in clouds]
    seen = [what_is_seen(*each) for each in zip(clouds, medium, planes, strict=True)]
    return Scene(
        index=index,
        target=target,
        source=source,
        planes=(planes[0], planes[1]),
        coarse=(coarse[0], coarse[1]),
        medium=(medium[0], medium[1]),
        seen=(seen[0], seen[1]),
    )


def difference(T_a: _F64, T_b: _F64) -> tuple[float, float]:
    """Return (metres, degrees) between two transforms (4, 4) of the same frames."""
    turn = Rotation.from_matrix(T_a[:3, :3].T @ T_b[:3, :3]).magnitude()
    return float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])), float(np.degrees(turn))


def is_same(T_a: _F64, T_b: _F64, limits: LidarLimits) -> bool:
    """Return whether two transforms (4, 4) are one answer."""
    moved, turned = difference(T_a, T_b)
    return moved <= limits.same_translation_m and turned <= limits.same_rotation_deg


def rank_candidates(
    scenes: Sequence[Scene], largest_m: float, initial: _F64 | None, limits: LidarLimits
) -> list[Candidate]:
    """Return the candidates of all scenes, refined and judged on all scenes, best first.

    Args:
        scenes: One or more.
        largest_m: Largest distance of the sensors.
        initial: A guess (4, 4), tried like any other.
        limits: What counts as one answer.
    """
    pool: list[Candidate] = []
    for scene in scenes:
        own = _of_scene(scene, largest_m, initial, limits)
        pool += own
    merged = _merged(pool, limits)
    coarse = [scene.coarse for scene in scenes]
    together = [_judged(refine(coarse, c.T_target_source, _COARSE[1:]), c, scenes) for c in merged]
    best = _merged(_sorted(together), limits)[: 2 * _KEPT]
    medium = [scene.medium for scene in scenes]
    fine = [_judged(refine(medium, c.T_target_source, _MEDIUM), c, scenes) for c in best]
    return _merged(_sorted(fine), limits)


def _of_scene(
    scene: Scene, largest_m: float, initial: _F64 | None, limits: LidarLimits
) -> list[Candidate]:
    """Return one scene's own candidates, best first; only the best carries the scene's vote."""
    proposed = propose(scene.target, scene.source, scene.planes, largest_m)
    starts = _separate([h.T_target_source for h in proposed])[:_PROPOSALS]
    starts += [np.eye(4)] if initial is None else [np.eye(4), initial]
    found: list[Candidate] = []
    for start in starts:
        T = refine([scene.coarse], start, _COARSE)
        if np.linalg.norm(T[:3, 3]) > largest_m:
            continue
        found.append(_judged(T, Candidate(T, (), Agreement(), 0.0), [scene]))
    found = _merged(_sorted(found), limits)[:_KEPT]
    found = _sorted(
        [_judged(refine([scene.medium], c.T_target_source, _MEDIUM), c, [scene]) for c in found]
    )
    return [
        Candidate(c.T_target_source, (scene.index,) if k == 0 else (), c.agreement, c.score)
        for k, c in enumerate(found)
    ]


def _separate(starts: list[_F64]) -> list[_F64]:
    """Leave out starts that fall into the reach of a better one."""
    kept: list[_F64] = []
    for start in starts:
        gaps = [difference(start, other) for other in kept]
        if all(moved > 0.7 or turned > 5.0 for moved, turned in gaps):
            kept.append(start)
    return kept


def _judged(T: _F64, old: Candidate, scenes: Sequence[Scene]) -> Candidate:
    each = [agreement(*scene.seen, T) for scene in scenes]
    score = float(np.mean([one.score for one in each]))
    return Candidate(T, old.scenes, sum(each, start=Agreement()), score)


def _sorted(candidates: list[Candidate]) -> list[Candidate]:
    return sorted(candidates, key=lambda candidate: -candidate.score)


def _merged(candidates: list[Candidate], limits: LidarLimits) -> list[Candidate]:
    """Put candidates that are one answer together; the first of them stands, votes add up."""
    kept: list[Candidate] = []
    for candidate in candidates:
        T = candidate.T_target_source
        for k, other in enumerate(kept):
            if is_same(T, other.T_target_source, limits):
                votes = tuple(sorted({*other.scenes, *candidate.scenes}))
                kept[k] = Candidate(other.T_target_source, votes, other.agreement, other.score)
                break
        else:
            kept.append(candidate)
    return kept
