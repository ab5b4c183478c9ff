"""Logs cut at any byte and with flipped bits: all that can be read is, and the rest is counted."""

from __future__ import annotations

import hashlib
import sqlite3
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader as PlainReader1
from rosbags.rosbag2 import Reader as PlainReader2
from rosbags.typesys import Stores, get_typestore

from percept.core.errors import PerceptError, RecordingError, UsageError
from percept.datasets import open_recording
from percept.datasets.bag_recording import BagRecording
from percept.datasets.messages import Connection, RawMessage
from percept.datasets.recover import RecoveryReport, recover
from percept.datasets.write import LogWriter

_Stored = tuple[str, int, bytes]


def _read(path: Path) -> tuple[list[_Stored], Counter[str], int]:
    with open_recording(path) as recording:
        assert isinstance(recording, BagRecording)
        found = [
            (raw.connection.topic, raw.log_time_ns, bytes(raw.data)) for raw in recording.messages()
        ]
        return found, recording.losses, sum(info.count for info in recording.topics())


def _damage(path: Path, content: bytes | bytearray) -> Path:
    path.write_bytes(content)
    return path


class TestCut:
    def test_anywhere_gives_a_part_of_what_was_written(self, log: Path, tmp_path: Path) -> None:
        content, written = log.read_bytes(), set(_read(log)[0])
        rng, refused = np.random.default_rng(11), []
        for _ in range(30):
            path = _damage(tmp_path / log.name, content[: rng.integers(1, len(content))])
            try:
                found, losses, count = _read(path)
            except RecordingError:
                refused.append(path.stat().st_size / len(content))
                continue
            assert set(found) <= written
            assert len(set(found)) == len(found) == count
            assert [item[1] for item in found] == sorted(item[1] for item in found)
            assert losses
        # Only what comes before the list of topics, or before the magic, is not worth opening.
        assert max(refused, default=0) < 0.25

    @pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
    def test_yields_nearly_its_share(self, log: Path, tmp_path: Path, share: float) -> None:
        content, written = log.read_bytes(), _read(log)[0]
        path = _damage(tmp_path / log.name, content[: int(len(content) * share)])
        found, _, _ = _read(path)
        # A chunk of a compressed log that is cut is lost from the compressor's last block on.
        slack = 0.02 if log.name in ("plain.bag", "plain.mcap", "bare.mcap") else 0.06
        assert len(found) >= (share - slack) * len(written)

    def test_never_touches_the_input(self, log: Path, tmp_path: Path) -> None:
        content = log.read_bytes()[: log.stat().st_size // 2]
        path = _damage(tmp_path / log.name, content)
        before = path.stat().st_mtime_ns
        _read(path)
        recover(path, tmp_path / "out" / log.name)
        assert path.read_bytes() == content
        assert path.stat().st_mtime_ns == before
        assert {file.name for file in tmp_path.iterdir()} == {log.name, "out"}

    def test_filters_still_hold(self, log: Path, tmp_path: Path) -> None:
        path = _damage(tmp_path / log.name, log.read_bytes()[: int(log.stat().st_size * 0.7)])
        found, _, _ = _read(path)
        first, last = found[50][1], found[300][1]
        with open_recording(path) as recording:
            assert isinstance(recording, BagRecording)
            times = [raw.log_time_ns for raw in recording.messages({"/small0"}, first, last)]
        assert times == [t for topic, t, _ in found if topic == "/small0" and first <= t <= last]


@pytest.mark.parametrize("kind", ["bag", "bag bz2", "bag lz4"])
def test_the_chunk_in_which_a_recorder_was_killed_is_read(
    made: dict[str, Path], tmp_path: Path, kind: str
) -> None:
    # Until a chunk is complete its record states the size 0, and the bag header no index.
    with PlainReader1(made[kind]) as reader:
        assert reader.bio is not None
        chunks = sorted(reader.chunks.values(), key=lambda chunk: chunk.datapos)
        third = chunks[3]
    content = bytearray(made[kind].read_bytes()[: third.datapos + third.datasize])
    content[third.datapos - 4 : third.datapos] = bytes(4)
    place = content.rindex(b"size=", 0, third.datapos) + 5
    content[place : place + 4] = bytes(4)
    place = content.index(b"index_pos=") + 10
    content[place : place + 8] = bytes(8)
    found, losses, _ = _read(_damage(tmp_path / "killed.bag.active", content))
    whole = _read(made[kind])[0]
    assert found == whole[: len(found)]
    assert len(found) > 0.7 * 4 / len(chunks) * len(whole)
    assert losses["chunks that the end of the file cuts"] == 1


class TestFlippedBits:
    def test_are_never_a_crash(self, log: Path, tmp_path: Path) -> None:
        content, written = log.read_bytes(), _read(log)[0]
        rng = np.random.default_rng(12)
        for flips in (1, 1, 1, 3, 3, 10, 10, 100, 100, 100) * 2:
            damaged = bytearray(content)
            for _ in range(flips):
                damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
            path = _damage(tmp_path / log.name, damaged)
            try:
                found, losses, _ = _read(path)
            except PerceptError:
                continue
            assert [item[1] for item in found] == sorted(item[1] for item in found)
            assert len(found) == len(written) or losses

    def test_a_time_that_is_no_number_is_not_taken_for_one(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        path = _damage(tmp_path / "typed.db3", made["db3"].read_bytes())
        database = sqlite3.connect(path)
        database.execute("UPDATE messages SET timestamp = ? WHERE id = 20", (b"a time",))
        database.commit()
        database.close()
        found, losses, count = _read(path)
        assert len(found) == count == len(_read(made["db3"])[0]) - 1
        assert losses

    def test_a_chunk_that_fails_its_checksum_is_left_out_whole(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content, written = bytearray(made["mcap"].read_bytes()), set(_read(made["mcap"])[0])
        content[len(content) // 2] ^= 1
        found, losses, count = _read(_damage(tmp_path / "a.mcap", content))
        assert set(found) < written
        assert losses == {"messages in chunks that fail their checksum": len(written) - len(found)}
        assert len(found) == count

    def test_a_bad_chunk_costs_no_other(self, made: dict[str, Path], tmp_path: Path) -> None:
        for kind, needle in (("bag bz2", b"=bz2"), ("mcap zstd", b"\4\0\0\0zstd")):
            content, written = bytearray(made[kind].read_bytes()), set(_read(made[kind])[0])
            content[content.index(needle, len(content) // 2) + 500] ^= 255
            found, losses, count = _read(_damage(tmp_path / made[kind].name, content))
            assert set(found) < written
            assert len(found) > 0.7 * len(written)
            assert losses.total() == len(written) - len(found)
            assert len(found) == count

    def test_losses_are_counted_once(self, made: dict[str, Path], tmp_path: Path) -> None:
        content = bytearray(made["mcap"].read_bytes())
        content[len(content) // 2] ^= 1
        with open_recording(_damage(tmp_path / "a.mcap", content)) as recording:
            list(recording.envelopes())
            once = dict(recording.losses)
            list(recording.envelopes())
            assert recording.losses == once

    def test_damage_between_chunks_is_skipped(self, made: dict[str, Path], tmp_path: Path) -> None:
        for kind, needle in (("bag", b"compression="), ("mcap zstd", b"\x04\0\0\0zstd")):
            content, written = made[kind].read_bytes(), set(_read(made[kind])[0])
            # Without the end of the file there is no index, and the third chunk has no head.
            third = content.split(needle, 3)
            place = len(content) - len(third[3])
            damaged = content[: place - 60] + b"\xa5" * 60 + content[place:-2_000]
            found, losses, _ = _read(_damage(tmp_path / made[kind].name, damaged))
            assert losses["bytes between damaged records"] > 0
            assert set(found) < written
            assert len(found) > 0.7 * len(written)

    def test_a_lost_inner_page_loses_no_rows(self, made: dict[str, Path], tmp_path: Path) -> None:
        content = bytearray(made["db3"].read_bytes())
        written = _read(made["db3"])[0]
        database = sqlite3.connect(made["db3"])
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        (root,) = database.execute(query).fetchone()
        database.close()
        content[(root - 1) * 4096 : root * 4096] = bytes(4096)
        found, losses, _ = _read(_damage(tmp_path / "a.db3", content))
        assert found == written
        assert losses == {"files that are damaged; read page by page": 1}


class TestRecover:
    def test_what_is_readable_opens_with_the_plain_readers(self, log: Path, tmp_path: Path) -> None:
        path = _damage(tmp_path / log.name, log.read_bytes()[: int(log.stat().st_size * 0.6)])
        out = tmp_path / "out" / log.name
        report = recover(path, out)
        found, losses, _ = _read(path)
        assert _plain(out) == sorted(found)
        again, none, _ = _read(out)
        assert again == found
        assert not none
        assert report == RecoveryReport(
            (path,), (out,), dict(Counter(item[0] for item in found)), dict(losses)
        )

    def test_a_sound_log_is_copied_in_full(self, log: Path, tmp_path: Path) -> None:
        out = tmp_path / log.name
        report = recover(log, out)
        assert report.losses == {}
        assert _read(out)[0] == _read(log)[0]
        assert _definitions(out) == _definitions(log)

    def test_latching_sequence_and_publish_times_are_kept(
        self, made: dict[str, Path], tmp_path: Path, quality: str
    ) -> None:
        recover(made["bag lz4"], tmp_path / "a.bag")
        with PlainReader1(tmp_path / "a.bag") as reader:
            assert [getattr(c.ext, "latching", 0) for c in reader.connections] == [1, 1, 1]
        recover(made["mcap zstd"], tmp_path / "a.mcap")
        with (tmp_path / "a.mcap").open("rb") as stream:
            reader_2 = make_reader(stream, validate_crcs=True)
            found = [
                (m.sequence, m.publish_time - m.log_time) for _, _, m in reader_2.iter_messages()
            ]
            assert found == [(i, -5) for i in range(660)]
            assert [m.metadata for m in reader_2.iter_metadata()] == [{"name": "percept"}]
            summary = reader_2.get_summary()
            assert summary is not None
            stated = [c.metadata["offered_qos_profiles"] for c in summary.channels.values()]
            assert stated == [quality] * 3
            assert {c.compression for c in summary.chunk_indexes} == {"zstd"}

    def test_a_folder_gets_new_metadata(self, made: dict[str, Path], tmp_path: Path) -> None:
        folder = tmp_path / "log"
        folder.mkdir()
        content = made["db3"].read_bytes()
        _damage(folder / "log.db3", content[: int(len(content) * 0.6)])
        (folder / "metadata.yaml").write_text((made["db3"].parent / "metadata.yaml").read_text())
        report = recover(folder, tmp_path / "out")
        with PlainReader2(tmp_path / "out") as reader:
            assert reader.message_count == sum(report.kept.values()) == len(list(reader.messages()))

    def test_nothing_is_written_over(self, made: dict[str, Path], tmp_path: Path) -> None:
        out = tmp_path / "a.mcap"
        out.write_text("precious")
        with pytest.raises(UsageError, match=r"the output exists.*--force"):
            recover(made["mcap"], out)
        assert out.read_text() == "precious"
        recover(made["mcap"], out, overwrite=True)
        assert len(_read(out)[0]) == 660
        with pytest.raises(UsageError, match="the output is the input"):
            recover(out, out, overwrite=True)
        with pytest.raises(UsageError, match="the output lies in the input"):
            recover(made["db3"].parent, made["db3"].parent / "sub")

    @pytest.mark.parametrize(
        ("kind", "name", "remedy"),
        [
            ("bag", "a.mcap", "Name it a.bag"),
            ("mcap", "a.db3", "Name it a.mcap"),
            ("db3", "folder", "Name it folder.db3"),
        ],
    )
    def test_the_name_must_say_the_format(
        self, made: dict[str, Path], tmp_path: Path, kind: str, name: str, remedy: str
    ) -> None:
        with pytest.raises(UsageError, match=remedy):
            recover(made[kind], tmp_path / name)
        assert not list(tmp_path.iterdir())

    def test_a_folder_becomes_no_file(self, made: dict[str, Path], tmp_path: Path) -> None:
        with pytest.raises(UsageError, match=r"the copy of a folder is a folder.*Name it a,"):
            recover(made["db3"].parent, tmp_path / "a.mcap")
        assert not list(tmp_path.iterdir())

    def test_a_failure_leaves_nothing_behind(self, tmp_path: Path) -> None:
        path = tmp_path / "text.mcap"
        path.write_text("not a log")
        with pytest.raises(RecordingError, match="not a log"):
            recover(path, tmp_path / "out.mcap")
        assert [file.name for file in tmp_path.iterdir()] == ["text.mcap"]


def _plain(path: Path) -> list[_Stored]:
    reader: Any = PlainReader1(path) if path.suffix == ".bag" else PlainReader2(path)
    with reader:
        return sorted((c.topic, time_ns, bytes(data)) for c, time_ns, data in reader.messages())


def _definitions(path: Path) -> dict[str, tuple[str, str]]:
    with open_recording(path) as recording:
        assert isinstance(recording, BagRecording)
        return {c.topic: (c.msgtype, _hash(c.definition)) for c in recording.connections}


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest() if text else ""


def test_what_cannot_be_decoded_is_counted_once_however_often_it_is_read(
    tmp_path: Path,
) -> None:
    connection = Connection("/cloud", "sensor_msgs/msg/PointCloud2", "cdr", "", "")
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition, _ = store.generate_msgdef(connection.msgtype, ros_version=2)
    connection = replace(connection, definition=definition, definition_format="msg")
    path = tmp_path / "broken.mcap"
    with LogWriter(path, "mcap") as writer:
        for stamp in range(1, 6):
            writer.write_raw(RawMessage(connection, stamp, b"\0\1\0\0 not a cloud"))
    with open_recording(path) as recording:
        for _ in range(3):
            assert list(recording.samples()) == []
            assert recording.losses.total() == 5
        assert list(recording.samples(end_ns=2)) == []
        assert recording.losses.total() == 5
