"""The decoder: definitions of the log, hostile payloads, and what messages say."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from percept.core.errors import DecodeError
from percept.core.samples import (
    GnssFix,
    ImuSample,
    OdometrySample,
    OtherSample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.core.transform import Transform
from percept.datasets.decoding.decode import Decoder
from percept.datasets.decoding.encode import MessageEncoder
from percept.datasets.decoding.message_samples import CONVERTERS
from percept.datasets.decoding.typestores import standard_types
from percept.datasets.messages import Connection, RawMessage

STAMP_NS = 1_700_000_000_123_456_789
LOG_TIME_NS = STAMP_NS + 5_000_000
HEAD: dict[str, Any] = {"stamp_ns": STAMP_NS, "log_time_ns": LOG_TIME_NS, "frame": "lidar"}
IMU = ImuSample(
    topic="/imu",
    angular_velocity_radps=np.array([1.0, 2, 3]),
    linear_acceleration_mps2=np.array([0.0, 0, 9.81]),
    **HEAD,
)
EDGE = TransformSample(
    topic="/tf",
    stamp_ns=STAMP_NS,
    log_time_ns=LOG_TIME_NS,
    frame="map",
    T_frame_child=Transform.from_quat_xyzw("map", "base_link", [1, 2, 3], [0, 0, 0.6, 0.8]),
    static=False,
)


def raw_of(sample: Sample, encoding: str) -> RawMessage:
    msgtype, data = MessageEncoder(encoding).encode(sample)
    return RawMessage(Connection(sample.topic, msgtype, encoding), LOG_TIME_NS, bytes(data))


def decode_one(raw: RawMessage) -> Any:
    (sample,) = Decoder([raw.connection]).decode(raw)
    return sample


def custom(definition: str, topic: str = "/custom", msgtype: str = "my/msg/Thing") -> Connection:
    return Connection(topic, msgtype, "cdr", definition, "msg")


def serialized(connection: Connection, **fields: Any) -> RawMessage:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(connection.definition, connection.msgtype))
    message = store.types[connection.msgtype](**fields)
    data = store.serialize_cdr(message, connection.msgtype)
    return RawMessage(connection, LOG_TIME_NS, bytes(data))


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@pytest.mark.parametrize("sample", [IMU, EDGE])
def test_the_header_stamp_is_read_without_decoding(sample: Sample, encoding: str) -> None:
    raw = raw_of(sample, encoding)
    decoder = Decoder([raw.connection])
    assert decoder.header_stamp_ns(raw) == STAMP_NS
    for size in range(8):
        short = RawMessage(raw.connection, LOG_TIME_NS, raw.data[:size])
        assert decoder.header_stamp_ns(short) is None


def test_the_header_stamp_of_a_big_endian_message() -> None:
    store = standard_types("cdr")
    message = MessageEncoder("cdr")._imu(IMU)[1]
    data = store.serialize_cdr(message, "sensor_msgs/msg/Imu", little_endian=False)
    raw = RawMessage(Connection("/imu", "sensor_msgs/msg/Imu", "cdr"), LOG_TIME_NS, data)
    assert Decoder([raw.connection]).header_stamp_ns(raw) == STAMP_NS
    assert decode_one(raw).linear_acceleration_mps2[2] == 9.81


def test_a_type_without_a_header_has_the_log_time() -> None:
    raw = serialized(custom("int32 a\n"), a=5)
    decoder = Decoder([raw.connection])
    assert decoder.header_stamp_ns(raw) is None
    (sample,) = decoder.decode(raw)
    assert isinstance(sample, OtherSample)
    assert (sample.stamp_ns, sample.frame, sample.message.a) == (LOG_TIME_NS, "", 5)


def test_a_custom_type_with_a_header_has_its_stamp_and_frame() -> None:
    definition = "std_msgs/Header header\nfloat32 value\n"
    connection = custom(definition)
    header = MessageEncoder("cdr")._header(IMU)
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(definition, connection.msgtype))
    message = store.types[connection.msgtype](header=header, value=2.5)
    data = bytes(store.serialize_cdr(message, connection.msgtype))
    raw = RawMessage(connection, LOG_TIME_NS, data)
    # The log's definition does not spell the header out: the standard one is taken.
    sample = decode_one(raw)
    assert (sample.stamp_ns, sample.frame, sample.message.value) == (STAMP_NS, "lidar", 2.5)
    assert Decoder([connection]).header_stamp_ns(raw) == STAMP_NS


def test_an_empty_tf_message_has_no_stamp_and_no_samples() -> None:
    connection = Connection("/tf", "tf2_msgs/msg/TFMessage", "cdr")
    raw = RawMessage(connection, LOG_TIME_NS, b"\0\1\0\0" + bytes(16))
    assert Decoder([connection]).header_stamp_ns(raw) is None
    short = RawMessage(connection, LOG_TIME_NS, b"\0\1\0\0" + bytes(4))
    assert Decoder([connection]).decode(short) == []


def test_one_type_with_two_definitions_in_one_log() -> None:
    old = serialized(custom("int32 a\n", "/old"), a=7)
    new = serialized(custom("float64 a\nstring b\n", "/new"), a=0.5, b="x")
    decoder = Decoder([old.connection, new.connection])
    samples = [decoder.decode(raw)[0] for raw in (old, new, old)]
    assert [sample.message.a for sample in samples if isinstance(sample, OtherSample)] == [
        7,
        0.5,
        7,
    ]


def test_a_bad_definition_spoils_only_its_own_topic() -> None:
    good = raw_of(IMU, "cdr")
    bad = [
        custom("this is { no definition", "/bad"),
        custom("other_msgs/Unknown x\n", "/missing"),
        custom("my/Thing[2] again\n", "/recursive"),
        custom("string[4000000000] names\n", "/long"),
        Connection("/service_event", "my/srv/Add_Event", "cdr", "int64 a\n---\nint64 b", "msg"),
        custom("Nothing[] many\n" + "=" * 80 + "\nMSG: my/Nothing\n", "/nothing"),
        Connection("/json", "my/msg/Thing", "json"),
        Connection("/unknown", "my/msg/Unknown", "cdr"),
    ]
    decoder = Decoder([good.connection, *bad])
    assert sorted(decoder.undecodable) == sorted(c.topic for c in bad)
    assert decoder.sample_type(good.connection) is ImuSample
    assert decoder.decode(good)
    for connection in bad:
        raw = RawMessage(connection, LOG_TIME_NS, bytes(100))
        assert decoder.sample_type(connection) is OtherSample
        assert decoder.header_stamp_ns(raw) is None
        with pytest.raises(DecodeError) as caught:
            decoder.decode(raw)
        assert caught.value.where == connection.topic
        assert "\n" not in str(caught.value)


def test_a_standard_name_with_other_fields_is_no_sample_of_that_kind() -> None:
    connection = custom("int32 a\n", "/imu", "sensor_msgs/msg/Imu")
    raw = serialized(connection, a=3)
    assert Decoder([connection]).sample_type(connection) is OtherSample
    assert decode_one(raw).message.a == 3


def test_definitions_as_idl() -> None:
    idl = "module my { module msg { struct Thing { long a; }; }; };"
    separator = "=" * 80 + "\n"
    data = b"\0\1\0\0" + struct.pack("<i", 42)
    for text in (idl, f"{separator}IDL: my/msg/Thing\n{idl}\n"):
        connection = Connection("/custom", "my/msg/Thing", "cdr", text, "idl")
        assert decode_one(RawMessage(connection, LOG_TIME_NS, data)).message.a == 42


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_a_payload_cut_anywhere_is_an_error(encoding: str) -> None:
    cloud = PointCloud(topic="/points", points_xyz=np.ones((3, 3), np.float32), **HEAD)
    for sample in (cloud, IMU, EDGE):
        raw = raw_of(sample, encoding)
        decoder = Decoder([raw.connection])
        for size in range(len(raw.data)):
            with pytest.raises(DecodeError):
                decoder.decode(RawMessage(raw.connection, LOG_TIME_NS, raw.data[:size]))


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@given(data=st.data())
@settings(max_examples=40, derandomize=True)
def test_damaged_payloads_never_end_in_another_error(encoding: str, data: st.DataObject) -> None:
    msgtype = data.draw(st.sampled_from(sorted(t for t in CONVERTERS if "livox" not in t)))
    if msgtype not in standard_types(encoding).fielddefs:
        return
    connection = Connection("/topic", msgtype, encoding)
    if data.draw(st.booleans()) and msgtype == "sensor_msgs/msg/PointCloud2":
        cloud = PointCloud(topic="/p", points_xyz=np.ones((3, 3), np.float32), **HEAD)
        payload = bytearray(raw_of(cloud, encoding).data)
        for _ in range(3):
            payload[data.draw(st.integers(4, len(payload) - 1))] = data.draw(st.integers(0, 255))
    else:
        payload = bytearray(b"\0\1\0\0" + data.draw(st.binary(max_size=300)))
    raw = RawMessage(connection, LOG_TIME_NS, bytes(payload))
    decoder = Decoder([connection])
    decoder.header_stamp_ns(raw)
    try:
        samples = decoder.decode(raw)
    except DecodeError:
        return
    assert all(isinstance(sample, Sample) for sample in samples)


LIVOX = """std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
================================================================================
MSG: livox_ros_driver2/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_livox_clouds_by_the_definition_of_the_log(encoding: str) -> None:
    msgtype = "livox_ros_driver2/msg/CustomMsg"
    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(LIVOX, msgtype))
    point = store.types["livox_ros_driver2/msg/CustomPoint"]
    message = store.types[msgtype](
        header=MessageEncoder(encoding)._header(IMU),
        timebase=STAMP_NS,
        point_num=2,
        lidar_id=0,
        rsvd=np.zeros(3, np.uint8),
        points=[
            point(offset_time=n * 1000, x=1.0, y=2.0, z=n, reflectivity=9, tag=0, line=n)
            for n in range(2)
        ],
    )
    serialize = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
    connection = Connection("/livox", msgtype, encoding, LIVOX, "msg")
    cloud = decode_one(RawMessage(connection, LOG_TIME_NS, bytes(serialize(message, msgtype))))
    assert isinstance(cloud, PointCloud)
    assert cloud.points_xyz.tolist() == [[1, 2, 0], [1, 2, 1]]
    assert cloud.offset_ns is not None
    assert cloud.ring is not None
    assert (cloud.offset_ns.tolist(), cloud.ring.tolist()) == ([0, 1000], [0, 1])
    assert (cloud.stamp_ns, cloud.frame) == (STAMP_NS, "lidar")


def test_slashes_of_ros1_frames_are_stripped() -> None:
    slashed = TransformSample(
        topic="/tf_static",
        stamp_ns=STAMP_NS,
        log_time_ns=LOG_TIME_NS,
        frame="/map",
        T_frame_child=Transform.identity("/map", "/base_link"),
        static=True,
    )
    sample = decode_one(raw_of(slashed, "ros1"))
    assert (sample.frame, sample.T_frame_child.target) == ("map", "map")
    assert (sample.T_frame_child.source, sample.static) == ("base_link", True)


@pytest.mark.parametrize(
    "quat", [(0.0, 0, 0, 0), (float("nan"), 0, 0, 1), (float("inf"), 0, 0, 0), (1e300,) * 4]
)
def test_a_pose_without_a_rotation_is_an_error(quat: tuple[float, ...]) -> None:
    pose = PoseSample(topic="/pose", T_frame_child=Transform.identity("map", ""), **HEAD)
    raw = raw_of(pose, "cdr")
    data = bytearray(raw.data)
    data[-32:] = struct.pack("<4d", *quat)
    with pytest.raises(DecodeError, match="no rotation"):
        decode_one(RawMessage(raw.connection, LOG_TIME_NS, bytes(data)))


def test_an_imu_with_a_zero_quaternion_has_no_orientation() -> None:
    store = standard_types("cdr")
    message = MessageEncoder("cdr")._imu(IMU)[1]
    message.orientation.w = 0.0
    message.orientation_covariance[0] = 0.0
    data = store.serialize_cdr(message, "sensor_msgs/msg/Imu")
    raw = RawMessage(Connection("/imu", "sensor_msgs/msg/Imu", "cdr"), LOG_TIME_NS, data)
    assert decode_one(raw).quat_xyzw is None


def test_an_imu_that_says_so_has_no_orientation_whatever_its_quaternion() -> None:
    store = standard_types("cdr")
    message = MessageEncoder("cdr")._imu(IMU)[1]
    assert message.orientation_covariance[0] == -1.0  # by REP 145
    message.orientation.z, message.orientation.w = 0.6, 0.8
    for covariance, expected in ((-1.0, None), (0.0, [0.0, 0.0, 0.6, 0.8])):
        message.orientation_covariance[0] = covariance
        data = store.serialize_cdr(message, "sensor_msgs/msg/Imu")
        raw = RawMessage(Connection("/imu", "sensor_msgs/msg/Imu", "cdr"), LOG_TIME_NS, data)
        quat_xyzw = decode_one(raw).quat_xyzw
        assert (None if quat_xyzw is None else quat_xyzw.tolist()) == expected


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_odometry_names_both_frames_and_moves_in_the_childs(encoding: str) -> None:
    sent = OdometrySample(
        topic="/odom",
        **(HEAD | {"frame": "odom"}),
        T_frame_child=Transform.from_quat_xyzw("odom", "base_link", [1, 2, 3], [0, 0, 0.6, 0.8]),
        linear_velocity_mps=np.array([4.0, 5.0, 6.0]),
        angular_velocity_radps=np.array([0.1, 0.2, 0.3]),
    )
    found = decode_one(raw_of(sent, encoding))
    pose = found.T_frame_child
    assert (found.frame, pose.target, pose.source) == ("odom", "odom", "base_link")
    np.testing.assert_allclose(pose.matrix, sent.T_frame_child.matrix, atol=1e-12)
    assert found.linear_velocity_mps.tolist() == [4.0, 5.0, 6.0]
    assert found.angular_velocity_radps.tolist() == [0.1, 0.2, 0.3]


def test_an_imu_that_is_not_finite_is_an_error() -> None:
    broken = ImuSample(
        topic="/imu",
        angular_velocity_radps=np.array([np.nan, 0, 0]),
        linear_acceleration_mps2=np.zeros(3),
        **HEAD,
    )
    with pytest.raises(DecodeError, match="angular velocity"):
        decode_one(raw_of(broken, "cdr"))


def test_an_unknown_gnss_covariance_is_none() -> None:
    fix = GnssFix(topic="/gnss", latitude_deg=43.0, longitude_deg=-79.0, altitude_m=1.0, **HEAD)
    assert decode_one(raw_of(fix, "ros1")).covariance_m2 is None


def test_real_luminar_clouds(shared_data: Any) -> None:
    from rosbags.rosbag1 import Reader

    with Reader(shared_data / "bags" / "embag" / "test.bag") as reader:
        connections = {
            c.id: Connection(c.topic, c.msgtype, "ros1", c.msgdef.data, "msg")
            for c in reader.connections
        }
        decoder = Decoder(connections.values())
        clouds = []
        notes: Counter[str] = Counter()
        for connection, log_time_ns, data in reader.messages():
            raw = RawMessage(connections[connection.id], log_time_ns, data)
            stamp_ns = decoder.header_stamp_ns(raw)
            for sample in decoder.decode(raw, notes):
                assert sample.stamp_ns == stamp_ns
                clouds += [sample] if isinstance(sample, PointCloud) else []
    assert len(clouds) == 5
    assert not notes
    for cloud in clouds:
        assert len(cloud) > 35_000
        assert cloud.offset_ns is not None
        assert 50_000_000 < np.ptp(cloud.offset_ns) < 150_000_000
