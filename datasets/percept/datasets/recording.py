"""The one face that all logs and folders show: topics, a time span, and a stream of samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from percept.core.errors import DecodeError
from percept.core.samples import Sample

__all__ = [
    "Envelope",
    "Recording",
    "TopicInfo",
    "UndecodedMessage",
    "samples_of",
    "wanted_topics",
]


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic of a recording.

    Attributes:
        topic: Name.
        msgtype: Type in ROS 2 style, or the file kind for folders (`folder/pcd`).
        count: Messages that can be read.
        sample_type: The sample class that its messages decode to; `OtherSample` for the rest.
        undecodable: Why its messages cannot be decoded, or None where they can.
    """

    topic: str
    msgtype: str
    count: int
    sample_type: type[Sample]
    undecodable: str | None = None


@dataclass(frozen=True, slots=True)
class Envelope:
    """What is known of a message without decoding it.

    Attributes:
        topic: Name of its topic.
        stamp_ns: Header stamp, or None for a type without a header.
        log_time_ns: Time of recording.
        size_bytes: Serialized size.
    """

    topic: str
    stamp_ns: int | None
    log_time_ns: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class UndecodedMessage:
    """One message of a recording that is decoded when, and on which thread, the caller likes.

    Attributes:
        topic: Name of its topic.
        stamp_ns: Header stamp, or None where its first bytes hold none.
        log_time_ns: Time of recording.
        decode: Returns its samples: one, or one for each transform of a tf message. Call it
            once: what cannot be decoded is counted in the recording's `losses` and raised as
            `DecodeError`.
    """

    topic: str
    stamp_ns: int | None
    log_time_ns: int
    decode: Callable[[], tuple[Sample, ...]]


def samples_of(messages: Iterable[UndecodedMessage]) -> Iterator[Sample]:
    """Yield the samples of messages; those that cannot be decoded are only counted."""
    for message in messages:
        try:
            samples = message.decode()
        except DecodeError:
            continue
        yield from samples


def wanted_topics(topics: Collection[str] | None) -> Collection[str] | None:
    """Return topics as a collection: one name may come as a bare text, which is one of letters."""
    return (topics,) if isinstance(topics, str) else topics


class Recording(Protocol):
    """A log or a folder, open for reading; also a context manager.

    Attributes:
        paths: The files that are read.
        format: `rosbag1`, `sqlite3`, `mcap` or `folder`; several joined by `+`.
        start_ns: Smallest log time, or None for an empty recording.
        end_ns: Largest log time, or None for an empty recording.
        losses: What could not be read or decoded, by reason, with a count. Grows while
            samples are read.
        notes: What a user should know besides; no defects.
    """

    paths: tuple[Path, ...]
    format: str
    start_ns: int | None
    end_ns: int | None
    losses: Counter[str]
    notes: tuple[str, ...]

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics, sorted by name."""
        ...

    def samples(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Sample]:
        """Yield samples in log-time order with bounded memory.

        A message that cannot be decoded is counted in `losses` and skipped.

        Args:
            topics: Only these topics, or this one; all where it is None.
            start_ns: Smallest log time, inclusive.
            end_ns: Largest log time, inclusive.

        Raises:
            TopicNotFoundError: If a topic is not in the recording; names the candidates.
        """
        ...

    def undecoded(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[UndecodedMessage]:
        """Yield messages in log-time order, so that other threads may decode them.

        Decoding all of them gives the samples and the losses of `samples`, but for static
        transforms from before `start_ns`, which only `samples` brings.

        Args:
            topics: Only these topics, or this one; all where it is None.
            start_ns: Smallest log time, inclusive.
            end_ns: Largest log time, inclusive.

        Raises:
            TopicNotFoundError: If a topic is not in the recording; names the candidates.
        """
        ...

    def envelopes(self, *, topics: Collection[str] | None = None) -> Iterator[Envelope]:
        """Yield times and sizes of messages in log-time order, without decoding them."""
        ...

    def close(self) -> None:
        """Close all files."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
