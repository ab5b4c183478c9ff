"""rosbag2's sqlite3 files (.db3), schema versions 1 to 4, sound, with a write-ahead log, damaged.

A sound file is read by SQLite, opened immutable so that nothing is ever created beside it.
One with a write-ahead log is read from a temporary copy, because SQLite must write to merge it.
A damaged one is read page by page (`SqlitePages`); the same happens from the place where SQLite
gives up on a file that it has opened.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import RecordingError
from percept.datasets.formats.chunks import DAMAGED_MAGIC, raw_message
from percept.datasets.formats.sqlite_pages import Row, SqlitePages
from percept.datasets.messages import NO_CHECKSUMS, Connection, RawMessage

__all__ = ["Sqlite3Source", "has_log_tables"]

_FORMATS = {"ros2msg": "msg", "ros2idl": "idl"}
_ROW = np.dtype([("time", "i8"), ("rowid", "i8"), ("topic", "i8"), ("page", "u4"), ("cell", "u2")])
_MESSAGE_COLUMNS = 4
_TABLES = {"topics", "messages"}
# Of a damaged schema SQLite quotes bytes that are no text.
_UNREADABLE = (sqlite3.DatabaseError, UnicodeDecodeError)


def has_log_tables(path: Path) -> bool:
    """Return whether a file holds the tables of a rosbag2 log, whatever it begins with."""
    with contextlib.closing(SqlitePages(path)) as pages:
        return pages.sound and pages.tables().keys() >= _TABLES


class Sqlite3Source:
    """A `MessageSource` over one .db3 file.

    Args:
        path: The file.

    Raises:
        RecordingError: If it is no rosbag2 file, or not even its list of topics can be read.
    """

    format: str = "sqlite3"

    def __init__(self, path: Path) -> None:
        self.paths: tuple[Path, ...] = (path,)
        self.losses: Counter[str] = Counter()
        self.notes: tuple[str, ...] = (NO_CHECKSUMS,)
        self.counts: dict[str, int] = {}
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.by_id: dict[int, Connection] = {}
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._readable = self._merged_copy(path)
        self._pages: SqlitePages | None = None
        self._rows: NDArray[np.void] = np.empty(0, _ROW)
        self._database: sqlite3.Connection | None = None
        try:
            self._open_sound()
        except _UNREADABLE:
            self._open_damaged()
        self.connections: tuple[Connection, ...] = tuple(
            sorted(dict.fromkeys(self.by_id.values()), key=lambda c: (c.topic, c.msgtype))
        )

    def _merged_copy(self, path: Path) -> Path:
        """Return the path itself, or a copy where a write-ahead log must be merged."""
        log = path.with_name(path.name + "-wal")
        if not log.is_file() or not log.stat().st_size:
            return path
        self._temporary = tempfile.TemporaryDirectory(prefix="percept-")
        copy = Path(self._temporary.name) / path.name
        shutil.copyfile(path, copy)
        shutil.copyfile(log, copy.with_name(copy.name + "-wal"))
        try:
            database = sqlite3.connect(copy)
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.close()
        except _UNREADABLE:
            self.losses["write-ahead logs that cannot be merged"] += 1
            shutil.copyfile(path, copy)
        return copy

    def _open_sound(self) -> None:
        address = f"file:{quote(str(self._readable.absolute()))}?mode=ro&immutable=1"
        self._database = sqlite3.connect(address, uri=True, check_same_thread=False)
        self._check_size()
        names = {row[0] for row in self._database.execute("SELECT name FROM sqlite_master")}
        self._require_tables(names)
        texts = {}
        if "message_definitions" in names:
            texts = _definitions(self._database.execute("SELECT * FROM message_definitions"))
        self.by_id = _connections(self._database.execute("SELECT * FROM topics"), texts)
        self.counts = {connection.topic: 0 for connection in self.by_id.values()}
        query = "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages GROUP BY 1"
        groups = self._database.execute(query).fetchall()
        # SQLite counts in the index on the time; a damaged page hides rows without an error.
        (total,) = self._database.execute("SELECT COUNT(*) FROM messages").fetchone()
        if total != sum(group[1] for group in groups):
            raise sqlite3.DatabaseError("table and index differ")
        for key, count, first, last in groups:
            _require_numbers(key, first, last)
            self._count(key, count, first, last)

    def _count(self, key: int, count: int, first: int, last: int) -> None:
        if key not in self.by_id:
            self.losses["messages of unknown topics"] += count
            return
        self.counts[self.by_id[key].topic] += count
        self.start_ns = first if self.start_ns is None else min(self.start_ns, first)
        self.end_ns = last if self.end_ns is None else max(self.end_ns, last)

    def _check_size(self) -> None:
        """Refuse a file that is shorter than its header states; SQLite may notice too late."""
        pages = SqlitePages(self._readable)
        pages.close()
        if not pages.sound or pages.size < pages.stated_size:
            raise sqlite3.DatabaseError("the file is cut")

    def _require_tables(self, names: Collection[str]) -> None:
        if not set(names) >= _TABLES:
            self.close()
            raise RecordingError(
                "an SQLite file without the tables of a rosbag2 log",
                where=self.paths[0],
                remedy="Give a .db3 that `ros2 bag record` has written",
            )

    def _open_damaged(self) -> None:
        """List what the pages hold, in place of SQLite."""
        if self._database is not None:
            self._database.close()
            self._database = None
        self._pages = SqlitePages(self._readable)
        tables = self._pages.tables()
        topics = list(self._pages.rows(tables["topics"])) if "topics" in tables else []
        if not topics:
            self.close()
            raise RecordingError(
                "a damaged SQLite file in which the list of topics is lost",
                where=self.paths[0],
                remedy="Nothing can be read without it; use another copy of the log",
            )
        root = tables.get("message_definitions")
        rows = [] if root is None else [(key, *v[1:]) for key, v in self._pages.rows(root)]
        self.by_id = _connections(((key, *v[1:]) for key, v in topics), _definitions(rows))
        self.counts = {connection.topic: 0 for connection in self.by_id.values()}
        self.start_ns = self.end_ns = None
        self._rows = self._list_rows(self._pages)
        if not self._pages.has_magic:
            self.losses[DAMAGED_MAGIC] += 1
        self._count_rows()

    def _list_rows(self, pages: SqlitePages) -> NDArray[np.void]:
        """Return place and time of all whole messages, by time; count what is lost."""
        found = np.fromiter(self._whole_messages(pages), _ROW)
        _, first = np.unique(found["rowid"], return_index=True)
        found = found[np.sort(first)]
        missing_bytes = pages.stated_size - pages.size
        if missing_bytes >= pages.page_size and pages.reach <= pages.page_count:
            # Nothing in the file points behind its end: then nothing was ever there.
            self.losses["files whose header states a wrong number of pages"] += 1
        elif missing_bytes > 0:
            self.losses["bytes missing, of those that the file header states"] += missing_bytes
        else:
            self.losses["files that are damaged; read page by page"] += 1
        last = pages.highest_rowid("messages")
        last = max(last, int(found["rowid"].max()) if len(found) else 0)
        missing = last - len(found) - self.losses["messages whose payload is lost"]
        if missing > 0:
            self.losses["messages missing, at least, by the numbers that the file has"] += missing
        return found[np.argsort(found, order=("time", "rowid"))]

    def _whole_messages(self, pages: SqlitePages) -> Iterator[tuple[int, int, int, int, int]]:
        for cell in pages.cells(_MESSAGE_COLUMNS):
            key, log_time_ns = cell.head[1:3] if len(cell.head) >= 3 else (None, None)
            if not isinstance(key, int) or not isinstance(log_time_ns, int):
                continue
            if cell.head[0] is not None or key not in self.by_id:
                continue
            if cell.whole:
                yield log_time_ns, cell.rowid, key, cell.page, cell.index
            else:
                self.losses["messages whose payload is lost"] += 1

    def _count_rows(self) -> None:
        for key in np.unique(self._rows["topic"]):
            times = self._rows["time"][self._rows["topic"] == key]
            self._count(int(key), len(times), int(times.min()), int(times.max()))

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages in log-time order; see `MessageSource.messages`."""
        for key, log_time_ns, data in self.stored(topics, start_ns, end_ns):
            raw = raw_message(self.by_id[key], log_time_ns, data, self.losses)
            if raw is not None:
                yield raw

    def stored(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield topic id, log time and payload as stored, that is still compressed."""
        wanted = {k for k, c in self.by_id.items() if topics is None or c.topic in topics}
        first = -(2**63) if start_ns is None else max(start_ns, -(2**63))
        last = 2**63 - 1 if end_ns is None else min(end_ns, 2**63 - 1)
        done, given = (first, -(2**63)), 0
        if self._pages is None:
            try:
                for rowid, key, log_time_ns, data in self._select(wanted, first, last):
                    if (log_time_ns, rowid) <= done:
                        raise sqlite3.DatabaseError("the index on the time is damaged")
                    done, given = (log_time_ns, rowid), given + 1
                    if isinstance(data, bytes):
                        yield key, log_time_ns, data
                    else:
                        self.losses["messages whose payload is lost"] += 1
                if start_ns is None and end_ns is None and given != self._count_of(wanted):
                    raise sqlite3.DatabaseError("the index on the time is damaged")
            except _UNREADABLE:
                self._open_damaged()
        if self._pages is not None:
            rows = self._rows[(self._rows["time"] >= first) & (self._rows["time"] <= last)]
            rows = rows[np.isin(rows["topic"], list(wanted))]
            same_time = rows["time"] == done[0]
            before = (rows["time"] < done[0]) | (same_time & (rows["rowid"] <= done[1]))
            if given and before.sum() > given:
                self.losses["messages that a damaged index hides"] += int(before.sum()) - given
            yield from self._carved(self._pages, rows[~before])

    def _count_of(self, wanted: Collection[int]) -> int:
        return sum(self.counts[topic] for topic in {self.by_id[key].topic for key in wanted})

    def _select(
        self, wanted: Collection[int], first: int, last: int
    ) -> Iterator[tuple[int, int, int, object]]:
        if self._database is None:
            return
        marks = ",".join("?" * len(wanted))
        # Only keys are sorted where rosbag2's index on the time is missing, never payloads.
        query = f"SELECT id, topic_id, timestamp FROM messages WHERE topic_id IN ({marks})"  # noqa: S608 (marks only)
        arguments = [*wanted]
        # A bound that excludes nothing could still end the search at a damaged key.
        for operator, bound, loose in ((">=", first, -(2**63)), ("<=", last, 2**63 - 1)):
            if bound != loose:
                query += f" AND timestamp {operator} ?"
                arguments.append(bound)
        payload = self._database.cursor()
        keys = self._database.execute(query + " ORDER BY timestamp, id", arguments)
        for rowid, key, log_time_ns in keys:
            _require_numbers(key, log_time_ns)
            payload.execute("SELECT data FROM messages WHERE id = ?", (rowid,))
            row = payload.fetchone()
            yield rowid, key, log_time_ns, row[0] if row else None

    def _carved(
        self, pages: SqlitePages, rows: NDArray[np.void]
    ) -> Iterator[tuple[int, int, bytes]]:
        for row in rows:
            log_time_ns, _, key, page, cell = row.tolist()
            data = pages.last_value(page, cell)
            if isinstance(data, bytes):
                yield key, log_time_ns, data
            else:
                self.losses["messages whose payload is lost"] += 1

    def tables(self) -> Iterator[tuple[str, str, list[Row]]]:
        """Yield name, SQL text and rows of all tables and indexes; of `messages` no rows.

        Rows have their rowid in front. An index, and what cannot be read, has no rows.
        """
        kinds = ("table", "index")
        if self._pages is not None:
            for _, values in self._pages.rows(1):
                kind, name, _, root, sql = (*values, *[None] * 5)[:5]
                if kind in kinds and isinstance(root, int) and isinstance(sql, str):
                    small = kind == "table" and name != "messages"
                    yield str(name), sql, list(self._pages.rows(root)) if small else []
        elif self._database is not None:
            master = "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL"
            for kind, name, sql in self._database.execute(master).fetchall():
                if kind in kinds:
                    small = kind == "table" and name != "messages"
                    quoted = name.replace('"', '""')
                    query = f'SELECT rowid, * FROM "{quoted}"'  # noqa: S608 (quoted)
                    rows = self._database.execute(query).fetchall() if small else []
                    yield name, sql, [(row[0], row[1:]) for row in rows]

    def close(self) -> None:
        """Close the file and remove a temporary copy."""
        if self._database is not None:
            self._database.close()
        if self._pages is not None:
            self._pages.close()
        if self._temporary is not None:
            self._temporary.cleanup()


def _require_numbers(*values: object) -> None:
    """Refuse topic ids and times that are no integers: SQLite does not hold columns to types."""
    if not all(isinstance(value, int) for value in values):
        raise sqlite3.DatabaseError("a topic id or a time is no number")


def _definitions(rows: Iterable[Sequence[object]]) -> dict[str, tuple[str, str]]:
    """Return text and format by type, of rows with id, type, encoding, text, hash."""
    found = {}
    for row in rows:
        if len(row) >= 4:
            found[str(row[1])] = (str(row[3]), _FORMATS.get(str(row[2]), ""))
    return found


def _connections(
    rows: Iterable[Sequence[object]], texts: dict[str, tuple[str, str]]
) -> dict[int, Connection]:
    """Return the connections by topic id, of rows with id, name, type, format, ..."""
    found = {}
    for row in rows:
        if len(row) >= 4 and isinstance(row[0], int):
            text, form = texts.get(str(row[2]), ("", ""))
            form = form if text else ""
            found[row[0]] = Connection(str(row[1]), str(row[2]), str(row[3]), text, form)
    return found
