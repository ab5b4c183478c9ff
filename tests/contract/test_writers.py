"""What is written in any format comes back as it was."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

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
from percept.core.transform import Transform
from percept.datasets.decoding.typestores import standard_types
from percept.datasets.messages import Connection, RawMessage
from percept.datasets.open import open_recording
from percept.datasets.write import CloudLayout, Compression, LogFormat, LogWriter

NAMES: dict[LogFormat, str] = {"rosbag1": "drive.bag", "rosbag2": "drive", "mcap": "drive.mcap"}
START_NS = 1_700_000_000_123_456_789
T = Transform.from_quat_xyzw("map", "base_link", [1.5, -2, 3], [0.1, 0.2, 0.3, 0.9])


def make_samples() -> list[Sample]:
    rng = np.random.default_rng(7)
    frames: dict[str, Any] = {"frame": "map"}
    built: list[Sample] = []

    def add(kind: type[Sample], topic: str, **values: Any) -> None:
        stamp_ns = START_NS + len(built) * 10_000_000
        built.append(
            kind(topic=topic, stamp_ns=stamp_ns, log_time_ns=stamp_ns + 777, **frames, **values)
        )

    add(TransformSample, "/tf_static", T_frame_child=T, static=True)
    add(TransformSample, "/tf", T_frame_child=T, static=False)
    for _ in range(2):
        add(
            PointCloud,
            "/points",
            points_xyz=rng.normal(size=(60, 3)).astype("f4"),
            intensity=rng.integers(0, 255, 60).astype("f4"),
            offset_ns=rng.integers(-50_000_000, 50_000_000, 60),
            ring=rng.integers(0, 64, 60).astype("i4"),
        )
    add(PointCloud, "/bare", points_xyz=rng.normal(size=(8, 3)).astype("f4"))
    add(PointCloud, "/empty", points_xyz=np.zeros((0, 3), "f4"))
    for topic, shape, dtype in (
        ("/grey", (5, 7), "u1"),
        ("/colour", (5, 7, 3), "u1"),
        ("/grey16", (5, 7), "u2"),
        ("/colour16", (5, 7, 3), "u2"),
    ):
        add(CameraImage, topic, pixels=rng.integers(0, 255, shape).astype(dtype))
    add(
        CameraInfo,
        "/camera_info",
        image_size=(1920, 1080),
        model="plumb_bob",
        K=np.array([[1000.0, 0, 960], [0, 1001, 540], [0, 0, 1]]),
        distortion=np.array([-0.3, 0.1, 0.001, -0.001, 0.0]),
    )
    for topic, quat in (("/imu", np.array([0.1, 0.2, 0.3, 0.9])), ("/imu_bare", None)):
        add(
            ImuSample,
            topic,
            angular_velocity_radps=np.array([0.1, -0.2, 0.3]),
            linear_acceleration_mps2=np.array([0.0, 0.1, 9.81]),
            quat_xyzw=quat,
        )
    for topic, covariance in (("/gnss", np.diag([1.0, 2, 3])), ("/gnss_bare", None)):
        add(
            GnssFix,
            topic,
            latitude_deg=43.66,
            longitude_deg=-79.39,
            altitude_m=105.2,
            status=2,
            covariance_m2=covariance,
        )
    add(
        OdometrySample,
        "/odometry",
        T_frame_child=T,
        linear_velocity_mps=np.array([5.0, 0, 0]),
        angular_velocity_radps=np.array([0.0, 0, 0.1]),
    )
    add(PoseSample, "/pose", T_frame_child=Transform("map", "", T.matrix))
    return built


def write(path: Path, samples: Iterable[Sample], log_format: LogFormat, **options: Any) -> Path:
    with LogWriter(path, log_format, **options) as writer:
        for sample in samples:
            writer.write(sample)
    return path


def read(path: Path) -> list[Sample]:
    with open_recording(path) as recording:
        samples = list(recording.samples())
        assert not recording.losses
    return samples


def values_of(sample: Sample, leave_out: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    for field in fields(sample):
        if field.name not in leave_out:
            value = getattr(sample, field.name)
            yield field.name, value.matrix if isinstance(value, Transform) else value


def check_same(read_back: Sample, written: Sample) -> None:
    assert type(read_back) is type(written)
    found = dict(values_of(read_back, ("encoding",)))
    for name, value in values_of(written, ("encoding",)):
        if isinstance(value, np.ndarray):
            # A rotation matrix goes through a quaternion.
            tolerance = 1e-12 if name in ("T_frame_child", "quat_xyzw") else 0
            np.testing.assert_allclose(found[name], value, rtol=0, atol=tolerance)
            assert found[name].dtype == value.dtype
        else:
            assert found[name] == value, name


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_every_kind_of_sample_comes_back(tmp_path: Path, log_format: LogFormat) -> None:
    samples = make_samples()
    path = write(tmp_path / NAMES[log_format], samples, log_format)
    found = read(path)
    assert [s.topic for s in found] == [s.topic for s in samples]
    for read_back, written in zip(found, samples, strict=True):
        check_same(read_back, written)
    transforms = [s for s in found if isinstance(s, TransformSample)]
    assert [(s.T_frame_child.target, s.T_frame_child.source) for s in transforms] == [
        ("map", "base_link"),
        ("map", "base_link"),
    ]


@pytest.mark.parametrize(
    ("log_format", "compression"),
    [
        ("rosbag1", "bz2"),
        ("rosbag1", "lz4"),
        ("rosbag2", "zstd"),
        ("mcap", "lz4"),
        ("mcap", "zstd"),
    ],
)
def test_compressed_logs_come_back(
    tmp_path: Path, log_format: LogFormat, compression: Compression
) -> None:
    samples = make_samples()
    found = read(write(tmp_path / NAMES[log_format], samples, log_format, compression=compression))
    for read_back, written in zip(found, samples, strict=True):
        check_same(read_back, written)


@pytest.mark.parametrize(
    "layout",
    [
        CloudLayout(big_endian=True),
        CloudLayout(xyz="f8", intensity="u1"),
        CloudLayout(point_padding=11, row_padding=5, rows=4, intensity="u2"),
        CloudLayout(big_endian=True, xyz="f8", intensity="f8", row_padding=3, rows=2),
    ],
)
def test_the_layout_of_clouds_does_not_matter(tmp_path: Path, layout: CloudLayout) -> None:
    samples = [s for s in make_samples() if isinstance(s, PointCloud)]
    for log_format, name in NAMES.items():
        found = read(write(tmp_path / name, [*samples], log_format, cloud_layout=layout))
        for read_back, written in zip(found, samples, strict=True):
            check_same(read_back, written)


@pytest.mark.parametrize("images", ["jpeg", "png"])
def test_compressed_images_come_back(tmp_path: Path, images: str) -> None:
    pixels = np.full((32, 48, 3), (200, 60, 20), np.uint8)
    image = CameraImage(
        topic="/camera", stamp_ns=START_NS, log_time_ns=START_NS, frame="camera", pixels=pixels
    )
    (found,) = read(write(tmp_path / "a.mcap", [image], "mcap", images=images))
    assert isinstance(found, CameraImage)
    assert found.encoding == images
    np.testing.assert_allclose(found.pixels, pixels, atol=3 if images == "jpeg" else 0)


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_the_same_samples_give_the_same_bytes(tmp_path: Path, log_format: LogFormat) -> None:
    contents = []
    for place in ("a", "b"):
        path = write(tmp_path / place / NAMES[log_format], make_samples(), log_format)
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        contents.append([(file.name, file.read_bytes()) for file in files])
        assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    assert contents[0] == contents[1]


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_a_log_without_messages_opens(tmp_path: Path, log_format: LogFormat) -> None:
    with open_recording(write(tmp_path / NAMES[log_format], [], log_format)) as recording:
        assert recording.topics() == ()
        assert (recording.start_ns, recording.end_ns) == (None, None)


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_static_transforms_are_latched(tmp_path: Path, log_format: LogFormat) -> None:
    path = write(tmp_path / NAMES[log_format], make_samples()[:2], log_format)
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import ConnectionExtRosbag1, QosDurability

    with AnyReader([path]) as reader:
        latched = {}
        for connection in reader.connections:
            ext = connection.ext
            latched[connection.topic] = (
                ext.latching == 1
                if isinstance(ext, ConnectionExtRosbag1)
                else any(
                    q.durability is QosDurability.TRANSIENT_LOCAL for q in ext.offered_qos_profiles
                )
            )
    assert latched == {"/tf_static": True, "/tf": False}


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_nothing_stands_there_after_an_error(tmp_path: Path, log_format: LogFormat) -> None:
    path = tmp_path / NAMES[log_format]
    samples = make_samples()

    def fail_half_way() -> Iterator[Sample]:
        yield samples[0]
        assert not path.exists()
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write(path, fail_half_way(), log_format)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_an_existing_path_is_not_written_over(tmp_path: Path, log_format: LogFormat) -> None:
    path = tmp_path / NAMES[log_format]
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists already"):
        LogWriter(path, log_format)
    assert path.read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_wrong_name_or_compression_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.mcap"):
        LogWriter(tmp_path / "drive.bag", "mcap")
    with pytest.raises(UsageError, match="lz4, zstd"):
        LogWriter(tmp_path / "drive.mcap", "mcap", compression="bz2")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"stamp_ns": -1}, "no ROS stamp"),
        ({"stamp_ns": 2**31 * 10**9}, "no ROS stamp"),
        ({"offset_ns": np.full(8, 2**40)}, "int32"),
        ({"ring": np.full(8, 70_000)}, "uint16"),
    ],
)
def test_what_a_message_cannot_say_is_refused(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    cloud = next(s for s in make_samples() if s.topic == "/bare")
    with pytest.raises(UsageError, match=reason), LogWriter(tmp_path / "a.mcap", "mcap") as writer:
        writer.write(replace(cloud, **change))


def test_a_topic_keeps_its_type_and_tf_its_place(tmp_path: Path) -> None:
    static, moving, cloud = make_samples()[:3]
    with LogWriter(tmp_path / "a.mcap", "mcap") as writer:
        writer.write(cloud)
        with pytest.raises(UsageError, match="PointCloud2"):
            writer.write(replace(moving, topic="/points"))
        with pytest.raises(UsageError, match="tf_static"):
            writer.write(replace(static, topic="/tf"))


def test_points_that_do_not_fill_the_rows_are_refused(tmp_path: Path) -> None:
    cloud = next(s for s in make_samples() if s.topic == "/bare")
    layout = CloudLayout(rows=7)
    with pytest.raises(UsageError, match="8 points do not fill 7 rows"):
        write(tmp_path / "a.mcap", [cloud], "mcap", cloud_layout=layout)


def test_messages_of_any_type_are_copied_with_their_definition(tmp_path: Path) -> None:
    connection = Connection("/custom", "my/msg/Thing", "cdr", "int32 a\nstring b\n", "msg")
    data = b"\0\1\0\0" + (42).to_bytes(4, "little") + (2).to_bytes(4, "little") + b"x\0"
    for log_format in ("rosbag2", "mcap"):
        path = tmp_path / NAMES[log_format]
        with LogWriter(path, log_format) as writer:
            writer.write_raw(RawMessage(connection, START_NS, data))
        (sample,) = read(path)
        assert isinstance(sample, OtherSample)
        assert (sample.message.a, sample.message.b, sample.stamp_ns) == (42, "x", START_NS)
    with (
        pytest.raises(UsageError, match="cdr"),
        LogWriter(tmp_path / "drive.bag", "rosbag1") as writer,
    ):
        writer.write_raw(RawMessage(connection, START_NS, data))


@pytest.mark.parametrize("log_format", get_args(LogFormat))
def test_other_samples_of_standard_types_come_back(tmp_path: Path, log_format: LogFormat) -> None:
    encoding = "ros1" if log_format == "rosbag1" else "cdr"
    message: Any = standard_types(encoding).types["std_msgs/msg/String"]
    sample = OtherSample(
        topic="/text",
        stamp_ns=START_NS,
        log_time_ns=START_NS,
        msgtype="std_msgs/msg/String",
        message=message(data="hello"),
    )
    (found,) = read(write(tmp_path / NAMES[log_format], [sample], log_format))
    assert isinstance(found, OtherSample)
    assert found.message.data == "hello"
