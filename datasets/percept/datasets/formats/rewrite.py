"""Writes what a source can read into a sound file of the same format, by the format's writer.

Payloads are copied as they were stored, never decoded, and so are definitions, latching, quality
of service, sequence numbers and publish times as far as they are known.
"""

from __future__ import annotations

import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from percept.core.errors import RecordingError
from percept.datasets.formats.chunks import ChunkedSource, ChunkError
from percept.datasets.formats.mcap_log import McapLayout
from percept.datasets.formats.mcap_records import (
    HEAD_BYTES,
    MAGIC,
    message_head,
    read_chunk_head,
    read_head,
)
from percept.datasets.formats.rosbag1 import BagLayout
from percept.datasets.formats.sqlite3_log import Sqlite3Source
from percept.datasets.messages import MessageSource

if TYPE_CHECKING:
    from mcap.records import Attachment, Metadata
    from mcap.writer import CompressionType
    from mcap.writer import Writer as McapWriter
    from rosbags.interfaces import Connection as BagWriterConnection
    from rosbags.rosbag1 import Writer as BagWriter

__all__ = ["rewrite"]

# rosbag2 keeps a copy of metadata.yaml in the log; its counts are those of the lost original.
_STALE_METADATA = "rosbag2"
_PROFILES = {"cdr": "ros2", "ros1": "ros1"}


def rewrite(source: MessageSource, target: Path) -> Counter[str]:
    """Write all readable messages of a source to a new file.

    Args:
        source: An opened log file.
        target: The file to write; it must not exist.

    Returns:
        Messages written, by topic, topics without messages included.

    Raises:
        RecordingError: If the source is of no format that could be written.
    """
    if isinstance(source, ChunkedSource) and isinstance(source.layout, BagLayout):
        return _rewrite_bag(source, source.layout, target)
    if isinstance(source, ChunkedSource) and isinstance(source.layout, McapLayout):
        return _rewrite_mcap(source, source.layout, target)
    if isinstance(source, Sqlite3Source):
        return _rewrite_sqlite3(source, target)
    raise RecordingError(f"no writer for {source.format}", where=source.paths[0])


def _rewrite_bag(source: ChunkedSource, layout: BagLayout, target: Path) -> Counter[str]:
    from rosbags.rosbag1 import Writer

    written = Counter(dict.fromkeys(source.counts, 0))
    writer = Writer(target)
    if layout.compression in ("bz2", "lz4"):
        writer.set_compression(Writer.CompressionFormat[layout.compression.upper()])
    with writer:
        connections = _declare_bag(writer, layout)
        for key, log_time_ns, view, start, end in source.located():
            connection = connections[key]
            writer.write(connection, log_time_ns, view[start:end])
            written[connection.topic] += 1
    return written


def _declare_bag(writer: BagWriter, layout: BagLayout) -> dict[int, BagWriterConnection]:
    """Declare the connections of a bag; equal ones, which rosbag writes too, become one."""
    declared: dict[object, BagWriterConnection] = {}
    connections = {}
    for key, detail in layout.details.items():
        if detail not in declared:
            declared[detail] = writer.add_connection(
                detail.connection.topic,
                detail.connection.msgtype,
                msgdef=detail.connection.definition,
                md5sum=detail.md5sum or "*",
                callerid=detail.callerid,
                latching=detail.latching,
            )
        connections[key] = declared[detail]
    return connections


def _rewrite_mcap(source: ChunkedSource, layout: McapLayout, target: Path) -> Counter[str]:
    from mcap.writer import Writer

    written = Counter(dict.fromkeys(source.counts, 0))
    with target.open("wb") as stream:
        writer = Writer(stream, compression=_mcap_compression(source))
        writer.start(profile=_mcap_profile(source))
        channels = _declare_mcap(writer, layout)
        for key, log_time_ns, view, start, end in source.located():
            sequence, publish_ns = message_head(view, start)
            writer.add_message(
                channels[key], log_time_ns, bytes(view[start:end]), publish_ns, sequence
            )
            written[source.index.connections[key].topic] += 1
        _copy_side_records(writer, source.file, source.losses)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this
    return written


def _declare_mcap(writer: McapWriter, layout: McapLayout) -> dict[int, int]:
    schemas = {0: 0}
    for key, schema in layout.definitions.schemas.items():
        schemas[key] = writer.register_schema(schema.name, schema.encoding, schema.data)
    return {
        key: writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schemas.get(channel.schema_id, 0),
            channel.metadata,
        )
        for key, channel in layout.definitions.channels.items()
    }


def _mcap_compression(source: ChunkedSource) -> CompressionType:
    from mcap.writer import CompressionType

    names = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}
    for chunk in source.index.chunks:
        if not chunk.bare:
            try:
                compression = read_chunk_head(source.file, chunk.offset).compression
            except ChunkError:
                continue
            return names.get(compression, CompressionType.NONE)
    return CompressionType.NONE


def _mcap_profile(source: ChunkedSource) -> str:
    """Return the profile in the header record; where that is damaged, the encoding tells it."""
    from mcap.opcode import Opcode

    file = source.file
    head = read_head(file, len(MAGIC))
    if head is None or head[0] != Opcode.HEADER:
        profiles = {_PROFILES.get(c.encoding, "") for c in source.connections}
        return profiles.pop() if len(profiles) == 1 else ""
    content = file.read(min(head[1] - len(MAGIC) - HEAD_BYTES, 1 << 16))
    size = int.from_bytes(content[:4], "little")
    return content[4 : 4 + size].decode("ascii", errors="ignore") if size <= 32 else ""


def _copy_side_records(writer: McapWriter, file: BinaryIO, losses: Counter[str]) -> None:
    """Copy attachments and metadata up to the first damaged record."""
    from mcap.records import Metadata

    for record in _side_records(file, losses):
        if isinstance(record, Metadata):
            if record.name != _STALE_METADATA:
                writer.add_metadata(record.name, record.metadata)
        else:
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )


def _side_records(file: BinaryIO, losses: Counter[str]) -> Iterator[Attachment | Metadata]:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Attachment, Metadata

    readers = {Opcode.ATTACHMENT: Attachment.read, Opcode.METADATA: Metadata.read}
    size = file.seek(0, 2)
    position = len(MAGIC)
    while (head := read_head(file, position)) and head[0] != 0 and head[1] <= size:
        opcode, end = head
        if opcode == Opcode.DATA_END:
            return
        if opcode in readers:
            content = file.read(end - position - HEAD_BYTES)
            try:
                yield readers[Opcode(opcode)](ReadDataStream(BytesIO(content)))
            except (McapError, struct.error, ValueError, OverflowError):
                losses["attachments and metadata that cannot be read"] += 1
        position = end


def _rewrite_sqlite3(source: Sqlite3Source, target: Path) -> Counter[str]:
    written = Counter(dict.fromkeys(source.counts, 0))
    database = sqlite3.connect(target, isolation_level=None)
    database.set_authorizer(_tables_only)
    try:
        database.execute("PRAGMA journal_mode = OFF")
        database.execute("BEGIN")
        indexes = list(_copy_tables(source, database))
        insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
        for key, log_time_ns, data in source.stored():
            database.execute(insert, (key, log_time_ns, data))
            written[source.by_id[key].topic] += 1
        for sql in indexes:
            database.execute(sql)
        database.execute("COMMIT")
    except sqlite3.DatabaseError as error:
        raise RecordingError(
            f"its tables cannot be made anew ({error})",
            where=source.paths[0],
            remedy="Open the log as it is; what can be read of it is read",
        ) from error
    finally:
        database.close()
    return written


def _tables_only(action: int, *_details: object) -> int:
    """Let the statements of a stranger's schema make tables and indexes, and nothing else."""
    refused = {
        sqlite3.SQLITE_ATTACH,
        sqlite3.SQLITE_CREATE_VTABLE,
        sqlite3.SQLITE_FUNCTION,
        sqlite3.SQLITE_RECURSIVE,
        sqlite3.SQLITE_SELECT,
    }
    return sqlite3.SQLITE_DENY if action in refused else sqlite3.SQLITE_OK


def _copy_tables(source: Sqlite3Source, database: sqlite3.Connection) -> Iterator[str]:
    """Copy the tables except for the messages; yield the statements that make the indexes."""
    for name, sql, rows in source.tables():
        if sql.upper().startswith("CREATE INDEX"):
            yield sql
        elif sql.upper().startswith("CREATE TABLE") and not name.startswith("sqlite_"):
            database.execute(sql)
            for rowid, values in rows if name != "metadata" else ():
                # An integer primary key is stored as null: the row's own key stands for it.
                kept = [rowid if i == 0 and v is None else v for i, v in enumerate(values)]
                marks = ",".join("?" * len(kept))
                quoted = name.replace('"', '""')
                database.execute(f'INSERT INTO "{quoted}" VALUES ({marks})', kept)  # noqa: S608 (quoted)
