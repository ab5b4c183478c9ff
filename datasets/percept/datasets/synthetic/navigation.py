"""What the vehicle knows about its own motion: IMU, GNSS, odometry and the tf tree.

With noise 0 all of it is exact. With noise 1 the IMU has white noise and a constant bias, the
GNSS is a fixed RTK solution, and the odometry drifts by a wrong scale and a turning heading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS
from percept.core.geodesy import LocalFrame
from percept.core.rig import Rig
from percept.core.samples import GnssFix, ImuSample, OdometrySample, Sample, TransformSample
from percept.core.transform import Transform, quat_xyzw_from_matrix, rotation_from_rpy
from percept.datasets.synthetic.ego import Motion
from percept.datasets.synthetic.sensor_rig import BASE, T_BASE_GNSS, T_BASE_IMU

__all__ = ["GNSS_TOPIC", "IMU_TOPIC", "ODOMETRY_TOPIC", "Navigation"]

IMU_TOPIC, GNSS_TOPIC, ODOMETRY_TOPIC = "/imu/data", "/gnss/fix", "/odometry"

_UP_MPS2 = np.array([0.0, 0.0, 9.80665])
_IMU_STEP_NS, _ODOMETRY_STEP_NS, _GNSS_STEP_NS = 10 * NS_PER_MS, 20 * NS_PER_MS, 100 * NS_PER_MS
_IMU_DELAY_NS, _ODOMETRY_DELAY_NS, _GNSS_DELAY_NS = NS_PER_MS, 3 * NS_PER_MS, 30 * NS_PER_MS
_GYRO_SD_RADPS, _ACCELERATION_SD_MPS2, _TILT_SD_RAD = 0.002, 0.03, 0.001
_GYRO_BIAS_RADPS, _ACCELERATION_BIAS_MPS2 = 0.001, 0.02
_GNSS_SD_M = np.array([0.015, 0.015, 0.03])
_SCALE_SD, _TURN_SD_RADPS, _SPEED_SD_MPS = 0.004, 0.0002, 0.02
_RTK_STATUS = 2
_PORTION = 100


@dataclass(frozen=True, slots=True, eq=False)
class Navigation:
    """Streams of the vehicle's own motion.

    Attributes:
        ego: The exact motion.
        origin: Where the map frame lies on the earth.
        seed: Of the noise.
        noise: 0 for exact readings, 1 for ordinary sensors.
    """

    ego: Motion
    origin: LocalFrame
    seed: int
    noise: float

    def imu(self, duration_ns: int) -> Iterator[Sample]:
        """Yield IMU readings at 100 Hz in the frame `imu`."""
        rng = np.random.default_rng([self.seed, 11])
        gyro_bias = self.noise * rng.normal(0, _GYRO_BIAS_RADPS, 3)
        force_bias = self.noise * rng.normal(0, _ACCELERATION_BIAS_MPS2, 3)
        for stamps_ns in self._stamps(duration_ns, _IMU_STEP_NS):
            times_s = self.ego.seconds(stamps_ns)
            R_map_imu = self.ego.poses(times_s)[:, :3, :3] @ T_BASE_IMU.rotation
            acceleration = self.ego.acceleration_map(times_s, T_BASE_IMU.translation_m)
            force = np.einsum("nji,nj->ni", R_map_imu, acceleration + _UP_MPS2)
            turning = self.ego.twist(times_s)[1] @ T_BASE_IMU.rotation
            for n, stamp_ns in enumerate(stamps_ns.tolist()):
                tilt, gyro, accelerometer = self.noise * rng.standard_normal((3, 3))
                tilted = R_map_imu[n] @ rotation_from_rpy(*(_TILT_SD_RAD * tilt))
                yield ImuSample(
                    topic=IMU_TOPIC,
                    stamp_ns=stamp_ns,
                    log_time_ns=stamp_ns + _IMU_DELAY_NS,
                    frame=T_BASE_IMU.source,
                    angular_velocity_radps=turning[n] + gyro_bias + _GYRO_SD_RADPS * gyro,
                    linear_acceleration_mps2=force[n]
                    + force_bias
                    + _ACCELERATION_SD_MPS2 * accelerometer,
                    quat_xyzw=quat_xyzw_from_matrix(tilted),
                )

    def gnss(self, duration_ns: int) -> Iterator[Sample]:
        """Yield fixes of the antenna at 10 Hz."""
        rng = np.random.default_rng([self.seed, 12])
        for stamps_ns in self._stamps(duration_ns, _GNSS_STEP_NS):
            antenna = self.ego.poses(self.ego.seconds(stamps_ns)) @ T_BASE_GNSS.matrix[:, 3]
            for point, stamp_ns in zip(antenna[:, :3], stamps_ns.tolist(), strict=True):
                error = self.noise * _GNSS_SD_M * rng.standard_normal(3)
                latitude, longitude, altitude = self.origin.geodetic(point + error)
                yield GnssFix(
                    topic=GNSS_TOPIC,
                    stamp_ns=stamp_ns,
                    log_time_ns=stamp_ns + _GNSS_DELAY_NS,
                    frame=T_BASE_GNSS.source,
                    latitude_deg=latitude,
                    longitude_deg=longitude,
                    altitude_m=altitude,
                    status=_RTK_STATUS,
                    covariance_m2=np.diag((max(self.noise, 0.01) * _GNSS_SD_M) ** 2),
                )

    def odometry(self, duration_ns: int) -> Iterator[Sample]:
        """Yield odometry at 50 Hz, and the same pose as tf from `odom` to the vehicle.

        `odom` lies where the vehicle was at the first stamp.
        """
        rng = np.random.default_rng([self.seed, 13])
        scale = 1 + self.noise * float(rng.normal(0, _SCALE_SD))
        turn_radps = self.noise * float(rng.normal(0, _TURN_SD_RADPS))
        T_map_odom = Transform("map", "odom", self.ego.poses(np.zeros(1))[0])
        T_odom_map = T_map_odom.inverse().matrix
        for stamps_ns in self._stamps(duration_ns, _ODOMETRY_STEP_NS):
            times_s = self.ego.seconds(stamps_ns)
            matrices = T_odom_map @ self.ego.poses(times_s)
            velocity, turning = self.ego.twist(times_s)
            for n, stamp_ns in enumerate(stamps_ns.tolist()):
                drift = rotation_from_rpy(0.0, 0.0, turn_radps * float(times_s[n]))
                matrices[n, :3, :3] = drift @ matrices[n, :3, :3]
                matrices[n, :3, 3] = scale * drift @ matrices[n, :3, 3]
                T_odom_base = Transform("odom", BASE, matrices[n])
                speed, turn = self.noise * rng.standard_normal((2, 3))
                head = {"stamp_ns": stamp_ns, "log_time_ns": stamp_ns + _ODOMETRY_DELAY_NS}
                yield OdometrySample(
                    topic=ODOMETRY_TOPIC,
                    frame="odom",
                    T_frame_child=T_odom_base,
                    linear_velocity_mps=velocity[n] + _SPEED_SD_MPS * speed,
                    angular_velocity_radps=turning[n] + _GYRO_SD_RADPS * turn,
                    **head,
                )
                yield TransformSample(
                    topic="/tf", frame="odom", T_frame_child=T_odom_base, static=False, **head
                )

    def static_transforms(self, rig: Rig) -> Iterator[Sample]:
        """Yield the latched transforms from `base_link` to every sensor."""
        placed = [s.T_base_sensor for s in rig.sensors.values() if s.T_base_sensor is not None]
        for T_base_sensor in (*placed, T_BASE_GNSS, T_BASE_IMU):
            yield TransformSample(
                topic="/tf_static",
                stamp_ns=self.ego.start_ns,
                log_time_ns=self.ego.start_ns,
                frame=BASE,
                T_frame_child=T_base_sensor,
                static=True,
            )

    def _stamps(self, duration_ns: int, step_ns: int) -> Iterator[NDArray[np.int64]]:
        """Yield the stamps of a stream in portions, so that poses come many at a time."""
        portion_ns = _PORTION * step_ns
        end_ns = self.ego.start_ns + duration_ns + 1
        for first_ns in range(self.ego.start_ns, end_ns, portion_ns):
            yield np.arange(first_ns, min(first_ns + portion_ns, end_ns), step_ns, dtype=np.int64)
