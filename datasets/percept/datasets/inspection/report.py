"""One look at a log that says what is in it, what is wrong with it and what it is good for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from percept.core.errors import RecordingError
from percept.core.results import Verdict
from percept.core.samples import CameraInfo
from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.frames import FrameReport, read_frames, report_frames
from percept.datasets.inspection.kinds import SENSOR_KINDS, kind_of
from percept.datasets.inspection.sensors import SensorSummary, info_topic_of, probe, summarize
from percept.datasets.inspection.timing import StreamWatch
from percept.datasets.inspection.topics import TopicReport
from percept.datasets.inspection.uses import Use, judge_uses
from percept.datasets.inspection.verdict import judge_log, judge_topic
from percept.datasets.inspection.watchdog import lateness_of
from percept.datasets.recording import Recording, TopicInfo

__all__ = ["InputFile", "Inspection", "inspect_recording"]

_PROGRESS_EVERY = 1000


@dataclass(frozen=True, slots=True)
class InputFile:
    """One file of a log."""

    path: str
    bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """What an inspection found.

    Attributes:
        format: Of the log, as its recording says.
        files: What was read.
        start_ns: First log time, or None for a log without messages.
        end_ns: Last log time.
        duration_s: Between the two.
        messages: Number of messages that can be read.
        losses: What could not be read, by reason, with a count.
        verdict: `good`, `doubtful` or `bad`.
        why: What made the verdict.
        notes: What a user should know besides.
        topics: All topics, sorted by name.
        uses: Which jobs the log has the sensors for.
        frames: The tree of frames.
    """

    format: str
    files: tuple[InputFile, ...]
    start_ns: int | None
    end_ns: int | None
    duration_s: float
    messages: int
    losses: dict[str, int]
    verdict: Verdict
    why: tuple[str, ...]
    notes: tuple[str, ...]
    topics: tuple[TopicReport, ...]
    uses: tuple[Use, ...]
    frames: FrameReport

    def to_dict(self) -> dict[str, Any]:
        """Return plain values that JSON can hold."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class _Probed:
    frame: str = ""
    sensor: SensorSummary | None = None
    undecodable: str | None = None
    decoding_losses: tuple[str, ...] = ()


def inspect_recording(
    recording: Recording,
    config: InspectConfig | None = None,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> Inspection:
    """Look through a log once; memory does not grow with its length.

    Every message's times and size are read, transforms are decoded, and of each sensor a few
    samples.

    Args:
        recording: The log.
        config: Limits; the defaults where it is None.
        start_ns: Smallest log time to look at, inclusive.
        end_ns: Largest log time to look at, inclusive.
        on_progress: Called now and then with the number of messages seen so far.

    Raises:
        RecordingError: If the log is damaged and nothing of it can be read.
    """
    config = config or InspectConfig()
    infos = recording.topics()
    watches = _watch(recording, config, start_ns, end_ns, on_progress)
    whole = start_ns is None and end_ns is None
    if whole and recording.losses and not any(watch.count for watch in watches.values()):
        raise RecordingError(
            f"nothing in it can be read ({'; '.join(sorted(recording.losses))})",
            where=recording.paths[0] if recording.paths else None,
            remedy="Get the log again from where it was recorded",
        )
    tf_topics = [info.topic for info in infos if kind_of(info.sample_type) == "tf"]
    tree = read_frames(recording, tf_topics, start_ns, end_ns)
    # What the samples below cannot decode is told with their topics, not counted again.
    losses = dict(recording.losses)
    span_ns = _span(watches)
    probed = {i.topic: _probe(recording, i, infos, watches[i.topic]) for i in infos}
    reports = [_report(i, watches[i.topic], probed[i.topic], span_ns, config) for i in infos]
    topics = tuple(judge_topic(report, config) for report in reports)
    frames = report_frames(tree, {t.topic: t.frame for t in topics if t.kind in SENSOR_KINDS})
    judged = judge_log(topics, losses, frames, config)
    return Inspection(
        format=recording.format,
        files=tuple(InputFile(str(path), _size(path)) for path in recording.paths),
        start_ns=span_ns[0] if span_ns else None,
        end_ns=span_ns[1] if span_ns else None,
        duration_s=(span_ns[1] - span_ns[0]) / 1e9 if span_ns else 0.0,
        messages=sum(topic.count for topic in topics),
        losses=losses,
        verdict=judged.verdict,
        why=judged.why,
        notes=(*judged.notes, *recording.notes),
        topics=topics,
        uses=judge_uses(topics, frozenset(tree.frames())),
        frames=frames,
    )


def _watch(
    recording: Recording,
    config: InspectConfig,
    start_ns: int | None,
    end_ns: int | None,
    on_progress: Callable[[int], None] | None,
) -> dict[str, StreamWatch]:
    """Run all envelopes through a watch for each topic."""
    watches = {
        info.topic: StreamWatch(config, kind_of(info.sample_type)) for info in recording.topics()
    }
    for seen, envelope in enumerate(recording.envelopes()):
        if on_progress is not None and seen % _PROGRESS_EVERY == 0:
            on_progress(seen)
        if end_ns is not None and envelope.log_time_ns > end_ns:
            continue
        if start_ns is None or envelope.log_time_ns >= start_ns:
            watches[envelope.topic].add(envelope)
    return watches


def _span(watches: Mapping[str, StreamWatch]) -> tuple[int, int] | None:
    firsts = [w.first_ns for w in watches.values() if w.first_ns is not None]
    lasts = [w.last_ns for w in watches.values() if w.last_ns is not None]
    return (min(firsts), max(lasts)) if firsts else None


def _probe(
    recording: Recording, info: TopicInfo, infos: tuple[TopicInfo, ...], watch: StreamWatch
) -> _Probed:
    kind = kind_of(info.sample_type)
    if info.undecodable is not None:
        return _Probed(undecodable=" ".join(info.undecodable.split()))
    if kind not in SENSOR_KINDS or watch.first_ns is None or watch.last_ns is None:
        return _Probed()
    before = Counter(recording.losses)
    samples = probe(recording, info.topic, watch.first_ns, watch.last_ns)
    losses = tuple(
        text.removeprefix(f"{info.topic}: ") for text in sorted(recording.losses - before)
    )
    if not samples:
        return _Probed(undecodable="; ".join(losses) or "no message of it decodes")
    info_topic, camera_info = None, None
    if kind == "camera":
        names = [i.topic for i in infos if i.sample_type is CameraInfo and i.count]
        info_topic = info_topic_of(info.topic, names)
        camera_info = _camera_info(recording, info_topic)
    sensor = summarize(samples, info_topic, camera_info)
    return _Probed(samples[0].frame, sensor, decoding_losses=losses)


def _camera_info(recording: Recording, topic: str | None) -> CameraInfo | None:
    if topic is None:
        return None
    sample = next(iter(recording.samples(topics=[topic])), None)
    return sample if isinstance(sample, CameraInfo) else None


def _report(
    info: TopicInfo,
    watch: StreamWatch,
    probed: _Probed,
    span_ns: tuple[int, int] | None,
    config: InspectConfig,
) -> TopicReport:
    timing = watch.timing()
    given_hz = config.rates_hz.get(info.topic)
    nominal_s = 1 / given_hz if given_hz else timing.median_interval_s if timing.periodic else None
    lateness = (
        lateness_of(watch, nominal_s, span_ns, config)
        if nominal_s is not None and span_ns is not None
        else None
    )
    return TopicReport(
        topic=info.topic,
        type=info.msgtype,
        kind=kind_of(info.sample_type),
        frame=probed.frame,
        count=watch.count,
        bytes=watch.size_bytes,
        first_ns=watch.first_ns,
        last_ns=watch.last_ns,
        timing=timing,
        clock=watch.clock(),
        order=watch.order(),
        lateness=lateness,
        sensor=probed.sensor,
        undecodable=probed.undecodable,
        decoding_losses=probed.decoding_losses,
    )


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
