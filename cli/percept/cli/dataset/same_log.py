"""Whether two logs hold the same images, such as a part that was cut out of another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from percept.core.errors import PerceptError
from percept.core.samples import CameraImage
from percept.datasets.labelling.choice.duplicates import DuplicateConfig, DuplicateFinder
from percept.datasets.labelling.choice.image_look import ImageLook, look_at
from percept.datasets.recording import Recording

__all__ = ["MOST_LOOKS", "SharedStamp", "show_the_same"]

MOST_LOOKS = 3
"""So many pairs of images tell whether two logs are one."""


class SharedStamp(NamedTuple):
    """An image of one log, and one of the same topic and stamp in another.

    Attributes:
        topic: The topic of both.
        first_ns: When that of the first log was recorded.
        second_ns: When that of the second log was recorded.
    """

    topic: str
    first_ns: int
    second_ns: int


def show_the_same(
    first: Recording, second: Recording, shared: Sequence[SharedStamp], config: DuplicateConfig
) -> bool:
    """Return whether all images that two logs have at the same stamps show the same.

    Equal stamps alone say nothing: drives that were made by a program often begin at one time.

    Args:
        first: One log.
        second: The other.
        shared: What to look at; the first, the last and the middle are enough.
        config: How alike is alike.
    """
    step = max(1, (len(shared) - 1) // (MOST_LOOKS - 1))
    looks = [
        (_look(first, one.topic, one.first_ns), _look(second, one.topic, one.second_ns))
        for one in shared[::step][:MOST_LOOKS]
    ]
    both = [(here, there) for here, there in looks if here is not None and there is not None]
    return bool(both) and all(_alike(here, there, config) for here, there in both)


def _alike(here: ImageLook, there: ImageLook, config: DuplicateConfig) -> bool:
    finder = DuplicateFinder(config)
    finder.offer(here)
    return finder.offer(there) is not None


def _look(recording: Recording, topic: str, at_ns: int) -> ImageLook | None:
    """Return how the first image of a time of recording looks; None if it cannot be used."""
    for message in recording.undecoded(topics=[topic], start_ns=at_ns, end_ns=at_ns):
        try:
            (sample,) = message.decode()
            return look_at(sample.pixels) if isinstance(sample, CameraImage) else None
        except PerceptError:
            return None  # the same failure is counted where the image is collected
    return None
