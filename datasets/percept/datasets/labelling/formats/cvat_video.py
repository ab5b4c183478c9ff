"""The images of each camera of a drive as a video of CVAT, with the boxes of an object as a track.

CVAT shows a track from its first box on, between boxes in between them, until a box that is
`outside`. So each box that was seen is a keyframe, and where the object is missing in the next
image, its last box comes once more in that image, outside, without what belongs to one box only.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from percept.datasets.labelling.formats.cvat_elements import (
    add_box,
    add_labels,
    add_texts,
    box_source,
    write_document,
)
from percept.datasets.labelling.formats.image_box import ImageBox, each_box
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import LabelledFrame, LabelledSet
from percept.datasets.labelling.names import safe_name
from percept.datasets.labelling.placing import place_file

__all__ = ["write_videos"]

_Boxes = dict[int, ImageBox]


def write_videos(labelled: LabelledSet, folder: Path) -> None:
    """Write `<drive>_<camera>/annotations.xml` and `images/`, numbered in the order of time.

    Args:
        labelled: The set.
        folder: Where the videos go; made.
    """
    for name, frames in _videos(labelled).items():
        video = folder / name
        video.mkdir(parents=True)
        for number, frame in enumerate(frames):
            target = video / "images" / f"{number:06d}_{Path(frame.file).name}"
            place_file(labelled.folder / frame.file, target)
        tracks = (
            _track_element(number, boxes, len(frames))
            for number, boxes in enumerate(_tracks(frames))
        )
        write_document(video / "annotations.xml", _meta(labelled, name, frames), tracks)


def _videos(labelled: LabelledSet) -> dict[str, list[LabelledFrame]]:
    videos: dict[str, list[LabelledFrame]] = {}
    for keyframe, frame in labelled.frames():
        videos.setdefault(f"{keyframe.drive}_{safe_name(frame.camera)}", []).append(frame)
    for frames in videos.values():
        frames.sort(key=lambda frame: frame.stamp_ns)
    return videos


def _tracks(frames: Sequence[LabelledFrame]) -> Iterator[_Boxes]:
    """Yield for each track its boxes by the number of the image.

    A track of CVAT has one class and one box in an image: an object that changes its class, or
    has two boxes in an image, becomes several tracks. A box without an object is one by itself.
    """
    tracks: dict[tuple[object, ...], _Boxes] = {}
    for number, frame in enumerate(frames):
        seen: Counter[tuple[object, ...]] = Counter()
        for box in each_box(frame.boxes):
            key: tuple[object, ...] = (box.track_id, box.label)
            if box.track_id is None:
                key = ("alone", box.box_id)
            seen[key] += 1
            tracks.setdefault((*key, seen[key]), {})[number] = box
    yield from tracks.values()


def _track_element(number: int, boxes: Mapping[int, ImageBox], images: int) -> ET.Element:
    first = next(iter(boxes.values()))
    about = {"id": str(number), "label": xml_text(first.label), "source": box_source(first)}
    track = ET.Element("track", about)
    for at, box in boxes.items():
        add_box(track, box, {"frame": str(at), "outside": "0", "keyframe": "1"})
        if at + 1 not in boxes and at + 1 < images:
            gone = replace(box, box_id=0, confidence=None, source=None)
            add_box(track, gone, {"frame": str(at + 1), "outside": "1", "keyframe": "1"})
    return track


def _meta(labelled: LabelledSet, name: str, frames: Sequence[LabelledFrame]) -> ET.Element:
    width, height = frames[0].image_size
    about = {
        "name": name,
        "size": str(len(frames)),
        "mode": "interpolation",
        "overlap": "0",
        "created": labelled.created,
        "start_frame": "0",
        "stop_frame": str(len(frames) - 1),
    }
    meta = ET.Element("meta")
    task = ET.SubElement(meta, "task")
    add_texts(task, about)
    add_labels(task, labelled.categories)
    size = ET.SubElement(task, "original_size")
    add_texts(size, {"width": str(width), "height": str(height)})
    return meta
