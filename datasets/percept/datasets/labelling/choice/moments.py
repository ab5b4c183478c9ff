"""Which image of each camera and which scan of each LiDAR belong to a keyframe."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.settings import Settings
from percept.core.trajectory import Trajectory
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.keyframes import Instant, KeyframeConfig, choose_instants
from percept.datasets.recording import Envelope

__all__ = ["Moment", "StreamStamps", "SyncConfig", "choose_moments", "evidence_near", "taken_ns"]


class SyncConfig(Settings):
    """How sensors are brought together.

    Attributes:
        tolerance_s: Farthest that an image or a scan may lie from its keyframe's time, s. What
            lies farther is left out of the keyframe.
    """

    tolerance_s: float = Field(default=0.1, ge=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moment:
    """A keyframe before anything of it is decoded.

    Attributes:
        instant: The moment, and why it was chosen.
        images: Stamp of its image by topic.
        scans: Stamp of its scan by topic.
    """

    instant: Instant
    images: Mapping[str, int]
    scans: Mapping[str, int]


def taken_ns(stamp_ns: int | None, log_time_ns: int, *, unstamped: bool = False) -> int:
    """Return when a message was taken: its header stamp, else the time of its recording.

    Args:
        stamp_ns: Its header stamp; None and 0 are none, as ROS drivers mean by it.
        log_time_ns: Time of its recording.
        unstamped: Whether the header stamps of its topic say nothing.
    """
    return log_time_ns if unstamped or not stamp_ns else stamp_ns


class StreamStamps:
    """When the messages of each topic were taken; see `taken_ns`.

    A topic whose messages all bear one stamp, as of a driver whose clock stands, counts as one
    without stamps.

    Args:
        envelopes: Of all topics.

    Attributes:
        unstamped: Topics whose header stamps say nothing.
    """

    def __init__(self, envelopes: Iterable[Envelope]) -> None:
        times: dict[str, tuple[list[int], list[int]]] = {}
        for one in envelopes:
            headers, recorded = times.setdefault(one.topic, ([], []))
            headers.append(one.stamp_ns or 0)
            recorded.append(one.log_time_ns)
        self.unstamped = frozenset(
            topic
            for topic, (headers, _) in times.items()
            if len(set(headers)) == 1 and (len(headers) > 1 or not headers[0])
        )
        self._counts = {topic: len(headers) for topic, (headers, _) in times.items()}
        self._stamps: dict[str, NDArray[np.int64]] = {}
        self._recorded: dict[str, NDArray[np.int64]] = {}
        for topic, (headers, recorded) in times.items():
            taken = [
                taken_ns(header, at, unstamped=topic in self.unstamped)
                for header, at in zip(headers, recorded, strict=True)
            ]
            self._stamps[topic], first = np.unique(np.array(taken), return_index=True)
            self._recorded[topic] = np.array(recorded)[first]

    def count(self, topic: str) -> int:
        """Return the number of messages of a topic."""
        return self._counts.get(topic, 0)

    def recorded_ns(self, topic: str, stamp_ns: int) -> int | None:
        """Return when the first message of a stamp was recorded; None if a topic has no such."""
        place = int(np.searchsorted(self.of(topic), stamp_ns))
        found = place < len(self.of(topic)) and int(self.of(topic)[place]) == stamp_ns
        return int(self._recorded[topic][place]) if found else None

    def of(self, topic: str) -> NDArray[np.int64]:
        """Return the stamps (N,) of a topic, ascending, each once."""
        return self._stamps.get(topic, np.zeros(0, np.int64))

    def nearest(
        self, topic: str, moments_ns: NDArray[np.int64], within_ns: int
    ) -> list[int | None]:
        """Return for each moment (M,) the nearest stamp of a topic, or None if all are too far.

        A stamp is given to one moment only, the one that is nearest to it.
        """
        stamps = self.of(topic)
        if not len(stamps) or not len(moments_ns):
            return [None] * len(moments_ns)
        after = np.searchsorted(stamps, moments_ns).clip(0, len(stamps) - 1)
        before = (after - 1).clip(0)
        closer = np.abs(stamps[before] - moments_ns) <= np.abs(stamps[after] - moments_ns)
        index = np.where(closer, before, after)
        away = np.abs(stamps[index] - moments_ns)
        best: dict[int, int] = {}
        for moment in np.argsort(away, kind="stable").tolist():
            if away[moment] <= within_ns:
                best.setdefault(int(index[moment]), moment)
        taken = {moment: int(stamps[one]) for one, moment in best.items()}
        return [taken.get(moment) for moment in range(len(moments_ns))]


def choose_moments(
    stamps: StreamStamps,
    cameras: Sequence[str],
    lidars: Sequence[str],
    poses: Trajectory | None,
    config: KeyframeConfig,
    sync: SyncConfig,
    evidence: Sequence[FrameEvidence] = (),
    earlier_ns: Sequence[int] = (),
) -> tuple[Moment, ...]:
    """Choose the keyframes of a log, and what belongs to each.

    The first LiDAR gives the moments, or the first camera where there is none: the points of a
    keyframe are then moved as little as possible.

    Args:
        stamps: Of all topics.
        cameras: Topics of images.
        lidars: Topics of scans.
        poses: `T_world_base`; None where not known.
        config: When a keyframe is due.
        sync: How far apart what belongs together may be.
        evidence: What is known of moments.
        earlier_ns: Keyframes of earlier logs: one that was cut out of another gets the same, and
            its images are then found to be there already.

    Returns:
        The keyframes in the order of time; those that have neither image nor scan are left out.
    """
    reference = next((topic for topic in (*lidars, *cameras) if len(stamps.of(topic))), None)
    if reference is None:
        return ()
    instants = choose_instants(
        stamps.of(reference), poses, config, evidence, np.array(sorted(earlier_ns), dtype=np.int64)
    )
    times = np.array([instant.stamp_ns for instant in instants], dtype=np.int64)
    within_ns = round(sync.tolerance_s * 1e9)
    found = {topic: stamps.nearest(topic, times, within_ns) for topic in (*lidars, *cameras)}
    moments = (
        Moment(
            instant=instant,
            images=_of_moment(found, cameras, number),
            scans=_of_moment(found, lidars, number),
        )
        for number, instant in enumerate(instants)
    )
    return tuple(moment for moment in moments if moment.images or moment.scans)


def evidence_near(
    evidence: Sequence[FrameEvidence], moments_ns: Sequence[int], within_ns: int
) -> list[FrameEvidence | None]:
    """Return for each moment the evidence nearest in time, or None if all is too far."""
    if not evidence:
        return [None] * len(moments_ns)
    ordered = sorted(evidence, key=lambda one: one.stamp_ns)
    times = np.array([one.stamp_ns for one in ordered])
    found: list[FrameEvidence | None] = []
    for moment_ns in moments_ns:
        nearest = int(np.argmin(np.abs(times - moment_ns)))
        close = abs(int(times[nearest]) - moment_ns) <= within_ns
        found.append(ordered[nearest] if close else None)
    return found


def _of_moment(
    found: Mapping[str, list[int | None]], topics: Sequence[str], number: int
) -> dict[str, int]:
    return {topic: stamp for topic in topics if (stamp := found[topic][number]) is not None}
