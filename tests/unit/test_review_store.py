"""The store of decisions: nothing is lost, nothing is written over, damage is told."""

from __future__ import annotations

import math
import sqlite3
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from percept.core.errors import InputError, UsageError
from percept.core.map_findings import Decision, Kind, Status
from percept.review import ReviewStore, read_decisions
from percept.review.store import ConflictError

_MOVED = Decision(
    finding_id="moved-12-3",
    status=Status.CONFIRMED,
    comment="",
    kind=Kind.MOVED,
    map_element_id=-(2**62),
    along_m=3.5,
    length_m=12.25,
    x_m=600_000.125,
    y_m=-4.0,
    offset_m=0.4375,
)


def test_what_was_decided_comes_back_as_it_was(tmp_path: Path) -> None:
    width = replace(_MOVED, finding_id="width", kind=Kind.LANE_WIDTH, comment="ß <script>\n'")
    with ReviewStore(tmp_path / "review.sqlite") as store:
        store.decide(_MOVED)
        store.decide(width)
        assert store.decisions() == [_MOVED, width]
    with ReviewStore(tmp_path / "review.sqlite") as store:
        assert store.decisions() == [_MOVED, width]
    assert read_decisions(tmp_path / "review.sqlite") == [_MOVED, width]
    assert [path.name for path in tmp_path.iterdir()] == ["review.sqlite"]


def test_an_offset_that_means_nothing_stays_nan(tmp_path: Path) -> None:
    with ReviewStore(tmp_path / "review.sqlite") as store:
        store.decide(replace(_MOVED, offset_m=math.nan))
        assert math.isnan(store.decisions()[0].offset_m)


def test_the_last_decision_counts_and_the_others_are_its_history(tmp_path: Path) -> None:
    with ReviewStore(tmp_path / "review.sqlite") as store:
        said = [Status.CONFIRMED, Status.REJECTED, Status.UNSURE]
        for status in said:
            store.decide(replace(_MOVED, status=status))
        store.decide(replace(_MOVED, finding_id="other"))
        assert [d.status for d in store.decisions()] == [Status.UNSURE, Status.CONFIRMED]
        history = store.history(_MOVED.finding_id)
        assert [entry.decision.status for entry in history] == said
        assert [entry.revision for entry in history] == [1, 2, 3]
        assert [entry.revision for entry in store.latest(since=3)] == [4]


def test_one_that_is_open_again_is_no_decision(tmp_path: Path) -> None:
    with ReviewStore(tmp_path / "review.sqlite") as store:
        store.decide(_MOVED)
        store.decide(replace(_MOVED, status=Status.OPEN))
        assert store.decisions() == []
        assert len(store.history(_MOVED.finding_id)) == 2
    assert read_decisions(tmp_path / "review.sqlite") == []


def test_who_has_not_seen_the_last_decision_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "review.sqlite"
    with ReviewStore(path) as one, ReviewStore(path) as two:
        first = one.decide(_MOVED, after=0)
        with pytest.raises(ConflictError) as conflict:
            two.decide(replace(_MOVED, status=Status.REJECTED), after=0)
        assert conflict.value.current is not None
        assert conflict.value.current.decision == _MOVED
        two.decide(replace(_MOVED, status=Status.REJECTED), after=first.revision)
        assert one.decisions()[0].status is Status.REJECTED
        with pytest.raises(ConflictError) as never:
            two.decide(replace(_MOVED, finding_id="never"), after=7)
        assert never.value.current is None


def test_of_many_at_once_exactly_one_wins(tmp_path: Path) -> None:
    path, results = tmp_path / "review.sqlite", []

    def attempt(number: int) -> None:
        with ReviewStore(path) as store:
            try:
                store.decide(replace(_MOVED, comment=str(number)), after=0)
                results.append(number)
            except ConflictError:
                pass

    threads = [threading.Thread(target=attempt, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 1
    assert [decision.comment for decision in read_decisions(path)] == [str(results[0])]


def test_a_decision_is_on_the_disk_before_it_is_acknowledged(tmp_path: Path) -> None:
    with ReviewStore(tmp_path / "review.sqlite") as store:
        full = 2
        assert store._database.execute("PRAGMA synchronous").fetchone() == (full,)
        assert store._database.execute("PRAGMA journal_mode").fetchone() == ("wal",)


@pytest.mark.parametrize("reads", [True, False])
def test_a_damaged_file_is_told_and_left_alone(tmp_path: Path, *, reads: bool) -> None:
    path = tmp_path / "review.sqlite"
    with ReviewStore(path) as store:
        for number in range(200):
            store.decide(replace(_MOVED, finding_id=str(number)))
    content = path.read_bytes()
    inside = content[: 3 * 4096] + b"\xff" * 2048 + content[3 * 4096 + 2048 :]
    for damaged in (content[:5000], b"no database at all, but long" * 40, content[4096:], inside):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="is damaged"):
            read_decisions(path) if reads else ReviewStore(path)
        assert path.read_bytes() == damaged


def test_a_foreign_database_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "review.sqlite"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE holidays (place TEXT)")
    database.close()
    before = path.read_bytes()
    for act in (ReviewStore, read_decisions):
        with pytest.raises(InputError, match="no store of decisions"):
            act(path)
    assert path.read_bytes() == before


def test_a_newer_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "review.sqlite"
    ReviewStore(path).close()
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 2")
    database.close()
    with pytest.raises(InputError, match="another version"):
        ReviewStore(path)


def test_reading_makes_and_changes_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are no decisions"):
        read_decisions(tmp_path / "none.sqlite")
    (tmp_path / "empty.sqlite").touch()
    with pytest.raises(InputError, match="no store of decisions"):
        read_decisions(tmp_path / "empty.sqlite")
    path = tmp_path / "a name with % and ?.sqlite"
    with ReviewStore(path) as store:
        store.decide(_MOVED)
        # While the page is open the newest decisions are in the log beside the file.
        assert read_decisions(path) == [_MOVED]
    before = path.read_bytes()
    assert read_decisions(path) == [_MOVED]
    assert path.read_bytes() == before
    assert {item.name for item in tmp_path.iterdir()} == {"empty.sqlite", path.name}


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read or written"):
        ReviewStore(tmp_path / "no folder" / "review.sqlite")
