"""Reads the pages of a damaged SQLite file one by one, as the SQLite library will not.

Source: the SQLite file format (sqlite.org/fileformat2.html), sections 1.3 (header), 1.6
(b-tree pages), 1.7 (overflow pages), 2.1 (records). A row is found by the leaf page that holds
it, so that a lost inner page loses no rows. An overflow page cannot pass for a leaf: its first
byte is the top of a page number, and 0x0D there would need a file of 2**27 pages and more.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

__all__ = ["MAGIC", "Cell", "Row", "SqlitePages", "Value"]

MAGIC = b"SQLite format 3\0"
Value: TypeAlias = int | float | str | bytes | None
Row: TypeAlias = tuple[int, tuple[Value, ...]]

_INNER, _LEAF = 5, 13
_INTEGER_BYTES = (0, 1, 2, 3, 4, 6, 8)
_ENCODINGS = {2: "utf-16-le", 3: "utf-16-be"}


class _DamagedError(Exception):
    """A page, a record or an overflow chain that is not whole."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One row on a leaf page.

    Attributes:
        page: Number of the page, from 1.
        index: Number of the cell on it.
        rowid: Key of the row.
        head: Values in front of the last column, which alone may be large.
        whole: Whether the last column can be read too.
    """

    page: int
    index: int
    rowid: int
    head: tuple[Value, ...]
    whole: bool


class SqlitePages:
    """The pages of one file.

    Args:
        path: The file; it is only read.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        header = self._file.read(100).ljust(100, b"\0")
        stated = int.from_bytes(header[16:18], "big")
        self.page_size = 65536 if stated == 1 else stated
        self.sound = self.page_size >= 512 and self.page_size & (self.page_size - 1) == 0
        self._usable = self.page_size - header[20]
        self._encoding = _ENCODINGS.get(int.from_bytes(header[56:60], "big"), "utf-8")
        size = path.stat().st_size
        self.page_count = size // self.page_size if self.sound else 0
        self.lost_pages = max(int.from_bytes(header[28:32], "big") - self.page_count, 0)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def tables(self) -> dict[str, int]:
        """Return the root page of each table by name."""
        found = {}
        for _, values in self.rows(1):
            if len(values) >= 4 and values[0] == "table" and isinstance(values[3], int):
                found[str(values[1])] = values[3]
        return found

    def rows(self, root: int) -> Iterator[Row]:
        """Yield the rows of a small table as far as its pages can be read."""
        waiting, seen = [root], set()
        while waiting:
            number = waiting.pop()
            if number in seen or not 1 <= number <= self.page_count:
                continue
            seen.add(number)
            try:
                page = self._page(number)
                if page[self._start(number)] == _INNER:
                    waiting.extend(reversed(self._children(number, page)))
                    continue
                yield from self._whole_rows(number, page)
            except (_DamagedError, IndexError, struct.error):
                continue

    def _whole_rows(self, number: int, page: bytes) -> Iterator[Row]:
        for position in self._cell_positions(number, page):
            try:
                rowid, payload = self._payload(page, position, None)
                yield rowid, self._values(payload, len(payload))
            except (_DamagedError, IndexError, struct.error):
                continue

    def cells(self, columns: int) -> Iterator[Cell]:
        """Yield the rows of all leaf pages of the file that have so many columns."""
        for number in range(1, self.page_count + 1):
            page = self._page(number)
            if page[self._start(number)] != _LEAF:
                continue
            try:
                positions = self._cell_positions(number, page)
            except (_DamagedError, struct.error):
                continue
            for index, position in enumerate(positions):
                cell = self._cell(number, index, page, position, columns)
                if cell is not None:
                    yield cell

    def _cell(
        self, number: int, index: int, page: bytes, position: int, columns: int
    ) -> Cell | None:
        try:
            rowid, local = self._payload(page, position, 0)
            head = self._values(local, 0)[: columns - 1]
            if self._column_count(local) != columns:
                return None
        except (_DamagedError, IndexError, struct.error):
            return None
        try:
            self._check_chain(page, position)
        except (_DamagedError, struct.error):
            return Cell(number, index, rowid, head, whole=False)
        return Cell(number, index, rowid, head, whole=True)

    def last_value(self, page_number: int, index: int) -> Value:
        """Return the last column of a row, or None where its bytes contradict each other."""
        page = self._page(page_number)
        try:
            position = self._cell_positions(page_number, page)[index]
            _, payload = self._payload(page, position, None)
            return self._values(payload, len(payload))[-1]
        except (_DamagedError, IndexError, struct.error):
            return None

    def _page(self, number: int) -> bytes:
        self._file.seek((number - 1) * self.page_size)
        return self._file.read(self.page_size)

    @staticmethod
    def _start(number: int) -> int:
        return 100 if number == 1 else 0

    def _cell_positions(self, number: int, page: bytes) -> tuple[int, ...]:
        start = self._start(number)
        count = int.from_bytes(page[start + 3 : start + 5], "big")
        array = start + (12 if page[start] == _INNER else 8)
        if array + 2 * count > self._usable:
            raise _DamagedError
        positions: tuple[int, ...] = struct.unpack_from(f">{count}H", page, array)
        return positions

    def _children(self, number: int, page: bytes) -> list[int]:
        start = self._start(number)
        cells = self._cell_positions(number, page)
        children = [int.from_bytes(page[position : position + 4], "big") for position in cells]
        return [*children, int.from_bytes(page[start + 8 : start + 12], "big")]

    def _spans(self, page: bytes, position: int) -> tuple[int, int, int, int, int]:
        """Return rowid, payload size, local start and end, and the first overflow page."""
        size, position = _varint(page, position)
        rowid, position = _varint(page, position)
        longest = self._usable - 35
        if size <= longest:
            local, overflow = size, 0
        else:
            least = (self._usable - 12) * 32 // 255 - 23
            local = least + (size - least) % (self._usable - 4)
            local = local if local <= longest else least
            end = position + local
            overflow = int.from_bytes(page[end : end + 4], "big")
        if (
            position + local > self._usable
            or size > (self.page_count + self.lost_pages) * self.page_size
        ):
            raise _DamagedError
        rowid = rowid - (1 << 64) if rowid >= 1 << 63 else rowid
        return rowid, size, position, position + local, overflow

    def _payload(self, page: bytes, position: int, limit: int | None) -> tuple[int, bytes]:
        """Return rowid and payload; with a limit, what of it lies on the leaf page."""
        rowid, size, start, end, overflow = self._spans(page, position)
        parts = [page[start:end]]
        if limit is None:
            left = size - (end - start)
            while left > 0:
                overflow, part = self._overflow(overflow, left)
                parts.append(part)
                left -= len(part)
        return rowid, b"".join(parts)

    def _overflow(self, number: int, left: int) -> tuple[int, bytes]:
        if not 2 <= number <= self.page_count:
            raise _DamagedError
        page = self._page(number)
        return int.from_bytes(page[:4], "big"), page[4 : min(self._usable, 4 + left)]

    def _check_chain(self, page: bytes, position: int) -> None:
        """Follow an overflow chain without reading its content."""
        _, size, start, end, number = self._spans(page, position)
        left = size - (end - start)
        while left > 0:
            if not 2 <= number <= self.page_count:
                raise _DamagedError
            self._file.seek((number - 1) * self.page_size)
            number = int.from_bytes(self._file.read(4), "big")
            left -= self._usable - 4

    @staticmethod
    def _column_count(payload: bytes) -> int:
        header_size, position = _varint(payload, 0)
        count = 0
        while position < header_size:
            _, position = _varint(payload, position)
            count += 1
        return count

    def _values(self, payload: bytes, size: int) -> tuple[Value, ...]:
        """Return the columns of a record that lie within its bytes.

        Args:
            payload: The record, or its beginning.
            size: Bytes that must be there; 0 where the beginning will do.
        """
        header_size, position = _varint(payload, 0)
        start = header_size
        values: list[Value] = []
        while position < header_size:
            kind, position = _varint(payload, position)
            end = start + _stored_bytes(kind)
            if end > len(payload):
                if size:
                    raise _DamagedError
                break
            values.append(self._value(kind, payload[start:end]))
            start = end
        return tuple(values)

    def _value(self, kind: int, data: bytes) -> Value:
        if kind == 0:
            return None
        if kind <= 6:
            return int.from_bytes(data, "big", signed=True)
        if kind == 7:
            return float(struct.unpack(">d", data)[0])
        if kind <= 9:
            return kind - 8
        return data if kind % 2 == 0 else data.decode(self._encoding, errors="replace")


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """Return a variable-length integer (section 1.6) and the position after it."""
    value = 0
    for index in range(8):
        byte = data[position + index]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, position + index + 1
    return value << 8 | data[position + 8], position + 9


def _stored_bytes(kind: int) -> int:
    """Return the size of a value by its serial type (section 2.1)."""
    if kind <= 6:
        return _INTEGER_BYTES[kind]
    if kind >= 12:
        return (kind - 12) // 2
    if kind in (10, 11):
        raise _DamagedError
    return 8 if kind == 7 else 0
