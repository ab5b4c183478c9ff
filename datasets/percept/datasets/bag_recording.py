"""Logs as a `Recording`: sources merged in time, decoded, with latched transforms kept."""

from __future__ import annotations

import difflib
import textwrap
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from percept.core.errors import DecodeError, TopicNotFoundError
from percept.core.samples import OtherSample, Sample, TransformSample
from percept.datasets.decoding.decode import Decoder
from percept.datasets.formats.chunks import merge_in_time
from percept.datasets.losses import DecodingLosses, PassLosses
from percept.datasets.messages import Connection, MessageSource, RawMessage
from percept.datasets.recording import (
    Envelope,
    TopicInfo,
    UndecodedMessage,
    samples_of,
    wanted_topics,
)

__all__ = ["BagRecording"]

_LONGEST_REASON = 160


class BagRecording:
    """One log, or several merged in time; see `Recording`.

    Args:
        sources: The opened files, at least one; the recording closes them.
        losses: What was lost before any file was opened, by reason.
    """

    def __init__(
        self, sources: Sequence[MessageSource], losses: Counter[str] | None = None
    ) -> None:
        self.sources = tuple(sources)
        self.paths: tuple[Path, ...] = tuple(path for s in sources for path in s.paths)
        self.format = "+".join(sorted({source.format for source in sources}))
        self.losses: Counter[str] = Counter(losses or ())
        for source in sources:
            # From here on all sources count into the one counter that the recording shows.
            self.losses.update(source.losses)
            source.losses = self.losses
        self.notes: tuple[str, ...] = tuple(
            dict.fromkeys(note for source in sources for note in source.notes)
        )
        starts = [s.start_ns for s in sources if s.start_ns is not None]
        ends = [s.end_ns for s in sources if s.end_ns is not None]
        self.start_ns: int | None = min(starts, default=None)
        self.end_ns: int | None = max(ends, default=None)
        every = dict.fromkeys(c for source in sources for c in source.connections)
        self.connections: tuple[Connection, ...] = tuple(every)
        self._decoder = Decoder(every)
        self._decoding_losses = DecodingLosses(self.losses)

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics, sorted by name."""
        by_topic: dict[str, list[Connection]] = {}
        for connection in self.connections:
            by_topic.setdefault(connection.topic, []).append(connection)
        return tuple(self._info(topic, by_topic[topic]) for topic in sorted(by_topic))

    def _info(self, topic: str, connections: Sequence[Connection]) -> TopicInfo:
        undecodable = self._decoder.undecodable.get(topic)
        undecodable = None if undecodable is None else _one_line(undecodable)
        return TopicInfo(
            topic,
            " or ".join(sorted({c.msgtype for c in connections})),
            sum(source.counts.get(topic, 0) for source in self.sources),
            self._decoder.sample_type(connections[0]) if undecodable is None else OtherSample,
            undecodable,
        )

    def samples(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Sample]:
        """Yield samples in log-time order; see `Recording.samples`.

        Static transforms are latched: with a start time, the last of each before it come first.
        """
        topics = wanted_topics(topics)
        self._require(topics)
        return self._samples(topics, start_ns, end_ns)

    def _samples(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[Sample]:
        losses = self._decoding_losses.new_pass()
        if start_ns is not None:
            yield from self._latched(topics, start_ns, losses)
        yield from samples_of(self._undecoded(topics, start_ns, end_ns, losses))

    def undecoded(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[UndecodedMessage]:
        """Yield messages in log-time order, to be decoded on any thread; see `Recording`."""
        topics = wanted_topics(topics)
        self._require(topics)
        return self._undecoded(topics, start_ns, end_ns, self._decoding_losses.new_pass())

    def _undecoded(
        self,
        topics: Collection[str] | None,
        start_ns: int | None,
        end_ns: int | None,
        losses: PassLosses,
    ) -> Iterator[UndecodedMessage]:
        prepared: set[Connection] = set()
        for raw in self.messages(topics, start_ns, end_ns):
            if raw.connection not in prepared:
                self._decoder.prepare(raw.connection)
                prepared.add(raw.connection)
            yield UndecodedMessage(
                raw.connection.topic,
                self._decoder.header_stamp_ns(raw),
                raw.log_time_ns,
                partial(self._decode, raw, losses, losses.next_place()),
            )

    def _decode(self, raw: RawMessage, losses: PassLosses, place: int) -> tuple[Sample, ...]:
        notes: Counter[str] = Counter()
        try:
            return tuple(self._decoder.decode(raw, notes))
        except DecodeError as error:
            losses.add_failure(f"messages on {raw.connection.topic}", place, _one_line(error.what))
            raise
        finally:
            losses.add_notes(notes)

    def _latched(
        self, topics: Collection[str] | None, start_ns: int, losses: PassLosses
    ) -> Iterator[Sample]:
        static = [c.topic for c in self.connections if self._is_static(c)]
        wanted = [topic for topic in static if topics is None or topic in topics]
        latest: dict[tuple[str, str, str], Sample] = {}
        messages = self._undecoded(wanted, None, start_ns - 1, losses) if wanted else ()
        for sample in samples_of(messages):
            if isinstance(sample, TransformSample):
                key = (sample.topic, sample.frame, sample.T_frame_child.source)
                latest.pop(key, None)
                latest[key] = sample
        yield from latest.values()

    def _is_static(self, connection: Connection) -> bool:
        return (
            connection.topic.rpartition("/")[2] == "tf_static"
            and self._decoder.sample_type(connection) is TransformSample
        )

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages as they were serialized, in log-time order with bounded memory."""
        topics = wanted_topics(topics)
        wanted = None if topics is None else frozenset(topics)
        return merge_in_time(
            [
                (source.start_ns, partial(source.messages, wanted, start_ns, end_ns))
                for source in self.sources
                if source.start_ns is not None
            ],
            lambda raw: raw.log_time_ns,
        )

    def envelopes(self, *, topics: Collection[str] | None = None) -> Iterator[Envelope]:
        """Yield times and sizes of messages in log-time order, without decoding them."""
        topics = wanted_topics(topics)
        self._require(topics)
        return (
            Envelope(
                raw.connection.topic,
                self._decoder.header_stamp_ns(raw),
                raw.log_time_ns,
                len(raw.data),
            )
            for raw in self.messages(topics)
        )

    def _require(self, topics: Collection[str] | None) -> None:
        known = sorted({connection.topic for connection in self.connections})
        for topic in topics or ():
            if topic not in known:
                near = difflib.get_close_matches(topic, known, 3) or known[:12]
                raise TopicNotFoundError(
                    f"no topic '{topic}'",
                    where=self.paths[0],
                    remedy=f"Choose from: {', '.join(near)}" if near else "The log has no topics",
                )

    def close(self) -> None:
        """Close all files."""
        for source in self.sources:
            source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _one_line(reason: str) -> str:
    """Return a reason without the line breaks that a quoted definition brings."""
    return textwrap.shorten(reason, _LONGEST_REASON)
