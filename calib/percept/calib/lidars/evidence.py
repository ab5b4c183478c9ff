"""What the verdicts on a rig rest on: its registrations, and what they say together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.result import RigLoop
from percept.calib.lidars.rig_graph import PairEdge, Placement
from percept.calib.lidars.scenes import CalibrationScenes
from percept.calib.limits import LidarLimits
from percept.core.results import Verdict

__all__ = ["USABLE", "RigEvidence", "RigGraph", "usable_edges"]

_F64 = NDArray[np.float64]

USABLE = (Verdict.GOOD, Verdict.DOUBTFUL)


@dataclass(frozen=True, slots=True, eq=False)
class RigEvidence:
    """All that was measured.

    Attributes:
        reference: The sensor that everything is placed against.
        others: The sensors to place.
        scenes: The clouds that were used.
        found: Registrations by (target, source).
        start: `T_reference_sensor` (4, 4) that were given, and the reference's.
        limits: What the verdicts rest on.
    """

    reference: str
    others: tuple[str, ...]
    scenes: CalibrationScenes
    found: Mapping[tuple[str, str], PairRegistration]
    start: Mapping[str, _F64]
    limits: LidarLimits


@dataclass(frozen=True, slots=True, eq=False)
class RigGraph:
    """What the registrations say together."""

    placed: dict[str, Placement]
    poses: dict[str, _F64]
    covariances: dict[str, _F64]
    loops: tuple[RigLoop, ...]
    left_out: PairEdge | None


def usable_edges(found: Mapping[tuple[str, str], PairRegistration]) -> list[PairEdge]:
    """Return the registrations that are good or doubtful as edges of the rig's graph."""
    return [
        PairEdge(
            target,
            source,
            pair.T_target_source,
            _covariance(pair),
            pair.overlap,
            trusted=pair.verdict is Verdict.GOOD,
        )
        for (target, source), pair in found.items()
        if pair.verdict in USABLE and pair.T_target_source is not None
    ]


def _covariance(pair: PairRegistration) -> _F64:
    return np.asarray(np.linalg.inv(pair.information), dtype=np.float64)
