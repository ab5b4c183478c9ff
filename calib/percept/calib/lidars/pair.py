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

from percept.calib.lidars.free_space import Agreement
from percept.calib.lidars.pair_candidates import (
    Candidate,
    Scene,
    rank_candidates,
    refine_candidate,
)
from percept.calib.lidars.pair_result import PairRegistration, Rival
from percept.calib.lidars.pair_spread import solve_spread, solve_with_offset, weak_directions
from percept.calib.lidars.pair_verdict import Evidence, judge
from percept.calib.lidars.registration import Stage, refine
from percept.calib.lidars.view import SensorView, UnusableCloud, prepare_view
from percept.calib.limits import LidarLimits
from percept.core.errors import GeometryError
from percept.core.results import Verdict
from percept.core.settings import Settings

__all__ = ["LidarCalibrationConfig", "register_pair", "register_views", "view_of"]

_F64 = NDArray[np.float64]
_LIMITS = LidarLimits()


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
    views = [(view_of(target, config), view_of(source, config)) for target, source in scenes]
    return register_views(views, config, initial)


def view_of(
    cloud: NDArray[np.floating], config: LidarCalibrationConfig
) -> SensorView | UnusableCloud:
    """Prepare a cloud (N, 3 or more) for `register_views`, as the settings want it."""
    return prepare_view(
        cloud,
        nearest_m=config.nearest_m,
        farthest_m=config.farthest_m,
        voxel_m=config.voxel_m,
    )


def register_views(
    scenes: Sequence[tuple[SensorView | UnusableCloud, SensorView | UnusableCloud]],
    config: LidarCalibrationConfig,
    initial: NDArray[np.floating] | None = None,
    *,
    names: Sequence[str] | None = None,
    local: bool = False,
) -> PairRegistration:
    """Find where one LiDAR sits as seen from another, from clouds that are prepared.

    Args:
        scenes: What target and source saw, for each scene.
        config: Settings; those that the views were prepared with.
        initial: A guess (4, 4) of `T_target_source`.
        names: What the scenes are called in words; their numbers from 1 on if None.
        local: Look near the guess only. It is judged as any other answer, rivals excepted.

    Raises:
        GeometryError: If the guess is not (4, 4).
    """
    guess = _checked_guess(initial)
    dropped: Counter[str] = Counter()
    left_out: dict[int, str] = {}
    used: list[Scene] = []
    for index, (target, source) in enumerate(scenes):
        dropped.update(target.dropped)
        dropped.update(source.dropped)
        if isinstance(target, UnusableCloud):
            left_out[index] = f"the target's {target.reason}"
        elif isinstance(source, UnusableCloud):
            left_out[index] = f"the source's {source.reason}"
        elif np.array_equal(target.points, source.points):
            left_out[index] = "both clouds are the same data"
        else:
            used.append(Scene(index, target, source))
    called = tuple(names or (str(number + 1) for number in range(len(scenes))))
    ranked: list[Candidate] = []
    if used and local and guess is not None:
        ranked = refine_candidate(used, guess, _LIMITS)
    elif used:
        ranked = rank_candidates(used, config.largest_translation_m, guess, _LIMITS)
    if not ranked:
        return _nothing(called, dropped, left_out)
    return _solved(called, used, ranked, config, dropped, left_out)


def _checked_guess(initial: NDArray[np.floating] | None) -> _F64 | None:
    if initial is None:
        return None
    guess = np.asarray(initial, dtype=np.float64)
    if guess.shape != (4, 4) or not np.isfinite(guess).all():
        raise GeometryError(f"a guess is a finite (4, 4) matrix, not {guess.shape}")
    return guess


def _solved(
    names: tuple[str, ...],
    used: list[Scene],
    ranked: list[Candidate],
    config: LidarCalibrationConfig,
    dropped: Counter[str],
    left_out: dict[int, str],
) -> PairRegistration:
    """Refine the best candidate on all scenes and judge it."""
    winner = ranked[0]
    pairs = [scene.fine for scene in used]
    stages = (Stage(0.3, 2 * config.kernel_m, 8), Stage(0.3, config.kernel_m, 20))
    T = refine(pairs, winner.T_target_source, stages)
    T, offset_m = solve_with_offset(pairs, T, stages[-1], _LIMITS.offset_sd_m)
    spread = solve_spread(pairs, T, stages[-1], offset_m=offset_m, limits=_LIMITS)
    total = sum((scene.agreement(T) for scene in used), start=Agreement())
    weak, _ = weak_directions(spread.G, _LIMITS)
    rivals = tuple(_rival(c, winner) for c in ranked[1:])
    per_scene: list[_F64 | None] = [None] * len(names)
    for scene, solution in zip(used, spread.scene_transforms, strict=True):
        per_scene[scene.index] = solution
    verdict, why, advice = judge(
        Evidence(
            T=T,
            names=names,
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
        range_offset_m=offset_m,
        range_offset_sd_m=spread.offset.sd,
        rivals=rivals,
        verdict=verdict,
        why=why,
        advice=advice,
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


def _nothing(
    names: tuple[str, ...], dropped: Counter[str], left_out: dict[int, str]
) -> PairRegistration:
    reasons = "; ".join(f"scene {names[index]}: {why}" for index, why in left_out.items())
    why = (
        f"No scene could be used ({reasons or 'none was given'})."
        if len(left_out) == len(names)
        else "No place of the source within the largest translation fits any scene."
    )
    unknown = np.full(3, np.inf)
    return PairRegistration(
        T_target_source=None,
        scene_T_target_source=(None,) * len(names),
        sd_translation_m=unknown,
        sd_rotation_deg=unknown,
        leave_one_out=None,
        rms_m=float("nan"),
        overlap=0.0,
        overlap_05=0.0,
        scenes_agreeing=(0, len(names) - len(left_out)),
        weak_directions=(),
        information=np.zeros((6, 6)),
        structure_share=0.0,
        free_space_violation=0.0,
        range_offset_m=0.0,
        range_offset_sd_m=np.inf,
        rivals=(),
        verdict=Verdict.BAD,
        why=(why,),
        advice=(),
        dropped_points=dict(dropped),
        scenes_left_out=left_out,
    )
