"""mcap files of every profile: indexed, without an index, cut, damaged.

A file with a sound summary is streamed by its chunk index. Any other is read through once to
find what it holds, and then streamed in the same way. Messages outside of chunks are grouped
into runs that stand for chunks.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex as SummaryChunk
from mcap.records import Statistics
from mcap.stream_reader import StreamReader

from percept.datasets.formats.chunks import Chunk, ChunkedSource, ChunkError, ChunkIndex
from percept.datasets.formats.compression import CompressionError, decompress, decompress_prefix
from percept.datasets.formats.mcap_records import (
    HEAD_BYTES,
    MAGIC,
    Definitions,
    find_chunk,
    message_entries,
    read_chunk_head,
    read_head,
)

__all__ = ["McapLayout", "open_mcap"]

_REBUILT = "index missing or damaged; rebuilt by reading the whole file"
_RUN_BYTES = 1 << 22
_FOOTER = struct.Struct("<QQI")
_TAIL_BYTES = HEAD_BYTES + _FOOTER.size + len(MAGIC)
_BROKEN = (McapError, struct.error, ValueError, OverflowError, KeyError, EOFError)


@dataclass(slots=True)
class McapLayout:
    """The `ChunkFormat` of mcap files.

    Attributes:
        name: `mcap`.
        definitions: Schemas and channels by their ids.
    """

    name: str = "mcap"
    definitions: Definitions = field(default_factory=Definitions)

    entries = staticmethod(message_entries)

    def load(self, file: BinaryIO, chunk: Chunk) -> bytes:
        """Return the content of a chunk, its CRC checked; see `ChunkFormat.load`."""
        if chunk.bare:
            file.seek(chunk.offset)
            return file.read(chunk.size)
        head = read_chunk_head(file, chunk.offset)
        file.seek(head.data_start)
        data = file.read(min(head.data_size, chunk.size))
        try:
            if chunk.cut:
                return decompress_prefix(head.compression, data)
            data = decompress(head.compression, data, head.size)
        except CompressionError as error:
            raise ChunkError(str(error)) from error
        if head.crc and zlib.crc32(data) != head.crc:
            raise ChunkError("that fail their checksum")
        return data

    def indexed_counts(self, file: BinaryIO, chunk: Chunk) -> Mapping[int, int]:
        """Return what the message indexes after a chunk state; see `ChunkFormat`."""
        counts: dict[int, int] = {}
        position = chunk.offset + chunk.size
        while (head := read_head(file, position)) and head[0] == Opcode.MESSAGE_INDEX:
            content = file.read(6)
            if len(content) < 6:
                break
            key, size = struct.unpack("<HI", content)
            counts[key] = counts.get(key, 0) + size // 16
            position = head[1]
        return counts


def open_mcap(path: Path) -> ChunkedSource:
    """Open an mcap file; one that does not begin as mcap has been refused before."""
    layout = McapLayout()
    size = path.stat().st_size
    with path.open("rb") as file:
        index = _read_summary(file, size, layout)
        if index is None:
            index = _Scan(file, layout).run(len(MAGIC), size)
    return ChunkedSource(path, layout, index)


def _read_summary(file: BinaryIO, size: int, layout: McapLayout) -> ChunkIndex | None:
    """Return the index that the summary gives, or None where there is none to rely on."""
    section = _summary_section(file, size)
    if section is None:
        return None
    start, data = section
    chunks: list[SummaryChunk] = []
    statistics: Statistics | None = None
    definitions = Definitions()
    try:
        for record in StreamReader(BytesIO(data + MAGIC), skip_magic=True).records:
            if isinstance(record, SummaryChunk):
                chunks.append(record)
            elif isinstance(record, Statistics):
                statistics = record
        definitions.read(data)
    except _BROKEN:
        return None
    index = ChunkIndex(connections=definitions.connections())
    for record in sorted(chunks, key=lambda c: c.chunk_start_offset):
        end = record.chunk_start_offset + record.chunk_length
        ids = frozenset(record.message_index_offsets)
        if end > start or not ids <= index.connections.keys():
            return None
        index.chunks.append(_indexed_chunk(record, ids))
    layout.definitions = definitions
    return _with_counts(file, index, chunks, start, statistics)


def _statistics(section: bytes) -> Statistics | None:
    try:
        records = StreamReader(BytesIO(section + MAGIC), skip_magic=True).records
        return next((record for record in records if isinstance(record, Statistics)), None)
    except _BROKEN:
        return None


def _indexed_chunk(record: SummaryChunk, ids: frozenset[int]) -> Chunk:
    return Chunk(
        record.chunk_start_offset,
        record.chunk_length,
        record.message_start_time,
        record.message_end_time,
        ids or None,
    )


def _with_counts(
    file: BinaryIO,
    index: ChunkIndex,
    chunks: list[SummaryChunk],
    summary_start: int,
    statistics: Statistics | None,
) -> ChunkIndex | None:
    """Complete an index, or return None where only reading the whole file can."""
    # Chunks without message indexes, and what lies outside of chunks, show only when read.
    if any(chunk.ids is None for chunk in index.chunks) or statistics is None:
        return None
    counts = Counter(statistics.channel_message_counts)
    spans = [(c.start_ns, c.end_ns) for c in index.chunks]
    first, last = statistics.message_start_time, statistics.message_end_time
    consistent = (
        counts.total() == statistics.message_count
        and counts.keys() <= index.connections.keys()
        and statistics.chunk_count == len(chunks)
        and all(first <= start <= end <= last for start, end in spans)
    )
    if not consistent or _has_bare_messages(file, chunks, summary_start):
        return None
    index.counts = counts
    return index


def _has_bare_messages(file: BinaryIO, chunks: list[SummaryChunk], summary_start: int) -> bool:
    """Return whether there are messages between chunks, which no index lists."""
    ends = [c.chunk_start_offset + c.chunk_length + c.message_index_length for c in chunks]
    starts = [c.chunk_start_offset for c in chunks]
    for position, following in zip(
        [len(MAGIC), *sorted(ends)], [*sorted(starts), summary_start], strict=True
    ):
        while position < following and (head := read_head(file, position)):
            if head[0] == Opcode.MESSAGE:
                return True
            position = head[1]
    return False


def _summary_section(file: BinaryIO, size: int) -> tuple[int, bytes] | None:
    """Return start and bytes of a sound summary with its footer, or None."""
    if size < len(MAGIC) + _TAIL_BYTES:
        return None
    file.seek(size - _TAIL_BYTES)
    tail = file.read(_TAIL_BYTES)
    if tail[0] != Opcode.FOOTER or not tail.endswith(MAGIC):
        return None
    start, _, crc = _FOOTER.unpack_from(tail, HEAD_BYTES)
    footer_start = size - _TAIL_BYTES
    if not len(MAGIC) <= start <= footer_start:
        return None
    file.seek(start)
    data = file.read(size - len(MAGIC) - start)
    return (start, data) if crc in (0, zlib.crc32(data[:-4])) else None


class _Scan:
    """Reading through a whole file, record by record, past what is damaged."""

    def __init__(self, file: BinaryIO, layout: McapLayout) -> None:
        self.file = file
        self.layout = layout
        self.index = ChunkIndex(scanned=True)
        self.run_start: int | None = None

    def run(self, position: int, size: int) -> ChunkIndex:
        """Return all that can be read between two positions."""
        ended = False
        while position < size and not ended:
            head = read_head(self.file, position)
            if head is None or head[0] == 0 or head[1] > size:
                self._close_run(position)
                position = self._past_damage(position, size, head)
                continue
            opcode, end = head
            if opcode != Opcode.MESSAGE or self._run_is_full(position):
                self._close_run(position)
            ended = opcode == Opcode.DATA_END
            self._take(opcode, position, end)
            position = end
        self._close_run(min(position, size))
        if not ended or not self._has_footer(position, size):
            self.index.losses[_REBUILT] += 1
        self.index.connections = self.layout.definitions.connections()
        self.index.drop_unknown()
        self._count_missing(size)
        return self.index

    def _count_missing(self, size: int) -> None:
        """Compare what was found with the statistics, where the summary still has them."""
        section = _summary_section(self.file, size)
        statistics = _statistics(section[1]) if section else None
        if statistics is not None:
            reasons = self.index.losses.items()
            known = sum(count for reason, count in reasons if reason.startswith("messages"))
            missing = statistics.message_count - self.index.counts.total() - known
            if missing > 0:
                self.index.losses["messages missing, of those that the statistics state"] += missing

    def _has_footer(self, position: int, size: int) -> bool:
        """Return whether the file ends as it should, without a summary or with a sound one."""
        while (head := read_head(self.file, position)) and head[1] <= size:
            if head[0] == Opcode.FOOTER:
                return (
                    self.file.read(8) == bytes(8) or _summary_section(self.file, size) is not None
                )
            position = head[1]
        return False

    def _run_is_full(self, position: int) -> bool:
        return self.run_start is not None and position - self.run_start > _RUN_BYTES

    def _close_run(self, position: int) -> None:
        """End a run of messages outside of chunks."""
        if self.run_start is not None:
            size = position - self.run_start
            chunk = Chunk(self.run_start, size, 0, 0, bare=True)
            entries, _ = message_entries(self.layout.load(self.file, chunk))
            self.index.add(chunk, entries)
        self.run_start = None

    def _past_damage(self, position: int, size: int, head: tuple[int, int] | None) -> int:
        """Count what is broken at a position, and return where to go on."""
        following = find_chunk(self.file, position + 1, size)
        if following is not None:
            self.index.losses["bytes between damaged records"] += following - position
            return following
        if head is not None and head[0] == Opcode.CHUNK:
            self._take_chunk(Chunk(position, size - position, 0, 0, cut=True))
        elif head is not None and head[0] == Opcode.MESSAGE:
            self.index.losses["messages that the end of the file cuts"] += 1
        else:
            self.index.losses["bytes at the end that are no records"] += size - position
        return size

    def _take(self, opcode: int, position: int, end: int) -> None:
        if opcode == Opcode.CHUNK:
            self._take_chunk(Chunk(position, end - position, 0, 0))
        elif opcode == Opcode.MESSAGE and self.run_start is None:
            self.run_start = position
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self.file.seek(position + HEAD_BYTES)
            self.layout.definitions.add(opcode, self.file.read(end - position - HEAD_BYTES))

    def _take_chunk(self, chunk: Chunk) -> None:
        losses = self.index.losses
        try:
            data = self.layout.load(self.file, chunk)
        except ChunkError as error:
            self._count_lost(chunk, 0, str(error))
            return
        self.layout.definitions.read(data)
        entries, whole = message_entries(data)
        if chunk.cut:
            losses["chunks that the end of the file cuts"] += 1
        else:
            self._count_lost(chunk, len(entries), "" if whole else "with broken records")
        self.index.add(chunk, entries)

    def _count_lost(self, chunk: Chunk, kept: int, reason: str) -> None:
        stated = sum(self.layout.indexed_counts(self.file, chunk).values())
        if stated > kept:
            reason = reason or "with broken records"
            self.index.losses[f"messages in chunks {reason}"] += stated - kept
        elif reason:
            self.index.losses[f"chunks (with an unknown number of messages) {reason}"] += 1
