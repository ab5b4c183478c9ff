"""Records of ROS 1 bags, format version 2.0.

Source: the bag format as documented on the ROS wiki (Bags/Format/2.0). A record is
`u32 header_length, fields, u32 data_length, data`, and a field is `u32 length, name=value`.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import BinaryIO

from percept.datasets.formats.chunks import MOST_RECORDS, ChunkError, Entry
from percept.datasets.messages import Connection

__all__ = [
    "BAG_HEADER",
    "CHUNK",
    "CHUNK_INFO",
    "CONNECTION",
    "INDEX",
    "MAGIC",
    "MESSAGE",
    "BagConnection",
    "Head",
    "connections_in",
    "find_chunk",
    "message_entries",
    "parse_fields",
    "read_head",
    "time_ns",
]

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")
_LONGEST_HEADER = 1 << 20
_BLOCK_BYTES = 1 << 22


@dataclass(frozen=True, slots=True)
class Head:
    """The head of one record in a file.

    Attributes:
        op: Kind of record.
        fields: Its header fields.
        data_start: Position of its data.
        data_size: Size of its data.
    """

    op: int
    fields: dict[bytes, bytes]
    data_start: int
    data_size: int

    @property
    def end(self) -> int:
        """Position after the record."""
        return self.data_start + self.data_size


@dataclass(frozen=True, slots=True)
class BagConnection:
    """A connection with what only ROS 1 bags say of it.

    Attributes:
        connection: What all formats have.
        md5sum: Checksum of the definition.
        callerid: Name of the publishing node, or None.
        latching: 1 for a latched topic, 0 for others, None where it is not stated.
    """

    connection: Connection
    md5sum: str
    callerid: str | None
    latching: int | None


def parse_fields(header: bytes) -> dict[bytes, bytes]:
    """Return the fields of a record header.

    Raises:
        ChunkError: If the header is no list of fields.
    """
    fields = {}
    position = 0
    while position < len(header):
        start = position + 4
        if start > len(header):
            raise ChunkError("with broken records")
        position = start + _U32.unpack_from(header, start - 4)[0]
        name, separator, value = header[start:position].partition(b"=")
        if not separator or position > len(header):
            raise ChunkError("with broken records")
        fields[name] = value
    return fields


def read_head(file: BinaryIO, offset: int) -> Head | None:
    """Return the head of the record at an offset, or None where no sound head is."""
    file.seek(offset)
    prefix = file.read(4)
    size = _U32.unpack(prefix)[0] if len(prefix) == 4 else 0
    if not 0 < size <= _LONGEST_HEADER:
        return None
    header = file.read(size + 4)
    if len(header) != size + 4:
        return None
    try:
        fields = parse_fields(header[:size])
    except ChunkError:
        return None
    if len(fields.get(b"op", b"")) != 1:
        return None
    return Head(fields[b"op"][0], fields, offset + 8 + size, _U32.unpack(header[size:])[0])


def find_chunk(file: BinaryIO, offset: int, file_size: int) -> int | None:
    """Return where the next sound chunk record begins at or after an offset, or None."""
    while offset < file_size:
        file.seek(offset)
        block = file.read(_BLOCK_BYTES)
        for match in re.finditer(rb"op=\x05|compression=", block):
            for back in range(match.start() - 4, max(match.start() - 64, 3), -1):
                if _is_header_start(block, back):
                    start = offset + back - 4
                    head = read_head(file, start)
                    if head and head.op == CHUNK and head.end <= file_size:
                        return start
        offset += max(len(block) - 128, 1) if len(block) == _BLOCK_BYTES else len(block)
    return None


def _is_header_start(block: bytes, position: int) -> bool:
    """Return whether the bytes before a position state a chunk header's likely length."""
    size = _U32.unpack_from(block, position - 4)[0]
    first = _U32.unpack_from(block, position)[0] if position + 4 <= len(block) else 0
    return 30 <= size <= 128 and 4 <= first <= 32


def time_ns(value: bytes) -> int:
    """Return a bag time (u32 seconds, u32 nanoseconds) in ns.

    Raises:
        ChunkError: If it is no time.
    """
    if len(value) != 8:
        raise ChunkError("with broken records")
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds * 1_000_000_000 + nanoseconds)


def _records(data: bytes, start: int) -> tuple[dict[bytes, bytes], int, int]:
    """Return fields, start and end of the data of the record at a position of a chunk.

    Raises:
        ChunkError: If there is no whole record.
    """
    try:
        header_end = start + 4 + _U32.unpack_from(data, start)[0]
        end = header_end + 4 + _U32.unpack_from(data, header_end)[0]
    except struct.error as error:
        raise ChunkError("with broken records") from error
    if end > len(data):
        raise ChunkError("with broken records")
    return parse_fields(data[start + 4 : header_end]), header_end + 4, end


def message_entries(data: bytes) -> tuple[list[Entry], bool]:
    """Return the messages of a chunk in file order, and whether no record breaks off."""
    entries: list[Entry] = []
    position = 0
    try:
        for _ in range(MOST_RECORDS):
            if position >= len(data):
                return entries, True
            fields, start, position = _records(data, position)
            op = fields.get(b"op")
            if op == b"\x02":
                key = _U32.unpack(fields[b"conn"])[0]
                entries.append((time_ns(fields[b"time"]), key, start, position))
            elif op != b"\x07":
                return entries, False
    except (ChunkError, KeyError, struct.error):
        pass
    return entries, False


def connections_in(data: bytes) -> dict[int, BagConnection]:
    """Return the connections that the records of a chunk, or of an index, declare."""
    found: dict[int, BagConnection] = {}
    position = 0
    try:
        for _ in range(MOST_RECORDS):
            if position >= len(data):
                return found
            fields, start, position = _records(data, position)
            op = fields.get(b"op")
            if op == b"\x07":
                key = _U32.unpack(fields[b"conn"])[0]
                found[key] = _connection(fields[b"topic"], parse_fields(data[start:position]))
            elif op != b"\x02":
                # Not to walk through a chunk of zeros.
                return found
    except (ChunkError, KeyError, ValueError, struct.error):
        return found
    return found


def _connection(topic: bytes, fields: dict[bytes, bytes]) -> BagConnection:
    from rosbags.typesys.msg import normalize_msgtype

    name = topic.decode()
    name = "/" * name.startswith("/") + "/".join(part for part in name.split("/") if part)
    msgtype = normalize_msgtype(fields[b"type"].decode())
    definition = fields[b"message_definition"].decode(errors="replace")
    latching = fields.get(b"latching", b"").decode()
    callerid = fields.get(b"callerid")
    return BagConnection(
        Connection(name, msgtype, "ros1", definition, "msg" if definition else ""),
        fields[b"md5sum"].decode(),
        None if callerid is None else callerid.decode(),
        int(latching) if latching.isdecimal() else None,
    )
