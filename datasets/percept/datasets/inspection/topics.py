"""What an inspection says about one topic."""

from __future__ import annotations

from dataclasses import dataclass

from percept.core.health import Lateness
from percept.core.results import Verdict
from percept.datasets.inspection.clock import ClockHealth
from percept.datasets.inspection.sensors import SensorSummary
from percept.datasets.inspection.timing import StreamOrder, StreamTiming

__all__ = ["TopicReport"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicReport:
    """One topic.

    Attributes:
        topic: Name.
        type: Message type in ROS 2 style.
        kind: `lidar`, `camera`, `camera_info`, `imu`, `gnss`, `odometry`, `pose`, `tf`, `other`.
        frame: Coordinate frame of its first message; empty where it has none.
        count: Messages.
        bytes: Their serialized size.
        first_ns: Log time of the first message, or None without any.
        last_ns: Log time of the last message.
        timing: Rate, jitter and gaps.
        clock: Header against log clock; None without header stamps.
        order: Out-of-order, repeated and zero stamps.
        lateness: The watchdog's line; None for a stream without a rhythm.
        sensor: What the sensor delivers; None for other streams.
        undecodable: Why its messages cannot be decoded, or None where they can.
        decoding_losses: What had to be left out of the few messages that were decoded.
        verdict: `good`, `doubtful` or `bad`; streams that are no sensors are always `good`.
        why: Reasons for a verdict that is not good.
    """

    topic: str
    type: str
    kind: str
    frame: str
    count: int
    bytes: int
    first_ns: int | None
    last_ns: int | None
    timing: StreamTiming
    clock: ClockHealth | None
    order: StreamOrder
    lateness: Lateness | None
    sensor: SensorSummary | None
    undecodable: str | None
    decoding_losses: tuple[str, ...]
    verdict: Verdict = Verdict.GOOD
    why: tuple[str, ...] = ()
