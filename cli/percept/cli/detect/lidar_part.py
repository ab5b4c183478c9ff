"""The LiDAR half of `percept detect`: what is settled before the first scan, and what is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from percept.cli.detect.lidar_streams import LidarStreams, first_clouds, plan_streams
from percept.core.rig import LidarSensor
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets.recording import Recording
from percept.lidar.pipeline import LidarConfig, LidarDetector
from percept.lidar.prepare import prepare_detector
from percept.lidar.result import ScanResult

__all__ = ["LidarPart", "plan_lidars"]

_FIRST_CLOUDS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarPart:
    """The LiDARs of a run.

    Attributes:
        streams: The clouds that detection sees.
        detectors: By stream; a stream without one never has a point.
        scans_expected: Scans that will come, about.
    """

    streams: LidarStreams
    detectors: Mapping[str, LidarDetector]
    scans_expected: int

    @property
    def transforms(self) -> list[Transform]:
        """Where the sensors sit, for the view."""
        placed = [s.T_base_sensor for s in self.streams.sensors if s.T_base_sensor is not None]
        return placed if self.streams.merged or len(placed) == len(self.streams.sensors) else []

    @property
    def losses(self) -> dict[str, int]:
        """What did not reach the detectors, by reason: what they left out comes on top."""
        missing, unmatched = self.streams.missing, self.streams.unmatched
        return {
            **{f"merged scan without {topic}": n for topic, n in missing.items()},
            **{f"scan of {t} that fits no merged scan": n for t, n in unmatched.items()},
        }

    def frame_of(self, stream: str) -> str:
        """Return the frame that the boxes of a stream are given in."""
        sensor = self.streams.sensor_of(stream)
        return sensor.frame if sensor.T_base_sensor is None else sensor.T_base_sensor.target

    def detect(self, stream: str, scans: tuple[PointCloud, ...]) -> ScanResult:
        """Return the objects in scans that belong together; for several threads at once."""
        return self.detectors[stream].detect(self.streams.cloud_of(scans))

    def describe(self) -> list[dict[str, Any]]:
        """Return what was used of each stream: its topics, its frame, and how it is mounted."""
        return [self._describe(name) for name in self.detectors]

    def _describe(self, name: str) -> dict[str, Any]:
        mounting = self.detectors[name].mounting
        sensors = self.streams.sensors
        topics = [s.topic for s in sensors if self.streams.merged or s.name == name]
        return {
            "name": name,
            "topics": topics,
            "in_base_frame": self.streams.is_in_base(name),
            "height_m": round(mounting.height_m, 4),
            "found_height_m": round(mounting.found_height_m, 4) if mounting.clouds_used else None,
            "found_height_sd_m": round(mounting.sd_height_m, 4) if mounting.clouds_used else None,
            "tilt_deg": round(mounting.tilt_deg, 3),
            "upside_down": mounting.upside_down,
        }


def plan_lidars(
    recording: Recording,
    sensors: tuple[LidarSensor, ...],
    *,
    wanted: Literal["merge", "separate"] | None,
    config: LidarConfig,
    window_ns: tuple[int | None, int | None],
) -> LidarPart:
    """Settle how each LiDAR is mounted and whether they are merged, from the first scans.

    Args:
        recording: The log.
        sensors: The LiDARs.
        wanted: Whether they are merged; None decides by what is known of their places.
        config: The pipeline.
        window_ns: First and last log time that are wanted.

    Raises:
        PerceptError: If no scan has a point, or there is no ground to be found.
    """
    streams = plan_streams(sensors, wanted)
    first = first_clouds(streams, recording, *window_ns, _FIRST_CLOUDS)
    counted = streams.topics[: 1 if streams.merged else None]
    scans = sum(topic.count for topic in recording.topics() if topic.topic in counted)
    return LidarPart(
        streams=streams,
        detectors={
            name: _prepare(streams, name, clouds, config)
            for name, clouds in first.items()
            if clouds
        },
        scans_expected=max(scans, 1),
    )


def _prepare(
    streams: LidarStreams, name: str, clouds: list[PointCloud], config: LidarConfig
) -> LidarDetector:
    T_base_sensor = streams.placed(name)
    frame = clouds[0].frame
    return prepare_detector(
        clouds,
        _with_base_height(config, T_base_sensor),
        sensor=name,
        merged=streams.merged,
        T_base_sensor=None if T_base_sensor is None else Transform.identity(frame, frame),
    )


def _with_base_height(config: LidarConfig, T_base_sensor: Transform | None) -> LidarConfig:
    """Turn a sensor's height into that of the base frame, in which its clouds are judged."""
    if config.sensor_height_m is None or T_base_sensor is None:
        return config
    height_m = max(config.sensor_height_m - float(T_base_sensor.translation_m[2]), 0.0)
    return config.model_copy(update={"sensor_height_m": height_m})
