"""Scenes for calibration from a log: the spans in which vehicle and boards stand still.

A log with stops gives, for each of them, the points of some scans of every LiDAR together and
the sharpest image of every camera. Where cameras are asked for, each pose of a board is a stop
of its own; without them all that is seen from one place is one scene. A log of a vehicle that
never stops gives keyframes: one scan of every LiDAR, brought to one instant by the odometry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from percept.core.errors import InputError, InsufficientDataError, TopicNotFoundError
from percept.core.samples import CameraImage, PointCloud, Sample
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.recording import Recording
from percept.datasets.stops.motion import keyframe_stamps, read_motion, stands_still
from percept.datasets.stops.reading import SceneReader
from percept.datasets.stops.stillness import Frame, FrameMaker, StillSpan, still_spans
from percept.datasets.stops.stop import SceneConfig, Stop

__all__ = ["SceneConfig", "Stop", "find_stops"]

_REMEDY = "Stand still for 2 s at each place, and hold each board still for 1 s"
_SCAN_SHARE = 0.7
_SPANS_OF_PLACE = 3

Progress = Callable[[float], None]


def find_stops(
    recording: Recording,
    cloud_topics: Sequence[str],
    image_topics: Sequence[str] = (),
    config: SceneConfig | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
    progress: Progress | None = None,
    *,
    T_base_sensor: Mapping[str, Transform] | None = None,
) -> list[Stop]:
    """Find the scenes of a log.

    The log is read once for the scans, and a second time only where the scenes are. Of the
    whole log only the stamps and the poses of the vehicle are kept. Without `image_topics`
    there is one scene for each place of the vehicle, because more of them would not be
    independent.

    Args:
        recording: The log.
        cloud_topics: Of the LiDARs; the first one sets the pace.
        image_topics: Of the cameras.
        config: How scenes are taken.
        start_ns: First log time.
        end_ns: Last log time.
        progress: Called with the share that is done, from 0 to 1.
        T_base_sensor: By topic, where the LiDARs sit, for a vehicle that never stops; the log's
            own static transforms stand in. See `calibration_motion` for the error that a wrong
            one makes.

    Returns:
        Scenes in the order of time; at least one. A stop that lacks a LiDAR or a camera says so
        in its note.

    Raises:
        TopicNotFoundError: If a topic is not in the log.
        InputError: If no topic of clouds is given, or a topic holds something else.
        InsufficientDataError: If there is no stop and no motion to go by, or too little of it.
    """
    settings = config or SceneConfig()
    _check_topics(recording, cloud_topics, PointCloud, "point clouds")
    _check_topics(recording, image_topics, CameraImage, "images")
    if not cloud_topics:
        raise InputError("no topic with point clouds was given", where=recording.paths[0])
    report = progress or (lambda _share: None)
    window = start_ns, end_ns
    motion = read_motion(recording, *window)
    maker = FrameMaker(cloud_topics)
    log_times: dict[int, int] = {}
    frames = _frames(recording, maker, log_times, window, report)
    stands = None if motion is None else lambda stamp_ns: stands_still(motion, stamp_ns)
    spans = list(still_spans(frames, stands))
    reader = SceneReader(
        recording, tuple(cloud_topics), tuple(image_topics), settings, window, log_times
    )
    if spans:
        groups = _by_pose(spans) if image_topics else _by_place(spans)
        chosen = _even_choice(groups, settings.most_stops)
        left_out = len(groups) - len(chosen)
        scenes = (reader.stop(group, left_out) for group in chosen)
        count = len(chosen)
    else:
        moving, stamps_ns = _keyframes(recording, motion, log_times, maker.points, settings)
        places = reader.places(T_base_sensor or {})
        count = len(stamps_ns)
        scenes = (
            reader.keyframe(stamp_ns, number, moving, places)
            for number, stamp_ns in enumerate(stamps_ns)
        )
    found = []
    for number, scene in enumerate(scenes):
        found.append(scene)
        report(_SCAN_SHARE + (1 - _SCAN_SHARE) * (number + 1) / count)
    return found


def _check_topics(
    recording: Recording, topics: Sequence[str], kind: type[Sample], what: str
) -> None:
    known = {info.topic: info for info in recording.topics()}
    fitting = [info.topic for info in known.values() if info.sample_type is kind]
    remedy = f"Topics with {what}: {', '.join(fitting[:12]) or 'none'}"
    for topic in topics:
        if topic not in known:
            raise TopicNotFoundError(f"no topic '{topic}'", where=recording.paths[0], remedy=remedy)
        if topic not in fitting:
            holds = known[topic].undecodable or known[topic].msgtype
            raise InputError(f"topic '{topic}' holds no {what} ({holds})", remedy=remedy)


def _frames(
    recording: Recording,
    maker: FrameMaker,
    log_times: dict[int, int],
    window: tuple[int | None, int | None],
    report: Progress,
) -> Iterator[Frame]:
    """Yield the frames of the log; notes the log time of each by its stamp."""
    first_ns = window[0] or recording.start_ns or 0
    last_ns = window[1] or recording.end_ns or first_ns
    samples = recording.samples(topics=maker.topics, start_ns=window[0], end_ns=window[1])
    for sample in samples:
        if isinstance(sample, PointCloud):
            frame = maker.add(sample)
            if frame is not None and frame.stamp_ns not in log_times:
                log_times[frame.stamp_ns] = frame.log_time_ns
                yield frame
        done = (sample.log_time_ns - first_ns) / max(last_ns - first_ns, 1)
        report(_SCAN_SHARE * min(done, 1.0))
    frame = maker.rest()
    if frame is not None and frame.stamp_ns not in log_times:
        log_times[frame.stamp_ns] = frame.log_time_ns
        yield frame


def _by_pose(spans: Sequence[StillSpan]) -> list[list[StillSpan]]:
    """Return each span alone; where something is held at a place, without those of nothing."""
    shown = {span.place for span in spans if span.held_cells}
    return [[span] for span in spans if span.held_cells or span.place not in shown]


def _by_place(spans: Sequence[StillSpan]) -> list[list[StillSpan]]:
    """Return the spans of each place, of many the longest."""
    places: dict[int, list[StillSpan]] = {}
    for span in spans:
        places.setdefault(span.place, []).append(span)
    longest = (
        sorted(group, key=lambda span: span.first_ns - span.last_ns)[:_SPANS_OF_PLACE]
        for group in places.values()
    )
    return [sorted(group, key=lambda span: span.first_ns) for group in longest]


def _even_choice(groups: list[list[StillSpan]], most: int) -> list[list[StillSpan]]:
    """Return at most so many, spread evenly."""
    if len(groups) <= most:
        return groups
    picked = np.unique(np.linspace(0, len(groups) - 1, most).round().astype(int))
    return [groups[n] for n in picked.tolist()]


def _keyframes(
    recording: Recording,
    motion: Trajectory | None,
    log_times: Mapping[int, int],
    points: int,
    settings: SceneConfig,
) -> tuple[Trajectory, list[int]]:
    """Return the motion and the stamps of keyframes of a vehicle that never stops."""
    where = recording.paths[0]
    if not points:
        what = f"all {len(log_times)} scans are empty" if log_times else "not one scan can be read"
        raise InsufficientDataError(what, where=where, remedy="Look with `percept inspect`")
    if motion is None:
        raise InsufficientDataError(
            f"no stop found in {len(log_times)} scans, and no odometry to bring the points of a "
            "moving vehicle to one instant",
            where=where,
            remedy=_REMEDY,
        )
    stamps = np.array(sorted(log_times), dtype=np.int64)
    chosen = keyframe_stamps(motion, stamps, settings.keyframe_spacing_m, settings.most_keyframes)
    if not chosen:
        raise InsufficientDataError(
            "no stop found, and the odometry does not cover the scans", where=where, remedy=_REMEDY
        )
    return motion, chosen
