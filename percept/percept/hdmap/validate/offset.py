"""An offset that nearly all of the way has in common: of the map, of the poses, of the sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy, Kind
from percept.core.polyline import length_m
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.findings import chance_beyond, finding_id
from percept.hdmap.validate.result import StretchOffset

__all__ = ["CommonOffset", "common_offset", "offset_finding"]

_F64 = NDArray[np.float64]

_ROUNDS = 10
_SCALE_M = 0.08
_OBSERVABLE = 0.05
_NEARLY_ALL = 0.8
_AGREE_M = 0.15
_AGREE_SHARE = 0.35
_FLOOR_SD_M = 0.03
_INDEPENDENT_M = 100.0
_BETTER = 0.1
_ENOUGH = 4
_STRETCH_M = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class CommonOffset:
    """What the shifts along the drives have in common.

    Attributes:
        vector_m: (2,) float64 of the paint from the map in the map frame; 0 in a direction
            that was not observed.
        lateral_m: Of the paint to the left, seen from the vehicle: set where the shift turns
            with the vehicle and so is none of the map.
        sd_m: Spread of its length.
        share: Of the stretches that agree with it.
        observable: Whether both directions were observed.
        turns: Whether it turns with the vehicle.
    """

    vector_m: _F64
    lateral_m: float
    sd_m: float
    share: float
    observable: bool
    turns: bool

    @property
    def size_m(self) -> float:
        """How far it is."""
        return abs(self.lateral_m) if self.turns else float(np.linalg.norm(self.vector_m))


def common_offset(
    offsets: Sequence[StretchOffset], along: Sequence[tuple[float, float]]
) -> CommonOffset | None:
    """Fit one offset to shifts across the road, and along it where stop lines tell.

    Args:
        offsets: Along the drives; only those that lines agreed on are used.
        along: Of stop lines that agree: direction of travel in the map frame, and how far
            they lie beyond the map's.
    """
    used = [offset for offset in offsets if offset.lines > 0 and not offset.ambiguous]
    if len(used) < _ENOUGH:
        return None
    yaw = np.array([offset.yaw_rad for offset in used])
    lateral = np.array([offset.lateral_m for offset in used])
    rows = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    if along:
        heading, beyond = np.array(along).T
        # So that few stop lines weigh as much as the many stretches between them.
        repeat = max(1, len(used) // len(along))
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        rows = np.concatenate([rows, np.repeat(ahead, repeat, axis=0)])
        values = np.concatenate([lateral, np.repeat(beyond, repeat)])
    else:
        values = lateral
    vector, residual, observable = _robust_fit(rows, values)
    bias, turned, _ = _robust_fit(np.ones((len(lateral), 1)), lateral)
    shares = _agreeing(residual[: len(lateral)], vector), _agreeing(turned, bias)
    turns = shares[1] > shares[0] + _BETTER
    spread = float(np.median(np.abs(turned if turns else residual))) * 1.48
    independent = 1.0 + len(used) * _STRETCH_M / _INDEPENDENT_M
    sd = math.hypot(_FLOOR_SD_M, spread / math.sqrt(independent))
    return CommonOffset(vector, float(bias[0]), sd, shares[int(turns)], observable, turns)


def offset_finding(
    common: CommonOffset,
    offsets: Sequence[StretchOffset],
    config: ValidationConfig,
    whose: str,
    *,
    has_stop_lines: bool,
) -> Discrepancy | None:
    """Return the one finding of an offset that nearly all of the way has, if it is one.

    Args:
        common: What the shifts have in common.
        offsets: Along the drives.
        config: What counts.
        whose: The drive's name, or empty for all drives.
        has_stop_lines: Whether stop lines told of the direction along the road.
    """
    limit = max(config.global_offset_m, 3 * common.sd_m)
    if common.size_m <= limit or common.share < _NEARLY_ALL:
        return None
    path = np.array([[offset.x_m, offset.y_m, 0.0] for offset in offsets])
    yaw = np.array([offset.yaw_rad for offset in offsets])
    left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    seen = path.copy()
    seen[:, :2] += common.lateral_m * left if common.turns else common.vector_m
    return Discrepancy(
        finding_id=finding_id(Kind.GLOBAL_OFFSET, 0) + (f"-{whose}" if whose else ""),
        kind=Kind.GLOBAL_OFFSET,
        map_element_id=0,
        along_m=0.0,
        offset_m=common.size_m,
        length_m=length_m(path[:, :2]),
        sd_m=common.sd_m,
        observations=len(offsets),
        visits=len({offset.drive for offset in offsets}),
        confidence=common.share * chance_beyond(common.size_m, config.global_offset_m, common.sd_m),
        expected="paint where the map has it" + (f", in the drive {whose}" if whose else ""),
        observed=_words(common, float(np.median(yaw)), has_stop_lines=has_stop_lines),
        points_map=seen,
        points_expected_map=path,
    )


def _words(common: CommonOffset, yaw_rad: float, *, has_stop_lines: bool) -> str:
    if common.turns:
        side = "left" if common.lateral_m > 0 else "right"
        return (
            f"all paint lies {common.size_m:.2f} m to the {side} of the map's whichever way the "
            f"vehicle heads: the mounting of the sensor or the lever arm of the poses"
        )
    x, y = common.vector_m
    along = x * math.cos(yaw_rad) + y * math.sin(yaw_rad)
    across = y * math.cos(yaw_rad) - x * math.sin(yaw_rad)
    words = f"all paint lies {x:+.2f} m in x and {y:+.2f} m in y from the map's, "
    words += f"{across:+.2f} m to the left of the way"
    if common.observable:
        return f"{words} and {along:+.2f} m along it: an offset of the map or of the poses"
    unseen = "stop lines do not agree" if has_stop_lines else "no two stop lines were seen"
    return (
        f"{words}: an offset of the map or of the poses; along the way it cannot be observed, "
        f"as the road is straight and {unseen}"
    )


def _robust_fit(rows: _F64, values: _F64) -> tuple[_F64, _F64, bool]:
    """Return the solution (K,) by reweighted least squares, residuals, and whether it is full."""
    weight = np.ones(len(values))
    observable = True
    solution = np.zeros(rows.shape[1])
    for turn in range(_ROUNDS):
        normal = (rows * weight[:, None]).T @ rows / weight.sum()
        strength, axes = np.linalg.eigh(normal)
        kept = strength > _OBSERVABLE
        observable = bool(kept.all())
        right = (rows * weight[:, None]).T @ values / weight.sum()
        solution = axes[:, kept] @ ((axes[:, kept].T @ right) / strength[kept])
        residual = values - rows @ solution
        scale = max(_SCALE_M, 1.48 * float(np.median(np.abs(residual)))) if turn < 4 else _SCALE_M
        weight = 1.0 / (1.0 + (residual / scale) ** 2)
    return solution, values - rows @ solution, observable


def _agreeing(residual: _F64, solution: _F64) -> float:
    limit = max(_AGREE_M, _AGREE_SHARE * float(np.linalg.norm(solution)))
    return float(np.mean(np.abs(residual) < limit))
