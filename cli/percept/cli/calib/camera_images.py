"""The images of `percept calib camera`: from files, or the stillest ones of a log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import cycle, takewhile
from pathlib import Path
from typing import Any

from percept.calib.intrinsics.images import StillImages, decode_image
from percept.cli.progress import progress_bar
from percept.cli.window import log_window_ns
from percept.core.errors import InputError, TopicNotFoundError, UsageError
from percept.core.samples import CameraImage
from percept.datasets import open_recording
from percept.datasets.recording import Recording, TopicInfo

__all__ = ["CameraInputs", "images_of_bags", "images_of_files"]

_ENDINGS = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"}


@dataclass(frozen=True, slots=True)
class CameraInputs:
    """Images of one camera, decoded when they are asked for.

    Attributes:
        encoded: By name, in the order of capture, a file or the content of one.
        files: What was read.
        topic: Where the images came from in the log, or None.
        frame: Frame of the log's images, or None.
        looked_at: Images that were looked at to choose these.
        dropped: What was left out, by reason.
    """

    encoded: Mapping[str, Path | bytes]
    files: tuple[Path, ...]
    looked_at: int
    topic: str | None = None
    frame: str | None = None
    dropped: Mapping[str, int] = field(default_factory=dict)

    def image(self, name: str) -> Any:  # noqa: ANN401 - pixels; the command line knows no numpy
        """Return the pixels (H, W, 3) BGR of one image.

        Raises:
            InputError: If it cannot be decoded.
        """
        encoded = self.encoded[name]
        try:
            content = encoded.read_bytes() if isinstance(encoded, Path) else encoded
        except OSError as error:
            raise InputError(str(error.strerror), where=name) from error
        return decode_image(content, name)


def images_of_files(patterns: tuple[str, ...]) -> CameraInputs:
    """Return the images of files, folders and patterns; `image2` comes before `image10`.

    Raises:
        InputError: If a pattern names no image.
    """
    paths: dict[Path, None] = {}
    for pattern in patterns:
        folder = Path(pattern)
        found = folder.iterdir() if folder.is_dir() else _glob(pattern)
        named = sorted((path for path in found if path.is_file()), key=_natural)
        if folder.is_dir():
            named = [path for path in named if path.suffix.lower() in _ENDINGS]
        if not named:
            raise InputError(
                "no image there",
                where=pattern,
                remedy="Give a folder, a file, or a pattern in quotes such as 'shots/*.jpg'",
            )
        paths.update(dict.fromkeys(named))
    several = len({path.name for path in paths}) < len(paths)
    encoded = {str(path) if several else path.name: path for path in paths}
    return CameraInputs(encoded, tuple(paths), len(paths))


def _natural(path: Path) -> tuple[object, ...]:
    """Return a key that sorts numbers in names by their value."""
    parts = re.split(r"(\d+)", str(path))
    return tuple(
        int(part) if odd else part for part, odd in zip(parts, cycle((False, True)), strict=False)
    )


def _glob(pattern: str) -> Iterator[Path]:
    """Yield the paths of a pattern, which may begin with a folder without wildcards."""
    path = Path(pattern)
    if path.exists():
        yield path
        return
    plain = list(takewhile(lambda part: not set(part) & set("*?["), path.parts))
    yield from Path(*plain).glob(str(Path(*path.parts[len(plain) :])))


def images_of_bags(
    bags: tuple[Path, ...],
    topic: str | None,
    most_images: int,
    start_s: float | None,
    end_s: float | None,
) -> CameraInputs:
    """Return the stillest image of every slot of time of a log.

    A moving board or camera smears the corners, and neighbouring images say the same: the time is
    cut into as many slots as images are wanted, and of each the image is taken that differs
    least from the one before it.

    Args:
        bags: Logs of one drive.
        topic: The image topic; may be None where there is one only.
        most_images: The most images to take.
        start_s: Seconds from the log's start, or None.
        end_s: Seconds from the log's start, or None.

    Raises:
        InputError: If the log has no images.
        TopicNotFoundError: If there is no such topic.
        UsageError: If the log has several and none was named.
    """
    with open_recording(list(bags)) as recording:
        chosen = _image_topic(recording, topic)
        window = log_window_ns(recording, start_s, end_s)
        first_ns = window[0] if window[0] is not None else recording.start_ns or 0
        last_ns = window[1] if window[1] is not None else recording.end_ns or first_ns
        stillest = StillImages(first_ns, min(last_ns, recording.end_ns or last_ns), most_images)
        with progress_bar("looking for still images", chosen.count) as advance:
            for sample in recording.samples(
                topics=[chosen.topic], start_ns=window[0], end_ns=window[1]
            ):
                if isinstance(sample, CameraImage):
                    stillest.push(sample)
                    advance(stillest.looked_at)
        if not stillest.looked_at:
            raise InputError(f"no image on '{chosen.topic}' can be used", where=bags[0])
        return CameraInputs(
            stillest.encoded(),
            tuple(recording.paths),
            stillest.looked_at,
            chosen.topic,
            stillest.frame,
            {**recording.losses, **stillest.unusable},
        )


def _image_topic(recording: Recording, wanted: str | None) -> TopicInfo:
    topics = {t.topic: t for t in recording.topics() if t.sample_type is CameraImage}
    listed = ", ".join(sorted(topics))
    if not topics:
        raise InputError("no images in the log", where=recording.paths[0])
    if wanted is None:
        if len(topics) > 1:
            raise UsageError("the log has several cameras", remedy=f"Give --topic: {listed}")
        return next(iter(topics.values()))
    if wanted not in topics:
        raise TopicNotFoundError(
            f"no images on '{wanted}'", where=recording.paths[0], remedy=f"Image topics: {listed}"
        )
    return topics[wanted]
