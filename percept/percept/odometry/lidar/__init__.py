"""Where the vehicle was, by its LiDAR alone."""

from percept.odometry.lidar.config import LidarOdometryConfig
from percept.odometry.lidar.odometry import LidarOdometry, lidar_trajectory
from percept.odometry.lidar.result import LidarTrajectory, ScanQuality

__all__ = [
    "LidarOdometry",
    "LidarOdometryConfig",
    "LidarTrajectory",
    "ScanQuality",
    "lidar_trajectory",
]
