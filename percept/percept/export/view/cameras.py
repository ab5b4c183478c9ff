"""Images as rerun draws them: with the boxes of each model, and the cloud in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.core.transform import Transform
from percept.detection.result import ImageResult, Positions
from percept.export.box_text import box_text
from percept.export.canvas import Rgb, as_bgr, resized
from percept.export.palette import depth_colours, model_colours, sensor_colour_name
from percept.export.view.motion import Motion
from percept.export.view.stream import Turns, ViewStream

__all__ = ["ImageDrawing", "ViewCamera"]

_WIDEST_WHOLE_PX = 640
_JPEG_QUALITY = 80
_BYTES_PER_PIXEL = 0.25  # of a JPEG of this quality, on the safe side
_PROJECTED_BYTES = 4_000 * 12
_PLANE_M = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewCamera:
    """A camera of a view.

    Attributes:
        name: Name of the camera.
        camera: Its model, where known.
        T_root_camera: Where it sits in the view's root frame, where known; its source is the
            camera's optical frame.
    """

    name: str
    camera: Camera | None = None
    T_root_camera: Transform | None = None

    @property
    def is_placed(self) -> bool:
        """Whether the image stands in the 3D view, since model and place are known."""
        return self.camera is not None and self.T_root_camera is not None

    @property
    def place(self) -> list[str]:
        """Parts of the entity that the image hangs below."""
        if self.camera is None or self.T_root_camera is None:
            return ["cameras", self.name]
        return ["world", self.T_root_camera.source, self.name]


class ImageDrawing:
    """Draws images into a view.

    Args:
        stream: The view.
        motion: How the vehicle moves.
        turns: Which of them are drawn.
        cameras: What is known of the cameras; an image of another one has no place in 3D.
        models: Names of the networks, in the order of their colours.
    """

    def __init__(
        self,
        stream: ViewStream,
        motion: Motion,
        turns: Turns,
        cameras: Sequence[ViewCamera],
        models: Sequence[str],
    ) -> None:
        self._stream = stream
        self._motion = motion
        self._turns = turns
        self._cameras = {camera.name: camera for camera in cameras}
        self._colours = model_colours(models)
        self._shown: dict[str, set[str]] = {}
        self._objects: dict[str, None] = {}
        for camera in cameras:
            if camera.camera is not None:
                at = rr.new_entity_path(camera.place)
                stream.log(at, _pinhole(camera.camera), static=True)

    @property
    def objects(self) -> tuple[str, ...]:
        """Entities in the 3D view that have the objects of the images."""
        return (*self._objects,)

    @property
    def legend(self) -> str:
        """What the colours in the images mean, as sentences."""
        models = ", ".join(
            f"{model} {sensor_colour_name(index)}" for index, model in enumerate(self._colours)
        )
        return (
            f"Boxes by model: {models or 'none'}. A thin box without a name is an object that "
            "another model found with more confidence. Points in an image are coloured by depth, "
            "from yellow near by to violet at 60 m and beyond."
        )

    def add(self, result: ImageResult, cloud_px: NDArray[np.floating] | None) -> None:
        """Plot an image, and draw it with its boxes and points if it is its turn."""
        counts = {model: len(found) for model, found in result.boxes.items()}
        times_ms = {model: sum(stages.values()) for model, stages in result.timings_ms.items()}
        if result.failure is not None:
            failure = f"{result.camera}, image {result.frame}: {result.failure}"
            self._stream.note(failure, level="WARN")
        if result.image is None or (result.failure is not None and not result.boxes):
            self._show(result.camera, {})
            return
        self._stream.plot("boxes", result.camera, counts, self._colours)
        self._stream.plot("milliseconds", result.camera, {**times_ms, "decode": result.decode_ms})
        kind = (result.camera, *result.boxes)  # so that a network that seldom looks is seen
        if self._turns.take(kind, _drawn_bytes(result.image)):
            self.place(result)
            self._show(result.camera, self._drawn(result, result.image, cloud_px))

    def place(self, result: ImageResult) -> None:
        """Let an image that is drawn, and the objects in it, move as the vehicle does."""
        camera = self._cameras.get(result.camera, ViewCamera(name=result.camera))
        if camera.is_placed:
            place = camera.place
            self._motion.place(rr.new_entity_path(place), place[1], result.stamp_ns)
        for model, positions in result.positions.items():
            at = self._stream.entity_in(positions.frame_id, "objects", result.camera, model)
            self._motion.place(at, positions.frame_id, result.stamp_ns)
            self._objects[at] = None

    def _drawn(
        self, result: ImageResult, image: CameraImage, cloud_px: NDArray[np.floating] | None
    ) -> dict[str, rr.AsComponents]:
        """Return what there is to draw of an image, by entity."""
        place = self._cameras.get(result.camera, ViewCamera(name=result.camera)).place
        scale = _scale(image.pixels.shape[1])
        drawn: dict[str, rr.AsComponents] = {
            rr.new_entity_path([*place, "image"]): _jpeg(image, scale)
        }
        if cloud_px is not None and len(cloud_px):
            drawn[rr.new_entity_path([*place, "cloud"])] = _projected(cloud_px, scale)
        for model, found in result.boxes.items():
            colour, positions = self._colours[model], result.positions.get(model)
            primary = result.primary.get(model, np.ones(len(found), dtype=bool))
            for part, keep in (("boxes", primary), ("duplicates", ~primary)):
                if keep.any():
                    boxes = _boxes(found, positions, keep, colour, scale, named=part == "boxes")
                    drawn[rr.new_entity_path([*place, part, model])] = boxes
            known = primary & _is_known(positions, len(found))
            if positions is not None and known.any():
                at = self._stream.entity_in(positions.frame_id, "objects", result.camera, model)
                drawn[at] = _objects(found, positions, known, colour)
        return drawn

    def _show(self, camera: str, drawn: Mapping[str, rr.AsComponents]) -> None:
        """Draw what an image has, and wipe what only the one before had."""
        for entity in sorted(self._shown.get(camera, set()) - set(drawn)):
            self._stream.log(entity, rr.Clear(recursive=False))
        for entity, what in drawn.items():
            self._stream.log(entity, what)
        self._shown[camera] = set(drawn)


def _scale(width_px: int) -> float:
    """Return by how much an image is made smaller in the view."""
    return 1.0 if width_px <= _WIDEST_WHOLE_PX else 0.5


def _drawn_bytes(image: CameraImage) -> int:
    """Return about how many bytes an image of this size takes in the view."""
    height, width = image.pixels.shape[:2]
    return int(height * width * _scale(width) ** 2 * _BYTES_PER_PIXEL) + _PROJECTED_BYTES


def _pinhole(camera: Camera) -> rr.Pinhole:
    """Return a camera as rerun knows it, for images at the scale of the view.

    rerun knows no distortion: in the 3D view the rim of a wide image does not lie on what it shows.
    """
    scale = _scale(camera.image_size[0])
    K = camera.K.copy()
    K[:2, 2] += 0.5  # rerun counts pixels from the corner of the first one
    K[:2] *= scale
    return rr.Pinhole(
        image_from_camera=K,
        resolution=[side * scale for side in camera.image_size],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_PLANE_M,
    )


def _jpeg(image: CameraImage, scale: float) -> rr.EncodedImage:
    bgr = as_bgr(image.pixels)
    small = bgr if scale == 1 else resized(bgr, scale)
    _, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def _boxes(
    found: Detections2D,
    positions: Positions | None,
    keep: NDArray[np.bool_],
    colour: Rgb,
    scale: float,
    *,
    named: bool,
) -> rr.Boxes2D:
    """Return some of a model's boxes; those without a name are thin."""
    boxes_px = found.boxes_px[keep] * scale
    return rr.Boxes2D(
        mins=boxes_px[:, :2],
        sizes=boxes_px[:, 2:] - boxes_px[:, :2],
        colors=[colour] * len(boxes_px),
        radii=rr.Radius.ui_points(1.5 if named else 0.5),
        labels=[box_text(found, row, positions) for row in np.flatnonzero(keep).tolist()],
        show_labels=named,
    )


def _projected(cloud_px: NDArray[np.floating], scale: float) -> rr.Points2D:
    return rr.Points2D(
        (cloud_px[:, :2] + 0.5) * scale,
        colors=depth_colours(cloud_px[:, 2]),
        radii=rr.Radius.ui_points(1.0),
    )


def _objects(
    found: Detections2D, positions: Positions, keep: NDArray[np.bool_], colour: Rgb
) -> rr.Points3D:
    rows = np.flatnonzero(keep).tolist()
    return rr.Points3D(
        positions.points_m[rows],
        colors=[colour] * len(rows),
        radii=rr.Radius.ui_points(5),
        labels=[f"{found.labels[row]} {positions.range_m[row]:.1f} m" for row in rows],
        show_labels=True,
    )


def _is_known(positions: Positions | None, count: int) -> NDArray[np.bool_]:
    sources = ("",) * count if positions is None else positions.sources
    return np.array([bool(source) for source in sources], dtype=bool)
