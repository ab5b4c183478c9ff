"""Records of mcap files.

Source: the MCAP specification (mcap.dev/spec). A record is `u8 opcode, u64 length, content`.
Rare records are parsed by the mcap package; messages, of which there are many, in place.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from percept.datasets.formats.chunks import MOST_RECORDS, ChunkError, Entry
from percept.datasets.messages import Connection

__all__ = [
    "HEAD_BYTES",
    "MAGIC",
    "ChunkHead",
    "Definitions",
    "find_chunk",
    "message_entries",
    "message_head",
    "read_chunk_head",
    "read_head",
]

MAGIC = b"\x89MCAP0\r\n"
HEAD_BYTES = 9
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_BLOCK_BYTES = 1 << 22
_LAST_OFFSET = 1 << 43
_FORMATS = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl"}


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """The fixed part of a chunk record.

    Attributes:
        size: Bytes of its content after decompression.
        crc: CRC-32 of that content, 0 where it was not computed.
        compression: `zstd`, `lz4` or empty.
        data_start: Position of the compressed bytes in the file.
        data_size: Number of compressed bytes.
    """

    size: int
    crc: int
    compression: str
    data_start: int
    data_size: int


@dataclass(slots=True)
class Definitions:
    """Schemas and channels as they were met, and the connections that they make."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def read(self, data: bytes) -> None:
        """Take the schemas and channels among the records of a chunk, up to any break."""
        for opcode, start, end in _records(data):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.add(opcode, data[start:end])

    def add(self, opcode: int, content: bytes) -> None:
        """Take one schema or channel record; a broken one is left out."""
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas.setdefault(schema.id, schema)
            else:
                channel = Channel.read(stream)
                self.channels.setdefault(channel.id, channel)
        except (McapError, struct.error, ValueError, OverflowError):
            return

    def connections(self) -> dict[int, Connection]:
        """Return the connections by channel id."""
        return {key: self._connection(channel) for key, channel in self.channels.items()}

    def _connection(self, channel: Channel) -> Connection:
        from rosbags.typesys.msg import normalize_msgtype

        schema = self.schemas.get(channel.schema_id)
        if schema is None:
            return Connection(channel.topic, "", channel.message_encoding)
        form = _FORMATS.get(schema.encoding, "")
        text = schema.data.decode(errors="replace") if form else ""
        name = normalize_msgtype(schema.name) if schema.encoding == "ros1msg" else schema.name
        return Connection(channel.topic, name, channel.message_encoding, text, form if text else "")


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the whole records of a chunk's content.

    No record is empty: a chunk of zeros is not worth walking through.
    """
    position = 0
    for _ in range(MOST_RECORDS):
        if position + HEAD_BYTES > len(data):
            return
        opcode, length = _HEAD.unpack_from(data, position)
        start = position + HEAD_BYTES
        position = start + length
        if position > len(data) or not opcode or not length:
            return
        yield opcode, start, position


def message_entries(data: bytes) -> tuple[list[Entry], bool]:
    """Return the messages of a chunk in file order, and whether no record breaks off."""
    entries: list[Entry] = []
    position, size = 0, len(data)
    head, message = _HEAD.unpack_from, _MESSAGE.unpack_from
    for _ in range(MOST_RECORDS):
        if position + HEAD_BYTES > size:
            return entries, position == size
        opcode, length = head(data, position)
        start = position + HEAD_BYTES
        position = start + length
        if position > size or not opcode or not length:
            return entries, False
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE.size:
                return entries, False
            key, _, log_time_ns, _ = message(data, start)
            entries.append((log_time_ns, key, start + _MESSAGE.size, position))
    return entries, False


def message_head(data: bytes | memoryview, payload_start: int) -> tuple[int, int]:
    """Return sequence and publish time (ns) of the message whose payload begins there."""
    _, sequence, _, publish_ns = _MESSAGE.unpack_from(data, payload_start - _MESSAGE.size)
    return sequence, publish_ns


def read_head(file: BinaryIO, offset: int) -> tuple[int, int] | None:
    """Return opcode and end of the record at an offset, or None at the end of the file."""
    if offset > _LAST_OFFSET:
        return None
    file.seek(offset)
    head = file.read(HEAD_BYTES)
    if len(head) < HEAD_BYTES:
        return None
    opcode, length = _HEAD.unpack(head)
    return opcode, offset + HEAD_BYTES + length


def read_chunk_head(file: BinaryIO, offset: int) -> ChunkHead:
    """Return the fixed part of the chunk at an offset.

    Raises:
        ChunkError: If there is no sound chunk record.
    """
    file.seek(offset)
    data = file.read(HEAD_BYTES + _CHUNK.size + 32 + 8)
    try:
        opcode, length = _HEAD.unpack_from(data)
        _, _, size, crc, name_size = _CHUNK.unpack_from(data, HEAD_BYTES)
        start = HEAD_BYTES + _CHUNK.size + name_size
        (data_size,) = struct.unpack_from("<Q", data, start)
        name = data[HEAD_BYTES + _CHUNK.size : start].decode("ascii")
    except (struct.error, ValueError) as error:
        raise ChunkError("whose record is damaged") from error
    # The record states its length twice; this makes a find by pattern certain.
    if opcode != Opcode.CHUNK or name_size > 32 or length != start + 8 - HEAD_BYTES + data_size:
        raise ChunkError("whose record is damaged")
    return ChunkHead(size, crc, name, offset + start + 8, data_size)


def find_chunk(file: BinaryIO, offset: int, file_size: int) -> int | None:
    """Return where the next whole chunk record begins at or after an offset, or None."""
    pattern = re.compile(rb"\x06.{5}\x00\x00\x00", re.DOTALL)
    while offset < file_size:
        file.seek(offset)
        block = file.read(_BLOCK_BYTES)
        for match in pattern.finditer(block):
            try:
                head = read_chunk_head(file, offset + match.start())
            except ChunkError:
                continue
            if head.data_start + head.data_size <= file_size:
                return offset + match.start()
        offset += len(block) - 8 if len(block) == _BLOCK_BYTES else len(block)
    return None
