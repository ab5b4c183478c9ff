"""Samples of the vehicle's own motion as columns, each checked and sorted by its stamp."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.navigation import NavigationTopics
from percept.core.samples import GnssFix, ImuSample, PoseSample, Sample, TransformSample

__all__ = ["Column", "Readings", "collect_readings"]

_F = NDArray[np.float64]
_NO_FIX = -1


@dataclass(slots=True)
class Column:
    """Readings of one stream: a stamp and a row of numbers each.

    Attributes:
        width: Numbers in a row.
        frames: Names of the frames that its readings are given in, and of their children.
    """

    width: int
    frames: tuple[str, str] = ("", "")
    _stamps: array[int] = field(default_factory=lambda: array("q"))
    _values: array[float] = field(default_factory=lambda: array("d"))

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, *parts: NDArray[np.float64]) -> None:
        """Add a reading whose parts have `width` numbers together."""
        self._stamps.append(stamp_ns)
        for part in parts:
            self._values.frombytes(np.ascontiguousarray(part, dtype=np.float64).tobytes())

    def sorted(self, name: str, dropped: Counter[str]) -> tuple[NDArray[np.int64], _F]:
        """Return stamps (N,) that rise and rows (N, width); counts what has no time of its own."""
        stamps = np.frombuffer(self._stamps, dtype=np.int64)
        rows = np.frombuffer(self._values, dtype=np.float64).reshape(-1, self.width)
        order = np.argsort(stamps, kind="stable")
        order = order[stamps[order] > 0]
        unset = len(stamps) - len(order)
        fresh = np.append(True, np.diff(stamps[order]) > 0)[: len(order)]
        if unset:
            dropped[f"{name} without a stamp"] += unset
        if not fresh.all():
            dropped[f"{name} with the stamp of another"] += int((~fresh).sum())
        return stamps[order[fresh]], rows[order[fresh]]


@dataclass(slots=True)
class Readings:
    """What a log has of the vehicle's own motion.

    Attributes:
        imu: Rows of angular velocity, specific force, quaternion x y z w (NaN where none).
        gnss: Rows of latitude, longitude (degrees), altitude (m), status, covariance (9, m^2,
            NaN where it is unknown).
        paths: Rows of 16 numbers, a pose each, by `odometry`, `pose` and `tf`.
        dropped: Readings that cannot be used, by reason.
    """

    imu: Column = field(default_factory=lambda: Column(10))
    gnss: Column = field(default_factory=lambda: Column(13))
    paths: dict[str, Column] = field(
        default_factory=lambda: {kind: Column(16) for kind in ("odometry", "pose", "tf")}
    )
    dropped: Counter[str] = field(default_factory=Counter)


def collect_readings(topics: NavigationTopics, samples: Iterable[Sample]) -> Readings:
    """Gather the samples of the chosen topics; others are passed over."""
    readings = Readings()
    kinds = {topics.odometry: "odometry", topics.pose: "pose"}
    for sample in samples:
        if isinstance(sample, ImuSample) and sample.topic == topics.imu:
            _add_imu(readings, sample)
        elif isinstance(sample, GnssFix) and sample.topic == topics.gnss:
            _add_fix(readings, sample)
        elif isinstance(sample, PoseSample) and sample.topic in kinds:
            _add_pose(readings, kinds[sample.topic], sample)
        elif (
            isinstance(sample, TransformSample)
            and sample.topic == topics.tf
            and (sample.frame, sample.T_frame_child.source) == topics.tf_edge
        ):
            _add_pose(readings, "tf", sample)
    return readings


def _add_imu(readings: Readings, sample: ImuSample) -> None:
    quat = np.full(4, np.nan) if sample.quat_xyzw is None else sample.quat_xyzw
    readings.imu.add(
        sample.stamp_ns, sample.angular_velocity_radps, sample.linear_acceleration_mps2, quat
    )


def _add_fix(readings: Readings, sample: GnssFix) -> None:
    place = np.array([sample.latitude_deg, sample.longitude_deg, sample.altitude_m])
    if sample.status <= _NO_FIX or not np.isfinite(place).all():
        readings.dropped["GNSS messages without a fix"] += 1
        return
    if abs(place[0]) > 90 or abs(place[1]) > 180 or not place[:2].any():
        readings.dropped["GNSS fixes that are no place on earth"] += 1
        return
    covariance = sample.covariance_m2
    known = covariance is not None and bool(
        np.isfinite(covariance).all() and np.diag(covariance).min() > 0
    )
    spread = np.asarray(covariance).ravel() if known else np.full(9, np.nan)
    readings.gnss.add(sample.stamp_ns, place, np.array([float(sample.status)]), spread)


def _add_pose(readings: Readings, kind: str, sample: PoseSample | TransformSample) -> None:
    column, T = readings.paths[kind], sample.T_frame_child
    if not len(column):
        column.frames = (T.target, T.source)
    if (T.target, T.source) != column.frames:
        readings.dropped[f"{kind} of other frames than {' <- '.join(column.frames)}"] += 1
        return
    column.add(sample.stamp_ns, T.matrix.ravel())
