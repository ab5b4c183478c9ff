"""The transform between two LiDARs, without a guess, and how far it can be trusted.

Each scene proposes places on its own (`hypotheses`); they are refined, put together where they
agree, and every one is then judged on all scenes by what the other sensor saw and saw through
(`free_space`). The best is refined on all scenes jointly. Fitness alone never decides.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.calib.free_space import Agreement, agreement
from percept.calib.lidar_pair_candidates import (
    Candidate,
    Scene,
    prepare_scene,
    rank_candidates,
)
from percept.calib.lidar_pair_result import PairRegistration, Rival
from percept.calib.lidar_pair_spread import solve_spread, weak_directions
from percept.calib.lidar_pair_verdict import Evidence, judge
from percept.calib.limits import LidarLimits
from percept.calib.registration import Stage, refine, surface
from percept.core.errors import GeometryError
from percept.core.results import Verdict
from percept.core.settings import Settings

__all__ = ["LidarCalibrationConfig", "register_pair"]

_F64 = NDArray[np.float64]
_LIMITS = LidarLimits()
_FINE_PROBES = 15000


class LidarCalibrationConfig(Settings):
    """Settings of LiDAR to LiDAR calibrations.

    Attributes:
        largest_translation_m: The sensors are not farther apart than this.
        nearest_m: Returns nearer than this are the sensor's own housing.
        farthest_m: Returns farther than this are not used: the spot of a beam is wider than 10 cm
            there.
        voxel_m: Finest thinning: one point a voxel.
        kernel_m: Scale of the robust kernel in the end: a residual of this size has a quarter of
            the weight.
    """

    largest_translation_m: float = Field(default=5.0, gt=0, le=50)
    nearest_m: float = Field(default=0.3, ge=0)
    farthest_m: float = Field(default=50.0, gt=1)
    voxel_m: float = Field(default=0.1, gt=0.01, le=1.0)
    kernel_m: float = Field(default=0.05, gt=0.001, le=1.0)


def register_pair(
    scenes: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]],
    config: LidarCalibrationConfig | None = None,
    initial: NDArray[np.floating] | None = None,
) -> PairRegistration:
    """Find where one LiDAR sits as seen from another.

    Args:
        scenes: For each scene the cloud (N, 3 or more) of the target and the cloud (M, 3 or
            more) of the source: x, y, z in metres in the sensor's own frame, the sensor at the
            origin. Values that are not finite are dropped and counted.
        config: Settings.
        initial: A guess (4, 4) of `T_target_source`. It is one more place to try and has no
            other weight.

    Returns:
        The registration; its `T_target_source` is None where no scene could be used.

    Raises:
        GeometryError: If a cloud has fewer than three columns or the guess is not (4, 4).
    """
    config = config or LidarCalibrationConfig()
    guess = _checked_guess(initial)
    dropped: Counter[str] = Counter()
    left_out: dict[int, str] = {}
    used: list[Scene] = []
    for index, (target, source) in enumerate(scenes):
        clouds = [_cleaned(cloud, config, dropped) for cloud in (target, source)]
        reason = _unusable(clouds)
        if reason is None:
            used.append(prepare_scene(index, clouds[0], clouds[1]))
        else:
            left_out[index] = reason
    ranked = rank_candidates(used, config.largest_translation_m, guess, _LIMITS) if used else []
    if not ranked:
        return _nothing(len(scenes), dropped, left_out)
    return _solved(len(scenes), used, ranked, config, dropped, left_out)


def _checked_guess(initial: NDArray[np.floating] | None) -> _F64 | None:
    if initial is None:
        return None
    guess = np.asarray(initial, dtype=np.float64)
    if guess.shape != (4, 4) or not np.isfinite(guess).all():
        raise GeometryError(f"a guess is a finite (4, 4) matrix, not {guess.shape}")
    return guess


def _cleaned(
    cloud: NDArray[np.floating], config: LidarCalibrationConfig, dropped: Counter[str]
) -> _F64:
    """Return the usable points (N, 3) of a cloud and count the others."""
    points = np.asarray(cloud, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 3:
        raise GeometryError(f"a cloud is (N, 3), not {points.shape}")
    points = points[:, :3]
    finite = np.isfinite(points).all(axis=1)
    points = points[finite]
    ranges = np.linalg.norm(points, axis=1)
    near, far = ranges < config.nearest_m, ranges > config.farthest_m
    dropped.update(
        {
            "not finite": int((~finite).sum()),
            "too near": int(near.sum()),
            "too far": int(far.sum()),
        }
    )
    return np.ascontiguousarray(points[~near & ~far])


def _unusable(clouds: Sequence[_F64]) -> str | None:
    """Return why a scene cannot be used, or None."""
    for name, cloud in zip(("target", "source"), clouds, strict=True):
        if len(cloud) == 0:
            return f"the {name}'s cloud has no usable point"
        if len(cloud) < _LIMITS.fewest_points:
            return f"the {name}'s cloud has {len(cloud)} points only"
    if np.array_equal(clouds[0], clouds[1]):
        return "both clouds are the same data"
    return None


def _solved(
    count: int,
    used: list[Scene],
    ranked: list[Candidate],
    config: LidarCalibrationConfig,
    dropped: Counter[str],
    left_out: dict[int, str],
) -> PairRegistration:
    """Refine the best candidate on all scenes and judge it."""
    winner = ranked[0]
    voxel, kernel = config.voxel_m, config.kernel_m
    pairs = [
        (surface(s.target, voxel, _FINE_PROBES), surface(s.source, voxel, _FINE_PROBES))
        for s in used
    ]
    stages = (Stage(0.3, 2 * kernel, 8), Stage(0.3, kernel, 20))
    T = refine(pairs, winner.T_target_source, stages)
    spread = solve_spread(pairs, T, stages[-1])
    total = sum((agreement(*s.seen, T) for s in used), start=Agreement())
    weak, _ = weak_directions(spread.G, _LIMITS)
    rivals = tuple(_rival(c, winner) for c in ranked[1:])
    per_scene: list[_F64 | None] = [None] * count
    for scene, solution in zip(used, spread.scene_transforms, strict=True):
        per_scene[scene.index] = solution
    verdict, why = judge(
        Evidence(
            T=T,
            agreement=total,
            rivals=rivals,
            votes=winner.scenes,
            used=tuple(s.index for s in used),
            left_out=left_out,
            weak=weak,
            spread=spread,
        ),
        _LIMITS,
    )
    return PairRegistration(
        T_target_source=T,
        scene_T_target_source=tuple(per_scene),
        sd_translation_m=spread.translation_m,
        sd_rotation_deg=spread.rotation_deg,
        leave_one_out=spread.leave_one_out,
        rms_m=spread.rms_m,
        overlap=total.overlap,
        overlap_05=total.overlap_05,
        scenes_agreeing=(len(winner.scenes), len(used)),
        weak_directions=tuple(direction.name for direction in weak),
        information=spread.information,
        structure_share=total.share,
        free_space_violation=total.violation,
        rivals=rivals,
        verdict=verdict,
        why=why,
        dropped_points=dict(dropped),
        scenes_left_out=left_out,
    )


def _rival(candidate: Candidate, winner: Candidate) -> Rival:
    own = candidate.agreement
    fits = own.violation < _LIMITS.violation_bad
    close = fits and candidate.score > _LIMITS.rival_score * winner.score
    return Rival(
        candidate.T_target_source, own.share, own.violation, len(candidate.scenes), bool(close)
    )


def _nothing(count: int, dropped: Counter[str], left_out: dict[int, str]) -> PairRegistration:
    reasons = "; ".join(f"scene {index + 1}: {why}" for index, why in left_out.items())
    why = (
        f"No scene could be used ({reasons or 'none was given'})."
        if len(left_out) == count
        else "No place of the source within the largest translation fits any scene."
    )
    unknown = np.full(3, np.inf)
    return PairRegistration(
        T_target_source=None,
        scene_T_target_source=(None,) * count,
        sd_translation_m=unknown,
        sd_rotation_deg=unknown,
        leave_one_out=None,
        rms_m=float("nan"),
        overlap=0.0,
        overlap_05=0.0,
        scenes_agreeing=(0, count - len(left_out)),
        weak_directions=(),
        information=np.zeros((6, 6)),
        structure_share=0.0,
        free_space_violation=0.0,
        rivals=(),
        verdict=Verdict.BAD,
        why=(why,),
        dropped_points=dict(dropped),
        scenes_left_out=left_out,
    )
