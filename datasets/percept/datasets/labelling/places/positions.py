"""Latitude and longitude of moments, from the fixes of a log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.core.samples import GnssFix, Sample
from percept.core.trajectory import Trajectory
from percept.datasets.labelling.choice.moments import taken_ns

__all__ = ["FixTrack"]

_F64 = NDArray[np.float64]
_LONGEST_GAP_NS = 3_000_000_000
_NO_FIX = -1
_LEAST_FIXES = 2
_STEP_M = 2.0
_FASTEST_MPS = 100.0
_SLACK_M = 50.0
_NOWHERE_DEG = 0.01
_BESIDE = 2
_METRES_A_DEGREE = 111_000.0


class FixTrack:
    """Where a vehicle was on the earth, between its fixes.

    A moment that is more than 3 s from the next fix on one side has no place: at 15 m/s the
    vehicle may have turned off. Nor has one between two fixes that no car drives between. A fix or
    two that jump away from those before and after them are no fixes.

    Args:
        samples: Samples of one topic.

    Attributes:
        dropped: Number of samples that are no fix, or an impossible one.
    """

    def __init__(self, samples: Iterable[Sample]) -> None:
        self.dropped = 0
        fixes: list[tuple[int, int, float, float]] = []
        for one in samples:
            if isinstance(one, GnssFix) and _is_usable(one):
                fixes.append((one.stamp_ns, one.log_time_ns, one.latitude_deg, one.longitude_deg))
            else:
                self.dropped += 1
        unstamped = len(fixes) > 1 and len({fix[0] for fix in fixes}) == 1
        rows = [
            (taken_ns(stamp_ns, at_ns, unstamped=unstamped), latitude, longitude)
            for stamp_ns, at_ns, latitude, longitude in fixes
        ]
        rows = sorted({row[0]: row for row in rows}.values())
        stamps_ns = np.array([row[0] for row in rows], dtype=np.int64)
        latitudes = np.array([row[1] for row in rows], dtype=np.float64)
        longitudes = np.array([row[2] for row in rows], dtype=np.float64)
        # Without a jump where the vehicle crosses 180 degrees.
        longitudes = np.unwrap(longitudes, period=360.0)
        kept = ~_jumps(stamps_ns, latitudes, longitudes)
        self.dropped += len(fixes) - int(kept.sum())
        self._stamps_ns, self._latitudes = stamps_ns[kept], latitudes[kept]
        self._longitudes = np.unwrap(longitudes[kept], period=360.0)
        self._local = _local(self._latitudes, self._longitudes)
        steps_m = np.hypot(*np.diff(self._local, axis=0).T)
        seconds = np.diff(self._stamps_ns) / 1e9
        self._torn = (steps_m > _SLACK_M + _FASTEST_MPS * seconds) | (
            seconds * 1e9 > _LONGEST_GAP_NS
        )

    def __len__(self) -> int:
        return len(self._stamps_ns)

    def at(self, stamps_ns: Sequence[int] | NDArray[np.int64]) -> tuple[_F64, _F64]:
        """Return latitudes and longitudes (M,) in degrees at times (M,); NaN where not known."""
        stamps_ns = np.asarray(stamps_ns, dtype=np.int64)
        unknown = np.full(len(stamps_ns), np.nan)
        if not len(self):
            return unknown, unknown.copy()
        times = self._stamps_ns
        after = np.searchsorted(times, stamps_ns).clip(0, len(times) - 1)
        before = np.where(times[after] == stamps_ns, after, after - 1).clip(0)
        near = np.maximum(np.abs(times[after] - stamps_ns), np.abs(stamps_ns - times[before]))
        torn = np.append(self._torn, False)[before] & (before != after)
        known = (near <= _LONGEST_GAP_NS) & ~torn
        since = (stamps_ns - times[0]).astype(np.float64)
        seconds = (times - times[0]).astype(np.float64)
        latitudes = np.interp(since, seconds, self._latitudes)
        longitudes = np.interp(since, seconds, self._longitudes)
        turned = (longitudes + 180.0) % 360.0 - 180.0
        return np.where(known, latitudes, np.nan), np.where(known, turned, np.nan)

    def trajectory(self) -> Trajectory | None:
        """Return the way over the ground, level, heading where the vehicle goes; None if too short.

        Good enough to tell how far a vehicle drove and when it turned, for nothing more. Fixes
        nearer than 2 m to the one before count as standing still: receivers wander.
        """
        if len(self) < _LEAST_FIXES:
            return None
        local = self._local
        long = np.flatnonzero(self._torn)
        kept = _far_apart(local, {0, len(self) - 1, *long.tolist(), *(long + 1).tolist()})
        times, way = self._stamps_ns[kept], local[kept]
        steps = np.vstack([np.diff(way, axis=0), way[-1:] - way[-2:-1]])
        yaw = np.arctan2(steps[:, 1], steps[:, 0])
        matrices = np.broadcast_to(np.eye(4), (len(kept), 4, 4)).copy()
        matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(yaw)
        matrices[:, 1, 0], matrices[:, 0, 1] = np.sin(yaw), -np.sin(yaw)
        matrices[:, :2, 3] = way
        gaps_ns = np.column_stack([self._stamps_ns[long], self._stamps_ns[long + 1]])
        return Trajectory("fixes", "vehicle", times, matrices, gaps_ns)


def _far_apart(points: _F64, needed: set[int]) -> list[int]:
    """Return the points (N, 2) to keep: those that are needed, and each 2 m from the last one."""
    kept = [0]
    for number in range(1, len(points)):
        moved = np.hypot(*(points[number] - points[kept[-1]]))
        if number in needed or moved >= _STEP_M:
            kept.append(number)
    return kept


def _is_usable(fix: GnssFix) -> bool:
    inside = abs(fix.latitude_deg) <= 90 and abs(fix.longitude_deg) <= 360
    # Receivers without a fix often say 0, 0, or what a filter makes of it.
    somewhere = max(abs(fix.latitude_deg), abs(fix.longitude_deg)) > _NOWHERE_DEG
    return inside and fix.status > _NO_FIX and somewhere


def _local(latitudes: _F64, longitudes: _F64) -> _F64:
    """Return metres (N, 2) east and north of the first place."""
    if not len(latitudes):
        return np.zeros((0, 2))
    places = np.column_stack([latitudes, longitudes, np.zeros(len(latitudes))])
    return LocalFrame(*places[0].tolist()).local(places)[:, :2]


def _jumps(stamps_ns: NDArray[np.int64], latitudes: _F64, longitudes: _F64) -> NDArray[np.bool_]:
    """Return (N,) which fixes lie far from the median of themselves and two on either side."""
    if len(stamps_ns) <= 2 * _BESIDE:
        return np.zeros(len(stamps_ns), dtype=bool)
    around = (_BESIDE, _BESIDE)
    middle = np.column_stack(
        [
            np.median(sliding_window_view(np.pad(one, around, "reflect"), 2 * _BESIDE + 1), axis=1)
            for one in (latitudes, longitudes)
        ]
    )
    north_m = (latitudes - middle[:, 0]) * _METRES_A_DEGREE
    east_m = (longitudes - middle[:, 1]) * _METRES_A_DEGREE * np.cos(np.radians(middle[:, 0]))
    times = sliding_window_view(np.pad(stamps_ns, around, "edge"), 2 * _BESIDE + 1)
    span_s = (times[:, -1] - times[:, 0]) / 1e9
    return np.hypot(north_m, east_m) > _SLACK_M + _FASTEST_MPS / 4 * span_s
