"""The three log formats behind one face, by the writers of rosbags and mcap."""

from __future__ import annotations

from collections.abc import Callable
from io import BufferedWriter
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from percept.core.errors import UsageError

if TYPE_CHECKING:
    from rosbags.interfaces import Connection as RosbagsConnection
    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore

__all__ = ["Compression", "LogFormat", "LogSink", "open_sink"]

LogFormat = Literal["rosbag1", "rosbag2", "mcap"]
"""`rosbag1` a `.bag`, `rosbag2` a folder with sqlite3 storage, `mcap` a bare `.mcap`."""

Compression = Literal["none", "bz2", "lz4", "zstd"]

_LATCHED_DEPTH = 1000
_LIBRARY = "percept"


class LogSink(Protocol):
    """One log that is being written."""

    def add_topic(self, topic: str, msgtype: str, store: Typestore, *, latched: bool) -> int:
        """Declare a topic and return its number for `write`."""
        ...

    def write(self, number: int, log_time_ns: int, data: memoryview) -> None:
        """Append one serialized message."""
        ...

    def close(self) -> None:
        """Write the index and close."""
        ...

    def abort(self) -> None:
        """Close without an index, after an error."""
        ...


def open_sink(path: Path, log_format: LogFormat, compression: Compression) -> LogSink:
    """Start a new log.

    Raises:
        UsageError: If the format has no such compression.
    """
    formats: dict[str, tuple[Callable[[Path, Compression], LogSink], tuple[str, ...]]] = {
        "rosbag1": (_Rosbag1Sink, ("none", "bz2", "lz4")),
        "rosbag2": (_Rosbag2Sink, ("none", "zstd")),
        "mcap": (_McapSink, ("none", "lz4", "zstd")),
    }
    sink, compressions = formats[log_format]
    if compression not in compressions:
        raise UsageError(
            f"{log_format} cannot be compressed by '{compression}'",
            where=path,
            remedy=f"Use one of {', '.join(compressions)}",
        )
    return sink(path, compression)


class _Rosbag1Sink:
    def __init__(self, path: Path, compression: Compression) -> None:
        from rosbags.rosbag1 import Writer

        self._writer = Writer(path)
        if compression != "none":
            self._writer.set_compression(Writer.CompressionFormat[compression.upper()])
        self._writer.open()
        self._connections: list[RosbagsConnection] = []

    def add_topic(self, topic: str, msgtype: str, store: Typestore, *, latched: bool) -> int:
        connection = self._writer.add_connection(
            topic, msgtype, typestore=store, latching=1 if latched else None
        )
        self._connections.append(connection)
        return len(self._connections) - 1

    def write(self, number: int, log_time_ns: int, data: memoryview) -> None:
        self._writer.write(self._connections[number], log_time_ns, data)

    def close(self) -> None:
        self._writer.close()

    def abort(self) -> None:
        self._writer.abort()


class _Rosbag2Sink:
    def __init__(self, path: Path, compression: Compression) -> None:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        if compression == "zstd":
            self._writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self._connections: list[RosbagsConnection] = []

    def add_topic(self, topic: str, msgtype: str, store: Typestore, *, latched: bool) -> int:
        profiles = [_latched_qos()] if latched else []
        connection = self._writer.add_connection(
            topic, msgtype, typestore=store, offered_qos_profiles=profiles
        )
        self._connections.append(connection)
        return len(self._connections) - 1

    def write(self, number: int, log_time_ns: int, data: memoryview) -> None:
        self._writer.write(self._connections[number], log_time_ns, data)

    def close(self) -> None:
        self._writer.close()

    def abort(self) -> None:
        self._writer.abort()


class _McapSink:
    def __init__(self, path: Path, compression: Compression) -> None:
        from mcap.writer import CompressionType, Writer

        self._file: BufferedWriter = path.open("xb")
        self._writer = Writer(self._file, compression=CompressionType[compression.upper()])
        self._writer.start(profile="ros2", library=_LIBRARY)
        self._schemas: dict[tuple[str, str], int] = {}

    def add_topic(self, topic: str, msgtype: str, store: Typestore, *, latched: bool) -> int:
        definition, _ = store.generate_msgdef(msgtype, ros_version=2)
        key = (msgtype, definition)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                msgtype, "ros2msg", definition.encode()
            )
        return self._writer.register_channel(
            topic, "cdr", self._schemas[key], {"offered_qos_profiles": _qos_text(latched=latched)}
        )

    def write(self, number: int, log_time_ns: int, data: memoryview) -> None:
        self._writer.add_message(number, log_time_ns, bytes(data), log_time_ns)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it so
        self._file.close()

    def abort(self) -> None:
        self._file.close()


def _latched_qos() -> Qos:
    """Return what tf2's static broadcaster offers, deep enough for one message an edge."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    unset = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST,
        _LATCHED_DEPTH,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        unset,
        unset,
        QosLiveliness.SYSTEM_DEFAULT,
        unset,
        avoid_ros_namespace_conventions=False,
    )


def _qos_text(*, latched: bool) -> str:
    from rosbags.rosbag2.metadata import dump_qos_v8

    return dump_qos_v8([_latched_qos()] if latched else [])
