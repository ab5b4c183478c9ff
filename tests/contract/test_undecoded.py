"""Messages that other threads decode: the same samples and losses as reading in order."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from percept.core.errors import DecodeError, TopicNotFoundError
from percept.core.samples import CameraImage, ImuSample, PointCloud, Sample
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.recording import UndecodedMessage
from percept.datasets.write import LogWriter

_Decoded = tuple[list[Any], Counter[str]]


def _content(value: Any) -> Any:
    """Return a sample, or a part of one, as plain values that can be compared."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Transform):
        return value.target, value.source, value.matrix.tobytes()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = [_content(getattr(value, f.name)) for f in dataclasses.fields(value)]
        return type(value).__name__, parts
    if isinstance(value, list | tuple):
        return [_content(one) for one in value]
    return repr(value)  # NaN is not equal to itself


def _try(message: UndecodedMessage) -> tuple[Sample, ...]:
    try:
        return message.decode()
    except DecodeError:
        return ()


def _in_order(path: Path, **window: Any) -> _Decoded:
    with open_recording(path) as recording:
        samples = [_content(sample) for sample in recording.samples(**window)]
        return samples, recording.losses


def _on_threads(path: Path, **window: Any) -> _Decoded:
    with open_recording(path) as recording, ThreadPoolExecutor(4) as pool:
        found = pool.map(_try, recording.undecoded(**window))
        return [_content(sample) for samples in found for sample in samples], recording.losses


def _backwards(path: Path, **window: Any) -> _Decoded:
    """Decode the last message first, which is the worst that a pool could do."""
    with open_recording(path) as recording:
        found = [_try(message) for message in reversed(list(recording.undecoded(**window)))]
        return [_content(sample) for samples in found[::-1] for sample in samples], recording.losses


_WAYS = pytest.mark.parametrize("way", [_on_threads, _backwards])


@_WAYS
@pytest.mark.parametrize(
    "name",
    [
        "evo/nav2_turtlebot.mcap",
        "rosbagjs/example-lz4.bag",
        "embag/test.bag",
        "rosbag2/cpp_bags/topics_and_services.mcap",
        "rosbag2/cpp_bags/only_topics.mcap",
        "rosbag2/empty_bag",
        "rosbag2/mcap/cdr_test",
        "rosbag2/sqlite3/talker",
        "rosbag2/sqlite3/wbag",
    ],
)
def test_real_logs_give_the_same(
    shared_data: Path, name: str, way: Callable[[Path], _Decoded]
) -> None:
    path = shared_data / "bags" / name
    assert way(path) == _in_order(path)


def _jpeg(number: int) -> bytes:
    rng = np.random.default_rng(number)
    return bytes(cv2.imencode(".jpg", rng.integers(0, 255, (24, 32, 3), np.uint8))[1])


def _stamps(number: int) -> dict[str, Any]:
    log_time_ns = 1_700_000_000_000_000_000 + number * 50_000_000
    return {"stamp_ns": log_time_ns - 3_000_000, "log_time_ns": log_time_ns}


def _mixed() -> Iterable[Sample]:
    """Yield clouds, some with times that make no sense, readings and images, some broken."""
    rng = np.random.default_rng(1)
    for number in range(40):
        points = rng.normal(size=(50, 3)).astype(np.float32)
        times: Any = {"topic": "/points", "frame": "lidar", **_stamps(number)}
        yield PointCloud(points_xyz=points, **times)
        values = np.array([number, np.nan if number % 5 == 3 else 1.0, 0.0])
        yield ImuSample(
            topic="/imu",
            frame="imu",
            angular_velocity_radps=values,
            linear_acceleration_mps2=np.ones(3),
            **_stamps(number),
        )
        pixels = rng.integers(0, 255, (24, 32, 3), np.uint8)
        yield CameraImage(topic="/cam", frame="cam", pixels=pixels, **_stamps(number))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mixed") / "log.mcap"
    with LogWriter(path, "mcap") as writer:
        for sample in _mixed():
            writer.write(sample)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of which each fails for a reason of its own, or not at all."""
    at = tmp_path_factory.mktemp("images")
    for number in range(20):
        content = _jpeg(number)
        content = content[: 20 + number] if number % 4 == 2 else content
        (at / f"{number:06d}.jpg").write_bytes(content)
    return at


@_WAYS
@pytest.mark.parametrize("window", [(0, 99), (7, 31)])
@pytest.mark.parametrize("kind", ["log", "folder"])
def test_made_logs_give_the_same(
    request: pytest.FixtureRequest, kind: str, way: Callable[..., _Decoded], window: tuple[int, int]
) -> None:
    path = request.getfixturevalue(kind)
    with open_recording(path) as recording:
        assert recording.start_ns is not None
        assert recording.end_ns is not None
        step_ns = (recording.end_ns - recording.start_ns) // 40
        start_ns, end_ns = (recording.start_ns + step_ns * n for n in window)
    expected = _in_order(path, start_ns=start_ns, end_ns=end_ns)
    assert way(path, start_ns=start_ns, end_ns=end_ns) == expected
    assert (
        expected[1].total()
        == {("log", 0): 8, ("log", 7): 5, ("folder", 0): 5, ("folder", 7): 3}[kind, window[0]]
    )


def test_a_second_pass_counts_nothing_twice(log: Path) -> None:
    with open_recording(log) as recording:
        for message in reversed(list(recording.undecoded())):
            _try(message)
        once = recording.losses.copy()
        assert once.total() == 8
        list(recording.samples())
        assert recording.start_ns is not None
        for message in recording.undecoded(end_ns=recording.start_ns + 500_000_000):
            _try(message)
        assert recording.losses == once


@pytest.mark.parametrize("kind", ["log", "folder"])
def test_envelopes_say_the_same_times(request: pytest.FixtureRequest, kind: str) -> None:
    with open_recording(request.getfixturevalue(kind)) as recording:
        times = [(e.topic, e.stamp_ns, e.log_time_ns) for e in recording.envelopes()]
        found = [(m.topic, m.stamp_ns, m.log_time_ns) for m in recording.undecoded()]
    assert found == times
    assert found


@pytest.mark.parametrize("kind", ["log", "folder"])
def test_an_unknown_topic_is_refused_at_once(request: pytest.FixtureRequest, kind: str) -> None:
    with (
        open_recording(request.getfixturevalue(kind)) as recording,
        pytest.raises(TopicNotFoundError, match="no topic '/camera'"),
    ):
        recording.undecoded(topics=["/camera"])
