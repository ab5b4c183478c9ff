"""Which cameras of a log to use, what they are called, what is known of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from percept.core.cameras import Camera
from percept.core.errors import InputError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.samples import CameraImage
from percept.core.transform import Transform
from percept.core.transform_tree import TransformTree
from percept.datasets.camera_intrinsics import log_intrinsics, rig_intrinsics
from percept.datasets.camera_topics import (
    FIRST_MESSAGES,
    FirstImage,
    depth_topics,
    every_topic,
    first_image,
    other_cameras,
    topic_notes,
    topics_of_rig,
)
from percept.datasets.recording import Recording
from percept.datasets.sensors import (
    check_topics,
    place_in_base,
    read_static_transforms,
    topics_of,
)

__all__ = ["CameraStream", "choose_cameras"]

_STEEPEST = float(np.sin(np.radians(60)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraStream:
    """A camera of a log.

    Attributes:
        name: Name that results carry.
        topic: Topic of its images.
        frame: Its optical frame; empty where nothing names one.
        image_size: (width, height) of the first image; None where none can be read.
        camera: Its lens, for images of that size; None where it is not known.
        T_base_sensor: Where it sits; None where it is not known.
        depth_topic: Topic of depth images that show the same view; None where there is none.
        notes: What is not known of it, or was changed, as clauses.
        tree: The log's static transforms.
    """

    name: str
    topic: str
    frame: str = ""
    image_size: tuple[int, int] | None = None
    camera: Camera | None = None
    T_base_sensor: Transform | None = None
    depth_topic: str | None = None
    notes: tuple[str, ...] = ()
    tree: TransformTree = field(default_factory=TransformTree)

    def place_of(self, lidar: LidarSensor) -> Transform | None:
        """Return `T_camera_cloud` for the clouds of a LiDAR, or None where that is not known.

        Args:
            lidar: The LiDAR. Its clouds are in the base frame where its place is known, else in
                its own frame.
        """
        place = lidar.T_base_sensor
        if place is not None and self.T_base_sensor is not None:
            same = place.target == self.T_base_sensor.target
            return self.T_base_sensor.inverse() if same else None
        T_lidar_camera = self.tree.lookup(lidar.frame, self.frame) if self.frame else None
        if T_lidar_camera is None or not _is_optical(T_lidar_camera):
            return None
        T_camera_lidar = T_lidar_camera.inverse()
        return T_camera_lidar if place is None else T_camera_lidar @ place.inverse()


def choose_cameras(
    recording: Recording,
    rig: Rig | None,
    wanted: Mapping[str, str],
    tree: TransformTree | None = None,
) -> tuple[CameraStream, ...]:
    """Return the cameras to use, in a stable order, each with what is known of it.

    What was asked for decides; else the cameras of the rig whose topics are in the log; else
    every topic with images, one for each camera where it is there plain and compressed. Depth
    images are no cameras: they go with the camera whose view they show. Lens and place come from
    the rig, and from the log's `CameraInfo` and `tf_static` where the rig is silent.

    Args:
        recording: The log.
        rig: The rig that was given, or None.
        wanted: Topic by camera name, from the command line; may be empty.
        tree: The log's static transforms; read from it where None.

    Raises:
        InputError: If the log, or a topic that was asked for, has no images of a camera.
        TopicNotFoundError: If a topic is not in the log; names the candidates.
        PerceptError: If the rig's intrinsics make no camera.
    """
    images = topics_of(recording, CameraImage)
    check_topics(recording, wanted, CameraImage)
    first = {topic: first_image(recording, topic) for topic in images}
    for topic in wanted.values():
        if first[topic].is_depth:
            raise InputError(f"topic '{topic}' holds depth images, not those of a camera")
    pictures = {t: info for t, info in images.items() if not first[t].is_depth}
    if not pictures:
        raise InputError("all images in the log are depth images", where=recording.paths[0])
    chosen = dict(wanted) or topics_of_rig(rig, pictures) or every_topic(pictures)
    depths = depth_topics(chosen, first)
    tree = read_static_transforms(recording) if tree is None else tree
    streams = [
        _stream(recording, name, topic, rig, tree, first, depths.get(topic))
        for name, topic in chosen.items()
    ]
    left = [] if wanted else other_cameras(chosen.values(), pictures)
    if left:
        note = f"the rig does not have the cameras of {', '.join(left)}: they are left alone"
        streams[0] = replace(streams[0], notes=(*streams[0].notes, note))
    return tuple(streams)


def _stream(
    recording: Recording,
    name: str,
    topic: str,
    rig: Rig | None,
    tree: TransformTree,
    first: Mapping[str, FirstImage],
    depth_topic: str | None,
) -> CameraStream:
    known = rig.cameras().get(name) if rig is not None else None
    image, size = first[topic].image, first[topic].size
    camera, lens_note = _lens(recording, known, image, size)
    frame, T_base_sensor, place_note = _place(tree, rig, known, image.frame if image else "")
    return CameraStream(
        name=name,
        topic=topic,
        frame=frame,
        image_size=size,
        camera=camera,
        T_base_sensor=T_base_sensor,
        depth_topic=depth_topic,
        notes=tuple(filter(None, [lens_note, place_note, *topic_notes(topic, first, depth_topic)])),
        tree=tree,
    )


def _lens(
    recording: Recording,
    known: CameraSensor | None,
    image: CameraImage | None,
    size: tuple[int, int] | None,
) -> tuple[Camera | None, str]:
    if known is not None:
        return rig_intrinsics(known, size)
    if image is None or size is None:
        return None, f"none of its first {FIRST_MESSAGES} images can be read"
    return log_intrinsics(recording, image, size)


def _place(
    tree: TransformTree, rig: Rig | None, known: CameraSensor | None, image_frame: str
) -> tuple[str, Transform | None, str]:
    """Return the optical frame, `T_base_sensor`, and a note where that is not known."""
    frame = known.frame if known is not None else image_frame
    if known is not None and known.T_base_sensor is not None:
        return frame, known.T_base_sensor, ""
    T_base_frame = place_in_base(tree, rig, frame)
    if T_base_frame is None:
        return frame, None, f"its place is not known: no transform leads to frame '{frame}'"
    if _is_optical(T_base_frame):
        return frame, T_base_frame, ""
    for optical in (f"{frame}_optical_frame", f"{frame}_optical", _optical_of_link(frame)):
        T_base_optical = place_in_base(tree, rig, optical)
        if T_base_optical is not None and _is_optical(T_base_optical):
            note = f"frame '{frame}' of its images does not look ahead; '{optical}' is used"
            return optical, T_base_optical, note
    note = f"its place is not known: frame '{frame}' looks up or down, so it is no optical frame"
    return frame, None, note


def _optical_of_link(frame: str) -> str:
    return frame.removesuffix("_link").removesuffix("_frame") + "_optical_frame"


def _is_optical(T_upright_camera: Transform) -> bool:
    """Tell whether a camera looks nearly level; the body frame of one has z upwards instead."""
    return bool(abs(T_upright_camera.rotation[2, 2]) < _STEEPEST)
