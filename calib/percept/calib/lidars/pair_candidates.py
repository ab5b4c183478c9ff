"""Candidate places of the source, from each scene's proposals to a ranking over all scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.lidars.free_space import Agreement, agreement
from percept.calib.lidars.hypotheses import propose
from percept.calib.lidars.registration import Stage, Surface, refine
from percept.calib.lidars.view import SensorView
from percept.calib.limits import LidarLimits

__all__ = [
    "Candidate",
    "Scene",
    "difference",
    "is_same",
    "rank_candidates",
    "refine_candidate",
]

_F64 = NDArray[np.float64]

_COARSE = (Stage(2.0, 1.0, 5), Stage(1.0, 0.4, 6), Stage(0.5, 0.2, 8))
_MEDIUM = (Stage(0.5, 0.2, 8), Stage(0.3, 0.1, 6))
_PROPOSALS = 8  # refined for each scene
_KEPT = 4  # of each scene, and in the end
_PROMISING = 0.4  # of the best score; a rival in the end has 0.9 of it


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One scene.

    Attributes:
        index: Its place among the scenes given.
        target: What the target saw.
        source: What the source saw.
    """

    index: int
    target: SensorView
    source: SensorView

    @property
    def coarse(self) -> tuple[Surface, Surface]:
        """Surfaces of (target, source), thinned to 0.4 m."""
        return self.target.coarse, self.source.coarse

    @property
    def medium(self) -> tuple[Surface, Surface]:
        """Surfaces of (target, source), thinned to 0.2 m."""
        return self.target.medium, self.source.medium

    @property
    def fine(self) -> tuple[Surface, Surface]:
        """Surfaces of (target, source), thinned to the finest voxel."""
        return self.target.fine, self.source.fine

    def agreement(self, T_target_source: _F64) -> Agreement:
        """Count agreement and contradiction at a transform (4, 4)."""
        return agreement(self.target.seen, self.source.seen, T_target_source)


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
    return _settled(_promising(_merged(_sorted(together), limits), 2 * _KEPT), scenes, limits)


def refine_candidate(
    scenes: Sequence[Scene], T_target_source: _F64, limits: LidarLimits
) -> list[Candidate]:
    """Return the one candidate near a place (4, 4) that is known already, with no search.

    A scene votes for it where its own answer from there is the same one.
    """
    votes = tuple(
        scene.index
        for scene in scenes
        if is_same(refine([scene.medium], T_target_source, _MEDIUM), T_target_source, limits)
    )
    return _settled([Candidate(T_target_source, votes, Agreement(), 0.0)], scenes, limits)


def _settled(
    candidates: list[Candidate], scenes: Sequence[Scene], limits: LidarLimits
) -> list[Candidate]:
    """Refine candidates on the finer surfaces of all scenes and rank them."""
    medium = [scene.medium for scene in scenes]
    fine = [_judged(refine(medium, c.T_target_source, _MEDIUM), c, scenes) for c in candidates]
    return _merged(_sorted(fine), limits)


def _promising(ranked: list[Candidate], most: int) -> list[Candidate]:
    """Leave out what finer surfaces cannot bring near the best of a ranking."""
    least = _PROMISING * ranked[0].score if ranked else 0.0
    return [c for c in ranked[:most] if c.score >= min(least, ranked[0].score)]


def _of_scene(
    scene: Scene, largest_m: float, initial: _F64 | None, limits: LidarLimits
) -> list[Candidate]:
    """Return one scene's own candidates, best first; only the best carries the scene's vote."""
    proposed = propose(
        scene.target.points,
        scene.source.points,
        (scene.target.planes, scene.source.planes),
        largest_m,
    )
    starts = _separate([h.T_target_source for h in proposed])[:_PROPOSALS]
    starts += [np.eye(4)] if initial is None else [np.eye(4), initial]
    found: list[Candidate] = []
    for start in starts:
        T = refine([scene.coarse], start, _COARSE)
        if np.linalg.norm(T[:3, 3]) > largest_m:
            continue
        found.append(_judged(T, Candidate(T, (), Agreement(), 0.0), [scene]))
    found = _promising(_merged(_sorted(found), limits), _KEPT)
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
    each = [scene.agreement(T) for scene in scenes]
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
