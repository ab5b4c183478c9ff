"""Scans that the exports are tried on, and sound logs that tests then damage."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from percept.core.results import Detections3D
from percept.core.samples import PointCloud
from percept.lidar.result import ScanResult

_LABELS = ("car", "pedestrian", "unknown")


def _scan(number: int, boxes: int = 3, points: int = 400, sensor: str = "top") -> ScanResult:
    """Return a scan that depends on its number alone, 0.1 s after the one before."""
    rng = np.random.default_rng(number)
    stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
    cloud = PointCloud(
        topic=f"/{sensor}/points",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 7_000_000,
        frame=f"lidar_{sensor}",
        points_xyz=(rng.uniform(-40, 40, (points, 3)) * [1, 1, 0.02]).astype(np.float32),
    )
    detections = Detections3D(
        stamp_ns=stamp_ns,
        sensor=sensor,
        frame_id=f"lidar_{sensor}",
        boxes_m=np.column_stack(
            [
                rng.uniform(-40, 40, (boxes, 2)),
                np.full(boxes, 0.8),
                np.tile([4.2, 1.8, 1.5], (boxes, 1)),
                rng.uniform(-3, 3, boxes),
            ]
        ),
        labels=tuple(_LABELS[i % 3] for i in range(boxes)),
        confidences=rng.uniform(size=boxes),
        mean_intensity=np.where(np.arange(boxes) % 2, np.nan, 12.5),
        points=rng.integers(5, 500, boxes),
    )
    return ScanResult(
        cloud=cloud,
        ground=rng.uniform(size=points) < 0.5,
        cluster_ids=(np.arange(points) % (boxes + 1) - 1).astype(np.int32),
        detections=detections,
        timings_ms={"ground": 4.0, "cluster": 10.0 + number % 5, "boxes": 2.0, "classify": 0.5},
        dropped={"points out of range": number % 3},
    )


@pytest.fixture(scope="session")
def make_scan() -> Callable[..., ScanResult]:
    """Makes scans: `make_scan(number, boxes=3, points=400, sensor="top")`."""
    return _scan


_TYPE = "std_msgs/msg/String"
_CHUNK_BYTES = 16_384
_QUALITY = (
    "- {history: 1, depth: 5, reliability: 1, durability: 1, deadline: {sec: 0, nsec: 0}, "
    "lifespan: {sec: 0, nsec: 0}, liveliness: 1, liveliness_lease_duration: {sec: 0, nsec: 0}, "
    "avoid_ros_namespace_conventions: false}"
)


def _messages() -> list[tuple[str, int, str]]:
    """Return small messages with a large one among every ten, as in a log with a camera."""
    rng = np.random.default_rng(3)
    messages = []
    for i in range(660):
        letters = rng.integers(97, 123, 5_000 if i % 10 == 9 else i % 40, dtype=np.uint8)
        topic = "/large" if i % 10 == 9 else f"/small{i % 2}"
        messages.append((topic, 10**18 + i * 10**6, letters.tobytes().decode()))
    return messages


def _write_bag(path: Path, compression: str) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = BagWriter(path)
    writer.chunk_threshold = _CHUNK_BYTES
    if compression:
        writer.set_compression(BagWriter.CompressionFormat[compression])
    with writer:
        at = {t: writer.add_connection(t, _TYPE, typestore=store, latching=1) for t in _topics()}
        for topic, time_ns, text in _messages():
            data = store.serialize_ros1(store.types[_TYPE](text), _TYPE)
            writer.write(at[topic], time_ns, data)
    return path


def _write_mcap(path: Path, compression: CompressionType, *, chunks: bool = True) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as stream:
        writer = McapWriter(
            stream, chunk_size=_CHUNK_BYTES, compression=compression, use_chunking=chunks
        )
        writer.start("ros2")
        text, _ = store.generate_msgdef(_TYPE, ros_version=2)
        schema = writer.register_schema(_TYPE, "ros2msg", text.encode())
        quality = {"offered_qos_profiles": _QUALITY}
        at = {t: writer.register_channel(t, "cdr", schema, quality) for t in _topics()}
        writer.add_metadata("car", {"name": "percept"})
        for number, (topic, time_ns, text) in enumerate(_messages()):
            data = bytes(store.serialize_cdr(store.types[_TYPE](text), _TYPE))
            writer.add_message(at[topic], time_ns, data, time_ns - 5, number)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this
    return path


def _write_db3(folder: Path) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Rosbag2Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        at = {t: writer.add_connection(t, _TYPE, typestore=store) for t in _topics()}
        for topic, time_ns, text in _messages():
            data = store.serialize_cdr(store.types[_TYPE](text), _TYPE)
            writer.write(at[topic], time_ns, data)
    return next(folder.glob("*.db3"))


def _topics() -> list[str]:
    return sorted({topic for topic, _, _ in _messages()})


_MAKERS: dict[str, Callable[[Path], Path]] = {
    "bag": lambda at: _write_bag(at / "plain.bag", ""),
    "bag bz2": lambda at: _write_bag(at / "bz2.bag", "BZ2"),
    "bag lz4": lambda at: _write_bag(at / "lz4.bag", "LZ4"),
    "mcap": lambda at: _write_mcap(at / "plain.mcap", CompressionType.NONE),
    "mcap zstd": lambda at: _write_mcap(at / "zstd.mcap", CompressionType.ZSTD),
    "mcap lz4": lambda at: _write_mcap(at / "lz4.mcap", CompressionType.LZ4),
    "mcap bare": lambda at: _write_mcap(at / "bare.mcap", CompressionType.NONE, chunks=False),
    "db3": lambda at: _write_db3(at / "log"),
}


@pytest.fixture(scope="session", params=_MAKERS)
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One sound log of each kind, with the same messages."""
    return _MAKERS[request.param](tmp_path_factory.mktemp("sound"))


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """All kinds of sound logs by name, with the same 660 messages."""
    at = tmp_path_factory.mktemp("all")
    return {kind: make(at) for kind, make in _MAKERS.items()}


@pytest.fixture
def quality() -> str:
    """The quality of service that all topics of the mcap logs have."""
    return _QUALITY
