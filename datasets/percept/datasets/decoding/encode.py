"""Samples become ROS messages of either generation: the counterpart of `message_samples`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.clock import NS_PER_S
from percept.core.errors import UsageError
from percept.core.samples import (
    CameraImage,
    CameraInfo,
    GnssFix,
    ImuSample,
    OdometrySample,
    OtherSample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.datasets.decoding.cloud_layout import CloudLayout, packed_points
from percept.datasets.decoding.message_samples import is_static_topic
from percept.datasets.decoding.typestores import standard_types
from percept.datasets.messages import RosMessage

__all__ = ["ImageCoding", "MessageEncoder"]

ImageCoding = Literal["raw", "jpeg", "png"]
"""How images are written: as they are, by JPEG (quality 95), or by PNG."""

_JPEG_QUALITY = 95
_RAW_ENCODINGS = {
    (2, "u1"): "mono8",
    (2, "u2"): "mono16",
    (2, "f4"): "32FC1",
    (3, "u1"): "bgr8",
    (3, "u2"): "bgr16",
}
_COVARIANCE_KNOWN = 3
_SERVICE_GPS = 1
_NO_ORIENTATION = -1.0


class MessageEncoder:
    """Builds and serializes the messages of one ROS generation.

    Args:
        encoding: `ros1` or `cdr`.
        images: How images are written.
        cloud_layout: Layout of point clouds; packed little-endian where it is None.
    """

    def __init__(
        self,
        encoding: str,
        *,
        images: ImageCoding = "raw",
        cloud_layout: CloudLayout | None = None,
    ) -> None:
        self.encoding = encoding
        self.store = standard_types(encoding)
        self._images = images
        self._layout = cloud_layout or CloudLayout()
        self._builders: dict[type[Sample], Callable[[Any], tuple[str, RosMessage]]] = {
            CameraImage: self._image if images == "raw" else self._compressed_image,
            CameraInfo: self._camera_info,
            GnssFix: self._gnss,
            ImuSample: self._imu,
            OdometrySample: self._odometry,
            OtherSample: self._other,
            PointCloud: self._cloud,
            PoseSample: self._pose,
            TransformSample: self._transform,
        }

    def encode(self, sample: Sample) -> tuple[str, memoryview]:
        """Return the message type and the serialized message of a sample.

        Raises:
            UsageError: If the sample cannot be said in a ROS message.
        """
        build = self._builders.get(type(sample))
        if build is None:
            raise UsageError(f"a {type(sample).__name__} cannot be written", where=sample.topic)
        msgtype, message = build(sample)
        if self.encoding == "ros1":
            return msgtype, self.store.serialize_ros1(message, msgtype)
        return msgtype, self.store.serialize_cdr(message, msgtype, little_endian=True)

    def _make(self, msgtype: str, **fields: object) -> RosMessage:
        message_class: RosMessage = self.store.types[msgtype]
        return message_class(**fields)

    def _header(self, sample: Sample) -> RosMessage:
        seconds, nanoseconds = divmod(sample.stamp_ns, NS_PER_S)
        largest = 2**32 if self.encoding == "ros1" else 2**31
        if not 0 <= seconds < largest:
            raise UsageError(f"{sample.stamp_ns} ns is no ROS stamp", where=sample.topic)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        sequence = {"seq": 0} if self.encoding == "ros1" else {}
        return self._make("std_msgs/msg/Header", **sequence, stamp=stamp, frame_id=sample.frame)

    def _vector(self, xyz: ArrayLike, msgtype: str = "geometry_msgs/msg/Vector3") -> RosMessage:
        x, y, z = np.asarray(xyz, dtype=np.float64).tolist()
        return self._make(msgtype, x=x, y=y, z=z)

    def _quaternion(self, quat_xyzw: ArrayLike) -> RosMessage:
        x, y, z, w = np.asarray(quat_xyzw, dtype=np.float64).tolist()
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose_of(self, T_frame_child: Transform) -> RosMessage:
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector(T_frame_child.translation_m, "geometry_msgs/msg/Point"),
            orientation=self._quaternion(quat_xyzw_from_matrix(T_frame_child.rotation)),
        )

    def _cloud(self, sample: PointCloud) -> tuple[str, RosMessage]:
        packed = packed_points(sample, self._layout)
        fields = [
            self._make("sensor_msgs/msg/PointField", name=n, offset=o, datatype=d, count=1)
            for n, o, d in packed.fields
        ]
        msgtype = "sensor_msgs/msg/PointCloud2"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            height=packed.height,
            width=packed.width,
            fields=fields,
            is_bigendian=self._layout.big_endian,
            point_step=packed.point_step,
            row_step=packed.row_step,
            data=packed.data,
            is_dense=True,
        )

    def _image(self, sample: CameraImage) -> tuple[str, RosMessage]:
        pixels = np.ascontiguousarray(sample.pixels)
        encoding = _RAW_ENCODINGS.get((pixels.ndim, pixels.dtype.str[1:]))
        if encoding is None or (pixels.ndim == 3 and pixels.shape[2] != 3):
            raise UsageError(
                f"pixels {pixels.shape} {pixels.dtype} have no ROS encoding", where=sample.topic
            )
        msgtype = "sensor_msgs/msg/Image"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels[0].nbytes,
            data=pixels.view(np.uint8).reshape(-1),
        )

    def _compressed_image(self, sample: CameraImage) -> tuple[str, RosMessage]:
        lossless = self._images == "png"
        if sample.pixels.dtype not in ((np.uint8, np.uint16) if lossless else (np.uint8,)):
            raise UsageError(
                f"{sample.pixels.dtype} pixels cannot be written as {self._images}",
                where=sample.topic,
            )
        parameters = [] if lossless else [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        _, data = cv2.imencode(f".{self._images}", sample.pixels, parameters)
        msgtype = "sensor_msgs/msg/CompressedImage"
        return msgtype, self._make(
            msgtype, header=self._header(sample), format=self._images, data=data.reshape(-1)
        )

    def _camera_info(self, sample: CameraInfo) -> tuple[str, RosMessage]:
        K = np.asarray(sample.K, dtype=np.float64)
        matrices: dict[str, NDArray[np.float64]] = {
            "d": np.asarray(sample.distortion, dtype=np.float64),
            "k": K.reshape(-1),
            "r": np.eye(3).reshape(-1),
            "p": np.hstack([K, np.zeros((3, 1))]).reshape(-1),
        }
        if self.encoding == "ros1":
            matrices = {name.upper(): matrix for name, matrix in matrices.items()}
        width, height = sample.image_size
        region = self._make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        msgtype = "sensor_msgs/msg/CameraInfo"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            height=height,
            width=width,
            distortion_model=sample.model,
            **matrices,
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    def _imu(self, sample: ImuSample) -> tuple[str, RosMessage]:
        orientation_covariance = np.zeros(9)
        if sample.quat_xyzw is None:
            orientation_covariance[0] = _NO_ORIENTATION
        quat_xyzw = np.array([0.0, 0, 0, 1]) if sample.quat_xyzw is None else sample.quat_xyzw
        msgtype = "sensor_msgs/msg/Imu"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            orientation=self._quaternion(quat_xyzw),
            orientation_covariance=orientation_covariance,
            angular_velocity=self._vector(sample.angular_velocity_radps),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self._vector(sample.linear_acceleration_mps2),
            linear_acceleration_covariance=np.zeros(9),
        )

    def _gnss(self, sample: GnssFix) -> tuple[str, RosMessage]:
        known = sample.covariance_m2 is not None
        covariance = np.zeros((3, 3)) if sample.covariance_m2 is None else sample.covariance_m2
        status = self._make(
            "sensor_msgs/msg/NavSatStatus", status=sample.status, service=_SERVICE_GPS
        )
        msgtype = "sensor_msgs/msg/NavSatFix"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            status=status,
            latitude=sample.latitude_deg,
            longitude=sample.longitude_deg,
            altitude=sample.altitude_m,
            position_covariance=np.asarray(covariance, dtype=np.float64).reshape(-1),
            position_covariance_type=_COVARIANCE_KNOWN if known else 0,
        )

    def _odometry(self, sample: OdometrySample) -> tuple[str, RosMessage]:
        pose = self._make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self._pose_of(sample.T_frame_child),
            covariance=np.zeros(36),
        )
        twist = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(sample.linear_velocity_mps),
            angular=self._vector(sample.angular_velocity_radps),
        )
        msgtype = "nav_msgs/msg/Odometry"
        return msgtype, self._make(
            msgtype,
            header=self._header(sample),
            child_frame_id=sample.T_frame_child.source,
            pose=pose,
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
            ),
        )

    def _pose(self, sample: PoseSample) -> tuple[str, RosMessage]:
        msgtype = "geometry_msgs/msg/PoseStamped"
        pose = self._pose_of(sample.T_frame_child)
        return msgtype, self._make(msgtype, header=self._header(sample), pose=pose)

    def _transform(self, sample: TransformSample) -> tuple[str, RosMessage]:
        if sample.static != is_static_topic(sample.topic):
            raise UsageError(
                f"a transform with static={sample.static} cannot go here",
                where=sample.topic,
                remedy="Static transforms belong to a topic named tf_static, the others do not",
            )
        transform = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._vector(sample.T_frame_child.translation_m),
            rotation=self._quaternion(quat_xyzw_from_matrix(sample.T_frame_child.rotation)),
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(sample),
            child_frame_id=sample.T_frame_child.source,
            transform=transform,
        )
        msgtype = "tf2_msgs/msg/TFMessage"
        return msgtype, self._make(msgtype, transforms=[stamped])

    def _other(self, sample: OtherSample) -> tuple[str, RosMessage]:
        if sample.msgtype not in self.store.fielddefs:
            raise UsageError(
                f"'{sample.msgtype}' is no standard type, so that it can only be copied",
                where=sample.topic,
            )
        return sample.msgtype, sample.message
