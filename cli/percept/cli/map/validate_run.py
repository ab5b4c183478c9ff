"""The run behind `percept map validate`: from logs and a map to the run folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from percept.cli.interrupts import deferred_interrupt
from percept.cli.map.drive import DriveFacts, MapDrive, plan_drive
from percept.cli.map.evidence import cut_evidence
from percept.cli.map.lidar_looks import with_lidar_paint
from percept.cli.map.looks import Looked, looks_of
from percept.cli.map.validate_conclude import OUTPUTS, MapResult, conclude
from percept.cli.map.validate_request import MapValidateConfig, MapValidateRequest
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.cli.track.maps import named_place
from percept.core.errors import InputError
from percept.core.map_findings import Decision
from percept.core.rig import load_rig
from percept.core.settings import load_settings
from percept.datasets import open_recording
from percept.datasets.recording import Recording
from percept.export.view.map import MapView
from percept.hdmap import HdMap, load_map
from percept.hdmap.road_heights import RoadHeights
from percept.hdmap.validate import LaneValidator
from percept.hdmap.validate.decided import apply_decisions
from percept.lanes.ground import GroundSurface
from percept.lights.map_check import LightFindings, LightMapChecker
from percept.review import read_decisions

__all__ = ["run_map_validation"]


def run_map_validation(request: MapValidateRequest) -> dict[str, Any]:
    """Compare a map with what logs show, and fill the run folder; return `run.json`'s content.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(MapValidateConfig, request.config, dict(request.flags))
    hd_map = _painted_map(request)
    decisions = [decision for path in request.reviews for decision in read_decisions(path)]
    with (
        deferred_interrupt() as check,
        RunFolder(request.out, force=request.force, outputs=OUTPUTS) as folder,
    ):
        return _Work(request, config, hd_map, decisions, check).fill(folder)


def _painted_map(request: MapValidateRequest) -> HdMap:
    origin = None if request.origin is None else named_place(request.origin)
    hd_map = load_map(request.map_file, origin, anywhere=True)
    if not any(marking.kind == "line" and marking.painted for marking in hd_map.markings):
        raise InputError(
            "has no painted lines to compare the road with",
            where=request.map_file,
            remedy="Give a map whose line strings have the types line_thin or line_thick",
        )
    return hd_map


def _names(bags: Sequence[Path]) -> list[str]:
    """Return the names of logs; those that others have too with their folders."""
    counts = Counter(bag.name for bag in bags)
    return [bag.name if counts[bag.name] == 1 else str(bag) for bag in bags]


class _Work:
    """One run: what goes in, and what is gathered drive by drive."""

    def __init__(
        self,
        request: MapValidateRequest,
        config: MapValidateConfig,
        hd_map: HdMap,
        decisions: Sequence[Decision],
        check: Callable[[], None],
    ) -> None:
        self._request = request
        self._config = config
        self._map = hd_map
        self._decisions = decisions
        self._check = check
        self._names = _names(request.bags)
        self._heights = RoadHeights([m.points_map for m in hd_map.markings if m.kind == "line"])
        self._rig = load_rig(request.rig) if request.rig is not None else None
        self._validator = LaneValidator(
            hd_map.markings, hd_map.lanelets, config.validation, decisions
        )
        self._checker = LightMapChecker(
            hd_map.lights, config.lights, chosen=not request.models_are_default
        )
        self._drives: list[DriveFacts] = []
        self._grounds: dict[tuple[str, int], GroundSurface] = {}
        self._dropped: Counter[str] = Counter()
        self._notes: list[str] = []

    def fill(self, folder: RunFolder) -> dict[str, Any]:
        """Look at all drives, judge, and write everything."""
        with ExitStack() as stack:
            view: MapView | None = None
            for number, bag in enumerate(self._request.bags):
                with open_recording([bag]) as recording:
                    drive = self._plan(recording, number)
                    if view is None:
                        folder.begin(self._inputs(drive))
                        view = stack.enter_context(self._view(folder.path, drive))
                    self._look(drive, view)
                    self._drives.append(self._facts(drive))
            validation = self._validator.finish()
            lights = self._lights()
            kept = apply_decisions(lights.discrepancies, self._decisions, validation.counts)
            findings = sorted(
                (*validation.discrepancies, *kept), key=lambda f: (-f.confidence, f.finding_id)
            )
            if view is not None:
                view.add_findings(findings)
                self._notes += view.notes
        evidence = cut_evidence(
            findings,
            folder.path,
            drives=self._drives,
            hd_map=self._map,
            offsets=validation.offsets,
            check_interrupt=self._check,
        )
        return conclude(
            folder,
            MapResult(
                request=self._request,
                config=self._config,
                hd_map=self._map,
                drives=self._drives,
                validation=validation,
                lights=lights,
                findings=findings,
                evidence=evidence,
                dropped=self._dropped,
                notes=self._notes,
            ),
        )

    def _plan(self, recording: Recording, number: int) -> MapDrive:
        drive = plan_drive(
            recording,
            number,
            self._names[number],
            hd_map=self._map,
            heights=self._heights,
            rig=self._rig,
            config=self._config,
            request=self._request,
            check_interrupt=self._check,
        )
        self._check()
        return drive

    def _inputs(self, drive: MapDrive) -> list[Path]:
        request = self._request
        given = (request.rig, request.config, request.lane_model, *request.reviews)
        return [
            *drive.recording.paths,
            *request.bags,
            request.map_file,
            *(path for path in given if path is not None),
        ]

    def _view(self, folder: Path, drive: MapDrive) -> MapView:
        cameras = [camera.name for camera in drive.cameras.values()]
        looks = len(self._request.bags) * len(cameras) * drive.poses.length_m
        view = MapView(
            folder / "view.rrd",
            run_id=folder.name,
            cameras=cameras,
            looks_expected=int(looks / self._config.spacing_m) + 1,
            about_m=drive.poses.matrices[0, :3, 3],
        )
        view.add_map(self._map.markings)
        return view

    def _look(self, drive: MapDrive, view: MapView) -> None:
        """Look at the road all along a drive."""
        self._validator.begin_drive(drive.name, drive.poses)
        self._grounds = {}
        self._checker.begin_drive()
        way_m = max(drive.poses.length_m, self._config.spacing_m)
        done_m, last = 0.0, None
        with progress_bar(f"looking at {drive.name}", way_m) as advance:
            looks = looks_of(drive, self._config, self._dropped)
            for looked, lidar_paint in with_lidar_paint(looks, drive, self._dropped):
                self._check()
                self._take(looked, view)
                if lidar_paint is not None:
                    self._validator.push(lidar_paint)
                done_m += 0.0 if last is None else looked.distance_to(last)
                last = looked
                advance(done_m / len(drive.cameras))

    def _take(self, looked: Looked, view: MapView) -> None:
        if looked.paint is None or looked.image is None or looked.ground is None:
            self._dropped[looked.failure] += 1
            return
        self._grounds[looked.camera.name, looked.stamp_ns] = looked.ground
        self._validator.push(looked.paint)
        hiding = None if looked.hiding is None else looked.hiding.boxes_m
        for boxes in looked.boxes.values():
            self._checker.push(boxes, looked.camera, looked.T_map_base, hiding)
        pixels = looked.image.pixels
        view.add_look(looked.stamp_ns, looked.camera.name, pixels, looked.T_map_base, looked.paint)

    def _lights(self) -> LightFindings:
        if not self._request.models:
            return LightFindings.not_compared("Traffic lights are not compared: --no-lights.")
        lights = [light.corners_map for light in self._map.lights]
        if 2 * self._heights.hang(lights) < len(lights):
            why = "most of those of the map have no height over the road"
            return LightFindings.not_compared(f"Traffic lights are not compared: {why}.")
        return self._checker.finish()

    def _facts(self, drive: MapDrive) -> DriveFacts:
        self._dropped.update(drive.recording.losses)
        return DriveFacts(
            name=drive.name,
            bag=self._request.bags[drive.number],
            files=tuple(drive.recording.paths),
            poses=drive.poses,
            found=drive.found,
            cameras=drive.cameras,
            grounds=self._grounds,
            notes=drive.notes,
        )
