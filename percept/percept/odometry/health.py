"""Gaps and jumps of a stream of poses: where it cannot be interpolated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS, NS_PER_S

__all__ = ["Jump", "breaks_of", "find_gaps", "find_jumps"]

_GAP_INTERVALS = 5.0
_SHORTEST_GAP_NS = 100 * NS_PER_MS
_NEIGHBOURS = 5
_SPREADS = 10.0
_MAD_TO_SD = 1.4826
# How far a step may be off without a jump: noise of a pose, and a jerk that no road vehicle
# exceeds but in a crash (the median of the neighbours follows an even acceleration).
_STEP_M, _LARGEST_JERK_MPS3 = 0.15, 20.0
_STEP_RAD, _LARGEST_JERK_RADPS3 = 0.05, 10.0


@dataclass(frozen=True, slots=True)
class Jump:
    """Two poses whose difference contradicts the motion around them.

    Attributes:
        start_ns: Stamp of the pose before.
        end_ns: Stamp of the pose after.
        moved_m: How far the step is from the one that its neighbours make likely, metres.
        turned_rad: The same of its turn, rad.
    """

    start_ns: int
    end_ns: int
    moved_m: float
    turned_rad: float


def find_gaps(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (G, 2) the stamps around each interval that is longer than the stream's own.

    A gap is longer than 5 median intervals, and than 100 ms.

    Args:
        stamps_ns: (N,) int64, rising.
    """
    intervals = np.diff(stamps_ns)
    if not len(intervals):
        return np.zeros((0, 2), dtype=np.int64)
    limit_ns = max(_GAP_INTERVALS * float(np.median(intervals)), _SHORTEST_GAP_NS)
    long = np.flatnonzero(intervals > limit_ns)
    return np.column_stack([stamps_ns[long], stamps_ns[long + 1]])


def find_jumps(
    stamps_ns: NDArray[np.int64], matrices: NDArray[np.float64], gaps_ns: NDArray[np.int64]
) -> tuple[Jump, ...]:
    """Return the steps between poses that contradict the velocity of their neighbours.

    A step is compared with the median velocity, and the median turn rate, of the five steps on
    each side. Steps over a gap are left alone: nothing is known there anyway.

    Args:
        stamps_ns: (N,) int64, rising.
        matrices: (N, 4, 4) poses in one fixed frame.
        gaps_ns: (G, 2) gaps of the stream.
    """
    from scipy.spatial.transform import Rotation

    if len(stamps_ns) < 2 * _NEIGHBOURS:
        return ()
    dt_s = np.diff(stamps_ns) / NS_PER_S
    moves = np.diff(matrices[:, :3, 3], axis=0)
    relative = np.swapaxes(matrices[:-1, :3, :3], 1, 2) @ matrices[1:, :3, :3]
    turns = Rotation.from_matrix(relative).as_rotvec()
    known = ~np.isin(stamps_ns[:-1], gaps_ns[:, 0])
    off_m = _off_neighbours(moves, dt_s, known)
    off_rad = _off_neighbours(turns, dt_s, known)
    jumped = known & (
        (off_m > _limit(off_m, dt_s, _STEP_M, _LARGEST_JERK_MPS3))
        | (off_rad > _limit(off_rad, dt_s, _STEP_RAD, _LARGEST_JERK_RADPS3))
    )
    return tuple(
        Jump(int(stamps_ns[n]), int(stamps_ns[n + 1]), float(off_m[n]), float(off_rad[n]))
        for n in np.flatnonzero(jumped)
    )


def breaks_of(gaps_ns: NDArray[np.int64], jumps: Sequence[Jump]) -> NDArray[np.int64]:
    """Return (B, 2) gaps and jumps together, rising: nothing is interpolated over either.

    Those that overlap become one.
    """
    spans = sorted([*map(tuple, gaps_ns.tolist()), *((j.start_ns, j.end_ns) for j in jumps)])
    joined: list[list[int]] = []
    for start_ns, end_ns in spans:
        if joined and start_ns < joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], end_ns)
        else:
            joined.append([start_ns, end_ns])
    return np.array(joined, dtype=np.int64).reshape(-1, 2)


def _off_neighbours(
    steps: NDArray[np.float64], dt_s: NDArray[np.float64], known: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return (N,) how far steps (N, 3) are from what the median rate around them makes of them."""
    from scipy.ndimage import median_filter

    rates = steps / dt_s[:, None]
    off = np.zeros(len(steps))
    usual = median_filter(rates[known], size=(2 * _NEIGHBOURS + 1, 1), mode="nearest")
    off[known] = np.linalg.norm((rates[known] - usual) * dt_s[known, None], axis=1)
    return off


def _limit(
    off: NDArray[np.float64], dt_s: NDArray[np.float64], floor: float, largest_jerk: float
) -> NDArray[np.float64]:
    noise = _SPREADS * _MAD_TO_SD * float(np.median(off))
    window_s = _NEIGHBOURS * dt_s
    limit: NDArray[np.float64] = floor + noise + largest_jerk * window_s**2 / 2 * dt_s
    return limit
