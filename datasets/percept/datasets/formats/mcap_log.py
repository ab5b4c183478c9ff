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
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex as SummaryChunk
from mcap.records import Statistics
from mcap.stream_reader import StreamReader

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
from percept.datasets.formats.mcap_records import (
    HEAD_BYTES,
    MAGIC,
    Definitions,
    find_chunk,
    message_entries,
    read_chunk_head,
    read_head,
)

__all__ = ["McapLayout", "holds_mcap", "open_mcap"]

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
        data = file.read(min(head.data_size, chunk.offset + chunk.size - head.data_start))
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
            if head[1] - position != HEAD_BYTES + len(content) + size:
                # It states its length twice: a number that damage made is not believed.
                break
            counts[key] = counts.get(key, 0) + size // 16
            position = head[1]
        return counts

    def has_checksum(self, file: BinaryIO, chunk: Chunk) -> bool:
        """Return whether a chunk states a CRC; messages outside of chunks have none."""
        return not chunk.bare and read_chunk_head(file, chunk.offset).crc != 0


def holds_mcap(file: BinaryIO, size: int) -> bool:
    """Return whether a file ends as mcap, or has a chunk of one, whatever it begins with."""
    file.seek(max(size - len(MAGIC), 0))
    return file.read() == MAGIC or find_chunk(file, 0, size) is not None


def open_mcap(path: Path) -> ChunkedSource:
    """Open an mcap file; what does not even `holds_mcap` has been refused before."""
    layout = McapLayout()
    size = path.stat().st_size
    with path.open("rb") as file:
        index = _read_summary(file, size, layout)
        if index is None:
            index = _Scan(file, layout).run(len(MAGIC), size)
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC:
            index.losses[DAMAGED_MAGIC] += 1
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
    """Return whether there is between chunks what no index lists: messages, or damage."""
    ends = [c.chunk_start_offset + c.chunk_length + c.message_index_length for c in chunks]
    starts = [c.chunk_start_offset for c in chunks]
    for position, following in zip(
        [len(MAGIC), *sorted(ends)], [*sorted(starts), summary_start], strict=True
    ):
        while position < following and (head := read_head(file, position)):
            if head[0] == Opcode.MESSAGE:
                return True
            position = head[1]
        if position != following:
            return True
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
        self.size = 0
        self.statistics: Statistics | None = None

    def run(self, position: int, size: int) -> ChunkIndex:
        """Return all that can be read between two positions."""
        ended, self.size = False, size
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
            position = self._take(opcode, position, end)
        self._close_run(min(position, size))
        sound_end = ended and self._read_end(position, size)
        if not sound_end:
            self.index.losses[REBUILT] += 1
        section = _summary_section(self.file, size)
        if section:
            self.layout.definitions.read(section[1])
        self.index.connections = self.layout.definitions.connections()
        self.index.drop_unknown()
        statistics = self.statistics or (_statistics(section[1]) if section else None)
        self.index.count_missing(statistics.message_count if statistics else 0, "statistics state")
        return self.index

    def _read_end(self, position: int, size: int) -> bool:
        """Read the summary; return whether it is none or a sound one, with a footer."""
        while (head := read_head(self.file, position)) and head[1] <= size:
            if head[0] == Opcode.FOOTER:
                return (
                    self.file.read(8) == bytes(8) or _summary_section(self.file, size) is not None
                )
            if head[0] in (Opcode.SCHEMA, Opcode.CHANNEL):
                # What a lost chunk declares the summary repeats.
                self._take(head[0], position, head[1])
            if head[0] == Opcode.STATISTICS:
                self.file.seek(position)
                self.statistics = _statistics(self.file.read(head[1] - position))
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
            self._take_cut(Chunk(position, size - position, 0, 0, cut=True), head[1] - size)
        elif head is not None and head[0] == Opcode.MESSAGE:
            self.index.losses["messages that the end of the file cuts"] += 1
            self.index.losses[MISSING_BYTES] += head[1] - size
        else:
            self.index.losses["bytes at the end that are no records"] += size - position
        return size

    def _take(self, opcode: int, position: int, end: int) -> int:
        """Take one record; return where the next one begins."""
        if opcode == Opcode.CHUNK:
            return self._take_chunk(Chunk(position, end - position, 0, 0))
        if opcode == Opcode.MESSAGE and self.run_start is None:
            self.run_start = position
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self.file.seek(position + HEAD_BYTES)
            self.layout.definitions.add(opcode, self.file.read(end - position - HEAD_BYTES))
        return end

    def _take_chunk(self, chunk: Chunk) -> int:
        data, entries, reason = self._read(chunk)
        end = following = chunk.offset + chunk.size
        if reason:
            # Where a part of the file is missing, the stated size reaches into the next chunks.
            following = min(find_chunk(self.file, chunk.offset + 1, self.size) or end, end)
        if following < end:
            chunk = replace(chunk, size=following - chunk.offset)
            data, entries, _ = self._read(chunk)
        self._keep(chunk, data, entries)
        counts = self.layout.indexed_counts(self.file, chunk) if following == end else {}
        self.index.count_lost(sum(counts.values()), entries, reason, len(data) or chunk.size)
        return following

    def _take_cut(self, chunk: Chunk, missing: int) -> None:
        data, entries, _ = self._read(chunk)
        self._keep(chunk, data, entries)
        self.index.count_cut(len(data) or chunk.size, entries, missing)

    def _read(self, chunk: Chunk) -> tuple[bytes, list[Entry], str]:
        """Return a chunk's content and messages, and what is wrong with it."""
        try:
            data = self.layout.load(self.file, chunk)
        except ChunkError as error:
            return b"", [], str(error)
        entries, whole = message_entries(data)
        return data, entries, "" if whole else "with broken records"

    def _keep(self, chunk: Chunk, data: bytes, entries: list[Entry]) -> None:
        self.layout.definitions.read(data)
        self.index.add(chunk, entries)
