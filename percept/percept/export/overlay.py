"""Boxes as messages that Foxglove, rviz and other ROS 2 tools open: `overlay.mcap`.

Every scan gives a `vision_msgs/msg/Detection3DArray` on `/percept/<sensor>/detections_3d` and a
`visualization_msgs/msg/MarkerArray` on `/percept/<sensor>/markers`, with the frame and the stamp
of the scan and at its place in recording time, so that the file lies over the log that it
belongs to. Every image gives for each network a `vision_msgs/msg/Detection2DArray` on
`/percept/<camera>/<model>/detections_2d`, and a `foxglove_msgs/msg/ImageAnnotations` on
`/percept/<camera>/<model>/annotations`, which Foxglove draws into the image. Full tracks are on
`/percept/tracks`, each with its `id`, and `/percept/tracks/markers`; traffic lights on
`/percept/lights` and, where they hang, on `/percept/lights/markers`. Poses are on `/tf`. The
messages are those of ROS 2 Humble and later, vision_msgs 4.1; the file holds their definitions
with all that they depend on.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from percept.core.results import Detections3D, LightStates, Tracks
from percept.core.trajectory import Trajectory
from percept.detection.result import ImageResult
from percept.export.camera_messages import detection_2d_array, image_annotations
from percept.export.overlay_messages import (
    DETECTION_2D_ARRAY,
    DETECTION_3D_ARRAY,
    IMAGE_ANNOTATIONS,
    MARKER_ARRAY,
    TRANSFORMS,
    OverlayMessages,
    Values,
    detection_3d_array,
    marker_array,
)
from percept.export.overlay_tracks import (
    light_array,
    light_markers,
    track_array,
    track_markers,
    transform_messages,
)
from percept.export.palette import model_colours

__all__ = ["OverlayWriter"]

_TRACKS, _LIGHTS = "/percept/tracks", "/percept/lights"


class OverlayWriter:
    """Writes `overlay.mcap` scan by scan; the same scans give the same bytes.

    A context manager. The file gets its name when it is whole; leaving with an error deletes it.

    Args:
        path: The file to write; an older one is replaced.
        models: Names of all networks, in the order of their colours.
    """

    def __init__(self, path: Path, *, models: Sequence[str] = ()) -> None:
        self._path = path
        self._colours = model_colours(models)
        self._unfinished = path.with_name(f".{path.name}.unfinished")
        self._file: IO[bytes] = self._unfinished.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="percept")
        self._messages = OverlayMessages()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._written: dict[int, int] = {}

    def add(self, detections: Detections3D, log_time_ns: int) -> None:
        """Write the boxes of one scan.

        Args:
            detections: The boxes, in the frame that they name.
            log_time_ns: Time at which the scan was recorded.
        """
        base = f"/percept/{_topic_name(detections.sensor)}"
        self._write(
            (
                (f"{base}/detections_3d", DETECTION_3D_ARRAY, detection_3d_array(detections)),
                (f"{base}/markers", MARKER_ARRAY, marker_array(detections)),
            ),
            log_time_ns,
            detections.stamp_ns,
        )

    def add_image(self, result: ImageResult, frame_id: str) -> None:
        """Write what each network found in one image.

        Args:
            result: The image; it may come from the journal, without its pixels.
            frame_id: Frame of the camera.
        """
        for model, found in result.boxes.items():
            base = f"/percept/{_topic_name(result.camera)}/{_topic_name(model)}"
            array = detection_2d_array(found, frame_id)
            drawn = image_annotations(found, result.positions.get(model), self._colours[model])
            self._write(
                (
                    (f"{base}/detections_2d", DETECTION_2D_ARRAY, array),
                    (f"{base}/annotations", IMAGE_ANNOTATIONS, drawn),
                ),
                result.log_time_ns,
                result.stamp_ns,
            )

    def add_tracks(self, tracks: Tracks, log_time_ns: int) -> None:
        """Write the full tracks of a moment.

        Args:
            tracks: The tracks.
            log_time_ns: The moment in recording time, such as that of the scan at its stamp.
        """
        self._write(
            (
                (_TRACKS, DETECTION_3D_ARRAY, track_array(tracks)),
                (f"{_TRACKS}/markers", MARKER_ARRAY, track_markers(tracks)),
            ),
            log_time_ns,
            tracks.stamp_ns,
        )

    def add_lights(
        self,
        lights: LightStates,
        log_time_ns: int,
        *,
        faces: Mapping[int, NDArray[np.float64]] | None = None,
        frame_id: str = "",
    ) -> None:
        """Write the traffic lights of a moment.

        Args:
            lights: Their states.
            log_time_ns: The moment in recording time.
            faces: By id, the corners (4, 3) of the faces, metres, as far as they are known.
            frame_id: Frame that the corners are given in.
        """
        array = light_array(lights, faces or {}, frame_id)
        messages = [(_LIGHTS, DETECTION_3D_ARRAY, array)]
        if faces:
            markers = light_markers(lights, faces, frame_id)
            messages.append((f"{_LIGHTS}/markers", MARKER_ARRAY, markers))
        self._write(messages, log_time_ns, lights.stamp_ns)

    def add_poses(self, poses: Trajectory, *, log_offset_ns: int = 0) -> None:
        """Write where the vehicle was, as `/tf`: at most fifty poses a second.

        A log that has such a tf of its own needs no other; programs take one parent a frame.

        Args:
            poses: The poses.
            log_offset_ns: Recording time less the time of the stamps.
        """
        for stamp_ns, message in transform_messages(poses):
            self._write([("/tf", TRANSFORMS, message)], stamp_ns + log_offset_ns, stamp_ns)

    def close(self) -> None:
        """Finish the file and give it its name."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it so
        self._file.close()
        self._unfinished.replace(self._path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and not self._file.closed:
            self.close()
        self._file.close()
        self._unfinished.unlink(missing_ok=True)

    def _write(
        self, messages: Iterable[tuple[str, str, Values]], log_time_ns: int, stamp_ns: int
    ) -> None:
        for topic, msgtype, message in messages:
            channel = self._channel(topic, msgtype)
            self._writer.add_message(
                channel_id=channel,
                log_time=log_time_ns,
                publish_time=stamp_ns,
                sequence=self._written[channel],
                data=self._messages.serialize(message, msgtype),
            )
            self._written[channel] += 1

    def _channel(self, topic: str, msgtype: str) -> int:
        if topic not in self._channels:
            if msgtype not in self._schemas:
                self._schemas[msgtype] = self._writer.register_schema(
                    msgtype, "ros2msg", self._messages.definition(msgtype).encode()
                )
            channel = self._writer.register_channel(topic, "cdr", self._schemas[msgtype])
            self._channels[topic] = channel
            self._written[channel] = 0
        return self._channels[topic]


def _topic_name(sensor: str) -> str:
    """Return a sensor's name as ROS takes it in topics."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", sensor).strip("_")
    return name or "sensor"
