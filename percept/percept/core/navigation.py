"""Which streams of a log tell of the vehicle's own motion, and where their sensors sit."""

from __future__ import annotations

from dataclasses import dataclass

from percept.core.transform import Transform

__all__ = ["NavigationTopics"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NavigationTopics:
    """The topics of a log that poses can come from; None where it has none of a kind.

    Attributes:
        base_frame: The frame of the vehicle whose poses are wanted.
        gnss: Topic of GNSS fixes.
        imu: Topic of IMU readings.
        odometry: Topic of odometry.
        pose: Topic of poses.
        tf: Topic of moving transforms.
        tf_edge: Parent and child of the moving transform of `tf` that carries the vehicle.
        T_base_gnss: Where the antenna sits.
        T_base_imu: Where the IMU sits.
        T_base_odometry: Where the frame sits that `odometry` follows.
        T_base_pose: Where the frame sits that `pose` follows.
        T_base_tf: Where the child of `tf_edge` sits.
        notes: What is not known, or was left alone, as clauses.

    A place that is None is not known; the sensor is then taken to sit in the base frame.
    """

    base_frame: str = "base_link"
    gnss: str | None = None
    imu: str | None = None
    odometry: str | None = None
    pose: str | None = None
    tf: str | None = None
    tf_edge: tuple[str, str] | None = None
    T_base_gnss: Transform | None = None
    T_base_imu: Transform | None = None
    T_base_odometry: Transform | None = None
    T_base_pose: Transform | None = None
    T_base_tf: Transform | None = None
    notes: tuple[str, ...] = ()

    def names(self) -> tuple[str, ...]:
        """Return the topics to read, each once."""
        found = (self.gnss, self.imu, self.odometry, self.pose, self.tf)
        return tuple(dict.fromkeys(name for name in found if name is not None))
