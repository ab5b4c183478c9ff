"""What is no log is refused in one line; what has only lost its first bytes is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from percept.core.errors import RecordingError
from percept.datasets import open_recording
from percept.datasets.recover import recover

_MAGIC = "files whose first bytes, the file magic, are damaged"
_Maker = Callable[[Path], None]


class TestBadInput:
    @pytest.mark.parametrize(
        ("name", "make", "message"),
        [
            ("foo.mcap", lambda p: p.write_text("only a text, not a log"), "not a log.*Give"),
            ("foo.db3", lambda p: p.write_text("only a text, not a log"), "not a log.*Give"),
            ("foo.bag", lambda p: p.write_text("only a text, not a log"), "not a log.*Give"),
            ("foo.bag", lambda p: p.write_bytes(b"#ROSBAG V1.2\n"), "another version.*rosbag fix"),
            ("foo.db3", lambda p: p.touch(), "the file is empty"),
            ("foo.bag", lambda p: p.unlink(missing_ok=True), "no such file.*Check the path"),
            ("folder", lambda p: p.mkdir(), "folder"),
            ("cut.db3", lambda p: p.write_bytes(b"SQLite format 3\0\x10"), "topics is lost"),
            ("foo.mcap.zstd", lambda p: p.write_bytes(b"\x28\xb5\x2f\xfd"), "after decompression"),
        ],
    )
    def test_is_named_with_a_remedy(
        self, tmp_path: Path, name: str, make: _Maker, message: str
    ) -> None:
        path = tmp_path / name
        make(path)
        with pytest.raises(RecordingError, match=message) as caught:
            open_recording(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_a_database_of_something_else(self, tmp_path: Path) -> None:
        database = sqlite3.connect(tmp_path / "other.db3")
        database.execute("CREATE TABLE recipes (id INTEGER)")
        database.commit()
        database.close()
        with pytest.raises(RecordingError, match="without the tables of a rosbag2 log"):
            open_recording(tmp_path / "other.db3")

    def test_no_log_at_all(self) -> None:
        with pytest.raises(RecordingError, match="no log was given"):
            open_recording([])

    def test_a_bad_file_of_a_folder_is_counted(self, made: dict[str, Path], tmp_path: Path) -> None:
        (tmp_path / "a.mcap").write_bytes(made["mcap"].read_bytes())
        (tmp_path / "b.mcap").touch()
        with open_recording(tmp_path) as recording:
            assert len(list(recording.samples())) == 660
            assert dict(recording.losses) == {
                "files that cannot be used (b.mcap: the file is empty)": 1
            }


class TestDamagedMagic:
    @pytest.mark.parametrize("kind", ["bag", "bag bz2", "mcap", "mcap zstd", "db3"])
    @pytest.mark.parametrize("zeros", [slice(3, 4), slice(0, 16)])
    def test_costs_no_message(
        self, made: dict[str, Path], tmp_path: Path, kind: str, zeros: slice
    ) -> None:
        content = bytearray(made[kind].read_bytes())
        content[zeros] = bytes(zeros.stop - zeros.start)
        path = tmp_path / made[kind].name
        path.write_bytes(content)
        with open_recording(path) as recording:
            assert len(list(recording.samples())) == 660
            assert recording.losses[_MAGIC] == 1
            assert not any(reason.startswith("messages") for reason in recording.losses)
        out = tmp_path / "out" / path.name
        assert sum(recover(path, out).kept.values()) == 660
        with AnyReader([out]) as reader:
            assert reader.message_count == 660

    def test_counts_only_where_the_name_says_what_it_is(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        path = tmp_path / "log.dat"
        path.write_bytes(bytes(16) + made["mcap"].read_bytes()[16:])
        with pytest.raises(RecordingError, match="not a log"):
            open_recording(path)

    def test_a_damaged_record_before_messages_without_chunks_is_not_overlooked(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        path = tmp_path / "bare.mcap"
        path.write_bytes(bytes(16) + made["mcap bare"].read_bytes()[16:])
        with open_recording(path) as recording:
            found = len(list(recording.samples()))
            lost = sum(n for r, n in recording.losses.items() if r.startswith("messages"))
        assert found + lost == 660
