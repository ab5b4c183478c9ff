"""What a person decided, in one SQLite file beside the run.

Decisions are only ever added: the last one of a finding counts, and those before it are its
history. Each has a number that rises over all findings, its revision, by which a page knows
whether what it shows is still so. A decision is on the disk when `decide` returns.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Self

from percept.core.errors import InputError, UsageError
from percept.core.map_findings import Decision, Kind, Status

__all__ = ["ConflictError", "Entry", "ReviewStore", "read_decisions", "read_entries"]

_APPLICATION_ID = 0x50435256  # "PCRV"
_VERSION = 1
_TABLE = """
CREATE TABLE decisions (
    revision INTEGER PRIMARY KEY AUTOINCREMENT,
    finding_id TEXT NOT NULL,
    status TEXT NOT NULL,
    comment TEXT NOT NULL,
    kind TEXT NOT NULL,
    map_element_id INTEGER NOT NULL,
    along_m REAL NOT NULL,
    length_m REAL NOT NULL,
    x_m REAL NOT NULL,
    y_m REAL NOT NULL,
    offset_m REAL,
    decided_at TEXT NOT NULL
)
"""
_LATEST = (
    "SELECT * FROM decisions WHERE revision IN "
    "(SELECT max(revision) FROM decisions GROUP BY finding_id) AND revision > ? ORDER BY revision"
)
_HISTORY = "SELECT * FROM decisions WHERE finding_id = ? ORDER BY revision"
_INSERT = (
    "INSERT INTO decisions (finding_id, status, comment, kind, map_element_id, along_m, length_m,"
    " x_m, y_m, offset_m, decided_at) VALUES (:finding_id, :status, :comment, :kind,"
    " :map_element_id, :along_m, :length_m, :x_m, :y_m, :offset_m, :decided_at)"
)


@dataclass(frozen=True, slots=True)
class Entry:
    """One decision of the history.

    Attributes:
        revision: Its number, rising over all findings from 1.
        decided_at: When it was made, ISO 8601 in UTC.
        decision: What was decided; the status `open` takes an earlier one back.
    """

    revision: int
    decided_at: str
    decision: Decision


class ConflictError(Exception):
    """A finding was decided meanwhile, elsewhere.

    Attributes:
        current: How it stands now; None if it was never decided.
    """

    def __init__(self, current: Entry | None) -> None:
        super().__init__("the finding was decided meanwhile")
        self.current = current


class ReviewStore:
    """Decisions in a file that is made when it does not exist; a context manager.

    Threads and processes may share the file.

    Args:
        path: The SQLite file.

    Raises:
        InputError: If the file is damaged or no store of decisions.
        UsageError: If it can be neither made nor written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = Lock()
        with _explained(path):
            self._database = sqlite3.connect(
                path, timeout=10, isolation_level=None, check_same_thread=False
            )
            try:
                self._prepare()
            except BaseException:
                self._database.close()
                raise

    def _prepare(self) -> None:
        with self._transaction("DEFERRED"):  # one look: another process may be making it
            made = _check(self._database, self.path)
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute("PRAGMA synchronous = FULL")
        if not made:
            self._make_tables()

    def _make_tables(self) -> None:
        with self._transaction():
            if not _check(self._database, self.path):  # another may have been faster
                self._database.execute(_TABLE)
                self._database.execute("CREATE INDEX of_finding ON decisions (finding_id)")
                self._database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                self._database.execute(f"PRAGMA user_version = {_VERSION}")

    @contextmanager
    def _transaction(self, kind: str = "IMMEDIATE") -> Iterator[None]:
        """Hold the right to write; all that the block does is on the disk after it, or nothing."""
        self._database.execute(f"BEGIN {kind}")
        try:
            yield
            self._database.execute("COMMIT")
        except BaseException:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise

    def decide(self, decision: Decision, *, after: int | None = None) -> Entry:
        """Add a decision; it is on the disk when this returns.

        Args:
            decision: What was decided. The status `open` takes an earlier decision back.
            after: Revision of the finding that the person saw, 0 if none: the decision is
                refused where a later one exists. None adds it whatever there is.

        Returns:
            The decision as it stands in the history.

        Raises:
            ConflictError: If the finding has been decided since `after`.
            UsageError: If the file cannot be written.
        """
        values = asdict(decision)
        values["decided_at"] = datetime.now(UTC).isoformat(timespec="milliseconds")
        # SQLite stores NaN as NULL, which is what the column allows.
        with self._lock, _explained(self.path):
            with self._transaction():
                known = self._entries(_HISTORY, decision.finding_id)
                last = known[-1] if known else None
                if after is not None and after != (last.revision if last else 0):
                    raise ConflictError(last)
                revision = self._database.execute(_INSERT, values).lastrowid
            return Entry(revision or 0, values["decided_at"], decision)

    def latest(self, *, since: int = 0) -> list[Entry]:
        """Return the last entry of each finding, if its revision is after `since`."""
        with self._lock, _explained(self.path):
            return self._entries(_LATEST, since)

    def history(self, finding_id: str) -> list[Entry]:
        """Return all entries of a finding, the oldest first."""
        with self._lock, _explained(self.path):
            return self._entries(_HISTORY, finding_id)

    def decisions(self) -> list[Decision]:
        """Return what counts of each finding; one that was taken back is not among them."""
        return _counting(self.latest())

    def _entries(self, query: str, value: int | str) -> list[Entry]:
        return [_entry(row) for row in self._database.execute(query, (value,))]

    def close(self) -> None:
        """Bring everything into the one file, and let it go."""
        with self._lock:
            self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def read_decisions(path: Path) -> list[Decision]:
    """Return what counts of each finding, and change nothing at the file.

    Raises:
        InputError: If there is no such file, it is damaged, or it is no store of decisions.
    """
    return _counting(read_entries(path))


def read_entries(path: Path) -> list[Entry]:
    """Return the last entry of each finding, and change nothing at the file.

    Raises:
        InputError: As `read_decisions`.
    """
    if not path.is_file():
        raise InputError("there are no decisions", where=path, remedy=_WHERE_FROM)
    # Without a log beside it the file is complete, and may lie where nothing can be written.
    complete = not path.with_name(f"{path.name}-wal").exists()
    address = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if complete else ''}"
    with _explained(path), closing(sqlite3.connect(address, uri=True, timeout=10)) as database:
        if not _check(database, path):
            raise InputError("is no store of decisions", where=path, remedy=_WHERE_FROM)
        return [_entry(row) for row in database.execute(_LATEST, (0,))]


_WHERE_FROM = "Give the review.sqlite that `percept map review` made"


def _check(database: sqlite3.Connection, path: Path) -> bool:
    """Return whether a file holds decisions; False for one that is still empty.

    Raises:
        InputError: If it is damaged or holds something else.
    """
    (identity,) = database.execute("PRAGMA application_id").fetchone()
    (version,) = database.execute("PRAGMA user_version").fetchone()
    (tables,) = database.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if not identity and not tables:
        return False
    if identity != _APPLICATION_ID:
        raise InputError(
            "is a database, and no store of decisions",
            where=path,
            remedy="Move it away; the review makes one of its own there",
        )
    if version != _VERSION:
        raise InputError(
            f"was written by another version of percept (format {version}, not {_VERSION})",
            where=path,
        )
    (sound,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if sound != "ok":
        raise _damaged(path, sound)
    return True


def _damaged(path: Path, reason: object) -> InputError:
    return InputError(
        f"is damaged ({' '.join(str(reason).split())})",
        where=path,
        remedy="Bring it back from a copy, or move it away to begin anew",
    )


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Translate what SQLite ends with."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise UsageError(
            f"cannot be read or written ({error})",
            where=path,
            remedy="Look at the rights of the folder and at the room on the disk",
        ) from error
    except sqlite3.DatabaseError as error:
        raise _damaged(path, error) from error


def _entry(row: tuple[object, ...]) -> Entry:
    revision, finding_id, status, comment, kind, element, *places, offset, decided_at = row
    along, length, x, y = (float(str(value)) for value in places)
    decision = Decision(
        finding_id=str(finding_id),
        status=Status(str(status)),
        comment=str(comment),
        kind=Kind(str(kind)),
        map_element_id=int(str(element)),
        along_m=along,
        length_m=length,
        x_m=x,
        y_m=y,
        offset_m=float("nan") if offset is None else float(str(offset)),
    )
    return Entry(int(str(revision)), str(decided_at), decision)


def _counting(entries: list[Entry]) -> list[Decision]:
    return [entry.decision for entry in entries if entry.decision.status is not Status.OPEN]
