"""Several LiDARs as one: scans that belong together are grouped, then merged in the base frame."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS
from percept.core.errors import GeometryError, UsageError
from percept.core.samples import PointCloud
from percept.core.transform import Transform

__all__ = ["ScanGrouper", "merge_clouds", "placed_cloud"]

_Number = TypeVar("_Number", np.float32, np.int32)

_LONGEST_WAIT_SCANS = 5
_INTERVALS_KEPT = 9
_FIRST_TOLERANCE_NS = 50 * NS_PER_MS


class ScanGrouper:
    """Groups the scans of several LiDARs by their stamps while they stream in.

    The first topic is the reference: each of its scans begins one group, which takes from every
    other topic the scan with the nearest stamp, if that is within the tolerance and not nearer
    to another scan of the reference. A group may be short of a sensor, which is counted, and so
    is a scan that no group took. Nothing waits for longer than five scans of the reference, so
    that memory stays flat when a sensor dies.

    Attributes:
        missing: By topic, groups that went out without it.
        unmatched: By topic, scans that no group took.
    """

    def __init__(self, topics: Sequence[str], tolerance_ns: int | None = None) -> None:
        """Take the topics, the reference first.

        Args:
            topics: Two or more topics.
            tolerance_ns: Largest difference of stamps within a group; half the median period of
                the reference where it is None (50 ms until that is known).

        Raises:
            UsageError: If there is no topic, one is named twice, or the tolerance is negative.
        """
        if not topics or len(set(topics)) != len(topics):
            raise UsageError(f"a group needs different topics, not {list(topics)}")
        if tolerance_ns is not None and tolerance_ns < 0:
            raise UsageError(f"a tolerance cannot be negative ({tolerance_ns} ns)")
        self.missing: Counter[str] = Counter()
        self.unmatched: Counter[str] = Counter()
        self._reference = topics[0]
        self._fixed_ns = tolerance_ns
        self._intervals_ns: deque[int] = deque(maxlen=_INTERVALS_KEPT)
        self._last_ns: int | None = None
        self._waiting: deque[PointCloud] = deque()
        self._others: dict[str, list[PointCloud]] = {topic: [] for topic in topics[1:]}

    @property
    def tolerance_ns(self) -> int:
        """Largest difference of stamps within a group, as it is known now."""
        if self._fixed_ns is not None:
            return self._fixed_ns
        if not self._intervals_ns:
            return _FIRST_TOLERANCE_NS
        return int(np.median(self._intervals_ns)) // 2

    def groups(self, clouds: Iterable[PointCloud]) -> Iterator[tuple[PointCloud, ...]]:
        """Yield groups, reference first and then in the order of the topics.

        Args:
            clouds: Scans of the topics, in log order.
        """
        for cloud in clouds:
            yield from self.push(cloud)
        yield from self.flush()

    def push(self, cloud: PointCloud) -> list[tuple[PointCloud, ...]]:
        """Take one scan, and return the groups that are complete now.

        Raises:
            UsageError: If the scan's topic is none of the grouper's.
        """
        if cloud.topic == self._reference:
            if self._last_ns is not None and cloud.stamp_ns > self._last_ns:
                self._intervals_ns.append(cloud.stamp_ns - self._last_ns)
            self._last_ns = cloud.stamp_ns
            self._waiting.append(cloud)
        elif cloud.topic in self._others:
            self._others[cloud.topic].append(cloud)
            self._forget_oldest(cloud.topic)
        else:
            known = ", ".join([self._reference, *self._others])
            raise UsageError(f"topic '{cloud.topic}' is none of {known}")
        done = []
        while self._waiting and self._is_settled(self._waiting[0]):
            done.append(self._take(self._waiting.popleft()))
        return done

    def flush(self) -> list[tuple[PointCloud, ...]]:
        """Return what is still waiting at the end of the log, and count what is left over."""
        done = []
        while self._waiting:
            done.append(self._take(self._waiting.popleft()))
        for topic, scans in self._others.items():
            self._drop(topic, scans)
        return done

    def _is_settled(self, reference: PointCloud) -> bool:
        """Tell whether no later scan can come nearer to this one, or it has waited enough."""
        if len(self._waiting) > _LONGEST_WAIT_SCANS:
            return True
        # Until the second reference scan the period, and so the tolerance, is not known.
        if self._fixed_ns is None and not self._intervals_ns:
            return False
        return all(
            any(scan.stamp_ns >= reference.stamp_ns for scan in scans)
            for scans in self._others.values()
        )

    def _take(self, reference: PointCloud) -> tuple[PointCloud, ...]:
        group = [reference]
        for topic, scans in self._others.items():
            nearest = self._nearest(reference.stamp_ns, scans)
            if nearest is None:
                self.missing[topic] += 1
            else:
                group.append(nearest)
            limit = reference.stamp_ns - self.tolerance_ns
            past = [s for s in scans if s is not nearest and s.stamp_ns < limit]
            self._others[topic] = [s for s in scans if s is not nearest and s.stamp_ns >= limit]
            self._drop(topic, past)
        return tuple(group)

    def _nearest(self, stamp_ns: int, scans: Sequence[PointCloud]) -> PointCloud | None:
        """Return the nearest scan within the tolerance that is not nearer to a waiting one."""
        later_ns = [waiting.stamp_ns for waiting in self._waiting]
        claims = []
        for scan in scans:
            distance = abs(scan.stamp_ns - stamp_ns)
            better = any(abs(scan.stamp_ns - other) < distance for other in later_ns)
            if distance <= self.tolerance_ns and not better:
                claims.append((distance, scan))
        return min(claims, key=lambda claim: claim[0], default=(0, None))[1]

    def _forget_oldest(self, topic: str) -> None:
        scans = self._others[topic]
        if len(scans) > 2 * _LONGEST_WAIT_SCANS:
            self._drop(topic, [scans.pop(0)])

    def _drop(self, topic: str, scans: list[PointCloud]) -> None:
        if scans:
            self.unmatched[topic] += len(scans)
            scans.clear()


def merge_clouds(
    clouds: Sequence[PointCloud], T_base_sensors: Mapping[str, Transform]
) -> PointCloud:
    """Merge scans into one cloud in the base frame, with the first one's stamp.

    `offset_ns` counts from the first scan's stamp; a sensor without times of its points has
    all of them at its scan's stamp. Intensities stay in each sensor's own units, NaN for the
    points of a sensor that has none (None where no sensor has any). `ring` is the beam within
    its own sensor, -1 for the points of a sensor without rings (None where no sensor has any).
    Points stay where they were measured: a vehicle that moves 1 m during a turn smears what two
    sensors see at different times by up to that much.

    Args:
        clouds: One scan of each sensor, the reference first.
        T_base_sensors: By topic, all into one base frame.

    Raises:
        GeometryError: If there is no cloud, a topic has no transform, or the bases differ.
    """
    if not clouds:
        raise GeometryError("there is no cloud to merge")
    placed = [_in_base(cloud, T_base_sensors) for cloud in clouds]
    bases = sorted({cloud.frame for cloud in placed})
    if len(bases) > 1:
        raise GeometryError(f"clouds of one group end in several base frames: {', '.join(bases)}")
    first = placed[0]
    return PointCloud(
        topic="+".join(cloud.topic for cloud in clouds),
        stamp_ns=first.stamp_ns,
        log_time_ns=max(cloud.log_time_ns for cloud in clouds),
        frame=first.frame,
        points_xyz=np.concatenate([cloud.points_xyz for cloud in placed]),
        intensity=_joined([c.intensity for c in placed], placed, np.float32(np.nan)),
        offset_ns=_joined_offsets(placed),
        ring=_joined([c.ring for c in placed], placed, np.int32(-1)),
        dropped_nonfinite=sum(cloud.dropped_nonfinite for cloud in clouds),
    )


def placed_cloud(cloud: PointCloud, T_base_sensor: Transform) -> PointCloud:
    """Return a cloud in the base frame.

    The sensor's place counts, not the frame name in the log: drivers of several LiDARs often
    share one name.

    Args:
        cloud: A scan in its sensor's frame.
        T_base_sensor: Where that sensor sits.
    """
    return cloud.transformed(Transform(T_base_sensor.target, cloud.frame, T_base_sensor.matrix))


def _in_base(cloud: PointCloud, T_base_sensors: Mapping[str, Transform]) -> PointCloud:
    if cloud.topic not in T_base_sensors:
        raise GeometryError(
            f"'{cloud.topic}' has no transform into the base frame",
            remedy="Give a rig that places this sensor, or detect on each sensor separately",
        )
    return placed_cloud(cloud, T_base_sensors[cloud.topic])


def _joined(
    columns: Sequence[NDArray[_Number] | None], clouds: Sequence[PointCloud], filler: _Number
) -> NDArray[_Number] | None:
    if all(column is None for column in columns):
        return None
    return np.concatenate(
        [
            np.full(len(cloud), filler) if column is None else column
            for column, cloud in zip(columns, clouds, strict=True)
        ]
    )


def _joined_offsets(clouds: Sequence[PointCloud]) -> NDArray[np.int64] | None:
    stamp_ns = clouds[0].stamp_ns
    if all(cloud.offset_ns is None and cloud.stamp_ns == stamp_ns for cloud in clouds):
        return None
    parts = []
    for cloud in clouds:
        own = np.zeros(len(cloud), np.int64) if cloud.offset_ns is None else cloud.offset_ns
        parts.append(own + (cloud.stamp_ns - stamp_ns))
    return np.concatenate(parts)
