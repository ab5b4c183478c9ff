"""Reads the pages of a damaged SQLite file one by one, as the SQLite library will not.

Source: the SQLite file format (sqlite.org/fileformat2.html), sections 1.3 (header), 1.6
(b-tree pages), 1.7 (overflow pages), 2.1 (records). A row is found by the leaf page that holds
it, so that a lost inner page loses no rows. An overflow page cannot pass for a leaf: its first
byte is the top of a page number, and 0x0D there would need a file of 2**27 pages and more.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

__all__ = ["MAGIC", "Cell", "Row", "SqlitePages", "Value"]

MAGIC = b"SQLite format 3\0"
Value: TypeAlias = int | float | str | bytes | None
Row: TypeAlias = tuple[int, tuple[Value, ...]]

_INNER, _LEAF = 5, 13
_INNER_INDEX, _LEAF_INDEX = 2, 10
_INTEGER_BYTES = (0, 1, 2, 3, 4, 6, 8)
_ENCODINGS = {2: "utf-16-le", 3: "utf-16-be"}


# A row of rosbag2 has at least a size, a key, a header of 5 bytes, a topic and a time.
_SMALLEST_ROW = 12


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
    """The pages of one file; the last may be cut, and then holds the cells that are still whole.

    Args:
        path: The file; it is only read.

    Attributes:
        has_magic: Whether the file begins as SQLite files do.
        page_size: Bytes of a page.
        page_count: Pages in the file, one that is cut included.
        size: Bytes of the file.
        stated_size: Bytes that the file has by its header.
        reach: The highest page number that any page met so far refers to.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        header = self._file.read(100).ljust(100, b"\0")
        self.has_magic = header.startswith(MAGIC)
        stated = int.from_bytes(header[16:18], "big")
        self.page_size = 65536 if stated == 1 else stated
        self.sound = self.page_size >= 512 and self.page_size & (self.page_size - 1) == 0
        self._usable = self.page_size - header[20]
        self._encoding = _ENCODINGS.get(int.from_bytes(header[56:60], "big"), "utf-8")
        self.size = path.stat().st_size
        self.page_count = -(-self.size // self.page_size) if self.sound else 0
        self.stated_size = int.from_bytes(header[28:32], "big") * self.page_size
        self.reach = 0

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def tables(self) -> dict[str, int]:
        """Return the root page of each table by name."""
        return {name: root for kind, name, _, root in self._roots() if kind == "table"}

    def _roots(self) -> Iterator[tuple[Value, str, Value, int]]:
        """Yield kind, name, table and root page of all tables and indexes."""
        for _, values in self.rows(1):
            if len(values) >= 4 and isinstance(values[3], int):
                yield values[0], str(values[1]), values[2], values[3]

    def rows(self, root: int) -> Iterator[Row]:
        """Yield the rows of a small table as far as its pages can be read."""
        for number, page in self._tree(root):
            if page[self._start(number)] != _INNER:
                with suppress(_DamagedError, struct.error):
                    yield from self._whole_rows(number, page)

    def _tree(self, root: int) -> Iterator[tuple[int, bytes]]:
        """Yield number and content of the pages of a tree, as far as the way to them is sound."""
        waiting, seen = [root], set()
        while waiting:
            number = waiting.pop()
            if number in seen or not 1 <= number <= self.page_count:
                continue
            seen.add(number)
            page = self._page(number)
            if len(page) <= self._start(number):
                continue
            if page[self._start(number)] in (_INNER, _INNER_INDEX):
                with suppress(_DamagedError, struct.error):
                    waiting.extend(reversed(self._children(number, page)))
            yield number, page

    def highest_rowid(self, table: str) -> int:
        """Return the highest rowid of a table that inner pages and indexes still state, or 0.

        Those outlive the rows: an inner page has the highest key of each page below it, and an
        index the rowid of each row. One too high for the size of the file is not believed.
        """
        stated = [0]
        for kind, _, of, root in list(self._roots()):
            if of == table:
                read = self._inner_keys if kind == "table" else self._indexed_rowids
                stated.extend(key for n, page in self._tree(root) for key in read(n, page))
        credible = max(self.size, self.stated_size) // _SMALLEST_ROW
        return max(key for key in stated if key <= credible)

    def _inner_keys(self, number: int, page: bytes) -> Iterator[int]:
        if page[self._start(number)] == _INNER:
            with suppress(_DamagedError, IndexError, struct.error):
                for position in self._cell_positions(number, page):
                    yield _varint(page, position + 4)[0]

    def _indexed_rowids(self, number: int, page: bytes) -> Iterator[int]:
        kind = page[self._start(number)]
        if kind not in (_INNER_INDEX, _LEAF_INDEX):
            return
        with suppress(_DamagedError, IndexError, struct.error):
            for position in self._cell_positions(number, page):
                size, start = _varint(page, position + 4 * (kind == _INNER_INDEX))
                values = self._values(page[start : start + size], size)
                if values and isinstance(values[-1], int):
                    yield values[-1]

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
            self._note_reach(number, page)
            if page[self._start(number) :][:1] != bytes([_LEAF]):
                continue
            try:
                positions = self._cell_positions(number, page)
            except (_DamagedError, struct.error):
                continue
            for index, position in enumerate(positions):
                cell = self._cell(number, index, page, position, columns)
                if cell is not None:
                    yield cell

    def _note_reach(self, number: int, page: bytes) -> None:
        if page[self._start(number) :][:1] in (bytes([_INNER]), bytes([_INNER_INDEX])):
            with suppress(_DamagedError, struct.error):
                self.reach = max(self.reach, *self._children(number, page))

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
        """Return a page; the last one may be shorter than the others."""
        self._file.seek((number - 1) * self.page_size)
        return self._file.read(self.page_size)

    @staticmethod
    def _start(number: int) -> int:
        return 100 if number == 1 else 0

    def _cell_positions(self, number: int, page: bytes) -> tuple[int, ...]:
        start = self._start(number)
        count = int.from_bytes(page[start + 3 : start + 5], "big")
        if start >= len(page):
            raise _DamagedError
        array = start + (12 if page[start] in (_INNER, _INNER_INDEX) else 8)
        if array + 2 * count > min(self._usable, len(page)):
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
        fits = position + local <= min(self._usable, len(page))
        if not fits or size > max(self.size, self.stated_size):
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
        end = min(self._usable, 4 + left)
        if len(page) < end:
            raise _DamagedError
        return int.from_bytes(page[:4], "big"), page[4:end]

    def _check_chain(self, page: bytes, position: int) -> None:
        """Follow an overflow chain without reading its content."""
        _, size, start, end, number = self._spans(page, position)
        left = size - (end - start)
        while left > 0:
            self.reach = max(self.reach, number)
            start = (number - 1) * self.page_size
            if number < 2 or start + min(4 + left, self._usable) > self.size:
                raise _DamagedError
            self._file.seek(start)
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
