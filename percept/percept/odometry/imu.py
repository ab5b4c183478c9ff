"""IMU readings of a log: checked, with their noise measured, and cut where they pause."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S, ns_from_seconds
from percept.core.errors import InputError, InsufficientDataError
from percept.odometry.filter_config import FilterConfig
from percept.odometry.readings import Readings

__all__ = ["ImuReadings", "measure_noise", "pieces_of", "quiet_readings", "read_imu"]

_F = NDArray[np.float64]
_FEWEST = 100
_GRAVITY_RANGE_MPS2 = (8.5, 11.0)
_MAD_TO_SD = 1.4826
_MEAN_S, _SPAN_S = 0.5, 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ImuReadings:
    """IMU readings in the IMU's frame.

    Attributes:
        stamps_ns: (N,) int64, strictly rising.
        gyro_radps: (N, 3) float64 angular velocity.
        force_mps2: (N, 3) float64 specific force: acceleration less gravity.
        quats_xyzw: (N, 4) float64 orientation, NaN where it has none.
    """

    stamps_ns: NDArray[np.int64]
    gyro_radps: _F
    force_mps2: _F
    quats_xyzw: _F

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def part(self, keep: slice) -> ImuReadings:
        """Return some of the readings."""
        return ImuReadings(
            self.stamps_ns[keep], self.gyro_radps[keep], self.force_mps2[keep],
            self.quats_xyzw[keep],
        )  # fmt: skip

    def interval_s(self) -> float:
        """Return the median time between two readings, s."""
        return float(np.median(np.diff(self.stamps_ns))) / NS_PER_S


def read_imu(readings: Readings, dropped: Counter[str]) -> ImuReadings:
    """Return the IMU readings of a log.

    Raises:
        InsufficientDataError: If there are fewer than a hundred.
        InputError: If the force is not about that of gravity: in units of g, or without it.
    """
    stamps_ns, rows = readings.imu.sorted("IMU readings", dropped)
    if len(stamps_ns) < _FEWEST:
        raise InsufficientDataError(f"the log has {len(stamps_ns)} IMU readings")
    usual = float(np.median(np.linalg.norm(rows[:, 3:6], axis=1)))
    if not _GRAVITY_RANGE_MPS2[0] < usual < _GRAVITY_RANGE_MPS2[1]:
        raise InputError(
            f"the IMU's acceleration is mostly {usual:.2f} m/s^2, not about 9.8 with gravity",
            remedy="It has to be in m/s^2, gravity included (REP 145)",
        )
    return ImuReadings(stamps_ns, rows[:, :3], rows[:, 3:6], rows[:, 6:])


def pieces_of(imu: ImuReadings, longest_gap_s: float) -> list[ImuReadings]:
    """Return the readings cut at every gap that is longer than allowed."""
    cuts = np.flatnonzero(np.diff(imu.stamps_ns) > ns_from_seconds(longest_gap_s)) + 1
    bounds = [0, *cuts.tolist(), len(imu)]
    return [imu.part(slice(a, b)) for a, b in pairwise(bounds)]


def measure_noise(imu: ImuReadings, config: FilterConfig) -> tuple[float, float]:
    """Return the white noise of gyroscopes (rad/s/sqrt(Hz)) and accelerometers (m/s^2/sqrt(Hz)).

    The second difference of white noise has sqrt(6) times its standard deviation, and motion
    hardly enters it. The median of the axes' robust spreads is taken, never below the settings.
    """
    root_dt = np.sqrt(imu.interval_s())
    gyro, force = (
        float(np.median(_MAD_TO_SD * np.median(np.abs(np.diff(column, n=2, axis=0)), axis=0)))
        / np.sqrt(6)
        * root_dt
        for column in (imu.gyro_radps, imu.force_mps2)
    )
    return max(gyro, config.gyro_noise), max(force, config.force_noise)


def quiet_readings(imu: ImuReadings, config: FilterConfig) -> NDArray[np.bool_]:
    """Return (N,) whether turn rate and force stay the same for a second before and after.

    Means over half a second are compared: an engine shakes faster than that, and a car that
    rolls to a stop does not come to rest without a change of force. A quiet IMU stands or moves
    evenly: only with a speed of about zero does it stand.
    """
    step_s = imu.interval_s()
    mean, span = (max(round(width / step_s), 1) for width in (_MEAN_S, _SPAN_S))
    gyro, force = (_changes(column, mean, span) for column in (imu.gyro_radps, imu.force_mps2))
    quiet: NDArray[np.bool_] = (gyro < config.still_gyro_radps) & (force < config.still_force_mps2)
    return quiet


def _changes(columns: _F, mean: int, span: int) -> _F:
    """Return (N,) how much the moving mean of columns (N, 3) changes in a centred window."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

    usual = uniform_filter1d(columns, mean, axis=0, mode="nearest")
    low = minimum_filter1d(usual, span, axis=0, mode="nearest")
    high = maximum_filter1d(usual, span, axis=0, mode="nearest")
    change: _F = np.linalg.norm(high - low, axis=1)
    return change
