"""ROS 1 bags: plain, bz2 and lz4 chunks; with an index, without one (`.bag.active`), cut, damaged.

A bag with a sound index is streamed by it. Any other is read through once, chunk by chunk,
to find what it holds, and then streamed in the same way.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

from percept.core.errors import RecordingError
from percept.datasets.formats.chunks import (
    DAMAGED_MAGIC,
    MISSING_BYTES,
    REBUILT,
    Chunk,
    ChunkedSource,
    ChunkError,
    ChunkIndex,
    Entry,
)
from percept.datasets.formats.compression import CompressionError, decompress, decompress_prefix
from percept.datasets.formats.rosbag1_records import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    MAGIC,
    BagConnection,
    Head,
    connections_in,
    find_chunk,
    message_entries,
    read_head,
    time_ns,
)

__all__ = ["BagLayout", "has_bag_chunks", "open_rosbag1"]

# The LZ4 frame format: 4 bytes of magic, then flags, of them those of block and content checksums.
_LZ4_FLAGS_AT, _LZ4_CHECKSUMS = 4, 0x14
_OPS = frozenset({BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION})


@dataclass(slots=True)
class BagLayout:
    """The `ChunkFormat` of ROS 1 bags.

    Attributes:
        name: `rosbag1`.
        details: What only bags say of a connection, by id.
        compression: Compression of the first chunk.
        stated: Messages of each chunk by connection, as the index states, by chunk offset.
    """

    name: str = "rosbag1"
    details: dict[int, BagConnection] = field(default_factory=dict)
    compression: str = "none"
    stated: dict[int, dict[int, int]] = field(default_factory=dict)

    entries = staticmethod(message_entries)

    def load(self, file: BinaryIO, chunk: Chunk) -> bytes:
        """Return the content of a chunk; see `ChunkFormat.load`."""
        head = read_head(file, chunk.offset)
        if head is None or head.op != CHUNK:
            raise ChunkError("whose record is damaged")
        file.seek(head.data_start)
        last = chunk.offset + chunk.size
        end = last if chunk.cut else min(head.end, last)
        data = file.read(end - head.data_start)
        compression, size = _stated_content(head)
        try:
            if chunk.cut:
                return decompress_prefix(compression, data)
            return decompress(compression, data, size)
        except CompressionError as error:
            raise ChunkError(str(error)) from error

    def indexed_counts(self, file: BinaryIO, chunk: Chunk) -> Mapping[int, int]:  # noqa: ARG002 (protocol)
        """Return what the index states for a chunk; see `ChunkFormat.indexed_counts`."""
        return self.stated.get(chunk.offset, {})

    def has_checksum(self, file: BinaryIO, chunk: Chunk) -> bool:
        """Return whether a chunk is protected: bz2 always is, lz4 where a flag says so."""
        head = read_head(file, chunk.offset)
        if head is None:
            raise ChunkError("whose record is damaged")
        file.seek(head.data_start + _LZ4_FLAGS_AT)
        flags = int.from_bytes(file.read(1), "little")
        compression = head.fields.get(b"compression")
        return compression == b"bz2" or (compression == b"lz4" and bool(flags & _LZ4_CHECKSUMS))


def _stated_content(head: Head) -> tuple[str, int]:
    """Return compression and decompressed size of a chunk."""
    try:
        size = struct.unpack("<I", head.fields[b"size"])[0]
        return head.fields[b"compression"].decode("ascii"), size
    except (KeyError, ValueError, struct.error) as error:
        raise ChunkError("whose record is damaged") from error


def open_rosbag1(path: Path) -> ChunkedSource:
    """Open a ROS 1 bag.

    Raises:
        RecordingError: If it is an encrypted bag or one of another version.
    """
    layout = BagLayout()
    size = path.stat().st_size
    with path.open("rb") as file:
        sound_magic = _check_magic(path, file, size)
        head = _bag_header(path, file)
        index = _read_index(file, size, head, layout) if head else None
        if index is None:
            index = _Scan(file, size, layout).run()
            _state_lost_chunks(head, index, size)
        if not sound_magic:
            index.losses[DAMAGED_MAGIC] += 1
    return ChunkedSource(path, layout, index)


def has_bag_chunks(file: BinaryIO, size: int) -> bool:
    """Return whether there is a chunk of a ROS 1 bag in a file, whatever it begins with."""
    return find_chunk(file, 0, size) is not None


def _check_magic(path: Path, file: BinaryIO, size: int) -> bool:
    """Return whether the file begins as it should; it may not if it holds chunks."""
    if file.read(len(MAGIC)) == MAGIC:
        return True
    if not has_bag_chunks(file, size):
        raise RecordingError(
            "a ROS bag of another version than 2.0",
            where=path,
            remedy="Convert it with `rosbag fix` or record it anew",
        )
    return False


def _bag_header(path: Path, file: BinaryIO) -> Head | None:
    head = read_head(file, len(MAGIC))
    if head is None or head.op != BAG_HEADER:
        return None
    if head.fields.get(b"encryptor"):
        raise RecordingError("the bag is encrypted", where=path, remedy="Decrypt it with `rosbag`")
    return head


def _number(head: Head, name: bytes) -> int:
    return int.from_bytes(head.fields.get(name, b""), "little")


def _read_index(file: BinaryIO, size: int, head: Head, layout: BagLayout) -> ChunkIndex | None:
    """Return the index at the end of a bag, or None where it is missing or damaged."""
    position = _number(head, b"index_pos")
    if not head.end <= position <= size:
        return None
    index = ChunkIndex()
    try:
        while position < size:
            record = read_head(file, position)
            if record is None or record.end > size:
                return None
            _add_indexed(file, position, record, index, layout)
            position = record.end
    except (ChunkError, KeyError, struct.error):
        return None
    expected = (_number(head, b"conn_count"), _number(head, b"chunk_count"))
    known = index.connections.keys() >= index.counts.keys()
    if not known or (len(index.connections), len(index.chunks)) != expected:
        return None
    _note_compression(file, index, layout)
    return index


def _add_indexed(
    file: BinaryIO, position: int, record: Head, index: ChunkIndex, layout: BagLayout
) -> None:
    file.seek(position)
    data = file.read(record.end - position)
    if record.op == CONNECTION:
        _declare(connections_in(data), index, layout)
    elif record.op == CHUNK_INFO:
        pairs = struct.iter_unpack("<II", data[record.data_start - position :])
        counts = dict(pairs)
        offset = _number(record, b"chunk_pos")
        if not len(MAGIC) <= offset < position:
            raise ChunkError("whose record is damaged")
        index.chunks.append(
            Chunk(
                offset,
                # The chunk's own record says where it ends; the index does not.
                position - offset,
                time_ns(record.fields[b"start_time"]) if counts else 0,
                time_ns(record.fields[b"end_time"]) if counts else 0,
                frozenset(counts),
            )
        )
        layout.stated[offset] = counts
        index.counts.update(counts)


def _note_compression(file: BinaryIO, index: ChunkIndex, layout: BagLayout) -> None:
    """Keep the compression of the first chunk that can be read, for a sound copy."""
    for chunk in index.chunks:
        head = read_head(file, chunk.offset)
        if head is not None and b"compression" in head.fields:
            layout.compression = head.fields[b"compression"].decode(errors="replace")
            return


def _declare(found: Mapping[int, BagConnection], index: ChunkIndex, layout: BagLayout) -> None:
    layout.details.update(found)
    index.connections.update({key: detail.connection for key, detail in found.items()})


@dataclass(slots=True)
class _Broken:
    """A chunk that did not give all, while the index records behind it are read."""

    reason: str
    entries: list[Entry]
    size: int
    stated: int = 0


class _Scan:
    """Reading through a whole bag, record by record, past what is damaged."""

    def __init__(self, file: BinaryIO, size: int, layout: BagLayout) -> None:
        self.file = file
        self.size = size
        self.layout = layout
        self.index = ChunkIndex(scanned=True)
        self.index.losses[REBUILT] += 1
        self.stated = 0
        self.broken: _Broken | None = None

    def run(self) -> ChunkIndex:
        """Return all that can be read."""
        position = len(MAGIC)
        while position < self.size:
            head = read_head(self.file, position)
            if head is None or head.op not in _OPS:
                position = self._resynchronise(position, position + 1)
            elif head.op == CHUNK and head.end > self.size and self._found(head.data_start):
                position = self._resynchronise(position, head.data_start)
            elif head.op != CHUNK and head.end > self.size:
                self.index.losses["bytes of a record that the end of the file cuts"] += (
                    self.size - position
                )
                break
            elif head.op == CHUNK and self._is_unfinished(head):
                self._take_cut(head, Chunk(position, self.size - position, 0, 0, cut=True))
                break
            else:
                position = self._take(position, head)
        self._settle()
        self.index.drop_unknown()
        self.index.count_missing(self.stated, "index states")
        _note_compression(self.file, self.index, self.layout)
        return self.index

    def _is_unfinished(self, head: Head) -> bool:
        """Return whether a recorder was killed in this chunk: it writes the size afterwards."""
        if head.data_size or head.end == self.size:
            return False
        following = read_head(self.file, head.end)
        return following is None or following.op not in (INDEX, CHUNK, CHUNK_INFO)

    def _found(self, after: int) -> bool:
        return find_chunk(self.file, after, self.size) is not None

    def _resynchronise(self, position: int, after: int) -> int:
        self._settle()
        following = find_chunk(self.file, after, self.size)
        end = self.size if following is None else following
        self.index.losses["bytes between damaged records"] += end - position
        return end

    def _take(self, position: int, head: Head) -> int:
        """Take one record; return where the next one begins."""
        if head.op == CHUNK:
            return self._take_chunk(position, head)
        if head.op == INDEX and self.broken is not None:
            self.broken.stated += _number(head, b"count")
        elif head.op == CHUNK_INFO:
            self.file.seek(head.data_start)
            counts = self.file.read(head.data_size // 8 * 8)
            self.stated += sum(count for _, count in struct.iter_unpack("<II", counts))
        elif head.op == CONNECTION:
            self.file.seek(position)
            found = connections_in(self.file.read(head.end - position))
            _declare(found, self.index, self.layout)
        return head.end

    def _take_chunk(self, position: int, head: Head) -> int:
        self._settle()
        chunk = Chunk(position, min(head.end, self.size) - position, 0, 0, cut=head.end > self.size)
        if chunk.cut:
            self._take_cut(head, chunk)
            return head.end
        data, entries, reason = self._read(chunk)
        end = head.end
        if reason:
            # Where a part of the file is missing, the stated size reaches into the next chunks.
            end = min(find_chunk(self.file, head.data_start, self.size) or end, end)
        if end < head.end:
            chunk = replace(chunk, size=end - position)
            data, entries, _ = self._read(chunk)
        self._keep(chunk, data, entries)
        if reason:
            self.broken = _Broken(reason, entries, len(data) or end - head.data_start)
        return end

    def _read(self, chunk: Chunk) -> tuple[bytes, list[Entry], str]:
        """Return a chunk's content and messages, and what is wrong with it."""
        try:
            data = self.layout.load(self.file, chunk)
        except ChunkError as error:
            return b"", [], str(error)
        entries, whole = self.layout.entries(data)
        return data, entries, "" if whole else "with broken records"

    def _take_cut(self, head: Head, chunk: Chunk) -> None:
        self._settle()
        data, entries, _ = self._read(chunk)
        self._keep(chunk, data, entries)
        self.index.count_cut(len(data) or chunk.size, entries, head.end - self.size)

    def _keep(self, chunk: Chunk, data: bytes, entries: list[Entry]) -> None:
        _declare(connections_in(data), self.index, self.layout)
        self.index.add(chunk, entries)

    def _settle(self) -> None:
        """Count what a broken chunk has lost, when all index records behind it are read."""
        if self.broken is not None:
            broken, self.broken = self.broken, None
            self.index.count_lost(broken.stated, broken.entries, broken.reason, broken.size)


def _state_lost_chunks(head: Head | None, index: ChunkIndex, size: int) -> None:
    """Count what the bag header, written when the bag was whole, says of the missing end."""
    if head is None:
        return
    missing = _number(head, b"index_pos") - size
    if missing > 0:
        # It knows of all bytes, where a cut chunk knows of its own.
        index.losses.pop(MISSING_BYTES, None)
        index.losses["bytes missing, of those that the bag header states, at least"] += missing
    lost = _number(head, b"chunk_count") - len(index.chunks)
    if lost > 0:
        index.losses["chunks missing, of those that the bag header states"] += lost
