"""Samples into a log that other tools open: ROS 1 bag, ROS 2 folder, or mcap."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from percept.core.errors import UsageError
from percept.core.samples import Sample
from percept.datasets.decoding.cloud_layout import CloudLayout
from percept.datasets.decoding.encode import ImageCoding, MessageEncoder
from percept.datasets.decoding.message_samples import is_static_topic
from percept.datasets.decoding.typestores import DefinitionCatalog
from percept.datasets.formats.log_sinks import Compression, LogFormat, LogSink, open_sink
from percept.datasets.messages import RawMessage

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["CloudLayout", "Compression", "ImageCoding", "LogFormat", "LogWriter"]

_SUFFIXES = {"rosbag1": ".bag", "rosbag2": "", "mcap": ".mcap"}


class LogWriter:
    """Writes one log; a context manager.

    The log stands under a temporary name beside its place until it is complete: after an
    error there is nothing under its own name. The same samples in the same order give the same
    bytes, and memory does not grow with the length of the log (but for its index).

    Args:
        path: Where the log will stand: `*.bag`, a folder, or `*.mcap`. It must not exist.
        log_format: `rosbag1`, `rosbag2` (a folder, sqlite3) or `mcap`.
        compression: `bz2` or `lz4` for ROS 1, `zstd` for ROS 2, `lz4` or `zstd` for mcap.
        images: How camera images are written.
        cloud_layout: Layout of the PointCloud2 messages; packed, little-endian by default.

    Raises:
        UsageError: If the path exists or ends wrongly, or the format has no such compression.
    """

    def __init__(
        self,
        path: Path,
        log_format: LogFormat,
        *,
        compression: Compression = "none",
        images: ImageCoding = "raw",
        cloud_layout: CloudLayout | None = None,
    ) -> None:
        suffix = _SUFFIXES[log_format]
        if suffix and path.suffix != suffix:
            raise UsageError(f"a {log_format} log ends with '{suffix}'", where=path)
        if path.exists():
            raise UsageError(
                "exists already and is not written over", where=path, remedy="Choose another name"
            )
        self.path = path
        self._encoder = MessageEncoder(
            "ros1" if log_format == "rosbag1" else "cdr", images=images, cloud_layout=cloud_layout
        )
        self._catalog = DefinitionCatalog()
        self._topics: dict[str, tuple[str, int]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        # rosbag2 names the files inside after their folder, so that the name must be final.
        self._workshop = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        try:
            self._sink: LogSink = open_sink(self._workshop / path.name, log_format, compression)
        except BaseException:
            shutil.rmtree(self._workshop)
            raise

    def write(self, sample: Sample) -> None:
        """Append a sample under its topic and log time.

        Raises:
            UsageError: If the sample cannot be said in a ROS message, or its topic has
                another type.
        """
        msgtype, data = self._encoder.encode(sample)
        self._append(sample.topic, msgtype, sample.log_time_ns, data, self._encoder.store)

    def write_raw(self, raw: RawMessage) -> None:
        """Append a message of any type as it is, by the definition that its connection carries.

        Raises:
            DecodeError: If the definition cannot be used.
            UsageError: If the message is of the other ROS generation, or its topic has
                another type.
        """
        connection = raw.connection
        if connection.encoding != self._encoder.encoding:
            raise UsageError(
                f"'{connection.encoding}' messages do not go into this format",
                where=connection.topic,
            )
        store = self._catalog.store_for(connection)
        self._append(
            connection.topic, connection.msgtype, raw.log_time_ns, memoryview(raw.data), store
        )

    def _append(
        self, topic: str, msgtype: str, log_time_ns: int, data: memoryview, store: Typestore
    ) -> None:
        if topic not in self._topics:
            number = self._sink.add_topic(topic, msgtype, store, latched=is_static_topic(topic))
            self._topics[topic] = (msgtype, number)
        known, number = self._topics[topic]
        if known != msgtype:
            raise UsageError(f"holds '{known}', so that no '{msgtype}' goes in", where=topic)
        self._sink.write(number, log_time_ns, data)

    def close(self) -> None:
        """Complete the log and move it to its place.

        Raises:
            UsageError: If something else appeared there in the meantime.
        """
        try:
            self._sink.close()
            if self.path.exists():
                raise UsageError("appeared while the log was written", where=self.path)
            (self._workshop / self.path.name).rename(self.path)
        finally:
            shutil.rmtree(self._workshop)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
            return
        self._sink.abort()
        shutil.rmtree(self._workshop)
