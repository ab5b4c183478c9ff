"""The logs of a data set, each settled before its first image is read."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from percept.cli.dataset.request import PrepareConfig, PrepareRequest
from percept.cli.dataset.run_labels import RunLabels, RunLog
from percept.cli.dataset.same_log import SharedStamp, show_the_same
from percept.cli.detect.used_rig import camera_sensor
from percept.cli.odometry.request import OdometryConfig
from percept.cli.odometry.sources import PoseFinder
from percept.cli.run_folder import describe_input
from percept.cli.window import log_window_ns
from percept.core.errors import InputError, InsufficientDataError, UsageError
from percept.core.results import Verdict
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.samples import CameraImage, GnssFix, PointCloud
from percept.core.trajectory import Trajectory
from percept.core.transform_tree import TransformTree
from percept.datasets.cameras import CameraStream, choose_cameras
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.moments import Moment, StreamStamps, choose_moments
from percept.datasets.labelling.names import safe_name
from percept.datasets.labelling.places.positions import FixTrack
from percept.datasets.open import log_files, open_recording
from percept.datasets.recording import Recording
from percept.datasets.sensors import choose_lidars, read_static_transforms

__all__ = ["DrivePlan", "LogSource", "find_sources", "open_source", "plan_drive"]

_BASE = "base_link"
_REPEATED = "images whose stamp an earlier image of their camera has"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LogSource:
    """A log, and the run that looked at it.

    Attributes:
        paths: Files and folders of the log; several are one drive.
        run: What a run found in it; None without.
    """

    paths: tuple[Path, ...]
    run: RunLabels | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DrivePlan:
    """What is settled of a log.

    Attributes:
        name: In names of files.
        source: The log and its run.
        files: Files of the log.
        fingerprint: Hexadecimal digest of their first parts.
        start_ns: Time of its first message.
        base_frame: Frame of the vehicle.
        streams: Its cameras, by topic.
        lenses: What is known of them, by topic; no entry where the lens is not known.
        lidars: LiDARs of known place, by topic.
        poses: `T_world_base`; None where not known, or where nothing needs it.
        fixes: Where on the earth.
        images: Images of these cameras in the log.
        stamps: When the images and scans were taken.
        moments: The keyframes.
        evidence: What the run says of moments.
        losses: What of the log cannot be chosen, by reason.
        notes: What a user should know, as sentences.
    """

    name: str
    source: LogSource
    files: tuple[Path, ...]
    fingerprint: str
    start_ns: int
    base_frame: str
    streams: dict[str, CameraStream]
    lenses: dict[str, CameraSensor]
    lidars: dict[str, LidarSensor]
    poses: Trajectory | None
    fixes: FixTrack
    images: int
    stamps: StreamStamps
    moments: tuple[Moment, ...]
    evidence: tuple[FrameEvidence, ...]
    losses: Counter[str]
    notes: tuple[str, ...]

    @property
    def log(self) -> str:
        """The log as the user named it."""
        return " + ".join(str(path) for path in self.source.paths)


def find_sources(request: PrepareRequest) -> tuple[LogSource, ...]:
    """Return the logs, each once: those of the runs, and those that no run looked at.

    The log of a run that has moved is found again among `--bag` by its content.

    Raises:
        UsageError: If a log is given twice, or a run's log is not where it was.
        InputError: If a run cannot be used.
    """
    given = {path: _contents(path) for path in request.bags}
    sources, taken = [], set[Path]()
    for folder in request.runs:
        run = RunLabels.open(folder)
        paths = tuple(_here(log, given, folder) for log in run.logs)
        taken.update(paths)
        sources.append(LogSource(paths=paths, run=run))
    sources += [LogSource(paths=(path,), run=None) for path in request.bags if path not in taken]
    seen: dict[tuple[Path, ...], LogSource] = {}
    for source in sources:
        key = tuple(path.resolve() for path in source.paths)
        if key in seen:
            raise UsageError("the log is given twice", where=source.paths[0])
        seen[key] = source
    return tuple(sources)


def plan_drive(
    recording: Recording,
    source: LogSource,
    rig: Rig | None,
    config: PrepareConfig,
    request: PrepareRequest,
    check_interrupt: Callable[[], None],
    *,
    with_scans: bool,
    earlier: Sequence[DrivePlan] = (),
) -> DrivePlan:
    """Settle a log.

    Args:
        recording: The log.
        source: Where it is from.
        rig: Lenses and places; None takes those of the run, and what the log says.
        config: Settings.
        request: What was asked for.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.
        with_scans: Whether a format needs points.
        earlier: The logs before it.

    Raises:
        PerceptError: If the log has neither images nor scans, or the rig does not fit it.
    """
    rig = rig if rig is not None or source.run is None else source.run.rig
    tree = read_static_transforms(recording)
    window_ns = log_window_ns(recording, request.start_s, request.end_s)
    notes: list[str] = []
    if recording.format == "folder":
        notes.append(
            "Files whose names hold no times count as 10 a second: --every 0.1 takes them all."
        )
    streams = _cameras(recording, rig, request, tree)
    lidars = _lidars(recording, rig, tree) if with_scans else {}
    lenses = {topic: lens for topic, one in streams.items() if (lens := camera_sensor(one))}
    notes += [f"Camera {s.name}: {note}." for s in streams.values() for note in s.notes]
    fixes = _fixes(recording)
    poses, pose_notes = _poses(recording, rig, source, window_ns, check_interrupt, exact=with_scans)
    stamps = StreamStamps(
        one
        for one in recording.envelopes(topics=[*streams, *lidars])
        if (window_ns[0] or 0) <= one.log_time_ns <= (window_ns[1] or one.log_time_ns)
    )
    notes += _clock_notes(stamps, fixes)
    evidence = () if source.run is None else source.run.evidence(config.prelabels)
    moments = choose_moments(
        stamps,
        list(streams),
        list(lidars),
        poses if poses is not None else fixes.trajectory(),
        config.keyframes,
        config.sync,
        evidence,
        _moments_of_same(recording, streams, stamps, earlier, config),
    )
    fingerprint = _fingerprint(recording.paths)
    sensors: list[LidarSensor | CameraSensor] = [*lidars.values(), *lenses.values()]
    places = (sensor.T_base_sensor for sensor in sensors)
    base = next((place.target for place in places if place is not None), None)
    return DrivePlan(
        name=f"{safe_name(source.paths[0].stem)}-{fingerprint[:6]}",
        source=source,
        files=recording.paths,
        fingerprint=fingerprint,
        start_ns=recording.start_ns or 0,
        base_frame=base or (rig.base_frame if rig is not None else _BASE),
        streams=streams,
        lenses=lenses,
        lidars=lidars,
        poses=poses,
        fixes=fixes,
        images=sum(stamps.count(topic) for topic in streams),
        stamps=stamps,
        moments=moments,
        evidence=evidence,
        losses=_losses(recording, stamps, streams, lidars),
        notes=(*notes, *pose_notes),
    )


def open_source(source: LogSource) -> Recording:
    """Open the log of a source; see `open_recording`."""
    return open_recording(source.paths)


def _moments_of_same(
    recording: Recording,
    streams: Mapping[str, CameraStream],
    stamps: StreamStamps,
    earlier: Sequence[DrivePlan],
    config: PrepareConfig,
) -> list[int]:
    """Return the keyframes of the earlier logs that show what this one shows at the same stamps."""
    alike = config.selection.duplicates
    found: list[int] = []
    for plan in earlier if alike is not None else ():
        shared = [
            SharedStamp(topic, then_ns, here_ns)
            for moment in plan.moments
            for topic, stamp_ns in moment.images.items()
            if topic in streams
            if (here_ns := stamps.recorded_ns(topic, stamp_ns)) is not None
            if (then_ns := plan.stamps.recorded_ns(topic, stamp_ns)) is not None
        ]
        if not shared or alike is None:
            continue
        with open_source(plan.source) as other:
            if show_the_same(other, recording, shared, alike):
                found += [moment.instant.stamp_ns for moment in plan.moments]
    return found


def _losses(
    recording: Recording, stamps: StreamStamps, cameras: Collection[str], lidars: Collection[str]
) -> Counter[str]:
    """Return what reading all of a log lost; images and scans are told of one by one elsewhere."""
    told = tuple(f"messages on {topic} " for topic in (*cameras, *lidars))
    lost = Counter({why: n for why, n in recording.losses.items() if not why.startswith(told)})
    lost[_REPEATED] += sum(stamps.count(topic) - len(stamps.of(topic)) for topic in cameras)
    return lost


def _clock_notes(stamps: StreamStamps, fixes: FixTrack) -> list[str]:
    notes = [
        f"The header stamps on {topic} say nothing: times of recording are used."
        for topic in sorted(stamps.unstamped)
    ]
    if fixes.dropped:
        notes.append(
            f"{fixes.dropped} of {fixes.dropped + len(fixes)} GNSS messages say no place, or one "
            "that cannot be, and are not used."
        )
    return notes


def _here(log: RunLog, given: Mapping[Path, frozenset[str]], run: Path) -> Path:
    """Return where the log of a run is: among the given ones by its content, or where it was."""
    path = next((one for one, found in given.items() if found & log.contents), log.path)
    if not path.exists():
        raise UsageError(
            f"its log {log.path} is not there", where=run, remedy="Say with --bag where it is now"
        )
    return path


def _contents(path: Path) -> frozenset[str]:
    """Return what tells the files of a log from others."""
    files = log_files(path) if path.is_dir() else (path,)
    described = [describe_input(file) for file in files if file.is_file()]
    return frozenset(f"{one['bytes']}:{one['sha256_head']}" for one in described)


def _fingerprint(files: Sequence[Path]) -> str:
    """Return a digest of the files of a log, which stays when they move."""
    described = sorted(
        (path.name, one["bytes"], one["sha256_head"])
        for path in files
        if path.is_file()
        for one in (describe_input(path),)
    )
    parts = [f"{size}:{digest}" for _, size, digest in described]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _cameras(
    recording: Recording, rig: Rig | None, request: PrepareRequest, tree: TransformTree
) -> dict[str, CameraStream]:
    twice = [topic for topic, n in Counter(request.cameras.values()).items() if n > 1]
    if twice:
        raise UsageError(f"--topic gives {twice[0]} two names")
    if not any(t.sample_type is CameraImage and t.count for t in recording.topics()):
        if request.cameras:
            raise InputError("has no images", where=recording.paths[0])
        return {}
    chosen = choose_cameras(recording, rig, request.cameras, tree)
    return {stream.topic: stream for stream in chosen}


def _lidars(recording: Recording, rig: Rig | None, tree: TransformTree) -> dict[str, LidarSensor]:
    """Return the LiDARs that can be brought into the frame of the vehicle."""
    if not any(t.sample_type is PointCloud and t.count for t in recording.topics()):
        return {}
    sensors = choose_lidars(recording, rig, {}, tree)
    placed = {s.topic: s for s in sensors if s.topic is not None and s.T_base_sensor is not None}
    bases = {s.T_base_sensor.target for s in placed.values() if s.T_base_sensor is not None}
    return placed if len(bases) == 1 else {}


def _poses(
    recording: Recording,
    rig: Rig | None,
    source: LogSource,
    window_ns: tuple[int | None, int | None],
    check_interrupt: Callable[[], None],
    *,
    exact: bool,
) -> tuple[Trajectory | None, list[str]]:
    """Return where the vehicle was by the run, else by the log; what is bad is not used.

    A filter over all that a log says of its motion is worth its time where a format needs poses.
    """
    if source.run is not None and source.run.trajectory is not None:
        return source.run.trajectory, []
    if not exact:
        return None, []
    finder = PoseFinder(
        recording,
        rig,
        OdometryConfig(),
        source="auto",
        window_ns=window_ns,
        check_interrupt=check_interrupt,
    )
    try:
        found = finder.in_log()
    except (InputError, InsufficientDataError) as error:
        return None, [f"No poses: {error.what.rstrip('.')}."]
    if found is None:
        return None, ["The log has no poses."]
    if found.verdict is Verdict.BAD:
        return None, [f"The poses of the log are bad, and not used: {'; '.join(found.why)}."]
    return found.trajectory, [f"Poses: {note.rstrip('.')}." for note in found.notes]


def _fixes(recording: Recording) -> FixTrack:
    """Return the fixes of the receiver that says most."""
    topics = [t for t in recording.topics() if t.sample_type is GnssFix and t.count]
    if not topics:
        return FixTrack(())
    busiest = max(topics, key=lambda topic: topic.count)
    return FixTrack(recording.samples(topics=[busiest.topic]))
