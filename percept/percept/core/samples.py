"""What a log yields: typed, checked, frozen samples.

Every sample carries two times, and they are never mixed: `stamp_ns` from the message
header (when the sensor measured) and `log_time_ns` from the recorder (when it was written).
A sample without a header has the log time as its stamp.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform

__all__ = [
    "CameraImage",
    "CameraInfo",
    "GnssFix",
    "ImuSample",
    "OdometrySample",
    "OtherSample",
    "PointCloud",
    "PoseSample",
    "Sample",
    "TransformSample",
]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sample:
    """The part that all samples share.

    Attributes:
        topic: Name of the stream in the log.
        stamp_ns: Time of measurement (header), int64 ns since the epoch.
        log_time_ns: Time of recording, int64 ns since the epoch.
        frame: Name of the coordinate frame, empty where the message has none.
    """

    topic: str
    stamp_ns: int
    log_time_ns: int
    frame: str = ""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloud(Sample):
    """One LiDAR scan. All per-point fields stay aligned: take parts with `select` only.

    Attributes:
        points_xyz: (N, 3) float32, metres, in `frame`; finite.
        intensity: (N,) float32 in the sensor's own units, or None.
        offset_ns: (N,) int64 time of each point relative to `stamp_ns`, or None.
        ring: (N,) int32 beam index, or None.
        dropped_nonfinite: Points that were removed because a coordinate was not finite.

    Raises:
        GeometryError: If a field is not aligned with the points or a point is not finite.
    """

    points_xyz: NDArray[np.float32]
    intensity: NDArray[np.float32] | None = None
    offset_ns: NDArray[np.int64] | None = None
    ring: NDArray[np.int32] | None = None
    dropped_nonfinite: int = 0

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points_xyz, dtype=np.float32)
        if points.ndim != 2 or points.shape[1] != 3:
            raise GeometryError(f"points are (N, 3), not {points.shape}", where=self.topic)
        if not np.isfinite(points).all():
            raise GeometryError("a point cloud holds finite points only", where=self.topic)
        self._freeze("points_xyz", points)
        for name, dtype in (("intensity", np.float32), ("offset_ns", np.int64), ("ring", np.int32)):
            column = getattr(self, name)
            if column is None:
                continue
            if np.shape(column) != (len(points),):
                raise GeometryError(
                    f"{name} is ({len(points)},), not {np.shape(column)}", where=self.topic
                )
            self._freeze(name, np.ascontiguousarray(column, dtype=dtype))

    def _freeze(self, name: str, array: NDArray[Any]) -> None:
        view = array.view()
        view.setflags(write=False)
        object.__setattr__(self, name, view)

    def __len__(self) -> int:
        return len(self.points_xyz)

    def select(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> PointCloud:
        """Return the points of a mask (N,) bool or of indices (M,), with all their fields."""
        return replace(
            self,
            points_xyz=self.points_xyz[keep],
            intensity=None if self.intensity is None else self.intensity[keep],
            offset_ns=None if self.offset_ns is None else self.offset_ns[keep],
            ring=None if self.ring is None else self.ring[keep],
        )

    def transformed(self, T_target_frame: Transform) -> PointCloud:
        """Return the cloud in another frame.

        Raises:
            GeometryError: If the transform does not start at this cloud's frame.
        """
        if T_target_frame.source != self.frame:
            raise GeometryError(
                f"a cloud in frame '{self.frame}' cannot go through "
                f"T_{T_target_frame.target}_{T_target_frame.source}",
                where=self.topic,
            )
        points = T_target_frame.apply(self.points_xyz).astype(np.float32)
        return replace(self, points_xyz=points, frame=T_target_frame.target)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraImage(Sample):
    """One image.

    Attributes:
        pixels: (H, W) or (H, W, 3); colour is BGR. uint8, uint16 or float32.
        encoding: What the message said, such as `rgb8`, `bayer_rggb8` or `jpeg`.
        file: The JPEG or PNG file that the image was recorded as, if it shows just these pixels
            to any reader; None where there is none.
    """

    pixels: NDArray[Any]
    encoding: str = ""
    file: bytes | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraInfo(Sample):
    """Intrinsics that the log carries.

    Attributes:
        image_size: (width, height) in pixels.
        model: `plumb_bob`, `rational_polynomial`, `equidistant` or as the message says.
        K: (3, 3) float64 camera matrix, pixels.
        distortion: (D,) float64 coefficients in OpenCV's order.
    """

    image_size: tuple[int, int]
    model: str
    K: NDArray[np.float64]
    distortion: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImuSample(Sample):
    """One IMU reading in its own frame.

    Attributes:
        angular_velocity_radps: (3,) float64 rad/s.
        linear_acceleration_mps2: (3,) float64 m/s^2, gravity included.
        quat_xyzw: (4,) float64 orientation, or None where the driver gives none.
    """

    angular_velocity_radps: NDArray[np.float64]
    linear_acceleration_mps2: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GnssFix(Sample):
    """One GNSS fix in WGS 84.

    Attributes:
        latitude_deg: Degrees north.
        longitude_deg: Degrees east.
        altitude_m: Metres above the ellipsoid.
        status: As NavSatStatus: -1 no fix, 0 fix, 1 satellite-, 2 ground-based augmentation.
        covariance_m2: (3, 3) float64 in east, north, up, or None where unknown.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    status: int = 0
    covariance_m2: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseSample(Sample):
    """One pose `T_frame_child`; the child's name is empty where the message has none."""

    T_frame_child: Transform


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OdometrySample(PoseSample):
    """One odometry message: the pose and the child's velocity in its own frame.

    Attributes:
        linear_velocity_mps: (3,) float64.
        angular_velocity_radps: (3,) float64.
    """

    linear_velocity_mps: NDArray[np.float64]
    angular_velocity_radps: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TransformSample(Sample):
    """One edge of the tf tree; a tf message with several yields several samples.

    Attributes:
        T_frame_child: Maps points of the child frame into `frame`.
        static: Whether it came as latched (`tf_static`).
    """

    T_frame_child: Transform
    static: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OtherSample(Sample):
    """A message of a type that percept has no sample for, decoded by the log's own definition.

    Attributes:
        msgtype: Type name, such as `turtlesim/msg/Pose`.
        message: The decoded message, with the fields of its definition as attributes.
    """

    msgtype: str
    message: Any
