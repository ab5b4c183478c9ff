"""The run as rerun shows it: `view.rrd`. With `calibration_view`, all that imports rerun.

The file is written in parts, one a session, beside its final name. A session that ends well
joins the parts and gives the file its name; one that is killed leaves a part whose whole
messages are read by the session that resumes the run. Nothing here starts a server.
"""

from __future__ import annotations

import math
import shutil
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from percept.core.errors import GeometryError
from percept.core.results import Detections3D
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.export.palette import class_colour, cluster_colours
from percept.export.rrd_parts import cut_to_whole_messages
from percept.lidar.result import ScanResult

__all__ = ["ViewSummary", "ViewWriter", "merge_views", "rrd_recording"]

_APPLICATION = "percept"
_POINTS_PER_FRAME = 40_000
_BUDGET_BYTES = 512 * 1024 * 1024
_BYTES_PER_POINT = 16  # three float32 and a colour
_GROUND_RGB: NDArray[np.uint8] = np.array((92, 84, 74), dtype=np.uint8)
_LINES_RGB = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (240, 228, 66))
_NAMELESS_RGB = (105, 110, 115)
_TIME = "bag_time"
# A chunk an entity for so many frames: few chunks, and a killed process loses no more of its view.
_FRAMES_PER_FLUSH = 16
_FLUSH_BYTES = 4 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class ViewSummary:
    """What a session put into the view.

    Attributes:
        frames: Frames that were given; all are in the plots.
        drawn: Frames whose points and boxes are drawn.
        frame_stride: Every how manieth frame of a sensor is drawn.
        points_per_frame: Most points that are drawn of one frame.
        resumed: Whether an earlier session's parts came before.
        unreadable_parts: Parts of earlier sessions that could not be read and are left out.
    """

    frames: int
    drawn: int
    frame_stride: int
    points_per_frame: int
    resumed: bool = False
    unreadable_parts: int = 0

    def as_text(self) -> str:
        """Return the summary as sentences."""
        drawn = "every frame" if self.frame_stride == 1 else f"one frame in {self.frame_stride}"
        text = (
            f"The 3D view draws {drawn} of each sensor with at most {self.points_per_frame:,} "
            f"evenly taken points; the plots hold all frames."
        )
        if self.resumed:
            text += f" Up to {_FRAMES_PER_FLUSH} frames before the run was resumed may be missing."
        if self.unreadable_parts:
            text += f" {self.unreadable_parts} parts of earlier sessions could not be read."
        return text


class ViewWriter:
    """Writes `view.rrd` frame by frame with flat memory; a context manager.

    Leaving it without an error joins the parts into `path`. Leaving it with an error keeps the
    parts for a resumed run.

    Args:
        path: The file to write.
        run_id: What tells this run from others that are open in the same viewer.
        T_root_frames: Transforms that all map into one root frame, by frame; frames that are
            not among them are drawn at the origin, and a note in the view says so.
        frames_expected: Frames that will come, which decides how many of them fit in the budget.
        budget_bytes: Bytes that the drawn points may take before compression.
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
        budget_bytes: int = _BUDGET_BYTES,
        resume: bool = False,
    ) -> None:
        self._path = path
        self._run_id = run_id
        self._transforms = {transform.source: transform for transform in T_root_frames}
        self._roots = {transform.target for transform in T_root_frames}
        if len(self._roots) > 1:
            raise GeometryError(f"a view has one root frame, not {sorted(self._roots)}", where=path)
        self._placed: set[str] = set()
        self._frames_expected = frames_expected
        self._budget_bytes = budget_bytes
        self._stride = 0
        self._frames = self._drawn = 0
        self._frames_by_sensor: dict[str, int] = {}
        self._series: dict[str, list[str]] = {}
        self._folder = path.with_name(f".{path.name}.parts")
        if not resume:
            path.unlink(missing_ok=True)
            shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir(parents=True, exist_ok=True)
        if resume and path.exists():  # the earlier session came to its end here, but not elsewhere
            path.replace(self._folder / f"part-{len(_parts_in(self._folder)):04d}.rrd")
        earlier = len(_parts_in(self._folder))
        self._resumed = earlier > 0
        part = self._folder / f"part-{earlier:04d}.rrd"
        self._recording = rrd_recording(part, run_id, _blueprint())
        self._log_frames()

    def add(self, frame: int, result: ScanResult) -> None:
        """Add a frame: its plots always, its points and boxes where the budget has room.

        Args:
            frame: Number of the scan in the run.
            result: The scan.
        """
        detections = result.detections
        self._set_time(frame, detections.stamp_ns)
        self._log_plots(result)
        turn = self._frames_by_sensor.get(detections.sensor, 0)
        self._frames_by_sensor[detections.sensor] = turn + 1
        self._frames += 1
        if self._stride == 0:
            self._stride = self._stride_for(len(result.cloud))
            self.note(self._summary().as_text())
        if turn % self._stride == 0:
            self._drawn += 1
            place = self._place(detections.frame_id, detections.sensor)
            self._log(f"{place}/cloud", _points(result))
            known = np.array([label != "unknown" for label in detections.labels], dtype=bool)
            self._log(f"{place}/boxes", _boxes(detections, known, thickness_px=1.5, named=True))
            self._log(f"{place}/unknown", _boxes(detections, ~known, thickness_px=0.5, named=False))
        if self._frames % _FRAMES_PER_FLUSH == 0:
            self._recording.flush()

    def note(self, text: str, *, level: str = "INFO") -> None:
        """Add a line to the log of the view, at the time of the last frame.

        Args:
            text: What to say.
            level: `INFO`, `WARN` or `ERROR`.
        """
        self._log("notes", rr.TextLog(text, level=level))

    def close(self) -> ViewSummary:
        """Join the parts, give the file its name, and say what is in it."""
        self._recording.disconnect()
        parts = _parts_in(self._folder)
        unreadable = 0
        if len(parts) == 1:
            parts[0].replace(self._path)
        else:
            unreadable = merge_views(parts, self._path, run_id=self._run_id)
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

    def _summary(self, unreadable: int = 0) -> ViewSummary:
        stride = max(self._stride, 1)
        return ViewSummary(
            frames=self._frames,
            drawn=self._drawn,
            frame_stride=stride,
            points_per_frame=_POINTS_PER_FRAME,
            resumed=self._resumed,
            unreadable_parts=unreadable,
        )

    def _stride_for(self, points: int) -> int:
        drawn_bytes = min(points, _POINTS_PER_FRAME) * _BYTES_PER_POINT
        return max(1, math.ceil(self._frames_expected * drawn_bytes / self._budget_bytes))

    def _place(self, frame_id: str, sensor: str) -> str:
        """Return the entity that a sensor's points and boxes hang below."""
        if frame_id not in self._placed:
            self._placed.add(frame_id)
            known = frame_id in self._transforms or frame_id in self._roots
            if not known and (self._transforms or len(self._placed) > 1):
                self.note(f"frame '{frame_id}' is not connected; drawn at the origin", level="WARN")
        return rr.new_entity_path(["world", frame_id or "sensor", sensor])

    def _log_frames(self) -> None:
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for frame, transform in sorted(self._transforms.items()):
            pose = rr.Transform3D(
                translation=transform.translation_m,
                quaternion=rr.Quaternion(xyzw=quat_xyzw_from_matrix(transform.rotation)),
            )
            self._log(rr.new_entity_path(["world", frame]), pose, static=True)

    def _log_plots(self, result: ScanResult) -> None:
        sensor = result.detections.sensor
        labels = result.detections.labels
        self._log_series("objects", sensor, {name: labels.count(name) for name in set(labels)})
        self._log_series("milliseconds", sensor, result.timings_ms)

    def _log_series(self, plot: str, sensor: str, values: Mapping[str, float]) -> None:
        """Log one value a series; a series that was seen before and is silent now is 0."""
        known = self._series.setdefault(f"{plot}/{sensor}", [])
        for name in sorted(set(values) - set(known)):
            hue = _LINES_RGB[len(known) % len(_LINES_RGB)]
            colour = class_colour(name) if plot == "objects" else hue
            known.append(name)
            line = rr.SeriesLines(names=f"{sensor} {name}", colors=colour)
            self._log(rr.new_entity_path(["plots", plot, sensor, name]), line, static=True)
        for name in known:
            value = rr.Scalars(float(values.get(name, 0)))
            self._log(rr.new_entity_path(["plots", plot, sensor, name]), value)

    def _set_time(self, frame: int, stamp_ns: int) -> None:
        self._recording.set_time(_TIME, timestamp=np.datetime64(stamp_ns, "ns"))
        self._recording.set_time("frame", sequence=frame)

    def _log(self, entity: str, what: rr.AsComponents, *, static: bool = False) -> None:
        self._recording.log(entity, what, static=static, strict=True)


def merge_views(parts: Sequence[Path], path: Path, *, run_id: str) -> int:
    """Join parts of one view into a file with a blueprint, with flat memory.

    Parts that a killed process left are cut back to their last whole message first.

    Args:
        parts: The parts in order of time.
        path: The file to write; it gets its name when it is whole.
        run_id: What tells the run from others.

    Returns:
        The number of parts that could not be read and are left out.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    recording = rrd_recording(unfinished, run_id, _blueprint())
    unreadable = 0
    for part in parts:
        cut_to_whole_messages(part)
        try:
            with warnings.catch_warnings():
                # The end of a part that was cut lacks a footer, which is why we are here.
                warnings.simplefilter("ignore", RerunWarning)
                recording.send_chunks(RrdReader(part).stream())
        except (RuntimeError, ValueError):
            unreadable += 1
    recording.disconnect()
    unfinished.replace(path)
    return unreadable


def _parts_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("part-*.rrd"))


def rrd_recording(path: Path, run_id: str, blueprint: rrb.Blueprint) -> rr.RecordingStream:
    """Open a recording that goes to a file, with the layout in it and no wall-clock time."""
    recording = rr.RecordingStream(
        _APPLICATION,
        recording_id=run_id,
        send_properties=False,
        batcher_config=rr.ChunkBatcherConfig(
            flush_tick=timedelta(hours=1), flush_num_bytes=_FLUSH_BYTES
        ),
    )
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.save(path, default_blueprint=blueprint)
    return recording


def _blueprint() -> rrb.Blueprint:
    behind = rrb.EyeControls3D(position=(-35, 0, 25), look_target=(8, 0, 0), eye_up=(0, 0, 1))
    scans = rrb.Spatial3DView(origin="world", name="Scans and boxes", eye_controls=behind)
    side = rrb.Vertical(
        rrb.TimeSeriesView(origin="plots/objects", name="Objects by class"),
        rrb.TimeSeriesView(origin="plots/milliseconds", name="Milliseconds by stage"),
        rrb.TextLogView(origin="notes", name="Notes"),
        row_shares=[2, 2, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(scans, side, column_shares=[3, 1]),
        rrb.TimePanel(state="collapsed", timeline=_TIME),
        collapse_panels=True,
    )


def _points(result: ScanResult) -> rr.Points3D:
    """Return at most `_POINTS_PER_FRAME` points: ground brown, clusters in hues, the rest grey."""
    step = max(1, math.ceil(len(result.cloud) / _POINTS_PER_FRAME))
    colours = cluster_colours(result.cluster_ids[::step])
    colours = np.where(result.ground[::step, None], _GROUND_RGB, colours)
    return rr.Points3D(
        result.cloud.points_xyz[::step], colors=colours, radii=rr.Radius.ui_points(1.5)
    )


def _boxes(
    detections: Detections3D, keep: NDArray[np.bool_], *, thickness_px: float, named: bool
) -> rr.Boxes3D:
    """Return some of the boxes; those without a class are thin and nameless, for a clear view."""
    rows = np.flatnonzero(keep).tolist()
    boxes_m = detections.boxes_m[rows]
    labels = [detections.labels[row] for row in rows]
    confidences = detections.confidences[rows]
    return rr.Boxes3D(
        centers=boxes_m[:, :3],
        sizes=boxes_m[:, 3:6],
        quaternions=_quat_xyzw_of_yaw(boxes_m[:, 6]),
        colors=[class_colour(label) if named else _NAMELESS_RGB for label in labels],
        radii=rr.Radius.ui_points(thickness_px),
        fill_mode=rr.components.FillMode.MajorWireframe,
        labels=[f"{label} {score:.2f}" for label, score in zip(labels, confidences, strict=True)],
        show_labels=named,
    )


def _quat_xyzw_of_yaw(yaw_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions (N, 4) of turns about z."""
    zero = np.zeros_like(yaw_rad)
    return np.column_stack([zero, zero, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)])
