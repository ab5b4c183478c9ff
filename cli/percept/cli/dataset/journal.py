"""What was decoded so far, a line each, so that an interrupted preparation goes on where it was."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from percept.core.errors import DecodeError, UsageError
from percept.core.whole_file import whole_file
from percept.datasets.labelling.choice.image_look import ImageLook
from percept.datasets.labelling.images.image_files import WrittenImage

__all__ = ["JOURNAL_NAME", "PLAN_NAME", "CollectedImage", "CollectedScan", "Journal"]

PLAN_NAME = "plan.json"
JOURNAL_NAME = "journal.jsonl"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CollectedImage:
    """An image that was decoded.

    Attributes:
        drive: Name of its drive.
        topic: Its topic.
        stamp_ns: Its stamp.
        written: Its files; None where it could not be used.
        failure: Why not; empty where it could.
    """

    drive: str
    topic: str
    stamp_ns: int
    written: WrittenImage | None
    failure: str = ""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CollectedScan:
    """The points of a keyframe.

    Attributes:
        drive: Name of its drive.
        key_ns: The keyframe's moment.
        file: The file of points; empty where no scan could be used.
        stamp_ns: Time of the first scan in it.
        points: Points in it.
        offsets_ns: For each LiDAR in it, its scan's time minus the keyframe's.
        failures: Scans that could not be used, by reason.
    """

    drive: str
    key_ns: int
    file: str
    stamp_ns: int
    points: int
    offsets_ns: dict[str, int] = field(default_factory=dict)
    failures: dict[str, int] = field(default_factory=dict)


class Journal:
    """Images and scans that are finished; a context manager.

    Args:
        folder: The folder that their files are in.
        plan: What was asked for: a preparation goes on only with the same.

    Raises:
        UsageError: If the folder was begun with another plan.
    """

    def __init__(self, folder: Path, plan: dict[str, Any]) -> None:
        self.images: dict[tuple[str, str, int], CollectedImage] = {}
        self.scans: dict[tuple[str, int], CollectedScan] = {}
        self._folder = folder
        self._path = folder / JOURNAL_NAME
        self._check_plan(plan)
        whole = self._read()
        self._file = self._path.open("a", encoding="utf-8")
        self._file.truncate(whole)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(self, done: CollectedImage | CollectedScan) -> None:
        """Keep what is finished; its files are there."""
        if isinstance(done, CollectedImage):
            self.images[done.drive, done.topic, done.stamp_ns] = done
            line = {"image": _image_entry(done)}
        else:
            self.scans[done.drive, done.key_ns] = done
            line = {"scan": _scan_entry(done)}
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    def _check_plan(self, plan: dict[str, Any]) -> None:
        path = self._folder / PLAN_NAME
        text = json.dumps(plan, indent=1, sort_keys=True)
        if not path.exists():
            with whole_file(path) as unfinished:
                unfinished.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            raise UsageError(
                "was begun with other logs or settings",
                where=self._folder.parent,
                remedy="Give the same ones, or --force without --resume to begin anew",
            )

    def _read(self) -> int:
        """Take in the lines of an earlier preparation; return how many bytes of them are whole."""
        whole = 0
        if not self._path.exists():
            return whole
        for raw in self._path.read_bytes().splitlines(keepends=True):
            if not raw.endswith(b"\n"):
                break  # the write was cut off
            try:
                self._take_in(json.loads(raw))
            except (ValueError, KeyError, TypeError, DecodeError):
                break  # as a computer leaves it whose power failed; what follows is done again
            whole += len(raw)
        return whole

    def _take_in(self, entry: dict[str, Any]) -> None:
        """Take in what was finished, if its files are there still: else it is done again."""
        if "image" in entry:
            image = _image_of(entry["image"])
            if image.written is None or self._are_there(
                image.written.file, image.written.rectified_file
            ):
                self.images[image.drive, image.topic, image.stamp_ns] = image
        else:
            scan = CollectedScan(**entry["scan"])
            if not scan.points or self._are_there(scan.file):
                self.scans[scan.drive, scan.key_ns] = scan

    def _are_there(self, *names: str | None) -> bool:
        files = [self._folder / name for name in names if name is not None]
        return all(file.is_file() and file.stat().st_size > 0 for file in files)


def _image_entry(done: CollectedImage) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "drive": done.drive,
        "topic": done.topic,
        "stamp_ns": done.stamp_ns,
        "failure": done.failure,
    }
    if done.written is not None:
        entry |= {
            "file": done.written.file,
            "rectified_file": done.written.rectified_file,
            "image_size": list(done.written.image_size),
            "look": done.written.look.text(),
            "blurred": dict(done.written.blurred),
        }
    return entry


def _image_of(entry: dict[str, Any]) -> CollectedImage:
    written = None
    if "file" in entry:
        width, height = entry["image_size"]
        written = WrittenImage(
            file=entry["file"],
            rectified_file=entry["rectified_file"],
            image_size=(width, height),
            look=ImageLook.from_text(entry["look"]),
            blurred=entry["blurred"],
        )
    return CollectedImage(
        drive=entry["drive"],
        topic=entry["topic"],
        stamp_ns=entry["stamp_ns"],
        written=written,
        failure=entry["failure"],
    )


def _scan_entry(done: CollectedScan) -> dict[str, Any]:
    return {
        "drive": done.drive,
        "key_ns": done.key_ns,
        "file": done.file,
        "stamp_ns": done.stamp_ns,
        "points": done.points,
        "offsets_ns": done.offsets_ns,
        "failures": done.failures,
    }
