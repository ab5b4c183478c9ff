"""What the sensors of a log deliver, from a few samples of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from percept.core.samples import CameraImage, CameraInfo, GnssFix, ImuSample, PointCloud, Sample
from percept.datasets.recording import Recording

__all__ = [
    "CameraSummary",
    "GnssSummary",
    "ImuSummary",
    "LidarSummary",
    "SensorSummary",
    "implausible_intrinsics",
    "info_topic_of",
    "probe",
    "summarize",
]

_PROBES = 3
_GRAVITY_MPS2 = (8.0, 12.0)
_GRAVITY_G = (0.8, 1.2)


@dataclass(frozen=True, slots=True)
class LidarSummary:
    """Scans of one LiDAR.

    Attributes:
        points: Median number of finite points in a scan.
        nonfinite_share: Share of the points that were not finite.
        intensity: Smallest and largest, or None without the field.
        rings: Number of beams, or None without the field.
        scan_s: Time from the first to the last point, or None without per-point times.
        azimuth_deg: Degrees around z that have points, of 360.
        elevation_deg: 1st and 99th percentile of the angle above the sensor's x-y plane.
        range_m: Median and 99th percentile of the distance.
    """

    points: int
    nonfinite_share: float
    intensity: tuple[float, float] | None
    rings: int | None
    scan_s: float | None
    azimuth_deg: int | None
    elevation_deg: tuple[float, float] | None
    range_m: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class CameraSummary:
    """Images of one camera.

    Attributes:
        width_px: Image width.
        height_px: Image height.
        encoding: As the messages say.
        channels: 1 or 3.
        info_topic: The topic with its CameraInfo, or None where there is none.
        info_problem: Why the intrinsics in it cannot be right, or None where they can.
    """

    width_px: int
    height_px: int
    encoding: str
    channels: int
    info_topic: str | None
    info_problem: str | None


@dataclass(frozen=True, slots=True)
class ImuSummary:
    """Readings of one IMU.

    Attributes:
        acceleration_mps2: Median length of the acceleration, gravity included.
        orientation: Whether the driver gives one.
        problem: Why the readings cannot be in the units of REP 103, or None.
    """

    acceleration_mps2: float
    orientation: bool
    problem: str | None


@dataclass(frozen=True, slots=True)
class GnssSummary:
    """Fixes of one receiver.

    Attributes:
        latitude_deg: Of the first sample with a fix; None without any.
        longitude_deg: Likewise.
        fix_share: Share of the samples with a fix.
        horizontal_sd_m: Median of the stated standard deviation, or None where none is stated.
    """

    latitude_deg: float | None
    longitude_deg: float | None
    fix_share: float
    horizontal_sd_m: float | None


SensorSummary = LidarSummary | CameraSummary | ImuSummary | GnssSummary


def probe(recording: Recording, topic: str, first_ns: int, last_ns: int) -> list[Sample]:
    """Return up to three samples of a topic: the first of the span, one amid, one near its end."""
    found: dict[int, Sample] = {}
    for part in range(_PROBES):
        start_ns = first_ns + (last_ns - first_ns) * part // _PROBES
        stream = recording.samples(topics=[topic], start_ns=start_ns, end_ns=last_ns)
        sample = next(iter(stream), None)
        if sample is not None:
            found.setdefault(sample.log_time_ns, sample)
    return list(found.values())


def summarize(
    samples: Sequence[Sample], info_topic: str | None = None, info: CameraInfo | None = None
) -> SensorSummary | None:
    """Describe a sensor by its samples; None for a stream that is no sensor, or no samples.

    Args:
        samples: Of one topic.
        info_topic: The CameraInfo topic of a camera.
        info: A sample of it.
    """
    clouds = [s for s in samples if isinstance(s, PointCloud)]
    images = [s for s in samples if isinstance(s, CameraImage)]
    readings = [s for s in samples if isinstance(s, ImuSample)]
    fixes = [s for s in samples if isinstance(s, GnssFix)]
    if clouds:
        return _lidar(clouds)
    if images:
        return _camera(images[0], info_topic, info)
    if readings:
        return _imu(readings)
    return _gnss(fixes) if fixes else None


def info_topic_of(image_topic: str, info_topics: Sequence[str]) -> str | None:
    """Return the CameraInfo topic that image_transport's naming puts beside an image topic.

    `/cam/image_raw`, `/cam/image_raw/compressed` and `/cam/image_rect` all go with
    `/cam/camera_info`; the nearest common name space decides where there are several.
    """
    parts = image_topic.split("/")
    for length in range(len(parts), 0, -1):
        name = "/".join([*parts[:length], "camera_info"])
        if name in info_topics:
            return name
    return None


def implausible_intrinsics(info: CameraInfo, image_size: tuple[int, int]) -> str | None:
    """Return why intrinsics cannot belong to images of a size, or None where they can."""
    fx, fy, cx, cy = (float(info.K[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    width, height = image_size
    if not np.isfinite(info.K).all() or not np.isfinite(info.distortion).all():
        return "not finite"
    if fx <= 0 or fy <= 0:
        return "not calibrated (focal length 0)"
    if info.image_size != image_size:
        return f"for {info.image_size[0]}x{info.image_size[1]} images"
    if not (0 < cx < width and 0 < cy < height):
        return f"principal point ({cx:.0f}, {cy:.0f}) is outside the image"
    if not 0.5 < fx / fy < 2:
        return f"fx / fy is {fx / fy:.2f}"
    if not 0.1 < fx / width < 20:
        return f"focal length {fx:.0f} px for a width of {width} px"
    return None


def _lidar(clouds: Sequence[PointCloud]) -> LidarSummary:
    points = np.concatenate([c.points_xyz for c in clouds]).astype(np.float64)
    dropped = sum(c.dropped_nonfinite for c in clouds)
    ranges_m = np.linalg.norm(points, axis=1)
    seen = ranges_m > 0
    intensities = [c.intensity[np.isfinite(c.intensity)] for c in clouds if c.intensity is not None]
    rings = [c.ring for c in clouds if c.ring is not None and len(c)]
    times = [c.offset_ns for c in clouds if c.offset_ns is not None and len(c)]
    azimuth_deg = np.degrees(np.arctan2(points[seen, 1], points[seen, 0]))
    elevation_deg = np.degrees(np.arcsin(points[seen, 2] / ranges_m[seen]))
    return LidarSummary(
        points=int(median(len(c) for c in clouds)),
        nonfinite_share=dropped / max(len(points) + dropped, 1),
        intensity=_extent(intensities),
        rings=len(np.unique(np.concatenate(rings))) if rings else None,
        scan_s=median(float(np.ptp(t)) for t in times) / 1e9 if times else None,
        azimuth_deg=len(np.unique(np.floor(azimuth_deg) % 360)) if seen.any() else None,
        elevation_deg=_percentiles(elevation_deg, (1, 99)),
        range_m=_percentiles(ranges_m[seen], (50, 99)),
    )


def _extent(columns: Sequence[NDArray[np.float32]]) -> tuple[float, float] | None:
    values = [column for column in columns if len(column)]
    if not values:
        return None
    return float(min(v.min() for v in values)), float(max(v.max() for v in values))


def _percentiles(
    values: NDArray[np.float64], shares: tuple[int, int]
) -> tuple[float, float] | None:
    if not len(values):
        return None
    low, high = np.percentile(values, shares)
    return float(low), float(high)


def _camera(image: CameraImage, info_topic: str | None, info: CameraInfo | None) -> CameraSummary:
    height, width = image.pixels.shape[:2]
    problem = None
    if info_topic is not None:
        size = (int(width), int(height))
        problem = "cannot be read" if info is None else implausible_intrinsics(info, size)
    return CameraSummary(
        width_px=int(width),
        height_px=int(height),
        encoding=image.encoding,
        channels=1 if image.pixels.ndim == 2 else int(image.pixels.shape[2]),
        info_topic=info_topic,
        info_problem=problem,
    )


def _imu(readings: Sequence[ImuSample]) -> ImuSummary:
    length = median(float(np.linalg.norm(r.linear_acceleration_mps2)) for r in readings)
    problem = None
    if _GRAVITY_G[0] < length < _GRAVITY_G[1]:
        problem = "acceleration is in g, not in m/s^2"
    elif not _GRAVITY_MPS2[0] < length < _GRAVITY_MPS2[1]:
        problem = f"acceleration of {length:.1f} m/s^2 does not look like gravity"
    orientation = any(r.quat_xyzw is not None for r in readings)
    return ImuSummary(length if np.isfinite(length) else 0.0, orientation, problem)


def _gnss(fixes: Sequence[GnssFix]) -> GnssSummary:
    fixed = [
        f for f in fixes if f.status >= 0 and np.isfinite([f.latitude_deg, f.longitude_deg]).all()
    ]
    variances = [
        float(f.covariance_m2[0, 0] + f.covariance_m2[1, 1]) / 2
        for f in fixed
        if f.covariance_m2 is not None
    ]
    spreads = [math.sqrt(v) for v in variances if math.isfinite(v) and v >= 0]
    return GnssSummary(
        latitude_deg=fixed[0].latitude_deg if fixed else None,
        longitude_deg=fixed[0].longitude_deg if fixed else None,
        fix_share=len(fixed) / len(fixes),
        horizontal_sd_m=median(spreads) if spreads else None,
    )
