"""The run folder: where a command puts its results, and `run.json`, which is written last.

The presence of `run.json` says that the run came to its end. One process at a time may
write a folder; a lock file shows that it is taken.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
import sys
import time
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from percept.core.errors import UsageError
from percept.core.results import Verdict

__all__ = ["RunFolder", "describe_input"]

_LOCK_NAME = ".percept-lock"
_HEAD_BYTES = 1 << 20


class RunFolder:
    """An output folder that one command fills; a context manager.

    Making it checks and locks the folder, and changes nothing in it: a command does so before
    its work, and calls `begin` when the input has turned out to be usable.

    Args:
        path: The folder; made when it does not exist.
        force: Whether to write although something is in it; the outputs named below go first.
        resume: Whether an unfinished run in it may go on.
        outputs: Names of files and folders that the command writes.

    Raises:
        UsageError: If the folder is not empty, in use, no folder, or cannot be written.
    """

    def __init__(
        self, path: Path, *, force: bool = False, resume: bool = False, outputs: Iterable[str] = ()
    ) -> None:
        self.path = path
        self._started = datetime.now(UTC)
        self._clock = time.monotonic()
        if path.exists() and not path.is_dir():
            raise UsageError("is a file, not a folder", where=path, remedy="Give another --out")
        self._check_contents(force=force, resume=resume)
        self._made = not path.exists()
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = (path / _LOCK_NAME).open("w")
        except OSError as error:
            raise UsageError(
                f"cannot be written ({error.strerror})", where=path, remedy="Give another --out"
            ) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise UsageError(
                "is in use by another run", where=path, remedy="Wait for it or give another --out"
            ) from error
        self._stale = () if resume else ("run.json", *outputs)

    def begin(self, inputs: Iterable[Path] = ()) -> None:
        """Remove the outputs of an earlier run, unless it is resumed.

        Args:
            inputs: Files that the command reads: none of them may be such an output.

        Raises:
            UsageError: If an input would be removed.
        """
        stale = {(self.path / name).resolve() for name in self._stale}
        for path in inputs:
            if not stale.isdisjoint((path.resolve(), *path.resolve().parents)):
                raise UsageError(
                    "would be written over: it is read, and lies in --out",
                    where=path,
                    remedy="Give another --out",
                )
        self._clear(self._stale)

    def _check_contents(self, *, force: bool, resume: bool) -> None:
        found = [p.name for p in self.path.iterdir()] if self.path.is_dir() else []
        if not [name for name in found if name != _LOCK_NAME]:
            return
        if resume and "run.json" in found and not force:
            raise UsageError(
                "holds a finished run; there is nothing to resume",
                where=self.path,
                remedy="Give another --out, or --force without --resume to do it again",
            )
        if not force and not resume:
            raise UsageError(
                "is not empty",
                where=self.path,
                remedy="Give a new --out, --resume to go on with an interrupted run, "
                "or --force to write over a finished one",
            )

    def _clear(self, names: Iterable[str]) -> None:
        for name in names:
            target = self.path / name
            if target.is_dir() and not target.is_symlink():
                shutil.rmtree(target)
            else:
                target.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        (self.path / _LOCK_NAME).unlink(missing_ok=True)
        self._lock.close()
        # A run that failed before it wrote anything leaves no empty folder behind.
        if kind is not None and self._made and not any(self.path.iterdir()):
            self.path.rmdir()

    def finish(
        self,
        *,
        config: Mapping[str, Any],
        inputs: Iterable[Path],
        counts: Mapping[str, Any],
        dropped: Mapping[str, int],
        verdict: Verdict,
        why: Iterable[str],
        notes: Iterable[str] = (),
        health: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Write `run.json` atomically and return its content.

        Args:
            config: The resolved configuration.
            inputs: Files that were read.
            counts: What was done, in numbers.
            dropped: What was left out, by reason.
            verdict: How far the result can be trusted.
            why: Reasons for the verdict.
            notes: What else a user should know, as sentences.
            health: When sensors and detectors were late, by name, where that is known.
        """
        from importlib.metadata import version

        content: dict[str, Any] = {
            "command": ["percept", *sys.argv[1:]],
            "percept": version("percept-toolkit"),
            "started": self._started.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "wall_s": round(time.monotonic() - self._clock, 3),
            "config": dict(config),
            "inputs": [describe_input(path) for path in inputs],
            "counts": dict(counts),
            "dropped": dict(dropped),
            "verdict": str(verdict),
            "why": list(why),
            **({"notes": said} if (said := list(notes)) else {}),
            **({"health": dict(health)} if health is not None else {}),
            "exit_code": verdict.exit_code,
        }
        temporary = self.path / ".run.json.part"
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
        temporary.replace(self.path / "run.json")
        return content


def describe_input(path: Path) -> dict[str, Any]:
    """Return path, size and the SHA-256 of the first MiB of a file."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return {
        "path": str(path),
        "bytes": path.stat().st_size,
        "sha256_head": hashlib.sha256(head).hexdigest(),
    }
