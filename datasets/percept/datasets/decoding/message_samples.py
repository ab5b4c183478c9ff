"""Decoded ROS messages become samples: poses, transforms, GNSS, IMU, intrinsics.

The fields of a message are those of the standard ROS definitions; `Decoder` sees to that.
Clouds and images have modules of their own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.clock import NS_PER_S
from percept.core.errors import DecodeError
from percept.core.samples import (
    CameraImage,
    CameraInfo,
    GnssFix,
    ImuSample,
    OdometrySample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.core.transform import Transform
from percept.datasets.decoding.images import pixels_of_compressed, pixels_of_image, recorded_file
from percept.datasets.decoding.point_cloud2 import records_of_livox, records_of_point_cloud2
from percept.datasets.decoding.point_records import cloud_from_records
from percept.datasets.messages import RosMessage

__all__ = ["CONVERTERS", "Converter", "SampleHead", "head_of", "is_static_topic"]


class SampleHead(NamedTuple):
    """What all samples share; see `Sample`."""

    topic: str
    stamp_ns: int
    log_time_ns: int
    frame: str

    def fields(self) -> dict[str, Any]:
        """Return the head as keyword arguments of a sample."""
        return self._asdict()


class Converter(NamedTuple):
    """How the messages of one type become samples.

    Attributes:
        sample_type: The class of the samples.
        convert: From a message, its head and the counter of notes to samples.
        standard: Whether ROS itself defines the type, so that a definition can be checked.
    """

    sample_type: type[Sample]
    convert: Callable[[RosMessage, SampleHead, Counter[str]], list[Sample]]
    standard: bool = True


def head_of(message: RosMessage, topic: str, log_time_ns: int) -> SampleHead:
    """Return the head of a message; one without a header has the log time as its stamp."""
    header = getattr(message, "header", None)
    stamp = getattr(header, "stamp", None)
    if not hasattr(stamp, "sec") or not hasattr(stamp, "nanosec"):
        return SampleHead(topic, log_time_ns, log_time_ns, "")
    frame = _frame_name(str(getattr(header, "frame_id", "")))
    return SampleHead(topic, _nanoseconds(stamp), log_time_ns, frame)


def is_static_topic(topic: str) -> bool:
    """Tell whether a tf topic is the latched one, which only its name says."""
    return topic.rstrip("/").endswith("tf_static")


def _nanoseconds(stamp: RosMessage) -> int:
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def _frame_name(frame_id: str) -> str:
    """Strip the leading slash that ROS 1 tf allowed, so that names of both worlds meet."""
    return frame_id.lstrip("/")


def _point_cloud(message: RosMessage, head: SampleHead, notes: Counter[str]) -> list[Sample]:
    records = records_of_point_cloud2(message, head.topic)
    return [cloud_from_records(records, notes, **head.fields())]


def _livox(message: RosMessage, head: SampleHead, notes: Counter[str]) -> list[Sample]:
    records = records_of_livox(message, head.stamp_ns, head.topic)
    return [cloud_from_records(records, notes, **head.fields())]


def _image(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    pixels = pixels_of_image(message, head.topic)
    return [CameraImage(**head.fields(), pixels=pixels, encoding=message.encoding)]


def _compressed_image(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    pixels, encoding = pixels_of_compressed(message.data, message.format, head.topic)
    file = recorded_file(message.data, message.format)
    return [CameraImage(**head.fields(), pixels=pixels, encoding=encoding, file=file)]


def _camera_info(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    # ROS 1 names the matrices in capitals, ROS 2 in small letters.
    K = message.k if hasattr(message, "k") else message.K
    distortion = message.d if hasattr(message, "d") else message.D
    return [
        CameraInfo(
            **head.fields(),
            image_size=(int(message.width), int(message.height)),
            model=str(message.distortion_model),
            K=_finite(K, "K", head.topic).reshape(3, 3),
            distortion=_finite(distortion, "distortion", head.topic),
        )
    ]


def _imu(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    quat_xyzw = _xyzw(message.orientation)
    # REP-145 marks "no orientation" by -1 in the covariance; many drivers leave all zeros.
    given = message.orientation_covariance[0] != -1 and any(quat_xyzw.tolist())
    if given:
        quat_xyzw = _finite(quat_xyzw, "the orientation", head.topic)
    return [
        ImuSample(
            **head.fields(),
            angular_velocity_radps=_finite(
                _xyz(message.angular_velocity), "the angular velocity", head.topic
            ),
            linear_acceleration_mps2=_finite(
                _xyz(message.linear_acceleration), "the acceleration", head.topic
            ),
            quat_xyzw=quat_xyzw if given else None,
        )
    ]


def _gnss(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    covariance = np.array(message.position_covariance, dtype=np.float64).reshape(3, 3)
    known = message.position_covariance_type != 0
    return [
        GnssFix(
            **head.fields(),
            latitude_deg=float(message.latitude),
            longitude_deg=float(message.longitude),
            altitude_m=float(message.altitude),
            status=int(message.status.status),
            covariance_m2=covariance if known else None,
        )
    ]


def _odometry(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    child = _frame_name(message.child_frame_id)
    return [
        OdometrySample(
            **head.fields(),
            T_frame_child=_pose_transform(message.pose.pose, head.frame, child),
            linear_velocity_mps=_xyz(message.twist.twist.linear),
            angular_velocity_radps=_xyz(message.twist.twist.angular),
        )
    ]


def _pose(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    return [
        PoseSample(**head.fields(), T_frame_child=_pose_transform(message.pose, head.frame, ""))
    ]


def _pose_with_covariance(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    T_frame_child = _pose_transform(message.pose.pose, head.frame, "")
    return [PoseSample(**head.fields(), T_frame_child=T_frame_child)]


def _transforms(message: RosMessage, head: SampleHead, _: Counter[str]) -> list[Sample]:
    static = is_static_topic(head.topic)
    samples: list[Sample] = []
    for stamped in message.transforms:
        edge = head_of(stamped, head.topic, head.log_time_ns)
        child = _frame_name(stamped.child_frame_id)
        moved = stamped.transform
        T_frame_child = _transform(edge.frame, child, moved.translation, moved.rotation)
        samples.append(TransformSample(**edge.fields(), T_frame_child=T_frame_child, static=static))
    return samples


def _pose_transform(pose: RosMessage, frame: str, child: str) -> Transform:
    return _transform(frame, child, pose.position, pose.orientation)


def _transform(frame: str, child: str, translation: RosMessage, rotation: RosMessage) -> Transform:
    # Damaged numbers may overflow on their way to being refused.
    with np.errstate(over="ignore", invalid="ignore"):
        return Transform.from_quat_xyzw(frame, child, _xyz(translation), _xyzw(rotation))


def _xyz(vector: RosMessage) -> NDArray[np.float64]:
    return np.array([vector.x, vector.y, vector.z], dtype=np.float64)


def _xyzw(quaternion: RosMessage) -> NDArray[np.float64]:
    return np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w], dtype=np.float64)


def _finite(values: ArrayLike, what: str, topic: str) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise DecodeError(f"{what} is not finite", where=topic)
    return array


CONVERTERS: dict[str, Converter] = {
    "geometry_msgs/msg/PoseStamped": Converter(PoseSample, _pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Converter(PoseSample, _pose_with_covariance),
    "livox_interfaces/msg/CustomMsg": Converter(PointCloud, _livox, standard=False),
    "livox_ros_driver/msg/CustomMsg": Converter(PointCloud, _livox, standard=False),
    "livox_ros_driver2/msg/CustomMsg": Converter(PointCloud, _livox, standard=False),
    "nav_msgs/msg/Odometry": Converter(OdometrySample, _odometry),
    "sensor_msgs/msg/CameraInfo": Converter(CameraInfo, _camera_info),
    "sensor_msgs/msg/CompressedImage": Converter(CameraImage, _compressed_image),
    "sensor_msgs/msg/Image": Converter(CameraImage, _image),
    "sensor_msgs/msg/Imu": Converter(ImuSample, _imu),
    "sensor_msgs/msg/NavSatFix": Converter(GnssFix, _gnss),
    "sensor_msgs/msg/PointCloud2": Converter(PointCloud, _point_cloud),
    "tf/msg/tfMessage": Converter(TransformSample, _transforms),
    "tf2_msgs/msg/TFMessage": Converter(TransformSample, _transforms),
}
