"""What a damaged log has lost is said in numbers that add up, and never claimed of a sound one."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections import Counter
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from percept.core.errors import RecordingError
from percept.core.results import Verdict
from percept.datasets import open_recording
from percept.datasets.bag_recording import BagRecording
from percept.datasets.inspection import inspect_recording
from percept.datasets.messages import NO_CHECKSUMS
from percept.datasets.recover import recover

_PAGE = 4096
_COUNT = 660


def _read(path: Path) -> tuple[int, Counter[str], tuple[str, ...]]:
    with open_recording(path) as recording:
        assert isinstance(recording, BagRecording)
        found = sum(1 for _ in recording.messages())
        assert found == sum(info.count for info in recording.topics())
        return found, recording.losses, recording.notes


def _damage(path: Path, content: bytes | bytearray) -> Path:
    path.write_bytes(content)
    return path


def _lost_messages(losses: Counter[str]) -> int:
    return sum(count for reason, count in losses.items() if reason.startswith("messages"))


class TestHole:
    """A part cut out of the middle: the total at the end of the file outlives it."""

    @pytest.mark.parametrize("kind", ["bag", "bag lz4", "bag bz2", "mcap", "mcap zstd", "mcap lz4"])
    @pytest.mark.parametrize("start", [0.2, 0.43, 0.6])
    def test_all_messages_are_found_or_counted(
        self, made: dict[str, Path], tmp_path: Path, kind: str, start: float
    ) -> None:
        content = made[kind].read_bytes()
        first = int(start * len(content))
        path = _damage(tmp_path / made[kind].name, content[:first] + content[first + 30_011 :])
        found, losses, _ = _read(path)
        assert min(losses.values()) > 0
        assert found + _lost_messages(losses) == _COUNT
        assert found > 0.6 * _COUNT

    def test_of_a_database_the_highest_number_is_a_bound(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = made["db3"].read_bytes()
        path = _damage(tmp_path / "a.db3", content[:100_000] + content[133_333:])
        found, losses, _ = _read(path)
        assert 0.95 * _COUNT < found + _lost_messages(losses) <= _COUNT
        assert losses["bytes missing, of those that the file header states"] == 33_333


@pytest.mark.parametrize("kind", ["bag", "mcap", "mcap zstd"])
@pytest.mark.parametrize("fill", [b"\0", b"\xa5"])
def test_damage_in_the_middle_of_an_indexed_log_adds_up(
    made: dict[str, Path], tmp_path: Path, kind: str, fill: bytes
) -> None:
    content = bytearray(made[kind].read_bytes())
    first = int(0.43 * len(content))
    content[first : first + 50_000] = fill * 50_000
    found, losses, _ = _read(_damage(tmp_path / made[kind].name, content))
    assert 0.7 * _COUNT < found < _COUNT
    assert found + _lost_messages(losses) == _COUNT


class TestCut:
    def test_says_how_many_bytes_of_a_chunk_are_missing(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = made["mcap zstd"].read_bytes()
        place = content.index(b"\4\0\0\0zstd", len(content) // 2)
        (size,) = struct.unpack_from("<Q", content, place + 8)
        path = _damage(tmp_path / "a.mcap", content[: place + 16 + 1_000])
        losses = _read(path)[1]
        assert losses["bytes missing at the end of the file, at least"] == size - 1_000
        assert losses["chunks that the end of the file cuts"] == 1

    def test_of_a_bag_says_what_its_header_knows(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = made["bag"].read_bytes()
        place = content.index(b"index_pos=") + 10
        (index,) = struct.unpack_from("<Q", content, place)
        losses = _read(_damage(tmp_path / "a.bag", content[:200_000]))[1]
        stated = "bytes missing, of those that the bag header states, at least"
        assert losses[stated] == index - 200_000
        assert losses["chunks missing, of those that the bag header states"] > 0
        assert losses["bytes behind the last whole message of a cut chunk"] > 0

    def test_of_a_database_counts_the_messages_of_lost_pages(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = made["db3"].read_bytes()
        kept = int(len(content) * 0.6) // _PAGE * _PAGE
        found, losses, _ = _read(_damage(tmp_path / "a.db3", content[:kept]))
        missing = len(content) - kept
        assert losses["bytes missing, of those that the file header states"] == missing
        assert 0.97 * _COUNT < found + _lost_messages(losses) <= _COUNT

    def test_metadata_knows_the_messages_and_the_time(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        source = made["db3"]
        (tmp_path / "metadata.yaml").write_text((source.parent / "metadata.yaml").read_text())
        path = tmp_path / source.name
        _damage(path, source.read_bytes()[: int(source.stat().st_size * 0.6)])
        found, losses, _ = _read(tmp_path)
        assert found + _lost_messages(losses) == _COUNT
        lost_ms = losses["milliseconds missing at the end, of the time that metadata.yaml states"]
        assert lost_ms == _COUNT - found - losses["messages whose payload is lost"]


class TestDatabasePages:
    def test_of_a_page_that_is_cut_the_whole_cells_are_read(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = made["db3"].read_bytes()
        whole_page_less = _read(_damage(tmp_path / "b.db3", content[:-_PAGE]))[0]
        found, losses, _ = _read(_damage(tmp_path / "a.db3", content[:-1]))
        # Cells grow from the end of a page: its first row, or a lost overflow page, is cut.
        assert found == _COUNT - 1 > whole_page_less - 1
        assert losses["bytes missing, of those that the file header states"] == 1
        assert _lost_messages(losses) == 1

    def test_the_index_knows_the_rows_of_a_lost_last_page(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = bytearray(made["db3"].read_bytes())
        database = sqlite3.connect(made["db3"])
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        (root,) = database.execute(query).fetchone()
        database.close()
        at = (root - 1) * _PAGE
        (last,) = struct.unpack_from(">I", content, at + 8)
        content[(last - 1) * _PAGE : last * _PAGE] = b"\xa5" * _PAGE
        found, losses, _ = _read(_damage(tmp_path / "a.db3", content))
        assert found < _COUNT
        assert found + _lost_messages(losses) == _COUNT

    def test_a_page_count_that_is_a_lie_loses_nothing(
        self, made: dict[str, Path], tmp_path: Path
    ) -> None:
        content = bytearray(made["db3"].read_bytes())
        content[28:32] = b"\xff" * 4
        found, losses, _ = _read(_damage(tmp_path / "a.db3", content))
        assert found == _COUNT
        assert losses == {"files whose header states a wrong number of pages": 1}


@pytest.mark.parametrize(
    ("kind", "notes"),
    [
        *(("bag", (NO_CHECKSUMS,)), ("bag bz2", ()), ("mcap", ()), ("mcap zstd", ())),
        *(("mcap bare", (NO_CHECKSUMS,)), ("db3", (NO_CHECKSUMS,))),
    ],
)
def test_payloads_without_a_checksum_are_noted(
    made: dict[str, Path], kind: str, notes: tuple[str, ...]
) -> None:
    assert _read(made[kind]) == (_COUNT, Counter(), notes)


def test_the_note_is_no_reason_to_doubt(made: dict[str, Path]) -> None:
    with open_recording(made["bag"]) as recording:
        inspection = inspect_recording(recording)
    assert NO_CHECKSUMS in inspection.notes
    assert inspection.verdict is Verdict.GOOD


class TestBomb:
    def _mcap(self, path: Path, plain: int, stated: int) -> Path:
        """Return a log with one good chunk, and one that says and holds a lot of zeros."""
        with path.open("wb") as stream:
            writer = McapWriter(stream, compression=CompressionType.ZSTD)
            writer.start()
            channel = writer.register_channel("/a", "json", 0)
            writer.add_message(channel, 1, b"{}", 1)
            writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this
        packer, block = zstandard.ZstdCompressor().compressobj(), bytes(1 << 20)
        packed = b"".join(packer.compress(block) for _ in range(plain >> 20)) + packer.flush()
        crc = zlib.crc32(b"")
        head = struct.pack("<QQQII", 1, 1, stated, crc, 4) + b"zstd"
        record = head + struct.pack("<Q", len(packed)) + packed
        content = path.read_bytes()
        end = content.index(b"\x0f" + struct.pack("<Q", 4))
        bomb = b"\x06" + struct.pack("<Q", len(record)) + record
        path.write_bytes(content[:end] + bomb + content[end:])
        return path

    @pytest.mark.parametrize("stated", [1 << 20, 3 << 29, 1 << 62])
    def test_is_a_damaged_chunk(self, tmp_path: Path, stated: int) -> None:
        found, losses, _ = _read(self._mcap(tmp_path / "a.mcap", 200 << 20, stated))
        assert found == 1
        why = "do not decompress" if stated == 1 << 20 else "would decompress to more than any"
        assert [n for r, n in losses.items() if f"number of messages) that {why}" in r] == [1]


def test_a_schema_that_does_more_than_make_tables_is_refused(
    made: dict[str, Path], tmp_path: Path
) -> None:
    path = tmp_path / "hostile.db3"
    path.write_bytes(made["db3"].read_bytes())
    database = sqlite3.connect(path)
    database.execute('CREATE TABLE "a""b" (x)')
    database.execute('INSERT INTO "a""b" VALUES (\'kept\')')
    database.commit()
    assert sum(recover(path, tmp_path / "sound.db3").kept.values()) == _COUNT
    endless = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT n FROM r"
    database.execute("CREATE TABLE c (n)")
    database.execute("PRAGMA writable_schema = ON")
    hostile = f"CREATE TABLE c AS {endless}"
    database.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'c'", (hostile,))
    database.commit()
    database.close()
    with pytest.raises(RecordingError):
        recover(path, tmp_path / "hung.db3")
    assert not (tmp_path / "hung.db3").exists()
