"""From a log to the clouds that are detected on, one stream a sensor or one merged stream."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from percept.core.errors import InputError, UsageError
from percept.core.rig import LidarSensor
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets.recording import Recording
from percept.lidar.merge import ScanGrouper, merge_clouds, placed_cloud

__all__ = ["LidarStreams", "ScanFeed", "first_clouds", "plan_streams"]

MERGED_NAME = "lidars"


@dataclass(slots=True)
class LidarStreams:
    """The LiDARs of a log, as the clouds that detection sees.

    Attributes:
        sensors: The LiDARs, each with its topic; the first is the reference of a merge.
        merged: Whether their scans are brought together in the base frame.
        missing: By topic, merged scans that went out without that LiDAR.
        unmatched: By topic, scans that no merged scan took.
    """

    sensors: tuple[LidarSensor, ...]
    merged: bool
    missing: Counter[str] = field(default_factory=Counter)
    unmatched: Counter[str] = field(default_factory=Counter)

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each stream."""
        return (MERGED_NAME,) if self.merged else tuple(sensor.name for sensor in self.sensors)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics of all LiDARs."""
        return tuple(self.by_topic)

    @property
    def by_topic(self) -> dict[str, LidarSensor]:
        """The LiDARs by topic."""
        return {sensor.topic: sensor for sensor in self.sensors if sensor.topic is not None}

    def clouds(
        self, recording: Recording, start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[str, PointCloud]]:
        """Yield stream names and clouds in log order, in the base frame where it is known."""
        samples = recording.samples(topics=self.topics, start_ns=start_ns, end_ns=end_ns)
        feed = ScanFeed(self)
        for sample in samples:
            if isinstance(sample, PointCloud):
                yield from ((name, self.cloud_of(scans)) for name, scans in feed.push(sample))
        yield from ((name, self.cloud_of(scans)) for name, scans in feed.flush())

    def cloud_of(self, scans: tuple[PointCloud, ...]) -> PointCloud:
        """Return what detection sees of scans that belong together; for several threads at once."""
        if self.merged:
            places = {s.topic: s.T_base_sensor for s in self.sensors if s.topic and s.T_base_sensor}
            return merge_clouds(scans, places)
        (scan,) = scans
        T_base_sensor = self.by_topic[scan.topic].T_base_sensor
        return placed_cloud(scan, T_base_sensor) if T_base_sensor else scan

    def is_in_base(self, name: str) -> bool:
        """Return whether a stream's clouds are in the base frame."""
        return self.merged or self.placed(name) is not None

    def placed(self, name: str) -> Transform | None:
        """Return `T_base_sensor` of a stream; that of the reference for a merged one."""
        return self.sensor_of(name).T_base_sensor

    def sensor_of(self, name: str) -> LidarSensor:
        """Return the LiDAR of a stream; the reference for a merged one."""
        return self.sensors[0] if self.merged else self.sensors[self.names.index(name)]


class ScanFeed:
    """Takes scans one by one, and gives those that belong together as soon as they are complete.

    Args:
        streams: Where the scans go; what they lack is counted there at the end.
    """

    def __init__(self, streams: LidarStreams) -> None:
        self._streams = streams
        self._names = {topic: sensor.name for topic, sensor in streams.by_topic.items()}
        self._grouper = ScanGrouper(streams.topics) if streams.merged else None

    def push(self, scan: PointCloud) -> list[tuple[str, tuple[PointCloud, ...]]]:
        """Take a scan, and return what is complete: names of streams with their scans."""
        if self._grouper is None:
            return [(self._names[scan.topic], (scan,))]
        return [(MERGED_NAME, group) for group in self._grouper.push(scan)]

    def flush(self) -> list[tuple[str, tuple[PointCloud, ...]]]:
        """Return what is still waiting at the end of the log."""
        if self._grouper is None:
            return []
        groups = [(MERGED_NAME, group) for group in self._grouper.flush()]
        self._streams.missing.update(self._grouper.missing)
        self._streams.unmatched.update(self._grouper.unmatched)
        return groups


def plan_streams(
    sensors: tuple[LidarSensor, ...], wanted: Literal["merge", "separate"] | None
) -> LidarStreams:
    """Decide whether several LiDARs are merged.

    Args:
        sensors: The LiDARs, with their places where known.
        wanted: What was asked for; None merges where the place of every LiDAR is known.

    Raises:
        UsageError: If a merge was asked for and a place is not known, or two sensors are one
            topic.
    """
    for topic, count in Counter(sensor.topic for sensor in sensors).items():
        if topic is not None and count > 1:
            names = " and ".join(f"'{s.name}'" for s in sensors if s.topic == topic)
            raise UsageError(
                f"{names} are one LiDAR",
                where=topic,
                remedy="Name each topic once, in --topic or in the rig",
            )
    lost = [sensor.name for sensor in sensors if sensor.T_base_sensor is None]
    if wanted == "merge" and lost:
        raise UsageError(
            f"cannot merge: the place of {', '.join(lost)} is not known",
            remedy="Give --rig, or use --lidars separate",
        )
    merged = len(sensors) > 1 and not lost and wanted != "separate"
    return LidarStreams(sensors, merged)


def first_clouds(
    streams: LidarStreams,
    recording: Recording,
    start_ns: int | None,
    end_ns: int | None,
    wanted: int,
) -> dict[str, list[PointCloud]]:
    """Return the first clouds of each stream, as many as wanted where there are so many.

    Raises:
        InputError: If no cloud of any stream has a point.
    """
    found: dict[str, list[PointCloud]] = {name: [] for name in streams.names}
    nonfinite = clouds = 0
    scouting = LidarStreams(streams.sensors, streams.merged)
    for name, cloud in scouting.clouds(recording, start_ns, end_ns):
        clouds += 1
        nonfinite += cloud.dropped_nonfinite
        if len(cloud) and len(found[name]) < wanted:
            found[name].append(cloud)
        if all(len(some) >= wanted for some in found.values()):
            break
    if not any(found.values()):
        raise InputError(
            _why_nothing(recording, clouds, nonfinite),
            where=", ".join(s.topic or s.name for s in streams.sensors),
            remedy="Choose another --topic, --start or --end, or look with `percept inspect`",
        )
    return found


def _why_nothing(recording: Recording, clouds: int, nonfinite: int) -> str:
    """Say why not one point came out of the log."""
    if nonfinite:
        return f"all points of all {clouds} scans are NaN or infinite ({nonfinite} points)"
    if clouds:
        return f"all {clouds} scans are empty"
    if recording.losses:
        lost = "; ".join(f"{count} x {reason}" for reason, count in recording.losses.items())
        return f"not one scan can be read: {lost}"
    return "no scan in this part of the log"
