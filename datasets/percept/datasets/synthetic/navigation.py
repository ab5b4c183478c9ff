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
from percept.core.rig import Rig
from percept.core.samples import GnssFix, ImuSample, OdometrySample, Sample, TransformSample
from percept.core.transform import Transform, quat_xyzw_from_matrix, rotation_from_rpy
from percept.datasets.synthetic.ego import EgoMotion
from percept.datasets.synthetic.geodesy import LocalFrame
from percept.datasets.synthetic.vehicle import BASE, T_BASE_GNSS, T_BASE_IMU

__all__ = ["GNSS_TOPIC", "IMU_TOPIC", "ODOMETRY_TOPIC", "Navigation"]

IMU_TOPIC, GNSS_TOPIC, ODOMETRY_TOPIC = "/imu/data", "/gnss/fix", "/odometry"

_UP_MPS2 = np.array([0.0, 0.0, 9.80665])
_IMU_STEP_NS, _ODOMETRY_STEP_NS, _GNSS_STEP_NS = 10 * NS_PER_MS, 20 * NS_PER_MS, 100 * NS_PER_MS
_IMU_DELAY_NS, _ODOMETRY_DELAY_NS, _GNSS_DELAY_NS = NS_PER_MS, 3 * NS_PER_MS, 30 * NS_PER_MS
_GYRO_SD_RADPS, _ACCELERATION_SD_MPS2, _TILT_SD_RAD = 0.002, 0.03, 0.001
_GYRO_BIAS_RADPS, _ACCELERATION_BIAS_MPS2 = 0.001, 0.02
_GNSS_SD_M = np.array([0.015, 0.015, 0.03])
_SCALE_SD, _TURN_SD_RADPS, _SPEED_SD_MPS = 0.004, 0.0004, 0.02
_RTK_STATUS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Navigation:
    """Streams of the vehicle's own motion.

    Attributes:
        ego: The exact motion.
        origin: Where the map frame lies on the earth.
        seed: Of the noise.
        noise: 0 for exact readings, 1 for ordinary sensors.
    """

    ego: EgoMotion
    origin: LocalFrame
    seed: int
    noise: float

    def imu(self, duration_ns: int) -> Iterator[Sample]:
        """Yield IMU readings at 100 Hz in the frame `imu`."""
        rng = np.random.default_rng([self.seed, 11])
        gyro_bias = self.noise * rng.normal(0, _GYRO_BIAS_RADPS, 3)
        force_bias = self.noise * rng.normal(0, _ACCELERATION_BIAS_MPS2, 3)
        for stamp_ns in self._stamps(duration_ns, _IMU_STEP_NS):
            time_s = np.atleast_1d(self.ego.seconds(stamp_ns))
            pose = self.ego.poses(time_s)[0] @ T_BASE_IMU.matrix
            acceleration = self.ego.acceleration_map(time_s, T_BASE_IMU.translation_m)[0]
            force = pose[:3, :3].T @ (acceleration + _UP_MPS2)
            turning = T_BASE_IMU.rotation.T @ self.ego.twist(time_s)[1][0]
            tilt = rotation_from_rpy(*(self.noise * rng.normal(0, _TILT_SD_RAD, 3)))
            yield ImuSample(
                topic=IMU_TOPIC,
                stamp_ns=stamp_ns,
                log_time_ns=stamp_ns + _IMU_DELAY_NS,
                frame=T_BASE_IMU.source,
                angular_velocity_radps=turning
                + gyro_bias
                + self.noise * rng.normal(0, _GYRO_SD_RADPS, 3),
                linear_acceleration_mps2=force
                + force_bias
                + self.noise * rng.normal(0, _ACCELERATION_SD_MPS2, 3),
                quat_xyzw=quat_xyzw_from_matrix(pose[:3, :3] @ tilt),
            )

    def gnss(self, duration_ns: int) -> Iterator[Sample]:
        """Yield fixes of the antenna at 10 Hz."""
        rng = np.random.default_rng([self.seed, 12])
        for stamp_ns in self._stamps(duration_ns, _GNSS_STEP_NS):
            pose = self._pose(stamp_ns) @ T_BASE_GNSS
            error = self.noise * _GNSS_SD_M * rng.standard_normal(3)
            latitude, longitude, altitude = self.origin.geodetic(pose.translation_m + error)
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
        T_start_map = self._pose(self.ego.start_ns).inverse().matrix
        for stamp_ns in self._stamps(duration_ns, _ODOMETRY_STEP_NS):
            time_s = np.atleast_1d(self.ego.seconds(stamp_ns))
            matrix = T_start_map @ self.ego.poses(time_s)[0]
            drift = rotation_from_rpy(0.0, 0.0, turn_radps * float(time_s[0]))
            matrix[:3, :3] = drift @ matrix[:3, :3]
            matrix[:3, 3] = scale * drift @ matrix[:3, 3]
            T_odom_base = Transform("odom", BASE, matrix)
            velocity, turning = (part[0] for part in self.ego.twist(time_s))
            head = {"stamp_ns": stamp_ns, "log_time_ns": stamp_ns + _ODOMETRY_DELAY_NS}
            yield OdometrySample(
                topic=ODOMETRY_TOPIC,
                frame="odom",
                T_frame_child=T_odom_base,
                linear_velocity_mps=velocity + self.noise * rng.normal(0, _SPEED_SD_MPS, 3),
                angular_velocity_radps=turning + self.noise * rng.normal(0, _GYRO_SD_RADPS, 3),
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

    def _pose(self, stamp_ns: int) -> Transform:
        pose: NDArray[np.float64] = self.ego.poses(np.atleast_1d(self.ego.seconds(stamp_ns)))
        return Transform("map", BASE, pose[0])

    def _stamps(self, duration_ns: int, step_ns: int) -> Iterator[int]:
        yield from range(self.ego.start_ns, self.ego.start_ns + duration_ns + 1, step_ns)
