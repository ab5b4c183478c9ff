"""The settings of all classes as columns, so that they can be taken for many tracks at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from percept.tracking.config import TrackerConfig

__all__ = ["ClassColumns"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClassColumns:
    """One number for each of C classes; see `ClassSettings` for their meaning.

    Attributes:
        turns: (C,) bool whether the motion is `turn`.
        elongated: (C,) bool.
        walks: (C, 3) float64 `velocity_walk_mps`, `height_walk_m`, `turn_walk_radps`.
        birth_variances: (C, 3) float64 of vx, vy and the turn rate of a new track.
        position_variance_m2: (C,) float64 of a measured x or y at no range.
        position_sd_per_m: (C,) float64.
        height_variance_m2: (C,) float64.
        gates_m: (C,) float64.
        gate_speeds_mps: (C,) float64 twice `birth_speed_mps`, by which gates grow.
        keep_scores: (C,) float64.
        birth_scores: (C,) float64.
        t_birth_ns: (C,) float64.
        t_expire_ns: (C,) float64.
        t_prune_ns: (C,) float64.
    """

    turns: NDArray[np.bool_]
    elongated: NDArray[np.bool_]
    walks: _F64
    birth_variances: _F64
    position_variance_m2: _F64
    position_sd_per_m: _F64
    height_variance_m2: _F64
    gates_m: _F64
    gate_speeds_mps: _F64
    keep_scores: _F64
    birth_scores: _F64
    t_birth_ns: _F64
    t_expire_ns: _F64
    t_prune_ns: _F64

    @classmethod
    def of(cls, config: TrackerConfig) -> Self:
        """Return the columns of some settings, in the order of their classes."""
        settings = config.classes.values()

        def column(name: str) -> _F64:
            return np.array([getattr(one, name) for one in settings], dtype=np.float64)

        turns = np.array([one.motion == "turn" for one in settings])
        speed = column("birth_speed_mps")
        turn_rate = np.where(turns, column("birth_turn_radps"), 0.0)
        walks = ("velocity_walk_mps", "height_walk_m", "turn_walk_radps")
        return cls(
            turns=turns,
            elongated=np.array([one.elongated for one in settings]),
            walks=np.stack([column(name) for name in walks], axis=1),
            birth_variances=np.stack([speed, speed, turn_rate], axis=1) ** 2,
            position_variance_m2=column("position_sd_m") ** 2,
            position_sd_per_m=column("position_sd_per_m"),
            height_variance_m2=column("height_sd_m") ** 2,
            gates_m=column("gate_m"),
            gate_speeds_mps=2 * speed,
            keep_scores=column("keep_score"),
            birth_scores=column("birth_score"),
            t_birth_ns=column("t_birth_s") * 1e9,
            t_expire_ns=column("t_expire_s") * 1e9,
            t_prune_ns=column("t_prune_s") * 1e9,
        )

    def centre_variances(self, words: NDArray[np.int64], ranges_m: _F64) -> _F64:
        """Return the (N, 3) variances of measured centres, by class (N,) and range (N,)."""
        variances = np.empty((len(words), 3))
        across = self.position_variance_m2[words] + (self.position_sd_per_m[words] * ranges_m) ** 2
        variances[:, 0] = variances[:, 1] = across
        variances[:, 2] = self.height_variance_m2[words]
        return variances
