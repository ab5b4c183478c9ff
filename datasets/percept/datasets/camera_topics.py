"""Which topics of a log are cameras, what they are called, and which depth images go with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from itertools import islice
from typing import NamedTuple

import numpy as np

from percept.core.rig import Rig
from percept.core.samples import CameraImage
from percept.datasets.recording import Recording, TopicInfo, samples_of

__all__ = [
    "FIRST_MESSAGES",
    "FirstImage",
    "depth_topics",
    "every_topic",
    "first_image",
    "other_cameras",
    "topic_notes",
    "topics_of_rig",
]

FIRST_MESSAGES = 20
"""So many messages of a topic are tried until one can be read."""

_TRANSPORTS = ("compressed", "compressedDepth")
_IMAGE_WORDS = (
    "image", "image_raw", "image_color", "image_mono", "image_rect", "image_rect_color",
)  # fmt: skip
_LARGEST_STRETCH = 0.01


class FirstImage(NamedTuple):
    """The first image of a topic.

    Attributes:
        image: The image, or None where none of the first few messages can be read.
        is_depth: Whether the topic holds depths, not pictures.
    """

    image: CameraImage | None
    is_depth: bool

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) in pixels, or None without an image."""
        if self.image is None:
            return None
        height, width = self.image.pixels.shape[:2]
        return int(width), int(height)


def first_image(recording: Recording, topic: str) -> FirstImage:
    """Return the first of the first few images that can be read, and whether it is of depths."""
    messages = islice(recording.undecoded(topics=[topic]), FIRST_MESSAGES)
    image = next((s for s in samples_of(messages) if isinstance(s, CameraImage)), None)
    if image is None:
        return FirstImage(None, is_depth="depth" in topic.rpartition("/")[2].lower())
    named = "depth" in topic.lower() or image.encoding.upper() == "16UC1"
    deep = image.pixels.dtype == np.uint16 and named
    is_depth = image.pixels.ndim == 2 and (image.pixels.dtype == np.float32 or bool(deep))
    return FirstImage(image, is_depth)


def _plain(topic: str) -> str:
    """Return a topic without the name of its transport."""
    head, _, last = topic.rpartition("/")
    return head if last in _TRANSPORTS else topic


def topics_of_rig(rig: Rig | None, images: Mapping[str, TopicInfo]) -> dict[str, str]:
    """Return the topics of the rig's cameras, in whichever transport the log has them."""
    found = {}
    for camera in rig.cameras().values() if rig is not None else ():
        if camera.topic is None:
            continue
        same = [t for t in images if _plain(t) == _plain(camera.topic)]
        if same:
            found[camera.name] = camera.topic if camera.topic in same else _fullest(same, images)
    return found


def every_topic(images: Mapping[str, TopicInfo]) -> dict[str, str]:
    """Name every camera after its topic, without the words that all image topics have."""
    by_plain: dict[str, list[str]] = {}
    for topic, info in images.items():
        if info.count or not any(i.count for i in images.values()):
            by_plain.setdefault(_plain(topic), []).append(topic)
    uses = Counter(name for plain in by_plain for name in set(_names(plain)))
    return {
        next((name for name in _names(plain) if uses[name] == 1), plain): _fullest(topics, images)
        for plain, topics in by_plain.items()
    }


def _fullest(topics: list[str], images: Mapping[str, TopicInfo]) -> str:
    """Return the topic with the most images; of equals, the one that is not compressed."""
    return min(topics, key=lambda topic: (-images[topic].count, len(topic)))


def _names(plain: str) -> tuple[str, str]:
    """Return the short and the whole name of a topic."""
    whole = plain.strip("/")
    head, _, last = whole.rpartition("/")
    short = head if head and last in _IMAGE_WORDS else whole
    return short.replace("/", "_") or "camera", whole.replace("/", "_") or "camera"


def depth_topics(chosen: Mapping[str, str], first: Mapping[str, FirstImage]) -> dict[str, str]:
    """Return by camera topic the depth images that show its view.

    They do where they are in the camera's frame, or their name says that they were brought into
    its view, and have the shape of its images.
    """
    found: dict[str, str] = {}
    for topic in chosen.values():
        fitting = [t for t, f in first.items() if f.is_depth and _same_view(first[topic], f)]
        if fitting:
            found[topic] = max(fitting, key=lambda t: _shared_parts(t, topic))
    return found


def _same_view(camera: FirstImage, depth: FirstImage) -> bool:
    if camera.image is None or depth.image is None or not (camera.size and depth.size):
        return False
    across, down = (d / c for d, c in zip(depth.size, camera.size, strict=True))
    if abs(across / down - 1) > _LARGEST_STRETCH:
        return False
    if camera.image.frame and camera.image.frame == depth.image.frame:
        return True
    says_so = any(word in depth.image.topic for word in ("aligned", "registered"))
    return says_so and _shared_parts(camera.image.topic, depth.image.topic) > 1


def _shared_parts(topic: str, other: str) -> int:
    """Return how many leading parts two topics share; the empty one before the slash counts."""
    pairs = zip(topic.split("/"), other.split("/"), strict=False)
    return next((k for k, (a, b) in enumerate(pairs) if a != b), len(topic.split("/")))


def other_cameras(chosen: Collection[str], images: Collection[str]) -> list[str]:
    """Return the topics with images that are of none of the chosen cameras."""
    plain = {_plain(topic) for topic in chosen}
    return [topic for topic in images if _plain(topic) not in plain]


def topic_notes(topic: str, first: Mapping[str, FirstImage], depth_topic: str | None) -> list[str]:
    """Return what is left alone of the images near a camera, as clauses.

    Args:
        topic: The camera's.
        first: The first image of every topic with images.
        depth_topic: The depth images that go with the camera.
    """
    notes = [
        f"the same images are in {other}, which is left alone"
        for other, image in first.items()
        if other != topic and _plain(other) == _plain(topic) and not image.is_depth
    ]
    if depth_topic is None:
        near = [t for t, f in first.items() if f.is_depth and _shared_parts(t, topic) > 1]
        notes += [f"the depth images in {t} do not show its view, and are left alone" for t in near]
    return notes
