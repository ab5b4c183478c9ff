"""`percept odometry`: where the vehicle was."""

from percept.cli.odometry.command import odometry

__all__ = ["odometry"]
