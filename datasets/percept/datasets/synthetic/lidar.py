"""A spinning multi-beam LiDAR: beams, noise, drop-outs, intensity, and times per point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets.synthetic.ego import Motion
from percept.datasets.synthetic.world import World

__all__ = ["SCAN_PERIOD_NS", "LidarModel", "LidarScan", "cloud_of_scan", "scan_world"]

SCAN_PERIOD_NS = 100 * NS_PER_MS
_LOG_DELAY_NS = 55 * NS_PER_MS
_SCENE_MARGIN_M = 40.0
_RANGE_SD_M = 0.02
_INTENSITY_SD = 0.04
_SIGHT_M = 350.0
_HAZE_PER_M = 0.002
_DIFFUSE_SCALE = 100.0
_SATURATION = 255.0


@dataclass(frozen=True, slots=True, eq=False)
class LidarModel:
    """One LiDAR.

    Attributes:
        name: Sensor name; its frame has the same name.
        T_base_sensor: Where it sits.
        elevations_rad: (B,) float64 beam angles over the sensor's xy plane, lowest first.
        azimuth_steps: Firings in a full turn.
        field_of_view_rad: Width of the part of a turn, about +x, in which it fires.
        phase_ns: How much later than a multiple of the period it faces +x.
        max_range_m: Returns beyond are none.
    """

    name: str
    T_base_sensor: Transform
    elevations_rad: NDArray[np.float64]
    azimuth_steps: int
    field_of_view_rad: float = 2 * np.pi
    phase_ns: int = 0
    max_range_m: float = 100.0

    def azimuths_rad(self) -> NDArray[np.float64]:
        """Return the azimuths (C,) of one scan, from behind by the right side to behind."""
        turn = (np.arange(self.azimuth_steps) + 0.5) / self.azimuth_steps * 2 * np.pi - np.pi
        return turn[np.abs(turn) <= self.field_of_view_rad / 2]

    def offsets_ns(self) -> NDArray[np.int64]:
        """Return when the columns (C,) fire, relative to the moment when it faces +x."""
        return np.round(self.azimuths_rad() / (2 * np.pi) * SCAN_PERIOD_NS).astype(np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan:
    """The returns of one turn. The stamp is the moment when the sensor faces its +x.

    Attributes:
        stamp_ns: Time at which offsets are 0.
        points_sensor: (N, 3) float64 metres, each in the sensor's frame at its own time.
        intensity: (N,) float64 in 0..255; diffuse surfaces stay below 100.
        offset_ns: (N,) int64 time relative to the stamp, negative before it.
        ring: (N,) int32 beam, lowest first.
        object_ids: (N,) int64 truth: the object that was hit, -1 for the ground.
        rays: Number of rays that met something, before drop-outs.
    """

    stamp_ns: int
    points_sensor: NDArray[np.float64]
    intensity: NDArray[np.float64]
    offset_ns: NDArray[np.int64]
    ring: NDArray[np.int32]
    object_ids: NDArray[np.int64]
    rays: int


def scan_world(
    model: LidarModel,
    world: World,
    ego: Motion,
    stamp_ns: int,
    noise: float,
    rng: np.random.Generator,
) -> LidarScan:
    """Scan the world once around a stamp.

    Args:
        model: The sensor.
        world: What there is.
        ego: How the sensor moves during the scan; each column has its exact pose.
        stamp_ns: When the sensor faces its +x.
        noise: 0 for exact ranges without drop-outs, 1 for an ordinary sensor.
        rng: Source of the noise.
    """
    from percept.datasets.synthetic.raycast import cast_columns

    azimuths, offsets = model.azimuths_rad(), model.offsets_ns()
    times_s = ego.seconds(stamp_ns + offsets)
    T_map_sensor = ego.poses(times_s) @ model.T_base_sensor.matrix
    middle_s = float(ego.seconds(stamp_ns))
    x_m = float(T_map_sensor[len(offsets) // 2, 0, 3])
    scene = world.packed(middle_s, x_m, model.max_range_m + _SCENE_MARGIN_M)
    hits, what = cast_columns(
        azimuths, model.elevations_rad, T_map_sensor, times_s, scene.heights, scene.objects,
        scene.first, scene.primitives, scene.lines, scene.bars, model.max_range_m,
    )  # fmt: skip
    returned = np.isfinite(hits[:, :, 0])
    rays = int(returned.sum())
    if noise > 0:
        returned &= rng.uniform(size=what.shape) < _chance_of_return(hits, noise)
    column, ring = np.nonzero(returned)
    found = hits[column, ring]
    ranges = found[:, 0] + noise * _RANGE_SD_M * rng.standard_normal(len(found))
    intensity = _intensity(found) * (1 + noise * _INTENSITY_SD * rng.standard_normal(len(found)))
    ids = np.append(scene.ids, -1)[what[column, ring]]
    return LidarScan(
        stamp_ns,
        ranges[:, None] * _directions(azimuths[column], model.elevations_rad[ring]),
        np.clip(intensity, 0, _SATURATION),
        offsets[column],
        ring.astype(np.int32),
        ids,
        rays,
    )


def cloud_of_scan(scan: LidarScan, name: str) -> PointCloud:
    """Return a scan as the LiDAR's driver publishes it, after the turn is complete."""
    return PointCloud(
        topic=f"/{name}/points",
        stamp_ns=scan.stamp_ns,
        log_time_ns=scan.stamp_ns + _LOG_DELAY_NS,
        frame=name,
        points_xyz=scan.points_sensor.astype(np.float32),
        intensity=scan.intensity.astype(np.float32),
        offset_ns=scan.offset_ns,
        ring=scan.ring,
    )


def _directions(
    azimuth: NDArray[np.float64], elevation: NDArray[np.float64]
) -> NDArray[np.float64]:
    flat = np.cos(elevation)
    return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _chance_of_return(hits: NDArray[np.float64], noise: float) -> NDArray[np.float64]:
    """Return the probability (C, B) that a pulse comes back strong enough.

    The signal falls with the square of the range and with the cosine of incidence; retro-
    reflectors return it many times over. One pulse in a hundred is lost without a reason.
    """
    ranges, cosine, reflectance, gain = np.moveaxis(hits, 2, 0)
    signal = reflectance * (cosine + gain) * (_SIGHT_M / ranges) ** 2
    chance = 0.99 * -np.expm1(-signal)
    missed: NDArray[np.float64] = 1 - min(noise, 1.0) * (1 - chance)
    return np.nan_to_num(missed, nan=0.0)


def _intensity(hits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return intensity (N,): a rough diffuser dims with incidence and a little with range.

    Retro-reflectors saturate, as in sensors whose scale keeps 100..255 for them.
    """
    ranges, cosine, reflectance, gain = hits.T
    bright = reflectance * (0.3 + 0.7 * cosine + gain * (0.5 + 0.5 * cosine))
    intensity: NDArray[np.float64] = _DIFFUSE_SCALE * bright * np.exp(-_HAZE_PER_M * ranges)
    return np.minimum(intensity, _SATURATION)
