"""What every log format yields: connections and raw messages, before decoding."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

__all__ = ["NO_CHECKSUMS", "Connection", "MessageSource", "RawMessage", "RosMessage"]

RosMessage: TypeAlias = Any
"""A decoded message, or a part of one: its class is generated from its definition at run time."""


NO_CHECKSUMS = "payloads carry no checksum: flipped bits in them cannot be noticed"
"""Note on a log whose format, or whose writer, protects its payloads by nothing."""


@dataclass(frozen=True, slots=True)
class Connection:
    """One topic of a log, as its writer declared it.

    Attributes:
        topic: Name of the topic.
        msgtype: Type in ROS 2 style, such as `sensor_msgs/msg/PointCloud2`, for ROS 1 too.
        encoding: `ros1` or `cdr`; anything else is listed but cannot be decoded.
        definition: The message definition that the log carries, or an empty text.
        definition_format: `msg` (ROS .msg, concatenated with separators), `idl`, or empty.
    """

    topic: str
    msgtype: str
    encoding: str
    definition: str = ""
    definition_format: str = ""


@dataclass(frozen=True, slots=True)
class RawMessage:
    """One serialized message.

    Attributes:
        connection: Where it belongs.
        log_time_ns: Time of recording, int64 ns.
        data: Serialized bytes.
    """

    connection: Connection
    log_time_ns: int
    data: bytes | memoryview


class MessageSource(Protocol):
    """One opened file, or one set of files, of one log format.

    Attributes:
        paths: The files that are read.
        format: `rosbag1`, `sqlite3` or `mcap`.
        connections: All topics, also those without messages, sorted by topic.
        counts: Messages by topic, as far as they can be read.
        start_ns: Smallest log time, or None for an empty log.
        end_ns: Largest log time, or None for an empty log.
        losses: What could not be read, by reason, with a count; empty for a sound log.
        notes: What a user should know of the file besides; no defects.
    """

    paths: tuple[Path, ...]
    format: str
    connections: tuple[Connection, ...]
    counts: dict[str, int]
    start_ns: int | None
    end_ns: int | None
    losses: Counter[str]
    notes: tuple[str, ...]

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages in log-time order with bounded memory.

        Args:
            topics: Only these topics; all where it is None.
            start_ns: Smallest log time, inclusive.
            end_ns: Largest log time, inclusive.
        """
        ...

    def close(self) -> None:
        """Close the files and remove temporary copies."""
        ...
