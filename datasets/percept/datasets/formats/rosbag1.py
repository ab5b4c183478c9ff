"""ROS 1 bags: plain, bz2 and lz4 chunks; with an index, without one (`.bag.active`), cut, damaged.

A bag with a sound index is streamed by it. Any other is read through once, chunk by chunk,
to find what it holds, and then streamed in the same way.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from percept.core.errors import RecordingError
from percept.datasets.formats.chunks import Chunk, ChunkedSource, ChunkError, ChunkIndex
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

__all__ = ["BagLayout", "open_rosbag1"]

_OPS = frozenset({BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION})
_REBUILT = "index missing or damaged; rebuilt by reading the whole file"


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
        head = _bag_header(path, file)
        index = _read_index(file, size, head, layout) if head else None
        if index is None:
            index = _Scan(file, size, layout).run()
            _state_lost_chunks(head, index, size)
    return ChunkedSource(path, layout, index)


def _bag_header(path: Path, file: BinaryIO) -> Head | None:
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingError(
            "a ROS bag of another version than 2.0",
            where=path,
            remedy="Convert it with `rosbag fix` or record it anew",
        )
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


class _Scan:
    """Reading through a whole bag, record by record, past what is damaged."""

    def __init__(self, file: BinaryIO, size: int, layout: BagLayout) -> None:
        self.file = file
        self.size = size
        self.layout = layout
        self.index = ChunkIndex(scanned=True)
        self.index.losses[_REBUILT] += 1
        self.bad_chunk = False

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
                self._take_chunk(Chunk(position, self.size - position, 0, 0, cut=True))
                break
            else:
                self._take(position, head)
                position = head.end
        self.index.drop_unknown()
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
        following = find_chunk(self.file, after, self.size)
        end = self.size if following is None else following
        self.index.losses["bytes between damaged records"] += end - position
        return end

    def _take(self, position: int, head: Head) -> None:
        if head.op == CHUNK:
            cut = head.end > self.size
            self._take_chunk(Chunk(position, min(head.end, self.size) - position, 0, 0, cut=cut))
        elif head.op == INDEX and self.bad_chunk:
            self.index.losses["messages in damaged chunks"] += _number(head, b"count")
        elif head.op == CONNECTION:
            self.file.seek(position)
            found = connections_in(self.file.read(head.end - position))
            _declare(found, self.index, self.layout)

    def _take_chunk(self, chunk: Chunk) -> None:
        losses = self.index.losses
        self.bad_chunk = False
        try:
            data = self.layout.load(self.file, chunk)
        except ChunkError as error:
            losses[f"chunks {error}"] += 1
            self.bad_chunk = True
            return
        entries, whole = self.layout.entries(data)
        if chunk.cut:
            losses["chunks that the end of the file cuts"] += 1
        elif not whole:
            losses["chunks with broken records"] += 1
            losses["messages in damaged chunks"] -= len(entries)
            self.bad_chunk = True
        _declare(connections_in(data), self.index, self.layout)
        self.index.add(chunk, entries)


def _state_lost_chunks(head: Head | None, index: ChunkIndex, size: int) -> None:
    """Count what the bag header, written when the bag was whole, says of the missing end."""
    if head is None:
        return
    missing = _number(head, b"index_pos") - size
    if missing > 0:
        index.losses["bytes after the end of the file, at least"] += missing
    lost = _number(head, b"chunk_count") - len(index.chunks)
    if lost > 0:
        index.losses["chunks missing, of those that the bag header states"] += lost
