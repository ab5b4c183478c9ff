"""Poses of the vehicle from what its log has."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

from percept.core.errors import InsufficientDataError, PerceptError
from percept.core.geodesy import LocalFrame
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.samples import Sample
from percept.odometry.filter_config import FilterConfig
from percept.odometry.fixes import local_fixes
from percept.odometry.paths import path_poses
from percept.odometry.poses import PoseSource, VehiclePoses
from percept.odometry.readings import Readings, collect_readings

__all__ = ["poses_from_samples"]


def poses_from_samples(
    topics: NavigationTopics,
    samples: Iterable[Sample],
    *,
    origin: LocalFrame | None = None,
    prefer: PoseSource | Literal["auto"] = "auto",
    config: FilterConfig | None = None,
) -> VehiclePoses:
    """Return the vehicle's poses from the best source that the log has.

    `auto` trusts, in this order: GNSS with IMU where most fixes are good, odometry, poses, a
    moving transform, GNSS with IMU where the fixes are poor, and GNSS alone. Poses that turn
    out bad give way to the next source. What a better source lacks stands in the notes.

    Args:
        topics: The topics to use and where their sensors sit.
        samples: Samples of these topics, in any order; others are passed over.
        origin: Where the frame `map` lies on the earth, such as that of an HD map. Poses from
            GNSS are then given in `map`, else in `enu` about the first fix.
        prefer: The one source to use, or `auto`.
        config: Settings of the filter over GNSS and IMU.

    Raises:
        InsufficientDataError: If no source, or not the one that is preferred, gives poses.
    """
    readings = collect_readings(topics, samples)
    config = config or FilterConfig()
    notes = list(topics.notes)
    if prefer != "auto":
        return _with_notes(_poses_from(prefer, topics, readings, origin, config), notes, origin)
    bad: VehiclePoses | None = None
    for source in _order(readings, origin, config, notes):
        if source == "gnss" and bad is not None and bad.source == "gnss+imu":
            continue  # fixes that contradict the IMU are no better without it
        try:
            poses = _poses_from(source, topics, readings, origin, config)
        except PerceptError as error:
            notes.append(f"not from {source}: {error}")
            continue
        if poses.verdict is not Verdict.BAD:
            return _with_notes(poses, notes, origin)
        notes.append(f"poses from {source} are bad: {'; '.join(poses.why)}")
        bad = bad or poses
    if bad is not None:
        return _with_notes(bad, notes, origin)
    raise InsufficientDataError(
        "nothing in the log tells where the vehicle was", remedy="; ".join(notes) or None
    )


def _with_notes(poses: VehiclePoses, notes: list[str], origin: LocalFrame | None) -> VehiclePoses:
    if origin is not None and poses.origin is None:
        notes.append(f"poses from {poses.source} have no place on earth: no map can be laid under")
    return replace(poses, notes=(*notes, *poses.notes))


def _poses_from(
    source: PoseSource,
    topics: NavigationTopics,
    readings: Readings,
    origin: LocalFrame | None,
    config: FilterConfig,
) -> VehiclePoses:
    if source == "gnss+imu":
        from percept.odometry.fused import fused_poses

        return fused_poses(topics, readings, local_fixes(readings, origin, config), config)
    if source == "gnss":
        from percept.odometry.course import course_poses

        return course_poses(topics, local_fixes(readings, origin, config), config)
    return path_poses(source, topics, readings)


def _order(
    readings: Readings, origin: LocalFrame | None, config: FilterConfig, notes: list[str]
) -> list[PoseSource]:
    """Return the sources to try, the most trusted first; says why GNSS is not among the first."""
    paths: list[PoseSource] = [
        kind for kind in ("odometry", "pose", "tf") if len(readings.paths[kind])
    ]
    if not len(readings.gnss):
        return paths
    try:
        sd_m = local_fixes(readings, origin, config).median_sd_m()
    except PerceptError as error:
        notes.append(f"not from gnss: {error}")
        return paths
    if not len(readings.imu):
        notes.append("fixes without an IMU are used only where there is nothing else")
        return [*paths, "gnss"]
    if sd_m <= config.poor_sd_m:
        return ["gnss+imu", *paths, "gnss"]
    notes.append(f"GNSS is poor here: the median fix is good to {sd_m:.1f} m only")
    return [*paths, "gnss+imu", "gnss"]
