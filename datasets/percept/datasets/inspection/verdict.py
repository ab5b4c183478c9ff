"""The verdict on a log: findings about its topics, and what follows from all of them.

- A sensor stream is *bad* when it cannot be used: nothing of it decodes, or more than `bad_share`
  of it is without stamps or out of order, or it is late for more than `bad_share` of the time
  although its rate was given. It is *doubtful* beyond the other limits of `InspectConfig`.
- A log is *bad* when it has no messages, when every sensor stream in it is bad, or when a topic
  is missing whose rate was given. It is *doubtful* when a part of it could not be read, a sensor
  stream is not good, or its frames contradict each other. Else it is *good*.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from percept.core.results import Verdict
from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.frames import FrameReport
from percept.datasets.inspection.kinds import SENSOR_KINDS
from percept.datasets.inspection.sensors import CameraSummary, GnssSummary, ImuSummary, LidarSummary
from percept.datasets.inspection.topics import TopicReport

__all__ = ["LogVerdict", "judge_log", "judge_topic", "seconds_as_text"]

_TOPICS_NAMED = 4
_MINUTE, _HOUR, _DAY, _YEAR = 60.0, 3600.0, 86400.0, 365.25 * 86400
# GPS time does not follow leap seconds, and TAI is 19 s ahead of GPS; since 2017 these are fixed.
_KNOWN_OFFSETS_S = {-18.0: "GPS time against UTC?", -37.0: "TAI against UTC?"}


@dataclass(frozen=True, slots=True)
class LogVerdict:
    """The verdict on a whole log.

    Attributes:
        verdict: `good`, `doubtful` or `bad`.
        why: What made it so; empty for a good log.
        notes: What a user should know although it does not count against the log.
    """

    verdict: Verdict
    why: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Finding:
    problem: str
    detail: str
    bad: bool = False


def judge_topic(topic: TopicReport, config: InspectConfig) -> TopicReport:
    """Return the topic with its verdict; only streams of sensors are judged."""
    if topic.kind not in SENSOR_KINDS:
        return topic
    findings = _findings(topic, config)
    if not findings:
        return topic
    bad = any(finding.bad for finding in findings)
    return replace(
        topic,
        verdict=Verdict.BAD if bad else Verdict.DOUBTFUL,
        why=tuple(_with_detail(f.problem, f.detail) for f in findings),
    )


def judge_log(
    topics: Sequence[TopicReport],
    losses: Mapping[str, int],
    frames: FrameReport,
    config: InspectConfig,
) -> LogVerdict:
    """Return the verdict that follows from the topics, the losses and the frames."""
    notes = tuple(_notes(topics, frames))
    if not any(topic.count for topic in topics):
        return LogVerdict(Verdict.BAD, ("it holds no messages",), notes)
    doubts = [f"lost: {reason} ({count:,})" for reason, count in sorted(losses.items())]
    doubts += frames.conflicts
    doubts += _grouped(topics, config)
    sensors = [topic for topic in topics if topic.kind in SENSOR_KINDS]
    unusable = [topic for topic in sensors if topic.verdict is Verdict.BAD]
    absent = sorted(set(config.rates_hz) - {topic.topic for topic in topics})
    failures = [f"expected but not in the log: {name}" for name in absent]
    if sensors and len(unusable) == len(sensors):
        failures.append("no sensor stream in it can be used")
    why = (*failures, *doubts)
    if failures:
        return LogVerdict(Verdict.BAD, why, notes)
    return LogVerdict(Verdict.DOUBTFUL if why else Verdict.GOOD, why, notes)


def seconds_as_text(seconds: float) -> str:
    """Return a length of time with a fitting unit, such as `12 ms`, `37.0 s` or `5.2 years`."""
    size = abs(seconds)
    for limit, unit, name in ((_YEAR, _YEAR, "years"), (_DAY, _DAY, "days"), (_HOUR, _HOUR, "h")):
        if size >= limit:
            return f"{seconds / unit:.1f} {name}"
    if size >= 2 * _MINUTE:
        return f"{seconds / _MINUTE:.1f} min"
    if size >= 1:
        return f"{seconds:.1f} s"
    return f"{seconds * 1e3:.0f} ms" if size >= 0.01 else f"{seconds * 1e3:.2f} ms"


def _findings(topic: TopicReport, config: InspectConfig) -> list[_Finding]:
    if topic.undecodable is not None:
        return [_Finding("cannot be decoded", topic.undecodable, bad=True)]
    if topic.count == 0:
        return [_Finding("without messages", "")]
    return [
        *_rhythm_findings(topic, config),
        *_clock_findings(topic, config),
        *_order_findings(topic, config),
        *_sensor_findings(topic),
    ]


def _rhythm_findings(topic: TopicReport, config: InspectConfig) -> Iterator[_Finding]:
    late = topic.lateness
    if late is not None and late.late_share > config.max_late_share:
        detail = f"{late.late_share:.0%} of the time, longest {seconds_as_text(late.longest_s)}"
        expected = topic.topic in config.rates_hz
        yield _Finding("late", detail, bad=expected and late.late_share > config.bad_share)
    dropped = topic.timing.dropped_estimate
    if dropped > config.max_dropped_share * (topic.count + dropped):
        gaps = topic.timing.gap_count
        plural = "s" if gaps != 1 else ""
        yield _Finding("messages missing", f"about {dropped:,} in {gaps:,} gap{plural}")


def _clock_findings(topic: TopicReport, config: InspectConfig) -> Iterator[_Finding]:
    clock = topic.clock
    if clock is None:
        return
    if abs(clock.offset_s) > config.max_offset_s:
        detail = _offset_as_text(clock.offset_s, (topic.last_ns or 0) / 1e9)
        yield _Finding("header clock is off the log clock", detail)
    drift, sd = clock.drift_ppm, clock.drift_sd_ppm
    # Three standard deviations, so that a short log is not blamed for its own noise.
    if drift is not None and sd is not None and abs(drift) - 3 * sd > config.max_drift_ppm:
        yield _Finding("header clock drifts", f"{drift:+.0f} ppm")
    if clock.jump_count:
        first = clock.jumps[0]
        times = "once" if clock.jump_count == 1 else f"{clock.jump_count} times"
        yield _Finding(
            "header clock jumps against the log clock",
            f"{times}, first by {seconds_as_text(first.step_s)}",
        )


def _order_findings(topic: TopicReport, config: InspectConfig) -> Iterator[_Finding]:
    order, count = topic.order, topic.count
    if order.zero_stamps:
        share = order.zero_stamps / count
        yield _Finding("header stamps are zero", f"{share:.1%}", bad=share > config.bad_share)
    if order.header_disorder > config.max_disorder_share * count:
        share = order.header_disorder / count
        yield _Finding("header stamps out of order", f"{share:.1%}", bad=share > config.bad_share)
    if order.log_disorder > config.max_disorder_share * count:
        yield _Finding("log times out of order", f"{order.log_disorder / count:.1%}")
    if order.duplicate_stamps > config.max_duplicate_share * count:
        yield _Finding("header stamps repeat", f"{order.duplicate_stamps / count:.1%}")


def _sensor_findings(topic: TopicReport) -> Iterator[_Finding]:
    sensor = topic.sensor
    if topic.decoding_losses:
        yield _Finding("left out while decoding", "; ".join(topic.decoding_losses))
    if isinstance(sensor, LidarSummary) and sensor.points == 0:
        yield _Finding("scans without a finite point", "", bad=True)
    if isinstance(sensor, CameraSummary) and sensor.info_problem is not None:
        yield _Finding("CameraInfo cannot be right", sensor.info_problem)
    if isinstance(sensor, ImuSummary) and sensor.problem is not None:
        yield _Finding("IMU is not in SI units", sensor.problem)
    if isinstance(sensor, GnssSummary) and sensor.fix_share == 0:
        yield _Finding("without a fix", "")


def _offset_as_text(offset_s: float, log_time_s: float) -> str:
    side = "behind" if offset_s > 0 else "ahead"
    hints = [text for value, text in _KNOWN_OFFSETS_S.items() if abs(offset_s - value) < 1]
    if abs(log_time_s - offset_s) < _YEAR:
        hints = ["counted from 0: simulated time, or since power-on"]
    return ", ".join([f"{seconds_as_text(abs(offset_s))} {side}", *hints])


def _with_detail(problem: str, detail: str) -> str:
    return f"{problem} ({detail})" if detail else problem


def _grouped(topics: Sequence[TopicReport], config: InspectConfig) -> list[str]:
    """Return one line for each problem, with the topics that have it."""
    groups: dict[str, dict[str, list[str]]] = {}
    for topic in topics:
        if topic.kind in SENSOR_KINDS:
            for finding in _findings(topic, config):
                alike = groups.setdefault(finding.problem, {})
                alike.setdefault(finding.detail, []).append(topic.topic)
    return [
        f"{problem}: "
        + _listed([_with_detail(_listed(names), detail) for detail, names in alike.items()])
        for problem, alike in groups.items()
    ]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_TOPICS_NAMED])
    return shown + (f" and {len(names) - _TOPICS_NAMED} more" if len(names) > _TOPICS_NAMED else "")


def _notes(topics: Sequence[TopicReport], frames: FrameReport) -> Iterator[str]:
    if any(t.last_ns is not None and t.last_ns < _YEAR * 1e9 for t in topics):
        yield "its times count from zero, not from a date"
    undecodable: dict[str, list[str]] = {}
    for topic in topics:
        if topic.undecodable is not None and topic.kind not in SENSOR_KINDS:
            undecodable.setdefault(topic.undecodable, []).append(topic.topic)
    for reason, names in undecodable.items():
        yield f"cannot be decoded: {_listed(names)} ({reason})"
    if len(frames.roots) > 1:
        yield f"the frames fall into {len(frames.roots)} trees: roots {_listed(frames.roots)}"
    if frames.missing and frames.tree:
        named = [f"{frame} ({_listed(names)})" for frame, names in frames.missing.items()]
        yield f"frames of sensors that tf does not know: {_listed(named)}"
    elif frames.missing:
        yield "there is no tf: where the sensors sit has to come from a rig file"
