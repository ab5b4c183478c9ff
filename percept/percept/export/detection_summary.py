"""What a detection run found, gathered frame by frame in memory that does not grow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from percept.core.clock import iso_from_ns
from percept.core.results import Detections3D
from percept.export.finished import FinishedFrame, finished_frame
from percept.export.pictures import birds_eye, png_data_uri
from percept.export.report import Picture
from percept.export.running import EvenSample, MillisecondQuantiles
from percept.lidar.result import ScanResult

__all__ = ["DetectionSummary", "FramePoint", "SensorTotals", "band_name", "band_of"]

_BAND_M = 10
_LAST_BAND = 10
_PICTURES = 4
_CHART_POINTS = 400


@dataclass(frozen=True, slots=True)
class FramePoint:
    """One frame in the charts over time.

    Attributes:
        stamp_ns: Time of the scan.
        objects: Number of boxes.
        total_ms: Milliseconds of all stages.
    """

    stamp_ns: int
    objects: int
    total_ms: float


@dataclass(slots=True)
class SensorTotals:
    """Sums over the frames of one sensor.

    Attributes:
        frames: Frames that were judged.
        objects: Boxes.
        points: Points.
        ground_points: Points taken for ground.
        frame_ids: Frames that the boxes are given in.
    """

    frames: int = 0
    objects: int = 0
    points: int = 0
    ground_points: int = 0
    frame_ids: tuple[str, ...] = ()


class DetectionSummary:
    """Gathers a run for its report.

    Attributes:
        sensors: Totals by sensor.
        labels: Boxes by class.
        ranges: Boxes by class and by band of distance from the sensor on the ground plane,
            named by `band_name`.
        stages: Durations by stage, and of all stages as `total`.
        dropped: What was left out, by reason.
        first_ns: Stamp of the earliest scan, or None.
        last_ns: Stamp of the latest scan, or None.
    """

    def __init__(self) -> None:
        self.sensors: dict[str, SensorTotals] = {}
        self.labels: Counter[str] = Counter()
        self.ranges: dict[str, Counter[int]] = {}
        self.stages: dict[str, MillisecondQuantiles] = {}
        self.dropped: Counter[str] = Counter()
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        # By sensor: sensors take turns, and a stride over all of them would see one alone.
        self._pictures: dict[str, EvenSample[Picture]] = {}
        self._points: dict[str, EvenSample[FramePoint]] = {}

    @property
    def frames(self) -> int:
        """Frames that were judged."""
        return sum(totals.frames for totals in self.sensors.values())

    @property
    def objects(self) -> int:
        """Boxes of all frames."""
        return self.labels.total()

    @property
    def points(self) -> int:
        """Points of all frames."""
        return sum(totals.points for totals in self.sensors.values())

    @property
    def ground_points(self) -> int:
        """Points of all frames that were taken for ground."""
        return sum(totals.ground_points for totals in self.sensors.values())

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """A few frames from above, evenly over those of each sensor that came with points."""
        most = max(1, _PICTURES // max(1, len(self._pictures)))
        return tuple(picture for s in self._pictures.values() for picture in s.chosen(most))

    @property
    def timelines(self) -> dict[str, list[FramePoint]]:
        """Frames of each sensor for the charts over time, evenly thinned."""
        return {sensor: sample.chosen() for sensor, sample in self._points.items()}

    def add(self, frame: int, result: ScanResult) -> None:
        """Add a frame with its points.

        Args:
            frame: Number of the scan in the run.
            result: The scan.
        """
        self.add_finished(finished_frame(frame, result), result.detections)
        sample = self._pictures.setdefault(result.detections.sensor, EvenSample(_PICTURES))
        sample.offer(lambda: _from_above(frame, result))

    def add_finished(self, finished: FinishedFrame, detections: Detections3D) -> None:
        """Add a frame of which the points are gone: one from the journal of a resumed run."""
        totals = self.sensors.setdefault(finished.sensor, SensorTotals())
        totals.frames += 1
        totals.objects += len(detections)
        totals.points += finished.points
        totals.ground_points += finished.ground_points
        if finished.frame_id not in totals.frame_ids:
            totals.frame_ids += (finished.frame_id,)
        self.dropped.update(finished.dropped)
        self._add_boxes(detections)
        total_ms = self._add_timings(finished.timings_ms)
        stamp_ns = finished.stamp_ns
        self.first_ns = stamp_ns if self.first_ns is None else min(self.first_ns, stamp_ns)
        self.last_ns = stamp_ns if self.last_ns is None else max(self.last_ns, stamp_ns)
        sample = self._points.setdefault(finished.sensor, EvenSample(_CHART_POINTS))
        sample.offer(lambda: FramePoint(stamp_ns, len(detections), total_ms))

    def _add_boxes(self, detections: Detections3D) -> None:
        ranges_m = np.hypot(detections.boxes_m[:, 0], detections.boxes_m[:, 1])
        for label, range_m in zip(detections.labels, ranges_m.tolist(), strict=True):
            self.labels[label] += 1
            self.ranges.setdefault(label, Counter())[band_of(range_m)] += 1

    def _add_timings(self, timings_ms: Mapping[str, float]) -> float:
        total_ms = sum(timings_ms.values())
        for stage, duration_ms in (*timings_ms.items(), ("total", total_ms)):
            self.stages.setdefault(stage, MillisecondQuantiles()).add(duration_ms)
        return total_ms


def band_of(range_m: float) -> int:
    """Return the band of distance that a finite range in metres falls into."""
    return int(min(range_m // _BAND_M, _LAST_BAND))


def band_name(band: int) -> str:
    """Return the name of a band of distance, such as `10-20 m`."""
    near_m = band * _BAND_M
    return f"over {near_m} m" if band == _LAST_BAND else f"{near_m}-{near_m + _BAND_M} m"


def _from_above(frame: int, result: ScanResult) -> Picture:
    detections = result.detections
    image = birds_eye(
        result.cloud.points_xyz,
        result.ground,
        result.cluster_ids,
        detections.boxes_m,
        detections.labels,
    )
    count = len(detections)
    when = iso_from_ns(detections.stamp_ns)
    return Picture(
        png_data_uri(image),
        alt=f"Scan {frame} from above with {count} boxes",
        caption=f"Scan {frame} of {detections.sensor}, {when}: {count} objects",
    )
