"""Poses of a log: from the source that was asked for, and from the others beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Literal

from percept.cli.odometry.found import FoundPoses, found_by_lidar, found_in_log
from percept.cli.odometry.request import OdometryConfig, Source
from percept.cli.progress import progress_bar
from percept.core.errors import InputError, InsufficientDataError, UsageError
from percept.core.geodesy import LocalFrame
from percept.core.navigation import NavigationTopics
from percept.core.rig import LidarSensor, Rig
from percept.core.samples import (
    GnssFix,
    ImuSample,
    OdometrySample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.datasets.navigation_topics import choose_navigation
from percept.datasets.recording import Recording
from percept.datasets.sensors import check_topics, choose_lidars, read_static_transforms
from percept.odometry.lidar import LidarOdometry
from percept.odometry.poses import PoseSource
from percept.odometry.sources import poses_from_samples

__all__ = ["PoseFinder"]

_KINDS: dict[type[Sample], str] = {
    GnssFix: "gnss", ImuSample: "imu", OdometrySample: "odometry", PoseSample: "pose",
    TransformSample: "tf", PointCloud: "lidar",
}  # fmt: skip


class PoseFinder:
    """Finds poses in one log.

    Args:
        recording: The log.
        rig: The rig that was given, or None.
        config: Settings.
        source: What the poses are to be made from; `auto` takes the best that the log has.
        topics: Topics that were asked for; others are not used where there are any.
        window_ns: First and last log time that are wanted.
        origin: Where the frame `map` lies on the earth, or None.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Raises:
        TopicNotFoundError: If a topic is not in the log; names the candidates.
        InputError: If a topic holds nothing that poses come from.
        UsageError: If two topics are of one kind, or do not go with the source.
    """

    def __init__(
        self,
        recording: Recording,
        rig: Rig | None,
        config: OdometryConfig,
        *,
        source: Source,
        topics: tuple[str, ...] = (),
        window_ns: tuple[int | None, int | None],
        origin: LocalFrame | None = None,
        check_interrupt: Callable[[], None],
    ) -> None:
        self._recording = recording
        self._rig = rig
        self._config = config
        self._window_ns = window_ns
        self._origin = origin
        self._check = check_interrupt
        self._tree = read_static_transforms(recording)
        wanted = _topics_by_kind(recording, topics)
        self._lidar_topic = wanted.pop("lidar", None)
        self.source = _settled(source, wanted, self._lidar_topic)
        self._topics = choose_navigation(recording, rig, wanted, self._tree)

    def find(self) -> FoundPoses:
        """Return the poses of the source that was asked for, or of the best one.

        Raises:
            PerceptError: If there are none.
        """
        if self.source == "lidar":
            return self.by_lidar()
        if self.source != "auto":
            return self._in_log(self._preferred(self.source))
        if not self._topics.names():
            return self.by_lidar()
        try:
            return self._in_log("auto")
        except InsufficientDataError:
            if not self._has_clouds():
                raise
            return self.by_lidar()

    def in_log(self) -> FoundPoses | None:
        """Return the best poses that the log has ready; None where it has no topic for them.

        Raises:
            PerceptError: If those that it has are of no use.
        """
        return self._in_log("auto") if self._topics.names() else None

    def others(self, found: FoundPoses) -> list[FoundPoses]:
        """Return the poses of the other sources that the log has ready, to compare with."""
        topics = self._topics
        wanted: list[PoseSource] = []
        if topics.gnss is not None and not found.source.startswith("gnss"):
            wanted.append(self._preferred("gnss"))
        if topics.odometry is not None and found.source != "odometry":
            wanted.append("odometry")
        if topics.pose is not None and found.source != "pose":
            wanted.append("pose")
        beside = []
        for source in wanted:
            try:
                beside.append(self._in_log(source))
            except InsufficientDataError:
                continue
        return beside

    def by_lidar(self) -> FoundPoses:
        """Return the poses by LiDAR.

        Raises:
            PerceptError: If the log has no LiDAR, or too few scans.
        """
        sensor = self._lidar()
        odometry = LidarOdometry(self._config.lidar, T_base_sensor=sensor.T_base_sensor)
        topic = sensor.topic or sensor.name
        count = next(t.count for t in self._recording.topics() if t.topic == topic)
        before, number = Counter(self._recording.losses), 0
        with progress_bar("registering scans", max(count, 1)) as advance:
            for number, cloud in enumerate(self._clouds(topic), start=1):
                odometry.push(cloud)
                advance(number)
                self._check()
        if not number:
            raise InputError(
                "no scan in this part of the log",
                where=topic,
                remedy="Choose another --topic, --start or --end, or look with `percept inspect`",
            )
        lost = Counter(self._recording.losses) - before
        return found_by_lidar(odometry.result(), topic, lost)

    def _in_log(self, prefer: PoseSource | Literal["auto"]) -> FoundPoses:
        names, (start_ns, end_ns) = self._topics.names(), self._window_ns
        samples = self._recording.samples(topics=names, start_ns=start_ns, end_ns=end_ns)
        with progress_bar(f"reading {', '.join(names)}", None):
            poses = poses_from_samples(
                self._topics,
                self._checked(samples),
                origin=self._origin,
                prefer=prefer,
                config=self._config.filter,
            )
        return found_in_log(poses)

    def _checked(self, samples: Iterator[Sample]) -> Iterator[Sample]:
        for sample in samples:
            self._check()
            yield sample

    def _preferred(self, source: str) -> PoseSource:
        """Return the source by the word of the command line; checks that the log has it."""
        topics: NavigationTopics = self._topics
        if getattr(topics, source) is None:
            raise InputError(
                f"the log has nothing for --source {source}",
                where=self._recording.paths[0],
                remedy=f"It has {', '.join(topics.names()) or 'no poses, fixes or transforms'}",
            )
        if source == "gnss":
            return "gnss" if topics.imu is None else "gnss+imu"
        named: dict[str, PoseSource] = {"odometry": "odometry", "pose": "pose", "tf": "tf"}
        return named[source]

    def _has_clouds(self) -> bool:
        return any(t.sample_type is PointCloud and t.count for t in self._recording.topics())

    def _clouds(self, topic: str) -> Iterator[PointCloud]:
        start_ns, end_ns = self._window_ns
        samples = self._recording.samples(topics=[topic], start_ns=start_ns, end_ns=end_ns)
        return (sample for sample in samples if isinstance(sample, PointCloud))

    def _lidar(self) -> LidarSensor:
        """Return the LiDAR that was asked for, or the one that sees the most points."""
        if self._lidar_topic is not None:
            check_topics(self._recording, {"lidar": self._lidar_topic}, PointCloud)
            for sensor in choose_lidars(self._recording, self._rig, {}, self._tree):
                if sensor.topic == self._lidar_topic:
                    return sensor
            wanted = {"lidar": self._lidar_topic}
            return choose_lidars(self._recording, self._rig, wanted, self._tree)[0]
        sensors = choose_lidars(self._recording, self._rig, {}, self._tree)
        return max(sensors, key=lambda s: self._points_of_first(s.topic or s.name))

    def _points_of_first(self, topic: str) -> int:
        return len(next(self._clouds(topic), ()))


def _topics_by_kind(recording: Recording, topics: tuple[str, ...]) -> dict[str, str]:
    every = {info.topic: info for info in recording.topics()}
    wanted: dict[str, str] = {}
    for topic in topics:
        # A topic that is missing, or of no use, is refused as one of poses, with the candidates.
        info = every.get(topic)
        kind = "odometry" if info is None else _KINDS.get(info.sample_type, "odometry")
        if kind in wanted:
            raise UsageError(f"--topic names two topics of {kind}: {wanted[kind]} and {topic}")
        wanted[kind] = topic
    return wanted


def _settled(source: Source, wanted: dict[str, str], lidar_topic: str | None) -> Source:
    """Return the source: a LiDAR that is named, and nothing else, is meant to be used."""
    if lidar_topic is not None and not wanted and source == "auto":
        return "lidar"
    if source in ("gnss", "odometry", "pose", "tf") and wanted and source not in wanted:
        raise UsageError(
            f"--source {source} and --topic {next(iter(wanted.values()))} do not go together",
            remedy=f"Name a topic of {source}, or leave one of the two out",
        )
    return source
