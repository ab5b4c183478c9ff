"""Opens whatever a recorder has written: the content of a file decides, not its name."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from percept.core.clock import NS_PER_MS
from percept.core.errors import RecordingError

if TYPE_CHECKING:
    from percept.datasets.messages import MessageSource
    from percept.datasets.recording import Recording

__all__ = ["log_files", "open_recording", "open_source"]

_Path: TypeAlias = str | os.PathLike[str]
_KINDS = "a ROS 1 .bag, a .db3, an .mcap, or a folder of them"
_LOG_SUFFIXES = (".bag", ".bag.active", ".db3", ".mcap")
_COMPRESSED = (".zstd", ".zst")
_POINT_FILES = (".bin", ".pcd", ".ply", ".npy")
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def open_recording(path: _Path | Sequence[_Path]) -> Recording:
    """Open a log, several logs merged in time, or a folder of scans or images.

    Args:
        path: A ROS 1 bag, a ROS 2 folder, a bare .db3 or .mcap, these in zstd, a folder of
            such files, a folder or file of point clouds or images; or several logs.

    Raises:
        RecordingError: If it is none of these or cannot be read.
    """
    paths = [Path(path)] if isinstance(path, str | os.PathLike) else [Path(one) for one in path]
    if not paths:
        raise RecordingError("no log was given", remedy=f"Give {_KINDS}")
    for one in paths:
        if not one.exists():
            raise RecordingError("no such file or folder", where=one, remedy="Check the path")
    if len(paths) == 1 and not _is_log(paths[0]):
        from percept.datasets.files.folders import open_folder

        return open_folder(paths[0])
    return _open_logs(paths)


def _is_log(path: Path) -> bool:
    if path.is_dir():
        return bool(log_files(path)) or (path / "metadata.yaml").is_file()
    return path.suffix.lower() not in _POINT_FILES or path.stat().st_size == 0


def _open_logs(paths: Sequence[Path]) -> Recording:
    from percept.datasets.bag_recording import BagRecording

    sources: list[MessageSource] = []
    losses: Counter[str] = Counter()
    try:
        for path in paths:
            sources.extend(
                _open_folder_of_logs(path, losses) if path.is_dir() else (open_source(path),)
            )
        return BagRecording(sources, losses)
    except BaseException:
        for source in sources:
            source.close()
        raise


def _open_folder_of_logs(folder: Path, losses: Counter[str]) -> Iterator[MessageSource]:
    """Open the files of a folder; one that cannot be used is counted, unless it is the only one."""
    files = log_files(folder)
    if not files:
        raise RecordingError(
            "metadata.yaml is here, but no log file", where=folder, remedy=f"Give {_KINDS}"
        )
    stated = _stated(folder)
    missing = _file_names(stated) - {file.name for file in files}
    if missing:
        losses["files missing that metadata.yaml names"] += len(missing)
    sources: list[MessageSource] = []
    for file in files:
        try:
            sources.append(open_source(file))
        except RecordingError as error:
            if len(files) == 1:
                raise
            losses[f"files that cannot be used ({file.name}: {error.what})"] += 1
            continue
        yield sources[-1]
    if losses or any(source.losses for source in sources):
        losses.update(_missing(stated, sources))


def log_files(folder: Path) -> tuple[Path, ...]:
    """Return the log files of a folder by name; a file beside its compressed self counts once."""
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        name = file.name
        plain = name.rpartition(".")[0] if name.lower().endswith(_COMPRESSED) else name
        if plain.lower().endswith(_LOG_SUFFIXES) and file.is_file():
            found.setdefault(plain, file)
    return tuple(found.values())


def _stated(folder: Path) -> dict[str, Any]:
    """Return what metadata.yaml says; nothing if it cannot be read."""
    import yaml

    try:
        text = (folder / "metadata.yaml").read_text(errors="replace")
        stated = yaml.safe_load(text)["rosbag2_bagfile_information"]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        # The files tell all that this one could: it is not needed to read them.
        return {}
    return stated if isinstance(stated, dict) else {}


def _file_names(stated: dict[str, Any]) -> set[str]:
    names = stated.get("relative_file_paths")
    return {Path(str(name)).name for name in names} if isinstance(names, list) else set()


def _missing(stated: dict[str, Any], sources: Sequence[MessageSource]) -> dict[str, int]:
    """Return what a damaged log lacks of the messages and of the time that metadata.yaml states."""
    known = sum(
        count
        for source in sources
        for reason, count in source.losses.items()
        if reason.startswith("messages")
    )
    found = sum(count for source in sources for count in source.counts.values())
    last_ns = max((s.end_ns for s in sources if s.end_ns is not None), default=0)
    try:
        messages = int(stated["message_count"]) - found - known
        start_ns = int(stated["starting_time"]["nanoseconds_since_epoch"])
        end_ns = start_ns + int(stated["duration"]["nanoseconds"])
    except (KeyError, TypeError, ValueError):
        return {}
    lacking = {
        "messages missing, of those that metadata.yaml states": messages,
        "milliseconds missing at the end, of the time that metadata.yaml states": (
            (end_ns - last_ns) // NS_PER_MS if last_ns else 0
        ),
    }
    return {reason: count for reason, count in lacking.items() if count > 0}


def open_source(path: Path) -> MessageSource:
    """Open one log file by its content.

    Raises:
        RecordingError: If it is no log or cannot be read; names the file.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(16)
    except OSError as error:
        raise RecordingError(
            f"cannot be read ({error.strerror})", where=path, remedy="Check its permissions"
        ) from error
    if not magic:
        raise RecordingError("the file is empty", where=path, remedy="Copy or record it anew")
    if magic.startswith(_ZSTD_MAGIC):
        from percept.datasets.formats.compressed_file import CompressedSource

        return CompressedSource(path, open_source)
    opener = _opener(magic) or _salvager(path)
    if opener is None:
        raise RecordingError(
            f"not a log: it begins with {magic[:8]!r}", where=path, remedy=f"Give {_KINDS}"
        )
    return opener(path)


def _opener(magic: bytes) -> Callable[[Path], MessageSource] | None:
    if magic.startswith(b"#ROSBAG V"):
        from percept.datasets.formats.rosbag1 import open_rosbag1

        return open_rosbag1
    if magic.startswith(b"\x89MCAP0\r\n"):
        from percept.datasets.formats.mcap_log import open_mcap

        return open_mcap
    if magic == b"SQLite format 3\0":
        from percept.datasets.formats.sqlite3_log import Sqlite3Source

        return Sqlite3Source
    return None


def _salvager(path: Path) -> Callable[[Path], MessageSource] | None:
    """Return what opens a file by its name: one whose first bytes are damaged, but no others."""
    name, size = path.name.lower(), path.stat().st_size
    with path.open("rb") as file:
        if name.endswith((".bag", ".bag.active")):
            from percept.datasets.formats.rosbag1 import has_bag_chunks, open_rosbag1

            return open_rosbag1 if has_bag_chunks(file, size) else None
        if name.endswith(".mcap"):
            from percept.datasets.formats.mcap_log import holds_mcap, open_mcap

            return open_mcap if holds_mcap(file, size) else None
    if name.endswith(".db3"):
        from percept.datasets.formats.sqlite3_log import Sqlite3Source, has_log_tables

        return Sqlite3Source if has_log_tables(path) else None
    return None
