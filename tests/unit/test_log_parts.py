"""The parts that log readers are made of: merging, decompression, pages, records."""

from __future__ import annotations

import bz2
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard

from percept.datasets.formats.chunks import ChunkError, Entry, merge_in_time, raw_message
from percept.datasets.formats.compressed_file import unpack
from percept.datasets.formats.compression import (
    CompressionError,
    decompress,
    decompress_prefix,
    largest_plain,
)
from percept.datasets.formats.mcap_records import message_entries as mcap_entries
from percept.datasets.formats.rosbag1_records import connections_in, parse_fields
from percept.datasets.formats.rosbag1_records import message_entries as bag_entries
from percept.datasets.formats.sqlite_pages import SqlitePages
from percept.datasets.messages import Connection
from percept.datasets.open import log_files


class TestMergeInTime:
    def test_equals_a_sort(self) -> None:
        rng = np.random.default_rng(1)
        for _ in range(50):
            streams = [sorted(rng.integers(0, 30, rng.integers(0, 9)).tolist()) for _ in range(6)]
            parts = [(min(s, default=0), partial(iter, s)) for s in streams]
            assert list(merge_in_time(parts, lambda t: t)) == sorted(t for s in streams for t in s)

    def test_equal_times_come_in_the_order_of_the_parts(self) -> None:
        parts = [(5, partial(iter, [(5, "a"), (6, "b")])), (5, partial(iter, [(5, "c"), (6, "d")]))]
        assert [name for _, name in merge_in_time(parts, lambda i: i[0])] == ["a", "c", "b", "d"]

    def test_opens_a_stream_only_when_its_time_comes(self) -> None:
        opened: list[int] = []

        def stream(start: int) -> Iterator[int]:
            opened.append(start)
            yield from range(start, start + 10)

        merged = merge_in_time([(s, partial(stream, s)) for s in (0, 10, 20)], lambda t: t)
        assert [next(merged) for _ in range(10)] == list(range(10))
        assert opened == [0]
        next(merged)
        assert opened == [0, 10]


_PLAIN = np.random.default_rng(2).integers(0, 4, 400_000, dtype=np.uint8).tobytes()
_PACKED = {
    "zstd": zstandard.ZstdCompressor().compress(_PLAIN),
    "lz4": lz4.frame.compress(_PLAIN),
    "bz2": bz2.compress(_PLAIN, 1),
    "": _PLAIN,
}


@pytest.mark.parametrize("name", _PACKED)
class TestDecompress:
    def test_gives_the_whole(self, name: str) -> None:
        assert decompress(name, _PACKED[name], len(_PLAIN)) == _PLAIN
        assert decompress(name, _PACKED[name]) == _PLAIN

    def test_refuses_what_is_cut(self, name: str) -> None:
        if name:
            with pytest.raises(CompressionError, match="do not decompress"):
                decompress(name, _PACKED[name][:-5], len(_PLAIN))

    def test_refuses_another_size(self, name: str) -> None:
        if name:
            with pytest.raises(CompressionError, match="do not decompress"):
                decompress(name, _PACKED[name], len(_PLAIN) + 1)

    def test_gives_what_precedes_a_break(self, name: str) -> None:
        packed = _PACKED[name]
        prefix = decompress_prefix(name, packed[: len(packed) * 8 // 10])
        assert _PLAIN.startswith(prefix)
        assert len(prefix) > 0.3 * len(_PLAIN)
        assert decompress_prefix(name, packed) == _PLAIN


@pytest.mark.parametrize(
    "packed",
    [
        zstandard.ZstdCompressor().compress(bytes(80 << 20)),
        zstandard.ZstdCompressor(write_content_size=False).compress(bytes(80 << 20)),
        bz2.compress(bytes(80 << 20), 9),
    ],
    ids=["zstd", "zstd without size", "bz2"],
)
def test_a_bomb_is_not_unpacked(packed: bytes) -> None:
    name = "bz2" if packed.startswith(b"BZ") else "zstd"
    for size in (None, 80 << 20):
        with pytest.raises(CompressionError, match="more than any recorder writes"):
            decompress(name, packed, size)
    assert len(decompress_prefix(name, packed)) < 100 << 20


def test_large_chunks_that_shrink_well_are_unpacked() -> None:
    assert largest_plain(1_000) == 64 << 20
    assert largest_plain(200_000) == 200_000_000
    assert largest_plain(1 << 30) == 512 << 20


@pytest.mark.parametrize("entries", [bag_entries, mcap_entries])
def test_a_chunk_of_zeros_is_broken(
    entries: Callable[[bytes], tuple[list[Entry], bool]],
) -> None:
    assert entries(bytes(1_000)) == ([], False)
    assert entries(b"\x80" + bytes(999)) == ([], False)
    assert connections_in(bytes(1_000)) == {}


def test_no_more_records_are_listed_than_memory_can_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    bag = b"".join(
        len(f).to_bytes(4, "little") + f for f in (b"op=\2", b"conn=\0\0\0\0", b"time=" + bytes(8))
    )
    record = len(bag).to_bytes(4, "little") + bag + bytes(4)
    assert len(bag_entries(record * 20)[0]) == 20
    monkeypatch.setattr("percept.datasets.formats.rosbag1_records.MOST_RECORDS", 10)
    monkeypatch.setattr("percept.datasets.formats.mcap_records.MOST_RECORDS", 10)
    entries, whole = bag_entries(record * 20)
    assert (len(entries), whole) == (10, False)
    entries, whole = mcap_entries((b"\5" + (22).to_bytes(8, "little") + bytes(22)) * 20)
    assert (len(entries), whole) == (10, False)


def test_an_unknown_compression_is_named() -> None:
    with pytest.raises(CompressionError, match="unknown compression 'br'"):
        decompress("br", b"")


def test_files_of_several_zstd_frames_are_unpacked(tmp_path: Path) -> None:
    packed, plain = tmp_path / "a.zst", tmp_path / "a"
    packed.write_bytes(_PACKED["zstd"] * 3)
    assert unpack(packed, plain)
    assert plain.read_bytes() == _PLAIN * 3
    packed.write_bytes((_PACKED["zstd"] * 2)[:-9])
    assert not unpack(packed, plain)
    assert plain.read_bytes().startswith(_PLAIN)


def test_a_file_made_to_fill_the_disk_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("percept.datasets.formats.compressed_file._ALWAYS_ALLOWED_BYTES", 1 << 20)
    packed, plain = tmp_path / "a.zst", tmp_path / "a"
    packed.write_bytes(zstandard.ZstdCompressor().compress(bytes(200 << 20)))
    assert not unpack(packed, plain)
    assert plain.stat().st_size < 100 << 20


def test_compressed_messages_are_known_by_their_content() -> None:
    ros1, ros2 = Connection("/a", "t", "ros1"), Connection("/a", "t", "cdr")
    packed = zstandard.ZstdCompressor().compress(b"\0\1\0\0text")
    counter: Counter[str] = Counter()
    plain = raw_message(ros2, 1, packed, counter)
    assert plain is not None
    assert plain.data == b"\0\1\0\0text"
    kept = raw_message(ros1, 1, packed, counter)
    assert kept is not None
    assert kept.data == packed
    assert not counter
    assert raw_message(ros2, 1, packed[:-3], counter) is None
    assert counter == {"compressed messages that do not decompress": 1}


class TestSqlitePages:
    @pytest.mark.parametrize("page_size", [512, 4096, 65536])
    @pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16le", "UTF-16be"])
    def test_reads_what_sqlite_has_written(
        self, tmp_path: Path, page_size: int, encoding: str
    ) -> None:
        path, rows = tmp_path / "a.db3", _rows()
        database = sqlite3.connect(path)
        database.execute(f"PRAGMA page_size = {page_size}")
        database.execute(f"PRAGMA encoding = '{encoding}'")
        database.execute("CREATE TABLE a (id INTEGER PRIMARY KEY, n INTEGER, t TEXT, b BLOB)")
        database.execute("CREATE TABLE other (id INTEGER PRIMARY KEY, b BLOB)")
        database.executemany("INSERT INTO a VALUES (?, ?, ?, ?)", rows)
        database.commit()
        database.close()
        pages = SqlitePages(path)
        found = [(rowid, *values[1:]) for rowid, values in pages.rows(pages.tables()["a"])]
        assert found == rows
        cells = [cell for cell in pages.cells(4) if cell.head[0] is None]
        assert [cell.rowid for cell in sorted(cells, key=lambda c: c.rowid)] == [r[0] for r in rows]
        by_id = {cell.rowid: pages.last_value(cell.page, cell.index) for cell in cells}
        assert by_id == {row[0]: row[3] for row in rows}
        assert all(cell.whole for cell in cells)
        pages.close()

    def test_says_which_rows_are_cut(self, tmp_path: Path) -> None:
        path = tmp_path / "a.db3"
        database = sqlite3.connect(path)
        database.execute("CREATE TABLE a (id INTEGER PRIMARY KEY, n INTEGER, t TEXT, b BLOB)")
        database.execute("INSERT INTO a VALUES (1, 2, 'x', ?)", (bytes(100_000),))
        database.commit()
        database.close()
        path.write_bytes(path.read_bytes()[:50_000])
        pages = SqlitePages(path)
        (cell,) = (cell for cell in pages.cells(4) if cell.head[0] is None)
        assert (cell.rowid, cell.head[1:], cell.whole) == (1, (2, "x"), False)
        assert pages.last_value(cell.page, cell.index) is None
        assert pages.stated_size - pages.size == 26 * 4096 - 50_000
        pages.close()


def _rows() -> list[tuple[int, int, str, bytes]]:
    """Return rows with numbers of every stored size, and payloads around every limit."""
    numbers = [0, 1, 2, -1, 127, -128, 2**15, 2**23, -(2**31), 2**40, 2**62, -(2**63)]
    return [
        (i * 3 + 1, numbers[i % len(numbers)], "ü" * (i % 5), bytes([i % 256]) * (i * 37 % 9000))
        for i in range(200)
    ]


@pytest.mark.parametrize(
    "header", [b"\5\0\0\0a=1", b"\3\0\0\0abc", b"\1\0", b"\xff\xff\xff\xffa=1"]
)
def test_broken_bag_headers_are_refused(header: bytes) -> None:
    with pytest.raises(ChunkError):
        parse_fields(header)


def test_a_file_beside_its_compressed_self_counts_once(tmp_path: Path) -> None:
    for name in (
        "a.db3",
        "a.db3.zstd",
        "b.mcap.zstd",
        "c.bag.active",
        "notes.txt",
        "metadata.yaml",
    ):
        (tmp_path / name).touch()
    names = [file.name for file in log_files(tmp_path)]
    assert names == ["a.db3", "b.mcap.zstd", "c.bag.active"]
