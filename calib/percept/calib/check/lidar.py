"""Where LiDARs sit as seen from each other, by a new log alone, with known-bad controls."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from percept.calib.check.axes import base_motion, base_sd, plant_controls
from percept.calib.check.result import AXES, Control, Measurement
from percept.calib.lidars.free_space import Agreement, agreement, what_is_seen
from percept.calib.lidars.levelling import find_planes
from percept.calib.lidars.pair import LidarCalibrationConfig, register_pair
from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.pair_spread import solve_spread
from percept.calib.lidars.registration import Stage, Surface, linearise, refine, surface
from percept.calib.lidars.scenes import CalibrationScenes
from percept.calib.limits import CheckLimits, LidarLimits
from percept.core.results import Verdict

__all__ = ["measure_lidars"]

_F64 = NDArray[np.float64]
_Clouds = Sequence[tuple[_F64, _F64]]
_Surfaces = Sequence[tuple[Surface, Surface]]

_USABLE = (Verdict.GOOD, Verdict.DOUBTFUL)
_ELSEWHERE = "What both see is symmetric: the sensor fits as well at quite another place."
_COARSER = 2.0  # the control needs to find centimetres, not millimetres


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A place of the sensor that the clouds allow; transforms and covariances as `Measurement`."""

    T_against_sensor: _F64
    covariance: _F64
    scene_places: tuple[_F64, ...]
    verdict: Verdict
    why: tuple[str, ...]
    rivals: tuple[_F64, ...] = ()


def measure_lidars(
    scenes: CalibrationScenes,
    T_base_sensor: Mapping[str, _F64],
    reference: str,
    config: LidarCalibrationConfig,
    limits: CheckLimits,
    progress: Callable[[float], None],
) -> list[Measurement]:
    """Register every two LiDARs of a rig, from the rig's places and from none.

    Args:
        scenes: Clouds of the LiDARs, each in its own frame.
        T_base_sensor: (4, 4) of each by the rig.
        reference: Against which the others are looked at where it is one of two.
        config: Settings of the registrations.
        limits: The limits.
        progress: Called with the share that is done.
    """
    names = [reference, *(name for name in T_base_sensor if name != reference)]
    pairs = [pair for pair in combinations(names, 2) if scenes.of(*pair)]
    measure = partial(_measure, scenes, T_base_sensor, config, limits)
    found = []
    # Most of the time goes into neighbour searches, which run without Python's lock.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, measured in enumerate(pool.map(measure, pairs), 1):
            found.append(measured)
            progress(number / len(pairs))
    return found


def _measure(
    scenes: CalibrationScenes,
    T_base_sensor: Mapping[str, _F64],
    config: LidarCalibrationConfig,
    limits: CheckLimits,
    pair: tuple[str, str],
) -> Measurement:
    """Register one pair (against, sensor)."""
    against, sensor = pair
    T_base_against = T_base_sensor[against]
    T_rig = np.asarray(np.linalg.inv(T_base_against) @ T_base_sensor[sensor])
    registered = register_pair(scenes.of(*pair), config, initial=T_rig)
    kept = [k for k, T in enumerate(registered.scene_T_target_source) if T is not None]
    clouds = [_in_range(scenes.of(*pair)[k], config) for k in kept]
    surfaces = [_surfaces(pair_of, _COARSER * config.voxel_m) for pair_of in clouds]
    place = _place(registered, T_rig, clouds, surfaces, config)
    if place is None:
        ambiguous = registered.verdict is Verdict.AMBIGUOUS
        verdict = Verdict.AMBIGUOUS if ambiguous else Verdict.BAD
        return _nothing(pair, verdict, registered.why, len(kept))
    controls = _controls(T_base_against, place, clouds, surfaces, config, limits)
    if not _same_on(controls, T_base_against, place):
        return _nothing(pair, Verdict.AMBIGUOUS, (_ELSEWHERE, *registered.why[:1]), len(kept))
    return Measurement(
        against=against,
        sensor=sensor,
        T_against_sensor=place.T_against_sensor,
        covariance=place.covariance,
        controls=controls,
        contradictions=_contradictions(T_base_against, place, limits),
        kind="lidar",
        scenes=len(kept),
        confirmed=len(kept) > 1,
        verdict=place.verdict,
        why=place.why,
    )


def _place(
    registered: PairRegistration,
    T_rig: _F64,
    clouds: _Clouds,
    surfaces: _Surfaces,
    config: LidarCalibrationConfig,
) -> _Place | None:
    """Return the place by the free registration, or the rig's where that one is undecided.

    A corridor lets a registration slide; the rig's place is then as good as any other, as far
    as the axes go that the corridor does hold.
    """
    T = registered.T_target_source
    if T is None:
        return None
    if registered.verdict in _USABLE:
        own = tuple(one for one in registered.scene_T_target_source if one is not None)
        return _Place(T, _covariance(registered), own, registered.verdict, registered.why)
    T_near = refine(surfaces, T_rig, _stages(config))
    if not _fits(clouds, T_near, config):
        return None
    spread = solve_spread(surfaces, T_near, _stages(config)[-1])
    rivals = (T, *(rival.T_target_source for rival in registered.rivals if rival.close))
    why = registered.why[:1]
    return _Place(T_near, spread.covariance, spread.scene_transforms, Verdict.DOUBTFUL, why, rivals)


def _covariance(registered: PairRegistration) -> _F64:
    """Return the covariance (6, 6) with the stated spreads and the correlations of the Hessian."""
    shape = np.linalg.inv(registered.information)
    stated = np.concatenate([np.radians(registered.sd_rotation_deg), registered.sd_translation_m])
    grow = stated / np.sqrt(np.diag(shape))
    return np.asarray(shape * np.outer(grow, grow), dtype=np.float64)


def _fits(clouds: _Clouds, T: _F64, config: LidarCalibrationConfig) -> bool:
    """Whether two clouds can be of one place at all, with the limits of the registration."""
    found, limits = Agreement(), LidarLimits()
    for pair in clouds:
        seen = [
            what_is_seen(points, surface(points, _COARSER * config.voxel_m), find_planes(points, 1))
            for points in pair
        ]
        found += agreement(seen[0], seen[1], T)
    return (
        found.seen >= limits.fewest_seen
        and found.share >= limits.least_share
        and found.sharpness >= limits.least_sharpness
        and found.violation < limits.violation_bad
    )


def _same_on(controls: Mapping[str, Control], T_base_against: _F64, place: _Place) -> bool:
    """Whether other places that fit differ only along axes that are not judged anyway."""
    limits = LidarLimits()
    most = np.repeat([limits.same_translation_m, limits.same_rotation_deg], 3)
    judged = np.array([controls[name].detected for name in AXES])
    motions = [base_motion(T_base_against, place.T_against_sensor, T) for T in place.rivals]
    return all((np.abs(motion)[judged] <= most[judged]).all() for motion in motions)


def _controls(
    T_base_against: _F64,
    place: _Place,
    clouds: _Clouds,
    surfaces: _Surfaces,
    config: LidarCalibrationConfig,
    limits: CheckLimits,
) -> dict[str, Control]:
    """Plant shifts at the place by one half of the data and look for them in the other."""
    stages, sd = _stages(config), base_sd(T_base_against, place.covariance)
    halves = surfaces[0::2], surfaces[1::2]
    if len(surfaces) == 1:
        halves = _half_surfaces(clouds[0], config)
    folds = [
        (refine(other, place.T_against_sensor, stages), partial(_solve, own, stages))
        for own, other in (halves, halves[::-1])
    ]
    controls = plant_controls("lidar", T_base_against, sd, folds, limits, held_out=True)
    systems = [linearise(a, b, place.T_against_sensor, stages[-1]) for a, b in surfaces]
    G = np.sum([system.G.sum(axis=0) for system in systems], axis=0)
    fixed = _shares_of_information(T_base_against, G) >= LidarLimits().weak_bad
    return {
        name: control if fixed[k] else replace(control, detected=False, determined=False)
        for k, (name, control) in enumerate(controls.items())
    }


def _half_surfaces(
    clouds: tuple[_F64, _F64], config: LidarCalibrationConfig
) -> tuple[_Surfaces, _Surfaces]:
    """Split the points of one scene in two halves that share the surroundings and no noise."""
    rng = np.random.default_rng(0)
    second = [rng.permutation(len(points)) % 2 == 1 for points in clouds]
    halves = [
        [_surfaces((clouds[0][mask[0]], clouds[1][mask[1]]), _COARSER * config.voxel_m)]
        for mask in ((second[0], second[1]), (~second[0], ~second[1]))
    ]
    return halves[0], halves[1]


def _shares_of_information(T_base_against: _F64, G: _F64) -> _F64:
    """Return (6,) how well the axes of the base are determined, over the best direction.

    Rotation and translation apart, each with the other one marginalised (Schur complement).

    Args:
        T_base_against: (4, 4).
        G: (6, 6) Hessian of the shapes: rotation, then translation, in the axes of `against`.
    """
    turned = np.kron(np.eye(2), T_base_against[:3, :3])
    H = turned @ G @ turned.T
    shares = []
    for own, other in ((slice(3, 6), slice(0, 3)), (slice(0, 3), slice(3, 6))):
        schur = H[own, own] - H[own, other] @ np.linalg.pinv(H[other, other]) @ H[other, own]
        strongest = max(float(np.linalg.eigvalsh(schur)[-1]), 1e-30)
        inverse = np.linalg.inv(schur / strongest + 1e-9 * np.eye(3))
        shares.append(1 / np.diag(inverse))
    return np.concatenate(shares)


def _solve(surfaces: _Surfaces, stages: Sequence[Stage], T_start: _F64) -> _F64:
    return refine(surfaces, T_start, stages)


def _stages(config: LidarCalibrationConfig) -> tuple[Stage, ...]:
    """Return the stages that a place some centimetres off needs; 1 deg is 35 cm at 20 m."""
    return Stage(0.6, 4 * config.kernel_m, 8), Stage(0.3, config.kernel_m, 10)


def _contradictions(T_base_against: _F64, place: _Place, limits: CheckLimits) -> dict[str, float]:
    """Return by axis how far scenes differ, where that is far beyond their spreads."""
    count = len(place.scene_places)
    if count < 2:
        return {}
    sd = base_sd(T_base_against, place.covariance) * np.sqrt(2 * count)
    least = np.repeat([limits.between_scenes_m, limits.between_scenes_deg], 3)
    motions = [base_motion(T_base_against, *two) for two in combinations(place.scene_places, 2)]
    largest = np.abs(motions).max(axis=0)
    beyond = largest > np.maximum(limits.between_scenes_sd * sd, least)
    return {name: float(largest[k]) for k, name in enumerate(AXES) if beyond[k]}


def _in_range(pair: tuple[_F64, _F64], config: LidarCalibrationConfig) -> tuple[_F64, _F64]:
    kept = []
    for points in pair:
        ranges = np.linalg.norm(points, axis=1)
        kept.append(points[(ranges >= config.nearest_m) & (ranges <= config.farthest_m)])
    return kept[0], kept[1]


def _surfaces(pair: tuple[_F64, _F64], voxel_m: float) -> tuple[Surface, Surface]:
    return surface(pair[0], voxel_m), surface(pair[1], voxel_m)


def _nothing(
    pair: tuple[str, str], verdict: Verdict, why: tuple[str, ...], scenes: int
) -> Measurement:
    return Measurement(
        against=pair[0],
        sensor=pair[1],
        T_against_sensor=None,
        covariance=np.full((6, 6), np.inf),
        controls={},
        kind="lidar",
        scenes=scenes,
        confirmed=False,
        verdict=verdict,
        why=why[:2],
    )
