"""The run behind `percept detect`: from a log to the run folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from percept.cli.detect_verdict import RunFacts, judge
from percept.cli.interrupts import deferred_interrupt
from percept.cli.lidar_streams import LidarStreams, first_clouds, plan_streams
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.cli.window import log_window_ns
from percept.core.rig import Rig, load_rig
from percept.core.samples import PointCloud
from percept.core.settings import Settings, load_settings
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.recording import Recording
from percept.datasets.sensors import choose_lidars
from percept.export.detection_report import detection_report
from percept.export.detection_summary import DetectionSummary
from percept.export.finished import detections_of
from percept.export.journal import FrameJournal
from percept.export.overlay import OverlayWriter
from percept.export.report import write_report
from percept.export.tables import DETECTIONS_3D, write_parquet
from percept.export.view import ViewWriter
from percept.lidar.pipeline import LidarConfig, LidarDetector
from percept.lidar.prepare import prepare_detector

__all__ = ["DetectConfig", "DetectRequest", "run_detection"]

_FIRST_CLOUDS = 10
_JOURNAL = ".journal"
_OUTPUTS = ("detections_3d.parquet", "view.rrd", "report.html", "overlay.mcap", _JOURNAL)


class DetectConfig(Settings):
    """All settings of `percept detect`.

    Attributes:
        lidars: `merge` or `separate`; None merges where the place of every LiDAR is known.
        lidar: The LiDAR pipeline.
    """

    lidars: Literal["merge", "separate"] | None = None
    lidar: LidarConfig = Field(default_factory=LidarConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectRequest:
    """What the command line asked for; see the options of `percept detect`."""

    bags: tuple[Path, ...]
    out: Path
    rig: Path | None = None
    topics: Mapping[str, str]
    config: Path | None = None
    flags: Mapping[str, Any]
    start_s: float | None = None
    end_s: float | None = None
    overlay: bool = False
    resume: bool = False
    force: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """What is settled before the first scan is judged."""

    config: DetectConfig
    streams: LidarStreams
    detectors: Mapping[str, LidarDetector]
    start_ns: int | None
    end_ns: int | None
    frames_expected: int

    def transforms(self) -> list[Transform]:
        """Return where the sensors sit, for the view."""
        placed = [s.T_base_sensor for s in self.streams.sensors if s.T_base_sensor is not None]
        return placed if self.streams.merged or len(placed) == len(self.streams.sensors) else []


def run_detection(request: DetectRequest) -> dict[str, Any]:
    """Detect objects in a log and fill the run folder; return the content of `run.json`.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(DetectConfig, request.config, dict(request.flags))
    rig = load_rig(request.rig) if request.rig is not None else None
    with (
        deferred_interrupt() as check,
        RunFolder(
            request.out, force=request.force, resume=request.resume, outputs=_OUTPUTS
        ) as folder,
        open_recording(list(request.bags)) as recording,
    ):
        plan = _plan(recording, rig, config, request)
        check()
        folder.begin()
        return _fill(folder, recording, plan, request, check)


def _plan(
    recording: Recording, rig: Rig | None, config: DetectConfig, request: DetectRequest
) -> _Plan:
    streams = plan_streams(choose_lidars(recording, rig, request.topics), config.lidars)
    start_ns, end_ns = log_window_ns(recording, request.start_s, request.end_s)
    first = first_clouds(streams, recording, start_ns, end_ns, _FIRST_CLOUDS)
    detectors = {}
    for name, clouds in first.items():
        if clouds:
            T_base_sensor = streams.placed(name)
            detectors[name] = prepare_detector(
                clouds,
                _with_base_height(config.lidar, T_base_sensor),
                sensor=name,
                merged=streams.merged,
                T_base_sensor=(
                    Transform.identity(clouds[0].frame, clouds[0].frame)
                    if T_base_sensor is not None
                    else None
                ),
            )
    counted = [s.topic for s in streams.sensors][: 1 if streams.merged else None]
    scans = sum(topic.count for topic in recording.topics() if topic.topic in counted)
    return _Plan(
        config=config,
        streams=streams,
        detectors=detectors,
        start_ns=start_ns,
        end_ns=end_ns,
        frames_expected=max(scans, 1),
    )


def _with_base_height(config: LidarConfig, T_base_sensor: Transform | None) -> LidarConfig:
    """Turn a sensor's height into that of the base frame, in which its clouds are judged."""
    if config.sensor_height_m is None or T_base_sensor is None:
        return config
    height_m = max(config.sensor_height_m - float(T_base_sensor.translation_m[2]), 0.0)
    return config.model_copy(update={"sensor_height_m": height_m})


def _fill(
    folder: RunFolder,
    recording: Recording,
    plan: _Plan,
    request: DetectRequest,
    check_interrupt: Callable[[], None],
) -> dict[str, Any]:
    fingerprint = _fingerprint(recording, plan)
    summary = DetectionSummary()
    with FrameJournal(folder.path / _JOURNAL, fingerprint, resume=request.resume) as journal:
        for finished, rows in journal.read():
            summary.add_finished(finished, detections_of(finished, rows))
        with ViewWriter(
            folder.path / "view.rrd",
            run_id=fingerprint,
            T_root_frames=plan.transforms(),
            frames_expected=plan.frames_expected,
            resume=journal.next_frame > 0,
        ) as view:
            _judge_scans(recording, plan, journal, summary, view, check_interrupt)
            notes = [view.close().as_text()]
        write_parquet(folder.path / "detections_3d.parquet", DETECTIONS_3D, journal.batches())
        if request.overlay:
            _write_overlay(folder.path / "overlay.mcap", journal)
        run = _conclude(folder, recording, plan, summary, notes)
        journal.remove()
    return run


def _judge_scans(
    recording: Recording,
    plan: _Plan,
    journal: FrameJournal,
    summary: DetectionSummary,
    view: ViewWriter,
    check_interrupt: Callable[[], None],
) -> None:
    """Run the detectors over all scans that are not finished."""
    done = journal.next_frame
    with progress_bar("detecting", plan.frames_expected) as advance:
        for frame, (name, cloud) in enumerate(_with_points(recording, plan, summary)):
            if frame >= done:
                result = plan.detectors[name].detect(cloud)
                journal.append(frame, result)
                summary.add(frame, result)
                view.add(frame, result)
            advance(frame + 1)
            check_interrupt()


def _with_points(
    recording: Recording, plan: _Plan, summary: DetectionSummary
) -> Iterator[tuple[str, PointCloud]]:
    """Yield the clouds of the streams that have a detector: the others never have a point."""
    for name, cloud in plan.streams.clouds(recording, plan.start_ns, plan.end_ns):
        if name in plan.detectors:
            yield name, cloud
        else:
            summary.dropped[f"scans of {name} without a point"] += 1


def _write_overlay(path: Path, journal: FrameJournal) -> None:
    with OverlayWriter(path) as overlay:
        for finished, rows in journal.read():
            overlay.add(detections_of(finished, rows), finished.log_time_ns)


def _conclude(
    folder: RunFolder,
    recording: Recording,
    plan: _Plan,
    summary: DetectionSummary,
    notes: list[str],
) -> dict[str, Any]:
    """Judge the run, and write the report and `run.json`."""
    verdict, why, advice = judge(_facts(recording, plan, summary))
    losses = _losses(recording, plan.streams)
    config = {
        **plan.config.model_dump(mode="json"),
        "sensors": [_describe(plan, name) for name in plan.detectors],
    }
    content = detection_report(
        summary,
        title=f"Objects in {recording.paths[0].name}",
        verdict=verdict,
        why=why,
        advice=advice,
        inputs=[describe_input(path) for path in recording.paths],
        settings=config,
        losses=losses,
        notes=notes,
    )
    write_report(folder.path / "report.html", content)
    return folder.finish(
        config=config,
        inputs=recording.paths,
        counts=_counts(summary),
        dropped={**summary.dropped, **losses},
        verdict=verdict,
        why=why,
    )


def _losses(recording: Recording, streams: LidarStreams) -> dict[str, int]:
    """Return what did not reach the detectors, by reason: what they left out comes on top."""
    return {
        **recording.losses,
        **{f"merged scan without {topic}": n for topic, n in streams.missing.items()},
        **{f"scan of {t} that fits no merged scan": n for t, n in streams.unmatched.items()},
    }


def _counts(summary: DetectionSummary) -> dict[str, Any]:
    return {
        "frames": summary.frames,
        "objects": summary.objects,
        "labels": dict(summary.labels.most_common()),
        "points": summary.points,
        "ground_points": summary.ground_points,
    }


def _facts(recording: Recording, plan: _Plan, summary: DetectionSummary) -> RunFacts:
    mountings = {name: detector.mounting for name, detector in plan.detectors.items()}
    given = plan.config.lidar.sensor_height_m is not None
    return RunFacts(
        frames=summary.frames,
        objects=summary.objects,
        points=summary.points,
        ground_points=summary.ground_points,
        losses=dict(recording.losses),
        missing=dict(plan.streams.missing),
        height_spread_m={} if given else {n: m.sd_height_m for n, m in mountings.items()},
        height_errors_m={
            n: m.height_m - m.found_height_m
            for n, m in mountings.items()
            if given and m.clouds_used
        },
    )


def _describe(plan: _Plan, name: str) -> dict[str, Any]:
    """Return what was used of a stream: its topics, its frame, and how it is mounted."""
    mounting = plan.detectors[name].mounting
    sensors = plan.streams.sensors
    topics = [s.topic for s in sensors if plan.streams.merged or s.name == name]
    return {
        "name": name,
        "topics": topics,
        "in_base_frame": plan.streams.is_in_base(name),
        "height_m": round(mounting.height_m, 4),
        "found_height_m": round(mounting.found_height_m, 4) if mounting.clouds_used else None,
        "found_height_sd_m": round(mounting.sd_height_m, 4) if mounting.clouds_used else None,
        "tilt_deg": round(mounting.tilt_deg, 3),
        "upside_down": mounting.upside_down,
    }


def _fingerprint(recording: Recording, plan: _Plan) -> str:
    """Return a text that stands for the version, the inputs, the settings and the sensors."""
    facts = {
        "percept": version("percept-toolkit"),
        "inputs": [describe_input(path) for path in recording.paths],
        "config": plan.config.model_dump(mode="json"),
        "window": [plan.start_ns, plan.end_ns],
        "sensors": [
            [s.name, s.topic, None if s.T_base_sensor is None else s.T_base_sensor.matrix.tolist()]
            for s in plan.streams.sensors
        ],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:32]
