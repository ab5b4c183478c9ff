"""What happens over time: tracks and lights from the tables of a run."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from percept.cli.track.request import TrackConfig
from percept.core.results import Detections2D, Detections3D, LightStates
from percept.core.rig import CameraSensor, Rig
from percept.core.trajectory import Trajectory
from percept.export.run_detections import read_detections_2d, read_detections_3d
from percept.hdmap import HdMap
from percept.hdmap.light import MapLight
from percept.lights import LightTracker, light_label
from percept.tracking.offline import TrackedDrive, track_drive

__all__ = ["Followed", "follow"]

_BOXES, _PIXELS = "detections_3d.parquet", "detections_2d.parquet"
_POSELESS = "scans at times without a pose"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Followed:
    """Objects and lights over the time of a run.

    Attributes:
        drive: The tracks; None for a run without scans.
        lights: The lights after each image; None for a run without images.
        map_lights: The lights of the map that `lights` speaks of; none where each camera follows
            its own boxes.
        dropped: What was left out, by reason.
        notes: What a user should know, as sentences.
        poseless: Scans at times without a pose: nothing of them is in the tracks.
    """

    drive: TrackedDrive | None
    lights: tuple[LightStates, ...] | None
    map_lights: tuple[MapLight, ...]
    dropped: Mapping[str, int]
    notes: tuple[str, ...]
    poseless: int = 0

    def counts(self) -> dict[str, Any]:
        """Return what `run.json` counts: tracks by class, gaps closed, lights."""
        found: dict[str, Any] = {}
        if self.drive is not None:
            labels: dict[int, str] = {}
            for tracks in self.drive.frames():
                labels.update(zip(tracks.ids.tolist(), tracks.labels, strict=True))
            found["tracks"] = dict(Counter(labels.values()).most_common())
            found["gaps_closed"] = self.drive.joined
        if self.lights is not None:
            found["lights"] = len({i for states in self.lights for i in states.ids.tolist()})
        return found


def follow(
    run: Path,
    *,
    rig: Rig,
    poses: Trajectory | None,
    hd_map: HdMap | None,
    config: TrackConfig,
) -> Followed:
    """Track the objects and lights of a run.

    Args:
        run: Folder with the tables of detections.
        rig: The sensors that the run used.
        poses: Where the vehicle was; None where that is not known.
        hd_map: The map, or None.
        config: Settings.

    Raises:
        InputError: If a table of the run is missing or damaged.
    """
    notes: list[str] = []
    dropped: Counter[str] = Counter()
    cameras = {name: camera for name, camera in rig.cameras().items() if camera.T_base_sensor}
    drive = None
    if (run / _BOXES).exists():
        drive = track_drive(_detections(run), config.tracking, poses=poses, cameras=cameras)
        dropped.update({f"tracks: {reason}": n for reason, n in drive.dropped.items()})
        notes += drive.notes
    if not (run / _PIXELS).exists():
        return Followed(
            drive=drive,
            lights=None,
            map_lights=(),
            dropped=dropped,
            notes=tuple(notes),
            poseless=_poseless(drive),
        )
    lights, why = _lights_of(hd_map, poses, cameras)
    notes += [f"Lights are followed without the map: {why}."] if why else []
    tracker = (
        LightTracker(config.lights, lights=lights, cameras=cameras, poses=poses)
        if lights
        else LightTracker(config.lights)
    )
    for found in read_detections_2d(run):
        tracker.push(found)
    dropped.update({f"lights: {reason}": n for reason, n in tracker.dropped.items()})
    return Followed(
        drive=drive,
        lights=tuple(tracker.history()),
        map_lights=lights,
        dropped=dropped,
        notes=(*notes, *tracker.notes),
        poseless=_poseless(drive),
    )


def _poseless(drive: TrackedDrive | None) -> int:
    return 0 if drive is None else drive.dropped[_POSELESS]


def _detections(run: Path) -> Iterator[Detections3D | Detections2D]:
    scans: Iterator[Detections3D | Detections2D] = read_detections_3d(run)
    if not (run / _PIXELS).exists():
        return scans
    images = (_without_lights(found) for found in read_detections_2d(run))
    return heapq.merge(scans, images, key=lambda found: found.stamp_ns)


def _without_lights(found: Detections2D) -> Detections2D:
    """Return the boxes of an image but for traffic lights, which have a tracker of their own."""
    rows = [row for row, label in enumerate(found.labels) if light_label(label) is None]
    return replace(
        found,
        boxes_px=found.boxes_px[rows],
        labels=tuple(found.labels[row] for row in rows),
        confidences=found.confidences[rows],
    )


def _lights_of(
    hd_map: HdMap | None, poses: Trajectory | None, cameras: Mapping[str, CameraSensor]
) -> tuple[tuple[MapLight, ...], str]:
    """Return the lights of the map that can be followed, or why none can."""
    if hd_map is None:
        return (), ""
    if not hd_map.lights:
        return (), "it has no traffic light"
    if not cameras:
        return (), "no camera has a known lens and place"
    if poses is None or poses.target != "map":
        return (), "nothing in the log tells where the vehicle was in it"
    return hd_map.lights, ""
