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
from percept.tracking import TrackedDrive, track_drive

__all__ = ["Followed", "follow"]

_BOXES, _PIXELS = "detections_3d.parquet", "detections_2d.parquet"
_SCANS = "scans "  # what a tracker says of scans that it could not use begins so
_FARTHEST_LIGHT_M = 1000.0  # a map whose lights are all beyond is that of another place


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Followed:
    """Objects and lights over the time of a run.

    Attributes:
        drive: The tracks; None for a run without scans.
        labels: How many tracks there are of each class, the most first.
        lights: The lights after each image; None for a run without images.
        map_lights: The lights of the map that `lights` speaks of; none where each camera follows
            its own boxes.
        dropped: What was left out, by reason.
        notes: What a user should know, as sentences.
        why_no_map: Why the lights are followed without the map that was given; empty where none
            was, or where they are those of the map.
    """

    drive: TrackedDrive | None
    labels: Mapping[str, int]
    lights: tuple[LightStates, ...] | None
    map_lights: tuple[MapLight, ...]
    dropped: Mapping[str, int]
    notes: tuple[str, ...]
    why_no_map: str = ""

    @property
    def poseless(self) -> int:
        """Scans without a pose of their time and frame: nothing of them is in the tracks."""
        dropped = {} if self.drive is None else self.drive.dropped
        return sum(count for reason, count in dropped.items() if reason.startswith(_SCANS))

    def counts(self) -> dict[str, Any]:
        """Return what `run.json` counts: tracks by class, gaps closed, lights."""
        found: dict[str, Any] = {}
        if self.drive is not None:
            found["tracks"] = dict(self.labels)
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
    cameras = {name: camera for name, camera in rig.cameras().items() if camera.T_base_sensor}
    drive = None
    if (run / _BOXES).exists():
        drive = track_drive(
            _detections(run), config.tracking, poses=poses, cameras=cameras, joining=config.joining
        )
    lights, why_no_map = _lights_of(hd_map, poses, cameras)
    notes = list(drive.notes) if drive is not None else []
    tracker = None
    if hd_map is not None and not (run / _PIXELS).exists():
        notes.append("The lights of the map are not followed: no image was looked at.")
    if (run / _PIXELS).exists():
        tracker = (
            LightTracker(config.lights, lights=lights, cameras=cameras, poses=poses)
            if lights
            else LightTracker(config.lights)
        )
        for found in read_detections_2d(run):
            tracker.push(found)
    return Followed(
        drive=drive,
        labels=_labels_of(drive),
        lights=None if tracker is None else tuple(tracker.history()),
        map_lights=() if tracker is None else lights,
        why_no_map="" if tracker is None else why_no_map,
        dropped={
            **_named("tracks", drive),
            **_named("lights", tracker),
            **_named("map", hd_map),
        },
        notes=(*notes, *(tracker.notes if tracker is not None else ())),
    )


def _labels_of(drive: TrackedDrive | None) -> dict[str, int]:
    labels: dict[int, str] = {}
    for tracks in drive.frames() if drive is not None else ():
        labels.update(zip(tracks.ids.tolist(), tracks.labels, strict=True))
    return dict(Counter(labels.values()).most_common())


def _named(what: str, part: TrackedDrive | LightTracker | HdMap | None) -> dict[str, int]:
    """Return what a part left out, with its name before each reason."""
    dropped = {} if part is None else part.dropped
    return {f"{what}: {reason}": count for reason, count in dropped.items()}


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
        return (), "nothing tells where the vehicle was in it"
    distance_m = _nearest_m(hd_map.lights, poses)
    if distance_m > _FARTHEST_LIGHT_M:
        return (), f"its nearest traffic light is {distance_m / 1000:.1f} km from the vehicle's way"
    return hd_map.lights, ""


def _nearest_m(lights: tuple[MapLight, ...], poses: Trajectory) -> float:
    """Return how near the vehicle came to a light, metres."""
    way = poses.matrices[:, :3, 3]
    places = (light.corners_map.mean(axis=0) for light in lights)
    return float(min(((way - place) ** 2).sum(axis=1).min() for place in places) ** 0.5)
