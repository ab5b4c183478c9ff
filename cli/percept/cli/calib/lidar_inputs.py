"""The clouds of `percept calib lidar`: from files, or from the stops of a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from percept.calib.lidars.result import SceneClouds
from percept.cli.window import log_window_ns
from percept.core.errors import UsageError
from percept.core.rig import LidarSensor, Rig
from percept.datasets import open_recording, read_point_cloud
from percept.datasets.sensors import choose_lidars
from percept.datasets.stops.find import Stop, find_stops

__all__ = ["LidarInputs", "clouds_from_bags", "clouds_from_files"]


@dataclass(frozen=True, slots=True, eq=False)
class LidarInputs:
    """What there is to calibrate.

    Attributes:
        scenes: Points (N, 3) by sensor name, scene by scene.
        sensors: The LiDARs by name, with their places where these are known.
        files: What was read.
        notes: What a user should know of it.
        dropped: What was left out, by reason.
    """

    scenes: tuple[SceneClouds, ...]
    sensors: dict[str, LidarSensor]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    dropped: Mapping[str, int] | None = None

    def most_points(self) -> str:
        """Return the name of the LiDAR with the most points."""
        points = {n: sum(len(scene.get(n, ())) for scene in self.scenes) for n in self.sensors}
        return max(points, key=lambda name: points[name])


def clouds_from_files(entries: Sequence[str], rig: Rig | None) -> LidarInputs:
    """Read the clouds of `--cloud NAME=PATH` entries.

    Raises:
        UsageError: If an entry has no name, or the names do not have equally many clouds.
        InputError: If a file cannot be read.
    """
    files: dict[str, list[Path]] = {}
    for entry in entries:
        name, equals, path = entry.partition("=")
        if not equals or not name or not path:
            raise UsageError(f"--cloud '{entry}' is not of the form NAME=PATH")
        files.setdefault(name, []).append(Path(path))
    counts = {name: len(paths) for name, paths in files.items()}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise UsageError(
            f"--cloud gives the LiDARs different numbers of scenes ({listed})",
            remedy="Give each LiDAR one cloud a scene, in the same order of scenes",
        )
    notes: Counter[str] = Counter()
    dropped: Counter[str] = Counter()
    scenes: list[SceneClouds] = []
    for number in range(next(iter(counts.values()), 0)):
        scene = {}
        for name, paths in files.items():
            cloud = read_point_cloud(paths[number], notes)
            scene[name] = cloud.points_xyz
            if cloud.dropped_nonfinite:
                dropped[f"points of {name} that are not finite"] += cloud.dropped_nonfinite
        scenes.append(scene)
    known = rig.lidars() if rig is not None else {}
    sensors = {name: known.get(name, LidarSensor(name, None, name, None)) for name in files}
    return LidarInputs(
        tuple(scenes),
        sensors,
        tuple(path for paths in files.values() for path in paths),
        tuple(f"{count} x {note}" for note, count in notes.items()),
        dict(dropped),
    )


def clouds_from_bags(
    bags: Sequence[Path],
    topics: Mapping[str, str],
    rig: Rig | None,
    window_s: tuple[float | None, float | None],
    progress: Callable[[float], None],
) -> LidarInputs:
    """Read the clouds of the stops of a log.

    Args:
        bags: Parts of one log.
        topics: Topic by sensor name; empty for all.
        rig: The rig that was given, or None.
        window_s: `--start` and `--end`.
        progress: Called with the share that is done.

    Raises:
        InputError: If the log cannot be used.
        InsufficientDataError: If it has no scene.
    """
    with open_recording(list(bags)) as recording:
        chosen = _well_named(choose_lidars(recording, rig, topics), topics, rig)
        topic_of = {sensor.name: sensor.topic or "" for sensor in chosen}
        start_ns, end_ns = log_window_ns(recording, *window_s)
        stops = find_stops(
            recording,
            list(topic_of.values()),
            start_ns=start_ns,
            end_ns=end_ns,
            progress=progress,
            T_base_sensor={s.topic or "": s.T_base_sensor for s in chosen if s.T_base_sensor},
        )
        losses = dict(recording.losses)
        files = tuple(recording.paths)
    scenes = tuple(
        {name: stop.clouds[topic] for name, topic in topic_of.items() if topic in stop.clouds}
        for stop in stops
    )
    sensors = {sensor.name: sensor for sensor in _own_frames(chosen)}
    return LidarInputs(scenes, sensors, files, tuple(_notes(stops, chosen)), losses)


def _notes(stops: Sequence[Stop], sensors: Sequence[LidarSensor]) -> list[str]:
    kind = "moments of a moving vehicle" if any(stop.moving for stop in stops) else "stops"
    places = len({stop.place for stop in stops})
    notes = [f"{len(stops)} {kind} at {places} places in the log"]
    notes += [f"scene {number}: {stop.note}" for number, stop in enumerate(stops, 1) if stop.note]
    shared = [frame for frame, n in Counter(s.frame for s in sensors).items() if n > 1]
    notes += [
        f"several topics have the frame '{frame}': their clouds may be in the vehicle's frame "
        "already, and their own names stand for their frames"
        for frame in shared
    ]
    return notes


def _well_named(
    sensors: Sequence[LidarSensor], topics: Mapping[str, str], rig: Rig | None
) -> list[LidarSensor]:
    """Name the LiDARs that nobody has named after their frames, where each has its own."""
    frames = Counter(sensor.frame for sensor in sensors)
    named = set(topics) | (set(rig.sensors) if rig is not None else set())
    return [
        replace(s, name=s.frame) if s.name not in named and s.frame and frames[s.frame] == 1 else s
        for s in sensors
    ]


def _own_frames(sensors: Sequence[LidarSensor]) -> list[LidarSensor]:
    """Give sensors without a frame of their own their name as frame, and no place."""
    counts = Counter(sensor.frame for sensor in sensors)
    return [
        sensor
        if sensor.frame and counts[sensor.frame] == 1
        else replace(sensor, frame=sensor.name, T_base_sensor=None)
        for sensor in sensors
    ]
