"""How far a LiDAR pair's transform can be trusted: spread and weak directions.

The covariance ``sigma^2 H^-1`` takes residuals for independent and comes out 5 to 10 times too
small. Residuals within a part of a scene are alike, so parts are left out as a whole instead
(delete-a-group jackknife; Shao & Tu, "The Jackknife and Bootstrap", 1995, section 2.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.lidars.registration import (
    Stage,
    Surface,
    System,
    linearise,
    refine,
    refine_with_offset,
)
from percept.calib.limits import LidarLimits

__all__ = [
    "Fault",
    "Spread",
    "WeakDirection",
    "solve_spread",
    "solve_with_offset",
    "weak_directions",
]

_F64 = NDArray[np.float64]
_WIDE = Stage(0.6, 0.3, 8)  # a scene's own answer must get away from the joint one
_Pairs = Sequence[tuple[Surface, Surface]]
_SECTORS = 8
# One step with the same neighbours moves less than a solution that looks for them again; in
# worlds with known truth the errors are 1.3 to 1.6 times what the sectors alone say.
_UNDERSTATED = 1.5
_AXES = {"rotation": ("roll", "pitch", "yaw"), "translation": ("forward x", "left y", "up z")}


@dataclass(frozen=True, slots=True)
class Fault:
    """How much a sensor seems to measure wrongly, and the standard deviation of that.

    Attributes:
        value: Metres that ranges are too long, or radians that beams point too high.
        sd: Of what the clouds say about it.
    """

    value: float
    sd: float

    def exceeds(self, least: float, sds: float) -> bool:
        """Whether it is more than both a size and a number of its standard deviations."""
        return abs(self.value) > max(least, sds * self.sd)


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """The spread of a transform; rotations (rad) and translations (m) along the target's axes.

    Attributes:
        covariance: (6, 6) of rotation, then translation, whatever the range offset is.
        G: (6, 6) the part of the Hessian that comes from the shape of the surfaces.
        scene_transforms: (4, 4) of each scene alone.
        scene_covariances: (n, 6, 6) of each of these.
        leave_one_out: Largest (metres, degrees) when one scene is left out, None with one scene.
        rms_m: Robust root mean square residual.
        offset: Ranges of the source that are too long, compared with the target's.
        tilt: Beams of the source that point higher than they are said to.
    """

    covariance: _F64
    G: _F64
    scene_transforms: tuple[_F64, ...]
    scene_covariances: _F64
    leave_one_out: tuple[float, float] | None
    rms_m: float
    offset: Fault
    tilt: Fault

    @property
    def rotation_deg(self) -> _F64:
        """(3,) degrees about the target's x, y, z."""
        return np.degrees(np.sqrt(np.diag(self.covariance)[:3]))

    @property
    def translation_m(self) -> _F64:
        """(3,) metres along the target's x, y, z."""
        return np.sqrt(np.diag(self.covariance)[3:])

    @property
    def information(self) -> _F64:
        """(6, 6) inverse of the covariance."""
        return np.asarray(np.linalg.pinv(self.covariance, hermitian=True), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class WeakDirection:
    """A direction that the surroundings determine badly.

    Attributes:
        name: In words, such as "forward x" or "yaw".
        ratio: Its information over that of the strongest direction of its kind.
    """

    name: str
    ratio: float


def solve_with_offset(
    pairs: _Pairs, T_target_source: _F64, stage: Stage, offset_sd_m: float
) -> tuple[_F64, float]:
    """Return the transform (4, 4) and how much too far (m) the source measures.

    A range offset moves a sensor along its view in every scene alike, so that no scene can
    contradict another; where the view is wide the surfaces themselves tell it from a move.

    Args:
        pairs: Surfaces of target and source, one pair a scene.
        T_target_source: (4, 4), the solution without an offset.
        stage: Gate and kernel.
        offset_sd_m: What offsets of sound sensors are like.
    """
    systems = [linearise(a, b, T_target_source, stage, sectors=_SECTORS) for a, b in pairs]
    covariance = _sector_covariance(systems)
    if not np.isfinite(covariance).all():
        return T_target_source, 0.0
    stiffness = _variance_of_unit(_summed(systems), covariance) / offset_sd_m**2
    return refine_with_offset(pairs, T_target_source, stage, stiffness)


def solve_spread(
    pairs: _Pairs,
    T_target_source: _F64,
    stage: Stage,
    *,
    offset_m: float = 0.0,
    limits: LidarLimits | None = None,
) -> Spread:
    """Leave out sectors and scenes of the joint solution (4, 4) in turn.

    Args:
        pairs: Surfaces of target and source, one pair a scene.
        T_target_source: (4, 4), the solution.
        stage: Gate and kernel.
        offset_m: By how much the source was found to measure too far.
        limits: What offsets of sound sensors are like, and when beams are at fault.
    """
    limits = limits or LidarLimits()
    systems = [
        linearise(a, b, T_target_source, stage, sectors=_SECTORS, offset_m=offset_m)
        for a, b in pairs
    ]
    covariance = _sector_covariance(systems)
    own = [refine([pair], T_target_source, [_WIDE, stage], offset_m=offset_m) for pair in pairs]
    own_covariances = np.stack(
        [
            _sector_covariance([linearise(*pair, T, stage, sectors=_SECTORS, offset_m=offset_m)])
            for pair, T in zip(pairs, own, strict=True)
        ]
    )
    moves = None
    if len(pairs) > 1:
        rest = (
            own[::-1]
            if len(pairs) == 2
            else [
                refine([*pairs[:k], *pairs[k + 1 :]], T_target_source, [stage], offset_m=offset_m)
                for k in range(len(pairs))
            ]
        )
        steps = np.stack([_step_between(T_target_source, T) for T in rest])
        covariance = _larger(covariance, _group_covariance(steps))
        moves = (
            float(np.linalg.norm(steps[:, 3:], axis=1).max()),
            float(np.degrees(np.linalg.norm(steps[:, :3], axis=1).max())),
        )
    squares = sum(float(system.squares.sum()) for system in systems)
    weights = sum(float(system.weights.sum()) for system in systems)
    H, b = _summed(systems), np.sum([system.b.sum(axis=0) for system in systems], axis=0)
    unit = _variance_of_unit(H, covariance)
    along, offset = _fault(H, b, unit, 6)
    bent, tilt = _fault(H, b, unit, 7)
    variance = 1 / (1 / offset.sd**2 + 1 / limits.offset_sd_m**2)
    covariance = covariance + variance * np.outer(along, along)
    if tilt.exceeds(np.radians(limits.tilt_doubtful_deg), limits.fault_sd):
        # The place is off by what the fault does to it, which is not corrected.
        covariance = covariance + tilt.value**2 * np.outer(bent, bent)
    return Spread(
        covariance=covariance,
        G=np.sum([system.G.sum(axis=0) for system in systems], axis=0),
        scene_transforms=tuple(own),
        scene_covariances=own_covariances,
        leave_one_out=moves,
        rms_m=float(np.sqrt(squares / max(weights, 1e-12))),
        offset=Fault(offset_m + offset.value, offset.sd),
        tilt=tilt,
    )


def _summed(systems: list[System]) -> _F64:
    return np.asarray(np.sum([system.H.sum(axis=0) for system in systems], axis=0))


def _variance_of_unit(H: _F64, covariance: _F64) -> float:
    """Return the factor that turns the inverse of H into a covariance (6, 6) like a given one."""
    inverse = np.diag(np.linalg.pinv(H[:6, :6], hermitian=True))
    return float((np.diag(covariance) / np.maximum(inverse, 1e-30)).mean())


def _fault(H: _F64, b: _F64, unit: float, column: int) -> tuple[_F64, Fault]:
    """Return how a fault moves the transform (6,) a unit, and what the clouds say about it.

    One step away from the solution, with the transform free to follow (Schur complement).
    """
    moved = -np.linalg.pinv(H[:6, :6], hermitian=True) @ H[:6, column]
    own = H[column, column] + H[column, :6] @ moved
    value = -(b[column] + moved @ b[:6]) / max(own, 1e-30)
    return moved, Fault(float(value), float(np.sqrt(unit / max(own, 1e-30))))


def _sector_covariance(systems: list[System]) -> _F64:
    """Return the covariance (6, 6) by leaving out one sector of one scene at a time.

    Each solution is one Gauss-Newton step away, with the sector's part taken out of the sums.
    """
    H = np.concatenate([system.H[:, :6, :6] for system in systems])
    b = np.concatenate([system.b[:, :6] for system in systems])
    filled = np.trace(H, axis1=1, axis2=2) > 0
    H, b = H[filled], b[filled]
    if len(H) < 2:
        return np.diag(np.full(6, np.inf))
    ridge = 1e-9 * np.diag(np.diag(H.sum(axis=0))) + 1e-12 * np.eye(6)
    steps = -np.linalg.solve(H.sum(axis=0) - H + ridge, (b.sum(axis=0) - b)[..., None])[..., 0]
    return _UNDERSTATED**2 * _group_covariance(steps)


def _group_covariance(steps: _F64) -> _F64:
    """Return the jackknife covariance (6, 6) of solutions (n, 6) that each lack one part."""
    offsets = steps - steps.mean(axis=0)
    covariance: _F64 = (len(steps) - 1) / len(steps) * offsets.T @ offsets
    return covariance


def _larger(a: _F64, b: _F64) -> _F64:
    """Scale `a` (6, 6) up where `b` has the larger variance; correlations stay those of `a`."""
    scale = np.sqrt(np.maximum(np.diag(b) / np.maximum(np.diag(a), 1e-30), 1.0))
    larger: _F64 = a * np.outer(scale, scale)
    return larger


def _step_between(T_from: _F64, T_to: _F64) -> _F64:
    """Return rotation (rad) and shift (m) (6,) along the target's axes."""
    turn = Rotation.from_matrix(T_to[:3, :3] @ T_from[:3, :3].T).as_rotvec()
    return np.concatenate([turn, T_to[:3, 3] - T_from[:3, 3]])


def weak_directions(H: _F64, limits: LidarLimits) -> tuple[list[WeakDirection], float]:
    """Name the directions that the Hessian (6, 6) says little about.

    Rotation and translation have different units and are judged apart, each with the other one
    marginalised (Schur complement; DCReg, arXiv 2509.06285, section IV).

    Returns:
        The weak directions, weakest first, and the lowest ratio of all.
    """
    r, t = slice(0, 3), slice(3, 6)
    found: list[WeakDirection] = []
    lowest = 1.0
    for kind, own, other in (("rotation", r, t), ("translation", t, r)):
        schur = H[own, own] - H[own, other] @ np.linalg.pinv(H[other, other]) @ H[other, own]
        values, vectors = np.linalg.eigh((schur + schur.T) / 2)
        ratios = np.maximum(values, 0) / max(values[-1], 1e-30)
        lowest = min(lowest, float(ratios[0]))
        for ratio, vector in zip(ratios, vectors.T, strict=True):
            if ratio < limits.weak_doubtful:
                found.append(WeakDirection(_in_words(vector, _AXES[kind]), float(ratio)))
    return sorted(found, key=lambda weak: weak.ratio), lowest


def _in_words(vector: _F64, names: tuple[str, ...]) -> str:
    large = [name for name, part in zip(names, np.abs(vector), strict=True) if part > 0.5]
    return " and ".join(large)
