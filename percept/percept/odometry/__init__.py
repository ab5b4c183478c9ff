"""Where the vehicle was: poses from what a log has, or from its LiDAR."""

from percept.odometry.filter_config import FilterConfig
from percept.odometry.health import Jump
from percept.odometry.lidar import LidarOdometry, LidarTrajectory, lidar_trajectory
from percept.odometry.poses import PoseSource, VehiclePoses
from percept.odometry.sources import poses_from_samples

__all__ = [
    "FilterConfig",
    "Jump",
    "LidarOdometry",
    "LidarTrajectory",
    "PoseSource",
    "VehiclePoses",
    "lidar_trajectory",
    "poses_from_samples",
]
