"""What scans and images share when they are drawn: one recording, its time, notes and plots."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.export.canvas import Rgb
from percept.export.view.layout import TIMELINE

__all__ = ["Turns", "ViewStream"]

_LINES_RGB = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (240, 228, 66))


class ViewStream:
    """A recording that scans and images are drawn into.

    Args:
        recording: The recording.
        T_root_frames: Transforms that all map into one root frame.
    """

    def __init__(self, recording: rr.RecordingStream, T_root_frames: Sequence[Transform]) -> None:
        self._recording = recording
        self._known = {transform.source: transform for transform in T_root_frames}
        self._roots = {transform.target for transform in T_root_frames}
        self._placed: set[str] = set()
        self._series: dict[str, list[str]] = {}
        self.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for frame, transform in sorted(self._known.items()):
            pose = rr.Transform3D(
                translation=transform.translation_m,
                quaternion=rr.Quaternion(xyzw=quat_xyzw_from_matrix(transform.rotation)),
            )
            self.log(rr.new_entity_path(["world", frame]), pose, static=True)

    def set_time(self, stamp_ns: int, count: str | None = None, number: int = 0) -> None:
        """Set the time of what is drawn next: its stamp, and its number in a named count."""
        self._recording.reset_time()
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        if count is not None:
            self._recording.set_time(count, sequence=number)

    def log(self, entity: str, what: rr.AsComponents, *, static: bool = False) -> None:
        """Draw something."""
        self._recording.log(entity, what, static=static, strict=True)

    def send(
        self,
        entity: str,
        stamps_ns: NDArray[np.int64],
        columns: rr.ComponentColumnList,
    ) -> None:
        """Draw something at many times at once.

        Args:
            entity: Where.
            stamps_ns: (N,) int64 times.
            columns: N values of each of its parts.
        """
        times = rr.TimeColumn(TIMELINE, timestamp=stamps_ns.astype("datetime64[ns]"))
        rr.send_columns(entity, [times], columns, strict=True, recording=self._recording)

    def add_root(self, frame_id: str) -> None:
        """Take a frame for one that does not move in the view."""
        self._roots.add(frame_id)

    def frame_in_root(self, frame_id: str) -> NDArray[np.float64]:
        """Return where a frame is drawn in the vehicle, (4, 4): at the origin if not connected."""
        return self._known[frame_id].matrix if frame_id in self._known else np.eye(4)

    def root_of(self, frame_id: str) -> Transform:
        """Return where a frame is in the vehicle's root frame, which is it itself if none is known.

        Raises:
            GeometryError: If it is not connected to the frames that are known.
        """
        if frame_id in self._known:
            return self._known[frame_id]
        if self._roots and frame_id not in self._roots:
            raise GeometryError(
                f"poses of frame '{frame_id}', which is not connected to '{min(self._roots)}'"
            )
        self._roots.add(frame_id)
        return Transform(frame_id, frame_id, np.eye(4))

    def note(self, text: str, *, level: str = "INFO") -> None:
        """Add a line to the log of the view, at the time that is set."""
        self.log("notes", rr.TextLog(text, level=level))

    def entity_in(self, frame_id: str, *below: str) -> str:
        """Return an entity in a frame; one that is not connected is at the origin, with a note."""
        if frame_id not in self._placed:
            self._placed.add(frame_id)
            is_known = frame_id in self._known or frame_id in self._roots
            if not is_known and (self._known or len(self._placed) > 1):
                self.note(f"frame '{frame_id}' is not connected; drawn at the origin", level="WARN")
        return rr.new_entity_path(["world", frame_id or "sensor", *below])

    def plot(
        self,
        plot: str,
        sensor: str,
        values: Mapping[str, float],
        colours: Mapping[str, Rgb] | None = None,
    ) -> None:
        """Plot a value a series.

        Args:
            plot: Name of the plot.
            sensor: Whose series they are.
            values: By series; one that is not there has no value at this time.
            colours: By series; those that are not there get colours of their own.
        """
        known = self._series.setdefault(f"{plot}/{sensor}", [])
        for name in sorted(set(values) - set(known)):
            colour = (colours or {}).get(name, _LINES_RGB[len(known) % len(_LINES_RGB)])
            known.append(name)
            line = rr.SeriesLines(names=f"{sensor} {name}", colors=colour)
            self.log(rr.new_entity_path(["plots", plot, sensor, name]), line, static=True)
        for name, value in values.items():
            at = rr.new_entity_path(["plots", plot, sensor, name])
            self.log(at, rr.Scalars(float(value)))


class Turns:
    """Which frames are drawn, so that all together fit in a budget.

    Args:
        expected: Frames of all sensors that will come.
        budget_bytes: Bytes that all that is drawn may take.

    Attributes:
        stride: One frame of a kind in so many is drawn; chosen when the first comes.
        frames: Frames that were counted.
        drawn: Those that are drawn.
    """

    def __init__(self, expected: int, budget_bytes: int) -> None:
        self._expected = expected
        self._budget_bytes = budget_bytes
        self._seen: Counter[Hashable] = Counter()
        self.stride = 1
        self.frames = self.drawn = 0

    def take(self, kind: Hashable, frame_bytes: int) -> bool:
        """Count a frame and return whether it is drawn.

        Args:
            kind: What it is one of, such as the scans of a sensor. The first of each kind is
                drawn: what is rare is seen too.
            frame_bytes: What it would take.
        """
        if self.frames == 0:
            self.stride = max(1, math.ceil(self._expected * frame_bytes / self._budget_bytes))
        is_drawn = self._seen[kind] % self.stride == 0
        self._seen[kind] += 1
        self.frames += 1
        self.drawn += is_drawn
        return is_drawn
