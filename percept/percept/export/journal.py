"""The journal of a run: what is finished stays finished when the process is killed.

Every finished frame, a scan or an image, is one Arrow record batch that is handed to the
operating system before the next frame starts, with the frame's own figures in the batch's
metadata. A session appends to a part of its own (`part-0000.arrows`, `part-0001.arrows`, ...), so
that a resumed run never writes behind the broken end of an earlier one; readers take the whole
batches of each part and stop where it breaks. The final tables are made from the journal.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Generic, Self, TypeVar

import pyarrow as pa

from percept.core.errors import UsageError
from percept.detection.result import ImageResult
from percept.export.finished import (
    FinishedFrame,
    FinishedImage,
    finished_frame,
    finished_image,
)
from percept.export.tables import (
    DETECTIONS_2D,
    DETECTIONS_3D,
    detections_2d_table,
    detections_3d_table,
)
from percept.lidar.result import ScanResult

__all__ = ["FrameJournal", "ImageJournal", "Journal"]

_Finished = TypeVar("_Finished", bound=FinishedFrame | FinishedImage)

_HEAD = "journal.json"
_FRAME_KEY = b"percept.frame"
_FRAMES_PER_SYNC = 32


class Journal(Generic[_Finished]):
    """Finished frames of an unfinished run, in a folder of its own; a context manager.

    Args:
        folder: Where the journal lies; made where it is missing.
        fingerprint: Text that stands for the inputs and the settings. A run can be resumed only
            with the text that it was started with.
        kind: What is kept of a frame besides its rows.
        schema: Columns of the rows.
        resume: Continue the journal that is there; without it a journal there is refused.

    Attributes:
        frames: Number of frames that are finished.
        next_frame: Number of the first frame that is not.

    Raises:
        UsageError: If the folder holds another unfinished run, or is being written to.
    """

    def __init__(
        self,
        folder: Path,
        fingerprint: str,
        kind: type[_Finished],
        schema: pa.Schema,
        *,
        resume: bool = False,
    ) -> None:
        self._folder = folder
        self._kind = kind
        self._schema = schema
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(folder / "lock")
        try:
            self._check_head(fingerprint, resume=resume)
        except UsageError:
            self._lock.close()
            raise
        self.frames = 0
        self.next_frame = 0
        for finished, _ in self.read():
            self._count(finished)
        self._sink: IO[bytes] | None = None
        self._writer: pa.RecordBatchStreamWriter | None = None

    def keep(self, finished: _Finished, table: pa.Table) -> _Finished:
        """Keep a finished frame; once this returns it survives the end of the process.

        Args:
            finished: The frame; its number is `next_frame` or higher.
            table: Its rows.

        Returns:
            The frame.
        """
        none = pa.RecordBatch.from_pylist([], schema=self._schema)
        rows = table.combine_chunks().to_batches() or [none]
        writer, sink = self._open_part()
        meta = {_FRAME_KEY: json.dumps(asdict(finished)).encode()}
        writer.write_batch(rows[0], custom_metadata=meta)
        sink.flush()
        self._count(finished)
        if self.frames % _FRAMES_PER_SYNC == 0:
            os.fsync(sink.fileno())
        return finished

    def read(self) -> Iterator[tuple[_Finished, pa.RecordBatch]]:
        """Yield the finished frames and their rows in order, one at a time."""
        for part in self._parts():
            for meta, rows in _read_part(part):
                yield self._kind(**meta), rows

    def batches(self) -> Iterator[pa.RecordBatch]:
        """Yield the rows of the finished frames in order, for `write_parquet`."""
        return (rows for _, rows in self.read())

    def close(self) -> None:
        """Close the files; what was appended stays for a later run."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._sink is not None:
            self._sink.close()
            self._sink = None
        self._lock.close()

    def remove(self) -> None:
        """Close the journal and delete its folder: the run is complete."""
        self.close()
        shutil.rmtree(self._folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _count(self, finished: _Finished) -> None:
        self.frames += 1
        self.next_frame = finished.frame + 1

    def _parts(self) -> list[Path]:
        return sorted(self._folder.glob("part-*.arrows"))

    def _open_part(self) -> tuple[pa.RecordBatchStreamWriter, IO[bytes]]:
        """Open the part of this session when its first frame comes."""
        if self._sink is None or self._writer is None:
            path = self._folder / f"part-{len(self._parts()):04d}.arrows"
            self._sink = path.open("xb")
            self._writer = pa.ipc.new_stream(self._sink, self._schema)
        return self._writer, self._sink

    def _check_head(self, fingerprint: str, *, resume: bool) -> None:
        head = self._folder / _HEAD
        if not head.exists():
            unfinished = head.with_suffix(".unfinished")
            unfinished.write_text(json.dumps({"fingerprint": fingerprint}), encoding="utf-8")
            unfinished.replace(head)
            return
        if not resume:
            raise UsageError(
                "holds an unfinished run",
                where=self._folder.parent,
                remedy="Continue it with --resume, or start anew with --force",
            )
        if _fingerprint_in(head) != fingerprint:
            raise UsageError(
                "the unfinished run here had other inputs or settings",
                where=self._folder.parent,
                remedy="Resume with the same ones, or start anew with --force",
            )


class FrameJournal(Journal[FinishedFrame]):
    """The scans of an unfinished run; see `Journal`."""

    def __init__(self, folder: Path, fingerprint: str, *, resume: bool = False) -> None:
        super().__init__(folder, fingerprint, FinishedFrame, DETECTIONS_3D, resume=resume)

    def append(self, frame: int, result: ScanResult) -> FinishedFrame:
        """Keep a finished scan; once this returns it survives the end of the process.

        Args:
            frame: Number of the scan in the run, from `next_frame` on and growing.
            result: The scan. One that could not be judged is kept as a result without boxes
                that says why in `dropped`.
        """
        table = detections_3d_table(frame, result.detections)
        return self.keep(finished_frame(frame, result), table)


class ImageJournal(Journal[FinishedImage]):
    """The images of an unfinished run; see `Journal`."""

    def __init__(self, folder: Path, fingerprint: str, *, resume: bool = False) -> None:
        super().__init__(folder, fingerprint, FinishedImage, DETECTIONS_2D, resume=resume)

    def append(self, result: ImageResult) -> FinishedImage:
        """Keep a finished image; once this returns it survives the end of the process.

        Args:
            result: The image; its number is `next_frame` or higher. One that cannot be used is
                kept with its `failure`.
        """
        return self.keep(finished_image(result), detections_2d_table(result))


def _fingerprint_in(head: Path) -> str | None:
    try:
        values = json.loads(head.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return values.get("fingerprint") if isinstance(values, dict) else None


def _locked(path: Path) -> IO[bytes]:
    """Take the lock of a journal; the system gives it back when the process ends, however."""
    lock = path.open("ab")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        lock.close()
        raise UsageError(
            "another process is writing this run",
            where=path.parent.parent,
            remedy="Wait until it ends, or choose another --out",
        ) from error
    return lock


def _read_part(path: Path) -> Iterator[tuple[dict[str, Any], pa.RecordBatch]]:
    """Yield the figures and rows of the whole batches of a part, up to where a kill cut it."""
    with path.open("rb") as source:
        try:
            reader = pa.ipc.open_stream(source)
        except (pa.ArrowInvalid, OSError):
            return
        while True:
            try:
                rows, meta = reader.read_next_batch_with_custom_metadata()
            except (StopIteration, pa.ArrowInvalid, OSError):
                return
            yield json.loads(meta[_FRAME_KEY]), rows
