"""Settings of the filter over GNSS and IMU, each default with its reason."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["FilterConfig"]


class FilterConfig(Settings):
    """Settings of the error-state Kalman filter over GNSS and IMU.

    The white noise of the IMU is measured in the log itself; the settings here are its floor,
    for what that does not show: scale errors, misalignment, time stamps.

    Attributes:
        output_hz: Poses a second; the IMU is integrated at its own rate.
        gyro_noise: Floor of the gyroscopes' white noise, rad/s/sqrt(Hz).
        force_noise: Floor of the accelerometers' white noise, m/s^2/sqrt(Hz).
        gyro_bias_sd_radps: Spread of gyroscope biases before any data (a low-cost MEMS IMU).
        force_bias_sd_mps2: Spread of accelerometer biases before any data.
        gyro_bias_walk: Growth of the gyroscope biases, rad/s/sqrt(s).
        force_bias_walk: Growth of the accelerometer biases, m/s^2/sqrt(s).
        gnss_sd_floor_m: Fixes are trusted no better than this, whatever they say: the
            antenna's place is not known better.
        status_sd_m: Standard deviation (each axis; twice that upwards) of fixes that tell none,
            for NavSatStatus 0 (alone), 1 (satellite-based), 2 (ground-based augmentation).
        poor_sd_m: The fixes are poor where the median standard deviation is larger: a lane is
            not told from the next one.
        gate_chi2: Largest squared Mahalanobis distance of a fix (three degrees of freedom;
            16.3 refuses one good fix in 1,000).
        recover_s: Fixes that are refused for so long are right and the filter is wrong: its
            position is let go.
        lateral_sd_mps: A car does not move sideways: standard deviation of its sideways speed,
            of which one second is one measurement (0.03 at a real car's rear axle); None for
            vehicles that can.
        orientation_sd_rad: The same of the IMU's own orientation; None does not use it but for
            the start.
        still_gyro_radps: The IMU is quiet where its turn rate, averaged over half a second,
            changes less within two seconds.
        still_force_mps2: The same of the specific force.
        still_speed_mps: A quiet IMU stands where the speed is not larger than this.
        longest_imu_gap_s: The filter starts anew after a longer gap in the IMU.
    """

    output_hz: float = Field(default=50.0, gt=0, le=1000)
    gyro_noise: float = Field(default=1e-4, gt=0)
    force_noise: float = Field(default=1e-3, gt=0)
    gyro_bias_sd_radps: float = Field(default=0.01, gt=0)
    force_bias_sd_mps2: float = Field(default=0.1, gt=0)
    gyro_bias_walk: float = Field(default=1e-5, gt=0)
    force_bias_walk: float = Field(default=1e-4, gt=0)
    gnss_sd_floor_m: float = Field(default=0.01, gt=0)
    status_sd_m: tuple[float, float, float] = (3.0, 1.5, 0.3)
    poor_sd_m: float = Field(default=1.0, gt=0)
    gate_chi2: float = Field(default=16.3, gt=0)
    recover_s: float = Field(default=5.0, gt=0)
    lateral_sd_mps: float | None = Field(default=0.1, gt=0)
    orientation_sd_rad: float | None = Field(default=None, gt=0)
    still_gyro_radps: float = Field(default=0.005, gt=0)
    still_force_mps2: float = Field(default=0.1, gt=0)
    still_speed_mps: float = Field(default=0.2, gt=0)
    longest_imu_gap_s: float = Field(default=1.0, gt=0)
