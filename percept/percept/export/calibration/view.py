"""A calibration as rerun shows it: `view.rrd` with clouds, cameras and boards in one frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.export.canvas import as_bgr
from percept.export.palette import sensor_colour
from percept.export.view import rrd_recording

__all__ = ["write_calibration_view"]

_POINTS_PER_CLOUD = 100_000
_IMAGE_WIDTH_PX = 640
_JPEG_QUALITY = 80
_PLANE_M = 1.0
_BOARD_RGB = (240, 228, 66)


def write_calibration_view(
    path: Path,
    *,
    clouds: Mapping[str, NDArray[np.floating]],
    images: Mapping[str, NDArray[np.generic]] | None = None,
    cameras: Mapping[str, tuple[Camera, Transform]] | None = None,
    boards: Mapping[str, NDArray[np.floating]] | None = None,
    before: Mapping[str, NDArray[np.floating]] | None = None,
) -> None:
    """Write what a calibration found as a view; the file gets its name when it is whole.

    Each sensor's cloud has the colour that it has in the pictures of the report. Of each cloud
    at most 100 000 evenly taken points are drawn, and a note in the view says so. The images
    stand before their cameras with the distortion taken out and at most 640 pixels wide.

    Args:
        path: The file to write; an older one is replaced.
        clouds: By sensor, (N, 3) metres, all in the frame of the view. Points that are not
            finite are left out.
        images: By camera, (H, W) or (H, W, 3) BGR.
        cameras: By camera, its model and `T_view_camera`.
        boards: By name, the outline (K, 3) of a board in the frame of the view, metres.
        before: Clouds as they were before the calibration; a second view shows them.

    Raises:
        GeometryError: If a cloud or an outline is not (N, 3), a camera has no model for its
            image, or an image has another size than its camera.
    """
    images, cameras, before = images or {}, cameras or {}, before or {}
    unknown = sorted(set(images) - set(cameras))
    if unknown:
        raise GeometryError(f"images of {', '.join(unknown)} need the camera's model")
    unfinished = path.with_name(f".{path.name}.unfinished")
    recording = rrd_recording(
        unfinished, f"calibration {path.parent.name}", _blueprint(both=bool(before))
    )
    drawing = _Drawing(recording)
    try:
        drawing.clouds("after", clouds)
        drawing.clouds("before", before)
        for name, (camera, T_view_camera) in cameras.items():
            drawing.camera(name, camera, T_view_camera, images.get(name))
        for name, outline in (boards or {}).items():
            drawing.board(name, outline)
        drawing.notes()
    except BaseException:
        recording.disconnect()
        unfinished.unlink(missing_ok=True)
        raise
    recording.disconnect()
    unfinished.replace(path)


class _Drawing:
    """Logs things into the recording; none of them changes over time."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._notes: list[str] = []

    def clouds(self, part: str, clouds: Mapping[str, NDArray[np.floating]]) -> None:
        if clouds:
            self._log([part], rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for index, (name, points) in enumerate(clouds.items()):
            finite = _finite(points)
            step = max(1, math.ceil(len(finite) / _POINTS_PER_CLOUD))
            drawn_share = "all drawn" if step == 1 else f"one in {step} is drawn"
            self._notes.append(f"{part}, {name}: {len(finite)} points, {drawn_share}")
            drawn = rr.Points3D(
                finite[::step], colors=sensor_colour(index), radii=rr.Radius.ui_points(1.5)
            )
            self._log([part, "clouds", name], drawn)

    def camera(
        self,
        name: str,
        camera: Camera,
        T_view_camera: Transform,
        pixels: NDArray[np.generic] | None,
    ) -> None:
        place = ["after", "cameras", name]
        pose = rr.Transform3D(
            translation=T_view_camera.translation_m,
            quaternion=rr.Quaternion(xyzw=quat_xyzw_from_matrix(T_view_camera.rotation)),
        )
        self._log(place, pose)
        scale = min(1.0, _IMAGE_WIDTH_PX / camera.image_size[0])
        width, height = (max(1, round(side * scale)) for side in camera.image_size)
        K = _matrix_at_scale(camera, scale)
        frustum = rr.Pinhole(
            image_from_camera=K,
            resolution=(width, height),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=_PLANE_M,
        )
        self._log([*place, "image"], frustum)
        self._notes.append(f"{name}: {camera.model} camera, drawn without its distortion")
        if pixels is not None:
            flat = _undistorted(pixels, camera, K, (width, height))
            _, jpeg = cv2.imencode(".jpg", flat, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
            picture = rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
            self._log([*place, "image"], picture)

    def board(self, name: str, outline: NDArray[np.floating]) -> None:
        corners = _finite(outline)
        closed = np.concatenate([corners, corners[:1]])
        line = rr.LineStrips3D(
            [closed], colors=_BOARD_RGB, radii=rr.Radius.ui_points(2), labels=[name]
        )
        self._log(["after", "boards", name], line)

    def notes(self) -> None:
        self._log(["notes"], rr.TextDocument("\n\n".join(self._notes)))

    def _log(self, place: Sequence[str], what: rr.AsComponents) -> None:
        self._recording.log(rr.new_entity_path(list(place)), what, static=True, strict=True)


def _finite(points: NDArray[np.floating]) -> NDArray[np.float32]:
    values = np.asarray(points, dtype=np.float32)
    if values.ndim != 2 or values.shape[1] != 3:
        raise GeometryError(f"points are (N, 3), not {values.shape}")
    return values[np.isfinite(values).all(axis=1)]


def _matrix_at_scale(camera: Camera, scale: float) -> NDArray[np.float64]:
    """Return the camera matrix of the image made smaller, whose pixel (0, 0) is its middle."""
    K = camera.K.copy()
    K[:2] *= scale
    K[:2, 2] += 0.5 * scale - 0.5
    return K


def _undistorted(
    pixels: NDArray[np.generic],
    camera: Camera,
    K: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.uint8]:
    """Return the image that a camera without distortion would have taken."""
    image = as_bgr(pixels)
    if image.shape[1::-1] != camera.image_size:
        raise GeometryError(
            f"the image is {image.shape[1]}x{image.shape[0]} and the camera "
            f"{camera.image_size[0]}x{camera.image_size[1]}"
        )
    rows, columns = np.mgrid[: size[1], : size[0]]
    rays = np.column_stack(
        [
            (columns.ravel() - K[0, 2]) / K[0, 0],
            (rows.ravel() - K[1, 2]) / K[1, 1],
            np.ones(size[0] * size[1]),
        ]
    )
    at_px, seen = camera.project(rays)
    at_px[~seen] = -10
    maps = at_px.reshape(size[1], size[0], 2).astype(np.float32)
    flat: Any = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
    return np.asarray(flat, dtype=np.uint8)


def _blueprint(*, both: bool) -> rrb.Blueprint:
    behind = rrb.EyeControls3D(position=(-18, 0, 14), look_target=(4, 0, 0), eye_up=(0, 0, 1))
    views = [rrb.Spatial3DView(origin="after", name="Calibrated", eye_controls=behind)]
    if both:
        views.insert(0, rrb.Spatial3DView(origin="before", name="Before", eye_controls=behind))
    notes = rrb.TextDocumentView(origin="notes", name="What is drawn")
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*views), notes, row_shares=[6, 1]),
        rrb.TimePanel(state="hidden"),
        collapse_panels=True,
    )
