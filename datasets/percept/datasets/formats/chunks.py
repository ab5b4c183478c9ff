"""Streaming from files that keep their messages in chunks: ROS 1 bags and mcap.

Both formats are read the same way: an index says which chunk covers which time and which
connections; chunks are loaded one by one when their time comes, checked, and merged by log
time. Memory is that of the chunks that overlap in time, whatever the length of the log. A
chunk that turns out to be broken is counted and left out; the rest goes on.
"""

from __future__ import annotations

import contextlib
import heapq
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, Protocol, TypeVar

from percept.datasets.formats.compression import ZSTD_MAGIC, CompressionError, decompress
from percept.datasets.messages import NO_CHECKSUMS, Connection, RawMessage

__all__ = [
    "DAMAGED_MAGIC",
    "MISSING_BYTES",
    "MOST_RECORDS",
    "REBUILT",
    "Chunk",
    "ChunkError",
    "ChunkFormat",
    "ChunkIndex",
    "ChunkedSource",
    "Entry",
    "merge_in_time",
    "raw_message",
]

Entry = tuple[int, int, int, int]
"""One message in a loaded chunk: log time in ns, connection id, start and end of its payload."""

REBUILT = "files whose index is missing or damaged; read through as a whole"
"""Reason of a loss that is none yet: what the index would have stated can only be missed."""

MOST_RECORDS = 1 << 21
"""Records of one chunk that are looked at, so that a list of them needs less than half a GB.

Recorders put some thousands into one, and into 60 MiB no more fit, even of empty messages.
"""

DAMAGED_MAGIC = "files whose first bytes, the file magic, are damaged"
MISSING_BYTES = "bytes missing at the end of the file, at least"

_T = TypeVar("_T")
_NEVER = 1 << 65


class ChunkError(Exception):
    """A chunk that cannot be read; the text says what is wrong with its messages."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """Where one chunk lies in its file.

    Attributes:
        offset: Position of the chunk's record, bytes.
        size: Bytes that it has in the file, with its record header.
        start_ns: Smallest log time in it.
        end_ns: Largest log time in it.
        ids: Connections that have messages in it, or None where the index does not say.
        cut: Whether the end of the file cuts it.
        bare: Whether it is a run of message records outside of any chunk.
    """

    offset: int
    size: int
    start_ns: int
    end_ns: int
    ids: frozenset[int] | None = None
    cut: bool = False
    bare: bool = False


@dataclass(slots=True)
class ChunkIndex:
    """What the index of a file says, or what reading through the whole file has found.

    Attributes:
        connections: Connections by the id that messages refer to.
        chunks: All chunks in file order.
        counts: Messages by connection id.
        losses: What could not be read, by reason.
        scanned: Whether all chunks were read to make this index, and their losses counted.
    """

    connections: dict[int, Connection] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    losses: Counter[str] = field(default_factory=Counter)
    scanned: bool = False

    def add(self, chunk: Chunk, entries: list[Entry]) -> None:
        """Add a chunk whose messages have been read."""
        if entries:
            counts = Counter(entry[1] for entry in entries)
            times = [entry[0] for entry in entries]
            self.counts.update(counts)
            held = replace(chunk, start_ns=min(times), end_ns=max(times), ids=frozenset(counts))
            self.chunks.append(held)

    def count_lost(self, stated: int, entries: list[Entry], reason: str, size: int) -> None:
        """Count what a chunk did not give.

        Args:
            stated: Messages that it should have as the index states, 0 where it does not.
            entries: The messages that were found in it.
            reason: What is wrong with it, as a clause; empty for a chunk that reads well.
            size: Bytes of its content.
        """
        if stated > len(entries):
            reason = reason or "with broken records"
            self.losses[f"messages in chunks {reason}"] += stated - len(entries)
        elif reason and (not stated or stated < len(entries)):
            self.losses[f"chunks (with an unknown number of messages) {reason}"] += 1
            unread = _unread(size, entries)
            if unread:
                self.losses[f"bytes without a whole message in chunks {reason}"] += unread

    def count_cut(self, size: int, entries: list[Entry], missing: int) -> None:
        """Count what is lost of a chunk that the end of the file cuts.

        Args:
            size: Bytes of its content that could be had.
            entries: The messages that were found in it.
            missing: Bytes of the chunk that lie behind the end of the file.
        """
        self.losses["chunks that the end of the file cuts"] += 1
        reasons = {
            "bytes behind the last whole message of a cut chunk": _unread(size, entries),
            MISSING_BYTES: missing,
        }
        self.losses.update({reason: count for reason, count in reasons.items() if count > 0})

    def count_missing(self, stated: int, where: str) -> None:
        """Count the messages that a file's own total has beyond those found and those lost.

        Args:
            stated: The total.
            where: What states it, as a clause.
        """
        lost = sum(n for reason, n in self.losses.items() if reason.startswith("messages"))
        missing = stated - self.counts.total() - lost
        if missing > 0:
            self.losses[f"messages missing, of those that the {where}"] += missing

    def drop_unknown(self) -> None:
        """Count messages whose connection was lost, and forget them."""
        for key in self.counts.keys() - self.connections.keys():
            self.losses["messages of unknown connections"] += self.counts.pop(key)


def _unread(size: int, entries: list[Entry]) -> int:
    return max(size - (entries[-1][3] if entries else 0), 0)


class ChunkFormat(Protocol):
    """How one format lays out its chunks."""

    name: str

    def load(self, file: BinaryIO, chunk: Chunk) -> bytes:
        """Return the decompressed, checked content of a chunk.

        Raises:
            ChunkError: If there is none that could be trusted.
        """
        ...

    def entries(self, data: bytes) -> tuple[list[Entry], bool]:
        """Return the messages of a loaded chunk in file order, and whether none broke off."""
        ...

    def indexed_counts(self, file: BinaryIO, chunk: Chunk) -> Mapping[int, int]:
        """Return messages by connection id as the file's index states; empty if it does not."""
        ...

    def has_checksum(self, file: BinaryIO, chunk: Chunk) -> bool:
        """Return whether a flipped bit in a chunk would be noticed.

        Raises:
            ChunkError: If its record is damaged.
        """
        ...


def merge_in_time(
    parts: Iterable[tuple[int, Callable[[], Iterator[_T]]]], time_of: Callable[[_T], int]
) -> Iterator[_T]:
    """Merge streams that are sorted by time, opening each only when its time comes.

    Args:
        parts: Start time of each stream and what opens it; nothing in it may be earlier.
        time_of: Time of an item. Items of equal time come in the order of `parts`.
    """
    waiting = sorted(((start, i, opener) for i, (start, opener) in enumerate(parts)), reverse=True)
    heap: list[tuple[int, int, _T, Iterator[_T]]] = []
    while heap or waiting:
        while waiting and (not heap or waiting[-1][0] <= heap[0][0]):
            _, order, opener = waiting.pop()
            _push_next(heap, order, opener(), time_of)
        if len(heap) == 1:
            # Alone until the next one's time comes: no need to compare.
            _, order, item, stream = heap.pop()
            yield item
            until = waiting[-1][0] if waiting else _NEVER
            for item in stream:
                if time_of(item) >= until:
                    heapq.heappush(heap, (time_of(item), order, item, stream))
                    break
                yield item
        elif heap:
            _, order, item, stream = heapq.heappop(heap)
            yield item
            _push_next(heap, order, stream, time_of)


def _push_next(
    heap: list[tuple[int, int, _T, Iterator[_T]]],
    order: int,
    stream: Iterator[_T],
    time_of: Callable[[_T], int],
) -> None:
    for item in stream:
        heapq.heappush(heap, (time_of(item), order, item, stream))
        return


def raw_message(
    connection: Connection, log_time_ns: int, data: bytes | memoryview, losses: Counter[str]
) -> RawMessage | None:
    """Return a stored message, decompressed if it is one of rosbag2's compressed ones.

    A CDR payload begins with its representation id, whose first byte is 0, so that the zstd
    magic decides without `metadata.yaml`. One that does not decompress is counted: None.
    """
    if connection.encoding == "cdr" and data[:4] == ZSTD_MAGIC:
        try:
            data = decompress("zstd", bytes(data))
        except CompressionError as error:
            losses[f"compressed messages {error}"] += 1
            return None
    return RawMessage(connection, log_time_ns, data)


class ChunkedSource:
    """A `MessageSource` over one file with chunks.

    Args:
        path: The file.
        layout: Its format.
        index: Its connections and chunks.
    """

    def __init__(self, path: Path, layout: ChunkFormat, index: ChunkIndex) -> None:
        self.paths: tuple[Path, ...] = (path,)
        self.format = layout.name
        self.losses: Counter[str] = index.losses
        self.index = index
        self.layout = layout
        self.file: BinaryIO = path.open("rb")
        unique = dict.fromkeys(index.connections.values())
        self.connections: tuple[Connection, ...] = tuple(
            sorted(unique, key=lambda c: (c.topic, c.msgtype))
        )
        self.counts: dict[str, int] = {c.topic: 0 for c in self.connections}
        for key, count in index.counts.items():
            self.counts[index.connections[key].topic] += count
        held = [chunk for chunk in index.chunks if chunk.ids is None or chunk.ids]
        self.start_ns: int | None = min((c.start_ns for c in held), default=None)
        self.end_ns: int | None = max((c.end_ns for c in held), default=None)
        self.notes: tuple[str, ...] = () if self._has_checksums() else (NO_CHECKSUMS,)
        self._late = 0
        self._given: Counter[int] = Counter()
        self._judged = {chunk.offset for chunk in index.chunks if index.scanned}

    def _has_checksums(self) -> bool:
        """Return whether the first readable chunk has one: a writer has one habit."""
        for chunk in self.index.chunks:
            with contextlib.suppress(ChunkError):
                return self.layout.has_checksum(self.file, chunk)
        return True

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages in log-time order; see `MessageSource.messages`."""
        for key, log_time_ns, view, start, end in self.located(topics, start_ns, end_ns):
            connection = self.index.connections[key]
            raw = raw_message(connection, log_time_ns, view[start:end], self.losses)
            if raw is not None:
                yield raw

    def located(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[tuple[int, int, memoryview, int, int]]:
        """Yield connection id, log time, the chunk's content, and where the payload lies in it."""
        wanted = {
            key for key, c in self.index.connections.items() if topics is None or c.topic in topics
        }
        first = -(2**63) if start_ns is None else start_ns
        last = 2**64 if end_ns is None else end_ns
        parts = [
            (chunk.start_ns, partial(self._chunk, chunk, wanted, first, last))
            for chunk in self.index.chunks
            if chunk.start_ns <= last
            and chunk.end_ns >= first
            and (chunk.ids is None or not wanted.isdisjoint(chunk.ids))
        ]
        late, previous = 0, first
        for located in merge_in_time(parts, itemgetter(1)):
            if located[1] >= previous:
                previous = located[1]
                yield located
                continue
            late += 1
            if late > self._late:
                self._late = late
                self.losses["messages outside of the time that the index states"] += 1

    def _chunk(
        self, chunk: Chunk, wanted: set[int], first: int, last: int
    ) -> Iterator[tuple[int, int, memoryview, int, int]]:
        data, entries = self._checked(chunk)
        kept = [e for e in entries if e[1] in wanted and first <= e[0] <= last]
        # Recorders write nearly sorted chunks; the sort is stable and then almost free.
        kept.sort(key=itemgetter(0))
        view = memoryview(data)
        for log_time_ns, key, start, end in kept:
            yield key, log_time_ns, view, start, end

    def _checked(self, chunk: Chunk) -> tuple[bytes, list[Entry]]:
        """Return what can be read of a chunk, and count once what cannot."""
        data, reason = b"", ""
        entries: list[Entry] = []
        try:
            data = self.layout.load(self.file, chunk)
            entries, whole = self.layout.entries(data)
            reason = "" if whole or chunk.cut else "with broken records"
        except ChunkError as error:
            reason = str(error)
        if chunk.offset not in self._judged:
            self._judged.add(chunk.offset)
            found = Counter(entry[1] for entry in entries)
            self._given.update(found)
            self._count_lost(chunk, found, reason)
            if len(self._judged) == len(self.index.chunks):
                self._reconcile()
        return data, entries

    def _reconcile(self) -> None:
        """Count what all chunks together lack of the total that the index states."""
        given = dict.fromkeys(self.counts, 0)
        for key, count in self._given.items():
            if key in self.index.connections:
                given[self.index.connections[key].topic] += count
        for topic, count in given.items():
            if self.counts[topic] > count:
                missing = self.counts[topic] - count
                self.losses["messages missing, of those that the index states"] += missing
            self.counts[topic] = count

    def _count_lost(self, chunk: Chunk, found: Counter[int], reason: str) -> None:
        """Compare what a chunk gave with what the index states, and count the difference."""
        stated = Counter(dict(self.layout.indexed_counts(self.file, chunk)))
        if not stated and reason:
            self.losses[f"chunks (with an unknown number of messages) {reason}"] += 1
        for key, count in (stated - found).items():
            self.losses[f"messages in chunks {reason or 'with broken records'}"] += count
            if key in self.index.connections:
                self.counts[self.index.connections[key].topic] -= count

    def close(self) -> None:
        """Close the file."""
        self.file.close()
