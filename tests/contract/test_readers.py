"""Laws that all log readers obey, on logs of all kinds with the same content, and real ones."""

from __future__ import annotations

import hashlib
import shutil
import sqlite3
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as PlainReader1
from rosbags.rosbag2 import Reader as PlainReader2

from percept.core.errors import TopicNotFoundError
from percept.core.samples import ImuSample, OtherSample, PointCloud, Sample, TransformSample
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.bag_recording import BagRecording
from percept.datasets.messages import RawMessage
from percept.datasets.write import LogWriter

_START_NS = 1_700_000_000_000_000_000
_STEP_NS = 50_000_000
_STEPS = 40


def _samples() -> Iterator[Sample]:
    """Yield static and moving transforms, clouds and IMU readings; header before log time."""
    rng = np.random.default_rng(5)
    for i in range(_STEPS):
        log_ns = _START_NS + i * _STEP_NS
        times: dict[str, Any] = {"stamp_ns": log_ns - 3_000_000, "log_time_ns": log_ns}
        if i in (0, 7):
            T_base_lidar = Transform("base_link", "lidar", np.eye(4) + np.eye(4, k=3) * (i + 1))
            yield TransformSample(
                topic="/tf_static",
                frame="base_link",
                T_frame_child=T_base_lidar,
                static=True,
                **times,
            )
        yield ImuSample(
            topic="/imu",
            frame="imu",
            angular_velocity_radps=rng.normal(size=3),
            linear_acceleration_mps2=rng.normal(size=3),
            **times,
        )
        if i % 4 == 0:
            points = rng.normal(size=(500, 3)).astype(np.float32)
            yield PointCloud(topic="/points", frame="lidar", points_xyz=points, **times)


def _digest(sample: Sample) -> tuple[Any, ...]:
    common = (sample.topic, sample.stamp_ns, sample.log_time_ns, sample.frame)
    if isinstance(sample, PointCloud):
        return (*common, sample.points_xyz.tobytes())
    if isinstance(sample, ImuSample):
        return (*common, sample.angular_velocity_radps.tobytes())
    assert isinstance(sample, TransformSample)
    return (*common, sample.static, sample.T_frame_child.matrix.tobytes())


def _write(path: Path, log_format: Any, compression: Any) -> Path:
    with LogWriter(path, log_format, compression=compression) as log:
        for sample in _samples():
            log.write(sample)
    return path


def _without_index(bag: Path, target: Path) -> Path:
    """Return a bag as the recorder leaves it when it is killed between two chunks."""
    with PlainReader1(bag) as reader:
        assert reader.bio is not None
        end = max(chunk.datapos + chunk.datasize for chunk in reader.chunks.values())
    data = bytearray(bag.read_bytes()[:end])
    place = data.index(b"index_pos=") + len(b"index_pos=")
    data[place : place + 8] = bytes(8)
    target.write_bytes(data)
    return target


def _split(folder: Path, target: Path) -> Path:
    """Return a folder of two files, each with every second message."""
    target.mkdir()
    source = next(folder.glob("*.db3"))
    for part in (0, 1):
        copy = target / f"part_{part}.db3"
        shutil.copyfile(source, copy)
        database = sqlite3.connect(copy)
        database.execute("DELETE FROM messages WHERE id % 2 = ?", (part,))
        database.commit()
        database.close()
    return target


def _bare_mcap(source: Path, target: Path, **options: Any) -> Path:
    """Return an mcap file with the same messages, written with other options."""
    with source.open("rb") as stream, target.open("wb") as out:
        writer = McapWriter(out, **options)
        writer.start("ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this
    return target


def _zstd(source: Path, target: Path) -> Path:
    target.write_bytes(zstandard.ZstdCompressor().compress(source.read_bytes()))
    return target


@pytest.fixture(scope="session")
def containers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same content in every container that a reader knows."""
    at = tmp_path_factory.mktemp("containers")
    made = {
        "bag": _write(at / "plain.bag", "rosbag1", "none"),
        "bag bz2": _write(at / "bz2.bag", "rosbag1", "bz2"),
        "bag lz4": _write(at / "lz4.bag", "rosbag1", "lz4"),
        "db3 folder": _write(at / "db3", "rosbag2", "none"),
        "db3 folder zstd": _write(at / "db3_zstd", "rosbag2", "zstd"),
        "mcap": _write(at / "plain.mcap", "mcap", "none"),
        "mcap lz4": _write(at / "lz4.mcap", "mcap", "lz4"),
        "mcap zstd": _write(at / "zstd.mcap", "mcap", "zstd"),
    }
    db3 = next(made["db3 folder"].glob("*.db3"))
    lone = at / "lone"
    lone.mkdir()
    shutil.copyfile(db3, lone / "a.db3")
    made["db3 folder without metadata.yaml"] = lone
    made["db3"] = db3
    made["db3 split"] = _split(made["db3 folder"], at / "split")
    made["bag.active"] = _without_index(made["bag"], at / "killed.bag.active")
    made["mcap by another name"] = Path(shutil.copyfile(made["mcap zstd"], at / "log.dat"))
    made["mcap without chunks"] = _bare_mcap(made["mcap"], at / "bare.mcap", use_chunking=False)
    made["mcap without statistics"] = _bare_mcap(
        made["mcap"], at / "statless.mcap", use_statistics=False
    )
    made["mcap without summary"] = _bare_mcap(
        made["mcap"],
        at / "summaryless.mcap",
        use_statistics=False,
        use_summary_offsets=False,
        repeat_channels=False,
        repeat_schemas=False,
        index_types=_no_index(),
    )
    made["db3.zstd"] = _zstd(db3, at / "packed.db3.zstd")
    made["mcap.zstd"] = _zstd(made["mcap"], at / "packed.mcap.zstd")
    return made


def _no_index() -> Any:
    from mcap.writer import IndexType

    return IndexType.NONE


_KINDS = (
    *("bag", "bag bz2", "bag lz4", "bag.active"),
    *("db3", "db3 folder", "db3 folder zstd", "db3.zstd", "db3 split"),
    "db3 folder without metadata.yaml",
    *("mcap", "mcap lz4", "mcap zstd", "mcap.zstd", "mcap by another name"),
    *("mcap without chunks", "mcap without statistics", "mcap without summary"),
)


@pytest.fixture(params=_KINDS)
def container(request: pytest.FixtureRequest, containers: dict[str, Path]) -> Path:
    assert set(_KINDS) == set(containers)
    return containers[request.param]


class TestEveryContainer:
    def test_gives_the_samples_that_were_written(self, container: Path) -> None:
        with open_recording(container) as recording:
            found = [_digest(sample) for sample in recording.samples()]
        # A split log may exchange messages of equal log time.
        assert sorted(found) == sorted(_digest(sample) for sample in _samples())

    def test_goes_forward_in_log_time(self, container: Path) -> None:
        with open_recording(container) as recording:
            times = [sample.log_time_ns for sample in recording.samples()]
            assert times == sorted(times)
            assert (recording.start_ns, recording.end_ns) == (times[0], times[-1])

    def test_counts_what_it_gives(self, container: Path) -> None:
        with open_recording(container) as recording:
            stated = {info.topic: info.count for info in recording.topics()}
            found = Counter(envelope.topic for envelope in recording.envelopes())
            types = {info.topic: info.sample_type for info in recording.topics()}
        assert stated == found == {"/imu": 40, "/points": 10, "/tf_static": 2}
        assert types == {"/imu": ImuSample, "/points": PointCloud, "/tf_static": TransformSample}

    def test_loses_nothing(self, container: Path) -> None:
        with open_recording(container) as recording:
            assert len(list(recording.samples())) == 52
            lost = dict(recording.losses)
        # A bag without an index is whole here, and that the index was missing is worth saying.
        assert [reason.partition(";")[0] for reason in lost] == (
            ["files whose index is missing or damaged"] if container.suffix == ".active" else []
        )

    @pytest.mark.parametrize("topics", [None, {"/imu"}, {"/points", "/tf_static"}])
    @pytest.mark.parametrize(("first", "last"), [(None, None), (5, 20), (None, 9), (33, None)])
    def test_filters_as_brute_force_does(
        self, container: Path, topics: set[str] | None, first: int | None, last: int | None
    ) -> None:
        start_ns = None if first is None else _START_NS + first * _STEP_NS
        end_ns = None if last is None else _START_NS + last * _STEP_NS
        with open_recording(container) as recording:
            assert isinstance(recording, BagRecording)
            found = [_stored(raw) for raw in recording.messages(topics, start_ns, end_ns)]
            brute = [
                _stored(raw)
                for raw in recording.messages()
                if (topics is None or raw.connection.topic in topics)
                and (start_ns is None or raw.log_time_ns >= start_ns)
                and (end_ns is None or raw.log_time_ns <= end_ns)
            ]
        assert found == brute
        assert found

    def test_static_transforms_are_latched(self, container: Path) -> None:
        start_ns = _START_NS + 20 * _STEP_NS
        with open_recording(container) as recording:
            first, second, *_ = recording.samples(start_ns=start_ns)
            none = list(recording.samples(topics=["/imu"], start_ns=start_ns, end_ns=start_ns))
        assert isinstance(first, TransformSample)
        assert first.T_frame_child.matrix[0, 3] == 8.0
        assert second.log_time_ns == start_ns
        assert [sample.topic for sample in none] == ["/imu"]

    def test_envelopes_agree_with_samples(self, container: Path) -> None:
        with open_recording(container) as recording:
            times = sorted((s.topic, s.stamp_ns, s.log_time_ns) for s in recording.samples())
            found = [(e.topic, e.stamp_ns, e.log_time_ns) for e in recording.envelopes()]
        assert sorted(found, key=str) == sorted(times, key=str)

    def test_leaves_the_input_alone(self, container: Path) -> None:
        before = _state(container.parent)
        with open_recording(container) as recording:
            list(recording.samples(topics=["/imu"]))
        assert _state(container.parent) == before

    def test_one_topic_may_come_as_a_text(self, container: Path) -> None:
        with open_recording(container) as recording:
            assert {sample.topic for sample in recording.samples(topics="/imu")} == {"/imu"}
            assert {envelope.topic for envelope in recording.envelopes(topics="/imu")} == {"/imu"}

    def test_an_unknown_topic_names_the_candidates(self, container: Path) -> None:
        with (
            open_recording(container) as recording,
            pytest.raises(TopicNotFoundError, match=r"no topic '/imo'.*Choose from: /imu"),
        ):
            recording.samples(topics=["/imo"])


def _stored(raw: RawMessage) -> tuple[str, int, bytes]:
    return raw.connection.topic, raw.log_time_ns, bytes(raw.data)


def _state(folder: Path) -> dict[Path, tuple[int, str]]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {f: (f.stat().st_mtime_ns, hashlib.sha256(f.read_bytes()).hexdigest()) for f in files}


def test_several_logs_are_merged_in_time(containers: dict[str, Path], tmp_path: Path) -> None:
    early = tmp_path / "early.mcap"
    with LogWriter(early, "mcap") as log:
        for sample in list(_samples())[:5]:
            log.write(sample)
    with open_recording([containers["bag"], early]) as recording:
        times = [sample.log_time_ns for sample in recording.samples()]
        assert recording.format == "mcap+rosbag1"
    assert len(times) == 57
    assert times == sorted(times)


def test_a_write_ahead_log_is_read_too(containers: dict[str, Path], tmp_path: Path) -> None:
    path = Path(shutil.copyfile(containers["db3"], tmp_path / "log.db3"))
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode = WAL")
    writer.execute("PRAGMA wal_autocheckpoint = 0")
    row = "SELECT topic_id, timestamp + 1, data FROM messages WHERE id = 2"
    writer.execute(f"INSERT INTO messages (topic_id, timestamp, data) {row}")
    writer.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for name in ("log.db3", "log.db3-wal"):
        shutil.copyfile(tmp_path / name, killed / name)
    writer.close()
    before = _state(killed)
    with open_recording(killed / "log.db3") as recording:
        assert len(list(recording.samples())) == 53
    assert _state(killed) == before


class TestRealLogs:
    @pytest.mark.parametrize(
        ("name", "count"),
        [
            ("evo/ROS_example.bag", 26_566),
            ("evo/nav2_turtlebot.mcap", 8_197),
            ("rosbagjs/example.bag", 8_647),
            ("rosbagjs/example-bz2.bag", 8_647),
            ("rosbagjs/example-lz4.bag", 8_647),
            ("rosbagjs/no-messages.bag", 0),
            ("embag/test.bag", 15),
            ("embag/test_2.bag", 2),
            ("rosbag2/cpp_bags/only_services.mcap", 12),
            ("rosbag2/cpp_bags/only_topics.mcap", 7),
            ("rosbag2/cpp_bags/topics_and_services.mcap", 13),
            ("rosbag2/cpp_bags/topics_and_services.db3", 13),
            ("rosbag2/empty_bag", 0),
            ("rosbag2/mcap/cdr_test", 7),
            ("rosbag2/mcap/talker", 20),
            ("rosbag2/mcap/wbag", 6_074),
            ("rosbag2/sqlite3/cdr_test", 7),
            ("rosbag2/sqlite3/talker", 20),
            ("rosbag2/sqlite3/wbag", 6_074),
        ],
    )
    def test_equals_plain_iteration(self, shared_data: Path, name: str, count: int) -> None:
        path = shared_data / "bags" / name
        with open_recording(path) as recording:
            assert isinstance(recording, BagRecording)
            found = [_stored(raw) for raw in recording.messages()]
            assert sum(info.count for info in recording.topics()) == len(found) == count
            assert not recording.losses
        assert [item[1] for item in found] == sorted(item[1] for item in found)
        assert sorted(found) == sorted(_plain(path))

    def test_definitions_that_cannot_be_used_break_no_other_topic(self, shared_data: Path) -> None:
        path = shared_data / "bags/rosbag2/cpp_bags/topics_and_services.mcap"
        with open_recording(path) as recording:
            kinds = Counter(sample.topic for sample in recording.samples())
            undecodable = {
                info.topic: info.count for info in recording.topics() if info.undecodable
            }
            lost = sum(recording.losses.values())
        assert kinds == {"/parameter_events": 7}
        assert lost == sum(undecodable.values()) == 6
        assert not any("\n" in reason for reason in recording.losses)

    def test_types_without_a_definition_come_from_the_stores(self, shared_data: Path) -> None:
        with open_recording(shared_data / "bags/rosbag2/sqlite3/talker/talker.db3") as recording:
            samples = recording.samples(topics=["/topic"])
            texts = [s.message.data for s in samples if isinstance(s, OtherSample)]
        assert len(texts) == 10
        assert texts[0].startswith("Hello")


def _plain(path: Path) -> Iterator[tuple[str, int, bytes]]:
    """Yield what rosbags gives, file by file: of a folder it may give nothing (mcap/talker)."""
    files = (
        [f for f in path.iterdir() if f.suffix in (".db3", ".mcap")] if path.is_dir() else [path]
    )
    for file in files:
        reader: Any = PlainReader1(file) if file.suffix == ".bag" else PlainReader2(file)
        with reader:
            for connection, time_ns, data in reader.messages():
                yield connection.topic, time_ns, bytes(data)
