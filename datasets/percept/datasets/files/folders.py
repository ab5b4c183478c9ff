"""Folders of scans and images as a recording: KITTI, Argoverse 2 exports, plain collections.

Every sub-folder with point clouds or images is a topic named by its path below the folder that
was opened (a last `data`, as in raw KITTI, is left out). Files of one folder that have no
digit in their names (`top.pcd`, `left.pcd`) are no sequence: each is a topic of one scan, named
by the file. A topic's frame is its last part. `file_stamps` says where the stamps come from; log
time and stamp are the same.
"""

from __future__ import annotations

import heapq
import os
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from percept.core.errors import DecodeError, RecordingError, TopicNotFoundError
from percept.core.samples import CameraImage, PointCloud, Sample
from percept.datasets.decoding.images import pixels_of_file_bytes
from percept.datasets.files.cloud_files import CLOUD_SUFFIXES, cloud_from_file
from percept.datasets.files.file_stamps import file_stamps_ns, time_list
from percept.datasets.losses import DecodingLosses, PassLosses
from percept.datasets.recording import (
    Envelope,
    TopicInfo,
    UndecodedMessage,
    samples_of,
    wanted_topics,
)

__all__ = ["FolderRecording", "open_folder"]

_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
_DEEPEST_LEVEL = 5


class _File(NamedTuple):
    stamp_ns: int
    topic: str
    path: Path
    stamp_is_known: bool


class _Stream(NamedTuple):
    info: TopicInfo
    files: list[_File]


def open_folder(path: Path) -> FolderRecording:
    """Open a folder of point clouds and images, or one such file.

    Raises:
        RecordingError: If there is nothing of the kind in it.
    """
    if path.is_file():
        return FolderRecording(path.parent, _single_file(path))
    notes: Counter[str] = Counter()
    streams: list[_Stream] = []
    for folder, names in _walk(path):
        streams += _streams_of(folder, names, path, notes)
    if not streams:
        kinds = ", ".join(CLOUD_SUFFIXES + _IMAGE_SUFFIXES)
        raise RecordingError(
            f"no point clouds or images here (looked for {kinds}, {_DEEPEST_LEVEL} levels down)",
            where=path,
            remedy="Give a log, or the folder that the files are in",
        )
    return FolderRecording(path, streams, notes)


class FolderRecording:
    """A `Recording` over files that hold one sample each; see `Recording`."""

    def __init__(
        self, root: Path, streams: Sequence[_Stream], losses: Counter[str] | None = None
    ) -> None:
        self._streams = {stream.info.topic: stream for stream in streams}
        stamps = [file.stamp_ns for stream in streams for file in stream.files]
        self.root = root
        self.paths = tuple(file.path for stream in streams for file in stream.files)
        self.format = "folder"
        self.start_ns: int | None = min(stamps, default=None)
        self.end_ns: int | None = max(stamps, default=None)
        self.losses: Counter[str] = Counter() if losses is None else losses
        self.notes: tuple[str, ...] = ()
        self._decoding_losses = DecodingLosses(self.losses)

    def topics(self) -> tuple[TopicInfo, ...]:
        """Return all topics, sorted by name."""
        return tuple(self._streams[topic].info for topic in sorted(self._streams))

    def samples(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Sample]:
        """Yield the samples of all or some topics in time order, one file at a time.

        Raises:
            TopicNotFoundError: If a topic is not here.
        """
        return samples_of(self.undecoded(topics=topics, start_ns=start_ns, end_ns=end_ns))

    def undecoded(
        self,
        *,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[UndecodedMessage]:
        """Yield files in time order, to be read and decoded on any thread; see `Recording`.

        Raises:
            TopicNotFoundError: If a topic is not here.
        """
        losses = self._decoding_losses.new_pass()
        return (
            UndecodedMessage(
                file.topic,
                file.stamp_ns,
                file.stamp_ns,
                partial(self._counted, file, losses, losses.next_place()),
            )
            for file in self._files(topics)
            if (start_ns is None or file.stamp_ns >= start_ns)
            and (end_ns is None or file.stamp_ns <= end_ns)
        )

    def _counted(self, file: _File, losses: PassLosses, place: int) -> tuple[Sample, ...]:
        notes: Counter[str] = Counter()
        try:
            return (self._decode(file, notes),)
        except DecodeError as error:
            losses.add_failure(f"files of {file.topic}", place, str(error))
            raise
        finally:
            losses.add_notes(notes)

    def _decode(self, file: _File, notes: Counter[str]) -> Sample:
        frame = file.topic.rpartition("/")[2]
        if file.path.suffix.lower() in CLOUD_SUFFIXES:
            stamp_ns = file.stamp_ns if file.stamp_is_known else None
            cloud = cloud_from_file(
                file.path, notes, topic=file.topic, stamp_ns=stamp_ns, frame=frame
            )
            return cloud if file.stamp_is_known else _restamped(cloud, file.stamp_ns)
        try:
            content = file.path.read_bytes()
        except OSError as error:
            raise DecodeError(f"cannot be read ({error.strerror})", where=file.path) from error
        pixels, encoding = pixels_of_file_bytes(content, str(file.path))
        return CameraImage(
            topic=file.topic,
            stamp_ns=file.stamp_ns,
            log_time_ns=file.stamp_ns,
            frame=frame,
            pixels=pixels,
            encoding=encoding,
            file=content,
        )

    def envelopes(self, *, topics: Collection[str] | None = None) -> Iterator[Envelope]:
        """Yield times and sizes of files in time order, without reading them.

        Raises:
            TopicNotFoundError: If a topic is not here.
        """
        return (
            Envelope(file.topic, file.stamp_ns, file.stamp_ns, file.path.stat().st_size)
            for file in self._files(topics)
        )

    def _files(self, topics: Collection[str] | None) -> Iterator[_File]:
        topics = wanted_topics(topics)
        wanted = self._streams.keys() if topics is None else topics
        for topic in wanted:
            if topic not in self._streams:
                raise TopicNotFoundError(
                    f"no topic '{topic}'",
                    where=self.root,
                    remedy=f"There are {', '.join(sorted(self._streams))}",
                )
        parts = [self._streams[topic].files for topic in sorted(wanted)]
        return heapq.merge(*parts, key=attrgetter("stamp_ns", "topic"))

    def close(self) -> None:
        """Do nothing: files are open only while they are read."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _restamped(cloud: PointCloud, stamp_ns: int) -> PointCloud:
    from dataclasses import replace

    return replace(cloud, stamp_ns=stamp_ns, log_time_ns=stamp_ns)


def _single_file(path: Path) -> list[_Stream]:
    if path.suffix.lower() not in CLOUD_SUFFIXES + _IMAGE_SUFFIXES:
        raise RecordingError(
            f"'{path.suffix}' is no point cloud or image",
            where=path,
            remedy=f"Give one of {', '.join(CLOUD_SUFFIXES + _IMAGE_SUFFIXES)}",
        )
    return [_stream([path], f"/{path.stem}", path.parent, Counter())]


def _walk(root: Path) -> Iterator[tuple[Path, list[str]]]:
    for folder, below, names in os.walk(root):
        depth = len(Path(folder).relative_to(root).parts)
        below[:] = (
            sorted(n for n in below if not n.startswith(".")) if depth < _DEEPEST_LEVEL else []
        )
        yield Path(folder), [name for name in names if not name.startswith(".")]


def _streams_of(
    folder: Path, names: list[str], root: Path, notes: Counter[str]
) -> Iterator[_Stream]:
    """Yield the clouds and the images of one folder, each under a topic of its own."""
    parts = list(folder.relative_to(root).parts) or [root.resolve().name]
    if parts[-1] == "data" and len(parts) > 1:
        parts.pop()
    topic = "/" + "/".join(parts)
    kinds = [
        [name for name in names if name.lower().endswith(suffixes)]
        for suffixes in (CLOUD_SUFFIXES, _IMAGE_SUFFIXES)
    ]
    endings = ("/points", "/image") if all(kinds) else ("", "")
    for kind, ending in zip(kinds, endings, strict=True):
        files = [folder / name for name in sorted(kind, key=_natural_order)]
        if _are_no_sequence(files, root):
            above = "" if folder == root else topic
            for file in files:
                yield _stream([file], f"{above}/{file.stem}{ending}", root, notes)
        elif files:
            yield _stream(files, topic + ending, root, notes)


def _are_no_sequence(files: list[Path], root: Path) -> bool:
    """Return whether several files have names without a number, and no list of times."""
    stems = {file.stem for file in files}
    named = len(files) > 1 and len(stems) == len(files)
    numbered = any(char.isdigit() for stem in stems for char in stem)
    return named and not numbered and time_list(files[0].parent, root) is None


def _natural_order(name: str) -> list[tuple[int, str]]:
    """Sort `pose10` behind `pose9`."""
    return [(int(digits or 0), text) for digits, text in re.findall(r"(\d*)(\D*)", name)]


def _stream(paths: list[Path], topic: str, root: Path, notes: Counter[str]) -> _Stream:
    stamps, known = file_stamps_ns(paths, root, notes)
    files = sorted(
        (_File(stamp, topic, path, known) for stamp, path in zip(stamps, paths, strict=True)),
        key=attrgetter("stamp_ns"),
    )
    suffix = paths[0].suffix.lower()
    sample_type = PointCloud if suffix in CLOUD_SUFFIXES else CameraImage
    kind = f"folder/{suffix[1:].replace('jpeg', 'jpg')}"
    return _Stream(TopicInfo(topic, kind, len(files), sample_type), files)
