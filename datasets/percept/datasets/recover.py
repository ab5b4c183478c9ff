"""A sound copy of a damaged log: everything that can be read, in the same format."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from percept.core.errors import InputError, RecordingError, UsageError
from percept.datasets.formats.bag_metadata import write_metadata
from percept.datasets.formats.compressed_file import CompressedSource
from percept.datasets.formats.rewrite import rewrite
from percept.datasets.open import log_files, open_source

if TYPE_CHECKING:
    from percept.datasets.messages import MessageSource

__all__ = ["RecoveryReport", "recover"]

_SUFFIXES = {"rosbag1": ".bag", "sqlite3": ".db3", "mcap": ".mcap"}


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """What a recovery has kept and what it has not.

    Attributes:
        inputs: The files that were read.
        outputs: The files that were written.
        kept: Messages written, by topic.
        losses: What could not be read, by reason, with a count; empty for a sound log.
    """

    inputs: tuple[Path, ...]
    outputs: tuple[Path, ...]
    kept: dict[str, int]
    losses: dict[str, int]


def recover(path: Path, out: Path, *, overwrite: bool = False) -> RecoveryReport:
    """Write a sound copy of a log.

    A file becomes a file, a folder a folder with the same files and a new `metadata.yaml`.
    Files that were compressed as a whole are written plain. The input is never changed.

    Args:
        path: A log file or a folder of log files.
        out: The file or folder to write.
        overwrite: Whether files that exist there may be replaced.

    Raises:
        RecordingError: If nothing can be read.
        UsageError: If the output exists, or is or lies within the input, or if its name is not
            one for the format of the log.
    """
    if not path.exists():
        raise RecordingError("no such file or folder", where=path, remedy="Check the path")
    if path.is_dir():
        return _recover_folder(path, out, overwrite=overwrite)
    _check_output(out, (path,), overwrite=overwrite)
    with contextlib.closing(open_source(path)) as source:
        _check_suffix(out, source.format)
        kept, losses = _recover_file(source, out)
    return RecoveryReport((path,), (out,), dict(kept), dict(losses))


def _check_output(out: Path, inputs: Iterable[Path], *, overwrite: bool) -> None:
    if any(out.resolve() == one.resolve() for one in inputs):
        raise UsageError("the output is the input", where=out, remedy="Choose another path")
    if out.is_dir():
        raise UsageError("the output is a folder", where=out, remedy="Give the name of a file")
    if out.exists() and not overwrite:
        raise UsageError("the output exists", where=out, remedy="Choose another or use --force")


def _check_suffix(out: Path, log_format: str) -> None:
    """Refuse a name that would lie: the copy has the format of the log."""
    suffix = _SUFFIXES[log_format]
    if out.suffix.lower() != suffix:
        raise UsageError(
            f"the copy has the format of the log, {log_format}, which this name does not say",
            where=out,
            remedy=f"Name it {out.with_suffix(suffix).name}",
        )


def _recover_file(source: MessageSource, out: Path) -> tuple[Counter[str], Counter[str]]:
    """Write one file under a temporary name, and rename it when it is whole."""
    out.parent.mkdir(parents=True, exist_ok=True)
    partial = out.with_name(f".{out.name}.{os.getpid()}.partial")
    try:
        kept = rewrite(_plain(source), partial)
        partial.replace(out)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})", where=out, remedy="Free space or rights"
        ) from error
    finally:
        partial.unlink(missing_ok=True)
    return kept, source.losses


def _plain(source: MessageSource) -> MessageSource:
    return source.plain if isinstance(source, CompressedSource) else source


def _recover_folder(folder: Path, out: Path, *, overwrite: bool) -> RecoveryReport:
    files = log_files(folder)
    if not files:
        raise RecordingError("no log file in it", where=folder, remedy="Give a folder with logs")
    if out.resolve().is_relative_to(folder.resolve()):
        raise UsageError("the output lies in the input", where=out, remedy="Choose another path")
    if out.suffix.lower() in _SUFFIXES.values():
        raise UsageError(
            "the copy of a folder is a folder, and this is the name of a file",
            where=out,
            remedy=f"Name it {out.stem}, or give one file of the folder",
        )
    targets = {file: out / _plain_name(file) for file in files}
    for target in (*targets.values(), out / "metadata.yaml"):
        _check_output(target, files, overwrite=overwrite)
    kept: Counter[str] = Counter()
    losses: Counter[str] = Counter()
    written = []
    for file, target in targets.items():
        try:
            with contextlib.closing(open_source(file)) as source:
                kept_here, lost_here = _recover_file(source, target)
        except RecordingError as error:
            losses[f"files that cannot be used ({file.name}: {error.what})"] += 1
            continue
        kept.update(kept_here)
        losses.update(lost_here)
        written.append(target)
    if not written:
        raise RecordingError("none of its files can be read", where=folder)
    write_metadata(folder, out, written)
    return RecoveryReport(files, tuple(written), dict(kept), dict(losses))


def _plain_name(file: Path) -> str:
    """Return a file's name without the suffixes of compressed and of unfinished files."""
    name = file.name
    for suffix in (".zstd", ".zst", ".active"):
        name = name.removesuffix(suffix)
    return name
