"""Writes `view.rrd` scan by scan and image by image with flat memory."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.health import StreamHealth
from percept.core.results import Detections3D, LightStates, Tracks
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.detection.result import ImageResult
from percept.export.view.cameras import ImageDrawing, ViewCamera
from percept.export.view.health import draw_health
from percept.export.view.layout import ViewParts, view_layout
from percept.export.view.lights import LightDrawing, LightFace
from percept.export.view.motion import Motion
from percept.export.view.recording import merge_views, rrd_recording
from percept.export.view.scans import POINTS_PER_SCAN, ScanDrawing
from percept.export.view.stream import Turns, ViewStream
from percept.export.view.summary import IMAGES_PER_FLUSH, SCANS_PER_FLUSH, ViewSummary
from percept.export.view.tracks import TrackDrawing
from percept.lidar.result import ScanResult

__all__ = ["ViewWriter"]

_BUDGET_BYTES = 512 * 1024 * 1024


class ViewWriter:
    """Writes `view.rrd` frame by frame with flat memory; a context manager.

    Leaving it without an error joins the parts into `path`. Leaving it with an error keeps the
    parts for a resumed run.

    Args:
        path: The file to write.
        run_id: What tells this run from others that are open in the same viewer.
        T_root_frames: Transforms that all map into one root frame, by frame; frames that are
            not among them are drawn at the origin, and a note in the view says so.
        frames_expected: Scans that will come, which decides how many of them fit in the budget;
            0 for a run of cameras alone.
        cameras: The cameras; those with a model and a place stand in the 3D view too.
        models: Names of all networks, in the order of their colours.
        images_expected: Images of all cameras that will come.
        budget_bytes: Bytes that the drawn points may take before compression, and once more the
            drawn images.
        resume: Continue with the parts that an earlier session left.

    Raises:
        GeometryError: If the transforms have several roots.
    """

    def __init__(
        self,
        path: Path,
        *,
        run_id: str,
        T_root_frames: Sequence[Transform] = (),
        frames_expected: int = 1,
        cameras: Sequence[ViewCamera] = (),
        models: Sequence[str] = (),
        images_expected: int = 0,
        budget_bytes: int = _BUDGET_BYTES,
        resume: bool = False,
    ) -> None:
        placed = [c.T_root_camera for c in cameras if c.T_root_camera is not None]
        transforms = [*T_root_frames, *placed]
        roots = {transform.target for transform in transforms}
        if len(roots) > 1:
            raise GeometryError(f"a view has one root frame, not {sorted(roots)}", where=path)
        self._path = path
        self._run_id = run_id
        self._parts = ViewParts(
            cameras={c.name: rr.new_entity_path(c.place) for c in cameras},
            scene=frames_expected > 0 or any(c.is_placed for c in cameras),
            scans=frames_expected > 0,
        )
        self._folder = path.with_name(f".{path.name}.parts")
        earlier = _earlier_parts(path, self._folder, resume=resume)
        self._resumed = earlier > 0
        part = self._folder / f"part-{earlier:04d}.rrd"
        self._first_parts = self._parts
        self._recording = rrd_recording(part, run_id, view_layout(self._parts))
        self._stream = ViewStream(self._recording, transforms)
        self._scan_turns = Turns(frames_expected, budget_bytes)
        self._image_turns = Turns(images_expected, budget_bytes)
        self._motion = Motion(self._stream)
        self._scans = ScanDrawing(self._stream, self._motion, self._scan_turns)
        self._images = ImageDrawing(self._stream, self._motion, self._image_turns, cameras, models)
        self._tracks = TrackDrawing(self._stream, Turns(frames_expected, budget_bytes))
        self._lights = LightDrawing(self._stream)
        self._inertial: str | None = None

    def add(self, frame: int, result: ScanResult) -> None:
        """Add a scan: its plots always, its points and boxes where the budget has room.

        Args:
            frame: Number of the scan in the run.
            result: The scan.
        """
        self._stream.set_time(result.detections.stamp_ns, "frame", frame)
        is_first = self._scan_turns.frames == 0
        self._scans.add(result)
        if is_first:
            self.note(self._summary().scans_text())
        if self._scan_turns.frames % SCANS_PER_FLUSH == 0:
            self._recording.flush()

    def add_image(self, result: ImageResult, cloud_px: NDArray[np.floating] | None = None) -> None:
        """Add an image: its plots always, itself and its boxes where the budget has room.

        Args:
            result: The image after the networks. Where it could not be decoded, a note says why.
            cloud_px: (N, 3) u, v in pixels of the recorded image and depth in metres of points
                to draw in it, as `project_cloud` gives them; at most 4,000 fit the budget.
        """
        self._stream.set_time(result.stamp_ns, "image", result.frame)
        before = self._image_turns.frames
        self._images.add(result, cloud_px)
        if before == 0 < self._image_turns.frames:
            self.note(f"{self._summary().images_text()} {self._images.legend}")
        if self._image_turns.frames % IMAGES_PER_FLUSH == 0:
            self._recording.flush()

    def add_poses(self, poses: Trajectory) -> None:
        """Let the vehicle move: what was and will be drawn is placed by its stamp.

        Args:
            poses: Where a frame of the vehicle is in one that stands still.

        Raises:
            GeometryError: If there are poses already, or the frame is not connected to the others.
        """
        self._motion.add(poses)
        self._inertial = poses.target
        self._parts = replace(self._parts, poses=True, scene=True)

    def add_tracks(self, tracks: Tracks) -> None:
        """Add the tracks of a moment; moments come in order of time, and after the poses."""
        self._stream.set_time(tracks.stamp_ns)
        if not self._parts.tracks:
            self._parts = replace(self._parts, tracks=True, scene=True)
            self.note(self._tracks.legend)
        self._tracks.add(tracks)

    def add_lights(self, lights: LightStates, map_lights: Sequence[LightFace] = ()) -> None:
        """Add the traffic lights of a moment; moments come in order of time.

        Args:
            lights: Their states.
            map_lights: Lights as the map has them, in the frame that poses are given in; those
                that were given before need not be given again. Without poses they are not drawn.
        """
        self._stream.set_time(lights.stamp_ns)
        if not self._parts.lights:
            self._parts = replace(self._parts, lights=True)
            self.note(self._lights.legend)
        self._lights.add(lights, map_lights, self._inertial)

    def add_health(self, health: Mapping[str, StreamHealth]) -> None:
        """Add when sensors and detectors were late, by name.

        Args:
            health: As `run_health` gives it.
        """
        if health:
            self._parts = replace(self._parts, health=True)
            draw_health(self._stream, health)

    def recall(self, detections: Detections3D) -> None:
        """Know again of a scan that an earlier session drew, so that it moves with the poses."""
        place = self._stream.entity_in(detections.frame_id, detections.sensor)
        self._motion.place(place, detections.frame_id, detections.stamp_ns)

    def recall_image(self, result: ImageResult) -> None:
        """Know again of an image that an earlier session drew; its pixels are not needed."""
        self._images.place(result)

    def note(self, text: str, *, level: str = "INFO") -> None:
        """Add a line to the log of the view, at the time of the last frame.

        Args:
            text: What to say.
            level: `INFO`, `WARN` or `ERROR`.
        """
        self._stream.note(text, level=level)

    def close(self) -> ViewSummary:
        """Join the parts, give the file its name, and say what is in it."""
        self._tracks.finish()
        if self._parts != self._first_parts:
            self._recording.send_blueprint(self._blueprint())
        self._recording.disconnect()
        parts = _parts_in(self._folder)
        unreadable = 0
        if len(parts) == 1:
            parts[0].replace(self._path)
        else:
            unreadable = merge_views(
                parts, self._path, run_id=self._run_id, blueprint=self._blueprint()
            )
        shutil.rmtree(self._folder)
        return self._summary(unreadable)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and self._folder.exists():
            self.close()
        else:
            self._recording.disconnect()

    def _blueprint(self) -> rrb.Blueprint:
        """Return the layout for what was drawn; tracks stand for the objects of single frames."""
        objects = (*self._scans.boxes, *self._images.objects)
        return view_layout(replace(self._parts, hidden=objects if self._parts.tracks else ()))

    def _summary(self, unreadable: int = 0) -> ViewSummary:
        scans, images = self._scan_turns, self._image_turns
        return ViewSummary(
            frames=scans.frames,
            drawn=scans.drawn,
            frame_stride=scans.stride,
            points_per_frame=POINTS_PER_SCAN,
            images=images.frames,
            images_drawn=images.drawn,
            image_stride=images.stride,
            resumed=self._resumed,
            unreadable_parts=unreadable,
        )


def _earlier_parts(path: Path, folder: Path, *, resume: bool) -> int:
    """Make the folder of the parts, and return how many earlier sessions left."""
    if not resume:
        path.unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    if resume and path.exists():  # the earlier session came to its end here, but not elsewhere
        path.replace(folder / f"part-{len(_parts_in(folder)):04d}.rrd")
    return len(_parts_in(folder))


def _parts_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("part-*.rrd"))
