"""Labels that people corrected in a tool, back as a labelled set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.labels import LabelledImage
from percept.datasets.labelling.corrections.box_pairing import ids_agree
from percept.datasets.labelling.corrections.corrected_boxes import (
    ShownBoxes,
    corrected_boxes,
    pairs_of,
)
from percept.datasets.labelling.corrections.corrected_files import (
    CorrectedFormat,
    FoundImages,
    corrected_format,
    find_images,
)
from percept.datasets.labelling.corrections.corrected_solids import (
    SolidCorrections,
    ViewLabels,
    read_camera_boxes,
)
from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.images.rectify import recorded_boxes
from percept.datasets.labelling.labelled_set import (
    ImageBoxes,
    Keyframe,
    LabelledFrame,
    LabelledSet,
)
from percept.datasets.labels.kitti import kitti_folder

__all__ = ["Corrected", "CorrectedFormat", "corrected_format", "read_corrected"]

_F64 = NDArray[np.float64]
_NOT_NAMED = "images of the data set that the labels do not have"
_RENUMBERED = (
    "the numbers of boxes in the files are not those of the data set: boxes were found again by "
    "their places"
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Corrected:
    """A set after a correction.

    Attributes:
        labelled: The keyframes and images that the labels have, with their boxes; files are those
            of the original's folder.
        dropped: What was not taken, counted by reason.
        notes: What else should be known.
        files: The files that were read.
    """

    labelled: LabelledSet
    dropped: Mapping[str, int]
    notes: tuple[str, ...]
    files: tuple[Path, ...]


def read_corrected(path: Path, name: CorrectedFormat, original: LabelledSet) -> Corrected:
    """Read corrected labels of a set that was exported.

    Images that the labels do not have are left out: nobody may have looked at them. What a format
    cannot hold is taken from the original, as `corrected_boxes` says. 3D boxes come back from
    KITTI alone; with the other formats they stay as they are.

    Args:
        path: The file or folder.
        name: Its format.
        original: The set as it was exported.

    Raises:
        InputError: If the files cannot be read, or are of another set.
    """
    found = find_images(path, name, original)
    reader = _Reader(original, found, kitti_folder(path) if name == "kitti" else None)
    keyframes = tuple(reader.keyframes())
    named = {label for one in keyframes for f in one.frames for label in f.boxes.labels}
    named |= {label for one in keyframes for label in one.solids.labels}
    new = sorted(named - set(original.categories))
    notes = list(found.notes)
    notes += [f"classes that the data set did not have: {', '.join(new)}"] if new else []
    notes += [] if reader.by_number else [_RENUMBERED]
    missing = sum(1 for _ in original.frames()) - len(found.by_frame)
    dropped = {_NOT_NAMED: missing, **found.dropped}
    return Corrected(
        labelled=replace(original, keyframes=keyframes, categories=(*original.categories, *new)),
        dropped={reason: number for reason, number in dropped.items() if number},
        notes=tuple(notes),
        files=found.files,
    )


class _Reader:
    def __init__(self, original: LabelledSet, found: FoundImages, kitti: Path | None) -> None:
        self._original = original
        self._found = found
        self._kitti = kitti
        self.by_number = _numbers_agree(original, found)
        boxes = [frame.boxes.ids for _, frame in original.frames()]
        solids = [keyframe.solids.ids for keyframe in original.keyframes]
        self._numbers = count(1 + max((int(ids.max()) for ids in boxes if len(ids)), default=0))
        self._solids = count(1 + max((int(ids.max()) for ids in solids if len(ids)), default=0))

    def keyframes(self) -> Iterator[Keyframe]:
        """Yield the keyframes that labels came back for."""
        for keyframe in self._original.keyframes:
            frames = [f for f in keyframe.frames if f.frame in self._found.by_frame]
            if not frames:
                continue
            if self._kitti is not None:
                yield self._from_kitti(replace(keyframe, frames=tuple(frames)), self._kitti)
            else:
                corrected = tuple(self._corrected(_as_recorded(frame), frame) for frame in frames)
                yield replace(keyframe, frames=corrected)

    def _corrected(self, shown: ShownBoxes, frame: LabelledFrame) -> LabelledFrame:
        found = self._found.by_frame[frame.frame]
        pairs = pairs_of(shown, found, by_number=self.by_number)
        return replace(frame, boxes=self._boxes(shown, found, pairs, {}))

    def _boxes(
        self,
        shown: ShownBoxes,
        found: LabelledImage,
        pairs: dict[int, int],
        links: Mapping[int, int],
    ) -> ImageBoxes:
        return corrected_boxes(
            shown, found, pairs, links, numbers=self._numbers, dropped=self._found.dropped
        )

    def _from_kitti(self, keyframe: Keyframe, folder: Path) -> Keyframe:
        views = list(camera_views(self._original, keyframe))
        shown = [_as_rectified(self._original, keyframe, view) for view in views]
        labels = [
            self._view_labels(view, one, folder) for view, one in zip(views, shown, strict=True)
        ]
        solids = SolidCorrections(keyframe.solids, labels, self._solids, self._found.dropped)
        known = {0, *solids.solids.ids.tolist()}
        frames = []
        for one, label, links in zip(shown, labels, solids.links, strict=True):
            boxes = self._boxes(one, label.found, dict(label.pairs), links)
            kept = np.array([n if n in known else 0 for n in boxes.solids.tolist()], np.int64)
            frames.append(replace(label.view.frame, boxes=replace(boxes, solids=kept)))
        return replace(keyframe, frames=tuple(frames), solids=solids.solids)

    def _view_labels(self, view: CameraView, shown: ShownBoxes, folder: Path) -> ViewLabels:
        found = self._found.by_frame[view.frame.frame]
        return ViewLabels(
            view=view,
            found=found,
            pairs=pairs_of(shown, found, by_number=False),
            camera_boxes=read_camera_boxes(folder / f"{view.frame.frame:06d}.txt", found),
        )


def _numbers_agree(original: LabelledSet, found: FoundImages) -> bool:
    ours = {int(number): f.frame for _, f in original.frames() for number in f.boxes.ids}
    theirs = {
        number: frame
        for frame, image in found.by_frame.items()
        for number in image.box_ids.tolist()
        if number
    }
    return ids_agree(ours, theirs)


def _as_recorded(frame: LabelledFrame) -> ShownBoxes:
    return ShownBoxes(
        boxes=frame.boxes,
        rows=np.arange(len(frame.boxes)),
        boxes_px=frame.boxes.boxes_px,
        recorded=lambda boxes_px: boxes_px,
        image_size=frame.image_size,
    )


def _as_rectified(original: LabelledSet, keyframe: Keyframe, view: CameraView) -> ShownBoxes:
    sensor = original.camera_of(keyframe, view.frame) or view.sensor
    size = np.array(view.frame.image_size * 2, dtype=np.float64)

    def recorded(boxes_px: _F64) -> _F64:
        return recorded_boxes(np.clip(boxes_px, 0.0, size), sensor)

    return ShownBoxes(
        boxes=view.frame.boxes,
        rows=np.flatnonzero(np.isin(view.frame.boxes.ids, view.boxes.ids)),
        boxes_px=view.boxes.boxes_px,
        recorded=recorded,
        image_size=view.frame.image_size,
    )
