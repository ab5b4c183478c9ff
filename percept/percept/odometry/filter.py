"""Filter and smoother over GNSS and IMU: the drive on one time line, and a run over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.transform import Transform, matrix_from_quat_xyzw
from percept.odometry.filter_config import FilterConfig
from percept.odometry.filter_kernels import ERRORS, STATE, Drive, run_forward, smooth_backward
from percept.odometry.fixes import Fixes
from percept.odometry.imu import ImuReadings, measure_noise, quiet_readings

__all__ = ["Smoothed", "make_drive", "smooth", "start_cost"]

_F = NDArray[np.float64]
_CHUNK = 2000
_POSE = np.array([0, 1, 2, 6, 7, 8])
# Where the IMU pauses nothing is known but that a car turns and speeds up within limits.
_PAUSE_INTERVALS = 5.0
_PAUSE_TURN_RADPS, _PAUSE_FORCE_MPS2 = 0.3, 3.0
_FARTHEST_FIX = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """What the smoother says, at every node.

    Attributes:
        states: (M, 21) float64, see `filter_kernels`.
        covariances: (M, 6, 6) float64 of the errors of place and attitude.
        fates: (F, 4) what became of each fix, see `filter_kernels.run_forward`.
    """

    states: _F
    covariances: _F
    fates: _F


def make_drive(
    imu: ImuReadings,
    fixes: Fixes,
    T_imu_base: Transform,
    antenna_imu_m: _F,
    config: FilterConfig,
) -> tuple[Drive, NDArray[np.int64]]:
    """Lay readings on one time line.

    Nodes are IMU readings, thinned to `output_hz`, and the fixes between.

    Args:
        imu: Readings without a long gap.
        fixes: Fixes; those outside the span of the readings are left out by the caller.
        T_imu_base: Where the vehicle's frame lies.
        antenna_imu_m: (3,) the antenna in the IMU's frame.
        config: Settings.

    Returns:
        The drive, and the stamps (M,) of its nodes.
    """
    every = max(round(1.0 / (config.output_hz * imu.interval_s())), 1)
    thinned = np.unique(np.append(np.arange(0, len(imu), every), len(imu) - 1))
    line_ns = np.union1d(imu.stamps_ns, fixes.stamps_ns)
    stamps_ns = np.union1d(imu.stamps_ns[thinned], fixes.stamps_ns)
    since, at = imu.stamps_ns - line_ns[0], line_ns - line_ns[0]
    fix_of_node = np.full(len(stamps_ns), -1, dtype=np.int64)
    fix_of_node[np.searchsorted(stamps_ns, fixes.stamps_ns)] = np.arange(len(fixes.stamps_ns))
    nearest = np.clip(np.searchsorted(imu.stamps_ns, stamps_ns), 0, len(imu) - 1)
    gyro_psd, force_psd = _noise_at(imu, stamps_ns, config)
    drive = Drive(
        times_s=at / NS_PER_S,
        gyro=_interpolated(at, since, imu.gyro_radps),
        force=_interpolated(at, since, imu.force_mps2),
        nodes=np.searchsorted(line_ns, stamps_ns).astype(np.int64),
        gyro_psd=gyro_psd,
        force_psd=force_psd,
        fix_of_node=fix_of_node,
        fixes=fixes.points_m,
        covariances=fixes.covariances_m2,
        quiet=quiet_readings(imu, config)[nearest],
        attitudes=_attitudes(imu, stamps_ns, nearest),
        antenna=np.array(antenna_imu_m, dtype=np.float64),
        base=np.array(T_imu_base.translation_m),
        sideways=np.array(T_imu_base.rotation[:, 1]),
        gravity=_gravity_mps2(fixes.origin.latitude_deg),
        walks=(config.gyro_bias_walk**2, config.force_bias_walk**2),
        gate=config.gate_chi2,
        recover_s=config.recover_s,
        still_speed=config.still_speed_mps,
        lateral_var=(config.lateral_sd_mps or 0.0) ** 2,
        orientation_var=(config.orientation_sd_rad or 0.0) ** 2,
    )
    return drive, stamps_ns


def smooth(drive: Drive, state: _F, covariance: _F, seconds: float = np.inf) -> Smoothed:
    """Filter over the nodes and smooth back, with memory for a part of them at a time.

    The forward run keeps the state at the start of each part; the backward run makes each part
    again from there.

    Args:
        drive: The drive.
        state: (21,) at the first node.
        covariance: (15, 15) of its error.
        seconds: Only the nodes of so much time from the first on.
    """
    total = _nodes_within(drive, seconds)
    starts = list(range(0, max(total - 1, 1), _CHUNK))
    fates, memory = np.zeros((len(drive.fixes), 4)), np.zeros(2)
    saved: list[tuple[_F, _F, _F]] = []
    for first in starts:
        saved.append((state, covariance, memory.copy()))
        states, store = _run(drive, first, total, saved[-1], memory, fates)
        state, covariance = states[1, -1].copy(), store[1, -1].copy()
    smoothed, spread = np.empty((total, STATE)), np.empty((total, 6, 6))
    for first, start in zip(reversed(starts), reversed(saved), strict=True):
        states, store = _run(drive, first, total, start, start[2].copy(), fates)
        states[1, -1], store[1, -1] = state, covariance
        smooth_backward(states, store)
        state, covariance = states[1, 0].copy(), store[1, 0].copy()
        part = slice(first, first + states.shape[1])
        smoothed[part], spread[part] = states[1], store[1][:, _POSE[:, None], _POSE]
    return Smoothed(smoothed, spread, fates)


def start_cost(drive: Drive, state: _F, covariance: _F, seconds: float) -> float:
    """Return twice the negative log-likelihood of the first fixes, given a start.

    No fix may cost more than one that is ten standard deviations away, so that outliers do not
    decide.
    """
    count = _nodes_within(drive, seconds)
    fates = np.zeros((len(drive.fixes), 4))
    states, store = np.empty((2, count, STATE)), np.empty((3, count, ERRORS, ERRORS))
    run_forward(drive, 0, state, covariance, np.zeros(2), fates, states, store)
    met = fates[fates[:, 0] > 0]
    return float((np.minimum(met[:, 1], _FARTHEST_FIX) + met[:, 2] - met[:, 1]).sum())


def _nodes_within(drive: Drive, seconds: float) -> int:
    times_s = drive.times_s[drive.nodes]
    return int(np.searchsorted(times_s, times_s[0] + seconds, side="right"))


def _run(
    drive: Drive, first: int, total: int, start: tuple[_F, _F, _F], memory: _F, fates: _F
) -> tuple[_F, _F]:
    count = min(_CHUNK + 1, total - first)
    states, store = np.empty((2, count, STATE)), np.empty((3, count, ERRORS, ERRORS))
    run_forward(drive, first, start[0], start[1], memory, fates, states, store)
    return states, store


def _interpolated(at: NDArray[np.int64], since: NDArray[np.int64], columns: _F) -> _F:
    return np.column_stack([np.interp(at, since, column) for column in columns.T])


def _noise_at(
    imu: ImuReadings, stamps_ns: NDArray[np.int64], config: FilterConfig
) -> tuple[_F, _F]:
    """Return (M,) the noise densities up to each node, larger where the IMU pauses."""
    gyro, force = measure_noise(imu, config)
    middle = stamps_ns - np.diff(stamps_ns, prepend=stamps_ns[0]) // 2
    after = np.clip(np.searchsorted(imu.stamps_ns, middle, side="right"), 1, len(imu) - 1)
    interval_s = (imu.stamps_ns[after] - imu.stamps_ns[after - 1]) / NS_PER_S
    paused_s = np.where(interval_s > _PAUSE_INTERVALS * imu.interval_s(), interval_s, 0.0)
    return (
        gyro**2 + paused_s * _PAUSE_TURN_RADPS**2,
        force**2 + paused_s * _PAUSE_FORCE_MPS2**2,
    )


def _attitudes(imu: ImuReadings, stamps_ns: NDArray[np.int64], nearest: NDArray[np.int64]) -> _F:
    """Return (M, 3, 3) the IMU's own orientation at nodes that are readings, else NaN."""
    found = np.full((len(stamps_ns), 3, 3), np.nan)
    exact = imu.stamps_ns[nearest] == stamps_ns
    usable = exact & np.isfinite(imu.quats_xyzw[nearest]).all(axis=1)
    for n in np.flatnonzero(usable).tolist():
        found[n] = matrix_from_quat_xyzw(imu.quats_xyzw[nearest[n]])
    return found


def _gravity_mps2(latitude_deg: float) -> float:
    """Return normal gravity on the WGS 84 ellipsoid (Somigliana's formula)."""
    sine2 = float(np.sin(np.radians(latitude_deg)) ** 2)
    stretch = float(np.sqrt(1 - 0.00669437999013 * sine2))
    return 9.7803253359 * (1 + 0.00193185265241 * sine2) / stretch
