"""The vehicle's poses from GNSS and IMU together."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.errors import InsufficientDataError
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.odometry.alignment import find_start
from percept.odometry.filter import Smoothed, make_drive, smooth
from percept.odometry.filter_config import FilterConfig
from percept.odometry.fixes import Fixes
from percept.odometry.health import Jump, breaks_of, find_gaps
from percept.odometry.imu import ImuReadings, pieces_of, read_imu
from percept.odometry.poses import VehiclePoses
from percept.odometry.readings import Readings

__all__ = ["fused_poses"]

_F = NDArray[np.float64]
_FEWEST_FIXES = 5
_OUTAGE_S = 2.0
# A sensor whose place is not known sits on the vehicle: the lever arm is wrong by so much.
_UNPLACED_M = 1.5
# The start is far off at first: it is found again from where the smoother puts it.
_RELINEARISED, _FIRST_S = 2, 120.0
_USED, _REFUSED, _RECOVERED = 1, 2, 3
# Where a limit is passed the poses are doubtful; five times as far they are bad.
_MOST_REFUSED, _MOST_SCATTER = 0.05, 2.5
_POSITION_M, _HEADING_RAD, _BAD = 1.0, np.radians(2.0), 5.0


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Poses of one piece of the log between long gaps of the IMU."""

    stamps_ns: NDArray[np.int64]
    matrices: _F
    sd_position_m: _F
    sd_heading_rad: _F
    fates: _F
    fix_stamps_ns: NDArray[np.int64]
    notes: tuple[str, ...]


def fused_poses(
    topics: NavigationTopics, readings: Readings, fixes: Fixes, config: FilterConfig
) -> VehiclePoses:
    """Return smoothed poses from GNSS and IMU.

    Args:
        topics: Where antenna and IMU sit.
        readings: What the log has.
        fixes: Its fixes in a local frame.
        config: Settings.

    Raises:
        InsufficientDataError: If fixes or IMU readings are too few, or the heading cannot be
            known.
        InputError: If the IMU's readings are in other units.
    """
    dropped = Counter(fixes.dropped)
    imu = read_imu(readings, dropped)
    pieces, problems = [], list[str]()
    for part in pieces_of(imu, config.longest_imu_gap_s):
        try:
            pieces.append(_fuse(topics, part, fixes, dropped, config))
        except InsufficientDataError as error:
            dropped[f"IMU readings of a piece without a start ({error})"] += len(part)
            problems.append(str(error))
    if not pieces:
        raise InsufficientDataError(problems[0])
    met = sum(len(piece.fix_stamps_ns) for piece in pieces)
    if met < len(fixes.stamps_ns):
        dropped["GNSS fixes outside the span of the IMU"] += len(fixes.stamps_ns) - met
    return _joined(topics, imu, fixes, pieces, dropped, config)


def _fuse(
    topics: NavigationTopics,
    imu: ImuReadings,
    fixes: Fixes,
    dropped: Counter[str],
    config: FilterConfig,
) -> _Piece:
    inside = (fixes.stamps_ns >= imu.stamps_ns[0]) & (fixes.stamps_ns <= imu.stamps_ns[-1])
    if inside.sum() < _FEWEST_FIXES:
        raise InsufficientDataError(f"only {inside.sum()} GNSS fixes in its span")
    unplaced_m = _UNPLACED_M if _unplaced(topics) else 0.0
    fixes = replace(
        fixes,
        stamps_ns=fixes.stamps_ns[inside],
        points_m=fixes.points_m[inside],
        covariances_m2=fixes.covariances_m2[inside] + unplaced_m**2 * np.eye(3),
    )
    begin = int(np.searchsorted(imu.stamps_ns, fixes.stamps_ns[0], side="right")) - 1
    if begin:
        dropped["IMU readings before the first fix"] += begin
    imu = imu.part(slice(begin, None))
    T_imu_base = _place_in_imu(topics)
    antenna_base = np.zeros(3) if topics.T_base_gnss is None else topics.T_base_gnss.translation_m
    antenna_imu = T_imu_base.apply(antenna_base[None])[0]
    drive, stamps_ns = make_drive(imu, fixes, T_imu_base, antenna_imu, config)
    start = find_start(drive, T_imu_base, config)
    state = start.state
    for _ in range(_RELINEARISED):
        state = smooth(drive, state, start.covariance, _FIRST_S).states[0]
    smoothed = smooth(drive, state, start.covariance)
    matrices, sd_position_m, sd_heading_rad = _poses_of_base(smoothed, T_imu_base)
    kept = np.isin(stamps_ns, imu.stamps_ns)
    return _Piece(
        stamps_ns[kept], matrices[kept], np.hypot(sd_position_m, unplaced_m)[kept],
        sd_heading_rad[kept],
        smoothed.fates, fixes.stamps_ns, start.notes,
    )  # fmt: skip


def _place_in_imu(topics: NavigationTopics) -> Transform:
    if topics.T_base_imu is None:
        return Transform.identity("imu", topics.base_frame)
    return topics.T_base_imu.inverse()


def _unplaced(topics: NavigationTopics) -> list[str]:
    places = (("IMU", topics.T_base_imu), ("antenna", topics.T_base_gnss))
    return [name for name, T in places if T is None]


def _poses_of_base(smoothed: Smoothed, T_imu_base: Transform) -> tuple[_F, _F, _F]:
    """Return `T_inertial_base` (M, 4, 4) and the spread of its position and heading (M,).

    With the base at l in the IMU's frame its error is dp - R [l]x dtheta, and the error of the
    attitude about the inertial axes is R dtheta.
    """
    R = smoothed.states[:, 6:15].reshape(-1, 3, 3)
    T_inertial_imu = np.broadcast_to(np.eye(4), (len(R), 4, 4)).copy()
    T_inertial_imu[:, :3, :3], T_inertial_imu[:, :3, 3] = R, smoothed.states[:, :3]
    x, y, z = T_imu_base.translation_m
    lever = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    J = np.concatenate([np.broadcast_to(np.eye(3), R.shape), -R @ lever], axis=2)
    position = J @ smoothed.covariances @ np.swapaxes(J, 1, 2)
    up = R[:, 2]
    heading = np.einsum("ni,nij,nj->n", up, smoothed.covariances[:, 3:, 3:], up)
    return (
        T_inertial_imu @ T_imu_base.matrix,
        np.sqrt(np.trace(position, axis1=1, axis2=2)),
        np.sqrt(heading),
    )


def _joined(
    topics: NavigationTopics,
    imu: ImuReadings,
    fixes: Fixes,
    pieces: list[_Piece],
    dropped: Counter[str],
    config: FilterConfig,
) -> VehiclePoses:
    stamps_ns = np.concatenate([piece.stamps_ns for piece in pieces])
    fates = np.concatenate([piece.fates for piece in pieces])
    gaps_ns = _at_poses(stamps_ns, find_gaps(imu.stamps_ns))
    jumps = tuple(jump for piece in pieces for jump in _jumps(piece))
    breaks_ns = _at_poses(stamps_ns, breaks_of(gaps_ns, jumps))
    in_gap = np.zeros(len(stamps_ns), dtype=bool)
    for start_ns, end_ns in breaks_ns.tolist():
        in_gap |= (stamps_ns > start_ns) & (stamps_ns < end_ns)
    sd_position_m = np.concatenate([piece.sd_position_m for piece in pieces])[~in_gap]
    sd_heading_rad = np.concatenate([piece.sd_heading_rad for piece in pieces])[~in_gap]
    refused = int((fates[:, 0] == _REFUSED).sum())
    if refused:
        dropped["GNSS fixes refused as outliers"] += refused
    verdict, why = _judge(topics, fixes, fates, sd_position_m, sd_heading_rad, config)
    matrices = np.concatenate([piece.matrices for piece in pieces])[~in_gap]
    return VehiclePoses(
        trajectory=Trajectory(
            fixes.frame, topics.base_frame, stamps_ns[~in_gap], matrices, breaks_ns
        ),
        source="gnss+imu",
        origin=fixes.origin,
        sd_position_m=sd_position_m,
        sd_heading_rad=sd_heading_rad,
        gaps_ns=gaps_ns,
        jumps=jumps,
        notes=(*dict.fromkeys(note for p in pieces for note in p.notes), *_outages(pieces)),
        dropped=dropped,
        verdict=verdict,
        why=why,
    )


def _jumps(piece: _Piece) -> list[Jump]:
    """Return the spans over which the fixes left the filter behind."""
    found = []
    for n in np.flatnonzero(piece.fates[:, 0] == _RECOVERED).tolist():
        used = piece.fix_stamps_ns[:n][piece.fates[:n, 0] != _REFUSED]
        start_ns = int(used[-1]) if len(used) else int(piece.stamps_ns[0])
        found.append(Jump(start_ns, int(piece.fix_stamps_ns[n]), float(piece.fates[n, 3]), 0.0))
    return found


def _at_poses(stamps_ns: NDArray[np.int64], gaps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return gaps as stamps of poses: the last one before and the first one after."""
    inside = (gaps_ns[:, 0] >= stamps_ns[0]) & (gaps_ns[:, 1] <= stamps_ns[-1])
    before = np.searchsorted(stamps_ns, gaps_ns[inside, 0], side="right") - 1
    after = np.searchsorted(stamps_ns, gaps_ns[inside, 1], side="left")
    return np.column_stack([stamps_ns[before], stamps_ns[after]])


def _outages(pieces: list[_Piece]) -> list[str]:
    """Return a note on spans without a fix that was used."""
    lengths = []
    for piece in pieces:
        used = piece.fix_stamps_ns[piece.fates[:, 0] != _REFUSED]
        ends = np.concatenate([piece.stamps_ns[:1], used, piece.stamps_ns[-1:]])
        lengths.append(np.diff(np.sort(ends)) / NS_PER_S)
    every = np.concatenate(lengths)
    long = every[every > _OUTAGE_S]
    if not len(long):
        return []
    return [f"spans without a good fix: {len(long)}, the longest of {long.max():.1f} s"]


def _judge(
    topics: NavigationTopics,
    fixes: Fixes,
    fates: _F,
    sd_position_m: _F,
    sd_heading_rad: _F,
    config: FilterConfig,
) -> tuple[Verdict, tuple[str, ...]]:
    used = np.isin(fates[:, 0], (_USED, _RECOVERED))
    refused = float((fates[:, 0] == _REFUSED).mean())
    # A squared Mahalanobis distance in three dimensions is 3 on average where all is right.
    scatter = float(fates[used, 1].mean() / 3) if used.any() else np.inf
    recovered = int((fates[:, 0] == _RECOVERED).sum())
    position, heading = np.percentile(sd_position_m, 95), np.percentile(sd_heading_rad, 95)
    checks = (
        (refused, _MOST_REFUSED, f"{refused:.0%} of the fixes contradict the IMU"),
        (scatter, _MOST_SCATTER, f"the fixes scatter {scatter:.1f} times as much as they say"),
        (recovered, 0.5, f"the fixes left the filter behind, times: {recovered}"),
        (position, _POSITION_M, f"the position is known to {position:.2f} m only"),
        (heading, _HEADING_RAD, f"the heading is known to {np.degrees(heading):.1f} deg only"),
        (
            fixes.median_sd_m(),
            config.poor_sd_m,
            f"the fixes are good to {fixes.median_sd_m():.1f} m",
        ),
    )
    why = [text for value, limit, text in checks if value > limit]
    unplaced = _unplaced(topics)
    if unplaced:
        why.append(f"where {' and '.join(unplaced)} sit is not known")
    if any(value > _BAD * limit for value, limit, _ in checks):
        return Verdict.BAD, tuple(why)
    return (Verdict.DOUBTFUL if why else Verdict.GOOD), tuple(why)
