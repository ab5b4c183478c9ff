"""The keyframes of a set, with the boxes that labelling begins from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from percept.cli.dataset.journal import CollectedImage, Journal
from percept.cli.dataset.place import PlacedMoment
from percept.core.transform import Transform
from percept.datasets.labelling.images.image_files import WrittenImage
from percept.datasets.labelling.labelled_set import (
    Drive,
    ImageBoxes,
    Keyframe,
    KeyScan,
    LabelledFrame,
    SolidBoxes,
    Split,
)
from percept.datasets.labelling.prelabels.label_keyframe import (
    ImageView,
    PreLabelConfig,
    label_keyframe,
)
from percept.datasets.labelling.prelabels.solid_points import with_points

__all__ = ["KeyframeMaker"]


class KeyframeMaker:
    """Makes keyframes one after the other, and numbers what is in them.

    Args:
        folder: Where the files are.
        journal: What was decoded.
        drives: The logs by name.
        config: How pre-labels are made.

    Attributes:
        dropped: Boxes that are no pre-labels, by reason.
    """

    def __init__(
        self, folder: Path, journal: Journal, drives: Mapping[str, Drive], config: PreLabelConfig
    ) -> None:
        self.dropped: Counter[str] = Counter()
        self._folder = folder
        self._journal = journal
        self._drives = drives
        self._config = config
        self._keyframes = 0
        self._frames = 0
        self._next_box = 1
        self._next_solid = 1

    def make(self, one: PlacedMoment, cameras: Sequence[str]) -> Keyframe:
        """Make a keyframe.

        Args:
            one: The moment; a part of the set has it.
            cameras: Names of the cameras whose images stay; an empty name is none.
        """
        plan, instant = one.plan, one.moment.instant
        T_world_base = None if plan.poses is None else plan.poses.at(one.key_ns)
        images = [(camera, self._image(one, camera)) for camera in filter(None, cameras)]
        views = [self._view(one, camera, image, T_world_base) for camera, image in images]
        run = plan.source.run
        labels = label_keyframe(
            views,
            SolidBoxes.none() if run is None else run.solids(one.key_ns, T_world_base),
            self._config,
            first_box=self._next_box,
            first_solid=self._next_solid,
        )
        frames = tuple(
            _frame(self._frames + number, one, camera, image, view, boxes)
            for number, ((camera, image), view, boxes) in enumerate(
                zip(images, views, labels.images, strict=True)
            )
        )
        scan = self._scan(one)
        keyframe = Keyframe(
            keyframe=self._keyframes,
            drive=plan.name,
            stamp_ns=one.key_ns,
            split=_split(one),
            latitude=one.latitude,
            longitude=one.longitude,
            reason=instant.reason,
            score=instant.score,
            T_world_base=T_world_base,
            frames=frames,
            scan=scan,
            solids=labels.solids
            if scan is None
            else with_points(labels.solids, self._folder / scan.file),
        )
        self._keyframes += 1
        self._frames += len(frames)
        self._next_box += sum(map(len, labels.images))
        self._next_solid += len(labels.solids)
        self.dropped.update(labels.dropped)
        return keyframe

    def _image(self, one: PlacedMoment, camera: str) -> CollectedImage:
        topic = one.topic_of(camera)
        return self._journal.images[one.plan.name, topic, one.moment.images[topic]]

    def _view(
        self,
        one: PlacedMoment,
        camera: str,
        image: CollectedImage,
        T_world_base: Transform | None,
    ) -> ImageView:
        run, poses = one.plan.source.run, one.plan.poses
        T_then = None if poses is None else poses.at(image.stamp_ns)
        motion = None
        if T_then is not None and T_world_base is not None:
            motion = T_then.inverse() @ T_world_base
        return ImageView(
            found={} if run is None else run.image_boxes(camera, image.stamp_ns),
            image_size=_written(image).image_size,
            camera=self._drives[one.plan.name].cameras.get(camera),
            offset_ns=image.stamp_ns - one.key_ns,
            vehicle_place=motion,
        )

    def _scan(self, one: PlacedMoment) -> KeyScan | None:
        scan = self._journal.scans.get((one.plan.name, one.key_ns))
        if scan is None or not scan.file:
            return None
        return KeyScan(
            stamp_ns=scan.stamp_ns,
            offset_ns=scan.stamp_ns - one.key_ns,
            file=scan.file,
            points=scan.points,
            offsets_ns=scan.offsets_ns,
        )


def _split(one: PlacedMoment) -> Split:
    if one.assignment.split is None:
        raise AssertionError("a keyframe without a part is not kept")
    return one.assignment.split


def _frame(
    number: int,
    one: PlacedMoment,
    camera: str,
    image: CollectedImage,
    view: ImageView,
    boxes: ImageBoxes,
) -> LabelledFrame:
    return LabelledFrame(
        frame=number,
        camera=camera,
        stamp_ns=image.stamp_ns,
        offset_ns=image.stamp_ns - one.key_ns,
        file=_written(image).file,
        rectified_file=_written(image).rectified_file,
        image_size=_written(image).image_size,
        boxes=boxes,
        vehicle_place=view.vehicle_place,
    )


def _written(image: CollectedImage) -> WrittenImage:
    if image.written is None:
        raise AssertionError("an image that could not be used is not kept")
    return image.written
