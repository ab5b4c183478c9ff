"""A finished run of `percept detect` as a source of labels: what it knows of any moment."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Self

from pydantic import BaseModel, Field, ValidationError

from percept.core.errors import InputError
from percept.core.results import Detections2D
from percept.core.rig import Rig, load_rig
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.label_keyframe import ImageView, PreLabelConfig
from percept.datasets.labelling.prelabels.run_solids import (
    solids_of_scans,
    solids_of_tracks,
    tracks_between,
)
from percept.datasets.labelling.prelabels.view_evidence import Vocabulary, evidence_of_views
from percept.export.pose_table import read_poses
from percept.export.run_at import ImagesAt, ScansAt, TracksAt

__all__ = ["RunLabels", "RunLog"]

_REMEDY = "Give the --out folder of `percept detect`; finish it with --resume"
_WITHIN_NS = 60_000_000
"""A scan that is farther away in time than this says nothing of a moment."""


_EVIDENCE_STEP_NS = 1_000_000_000
_MAPS = (".osm", ".xodr")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLog:
    """A log that a run read.

    Attributes:
        path: As it was given.
        contents: What tells each of its files from others: `size:digest of its first part`.
    """

    path: Path
    contents: frozenset[str]


class _Input(BaseModel):
    path: str
    bytes: int = Field(ge=0)
    sha256_head: str


class _Model(BaseModel):
    path: str = ""
    class_names: tuple[str, ...] = ()


class _Tracking(BaseModel):
    classes: dict[str, object] = Field(default_factory=dict)


class _Camera(BaseModel):
    name: str
    image_size: tuple[int, int] | None = None


class _Config(BaseModel):
    cameras: tuple[_Camera, ...] | None = None
    models: dict[str, _Model] | None = None
    tracking: _Tracking = _Tracking()


class _Record(BaseModel):
    """What is looked at of `run.json`."""

    command: tuple[str, ...] = ()
    config: _Config
    inputs: tuple[_Input, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class RunLabels:
    """What a run found, looked up by time; memory holds a part of its tables.

    Attributes:
        folder: The run folder.
        rig: The sensors that it used.
        logs: The logs that it read; several are one drive.
        models: The networks that looked at images, by name, with what is known of each file.
        trajectory: Where the vehicle was; None where the run does not know.
        tracks: Its tracks; None without.
        scans: Its scans; None without.
        images: Its images; None without.
        image_sizes: (width, height) of the images of each camera, where it is known.
        words: The class names of each network, and of tracks, for `evidence`.
        dropped: What `solids` could not give, by reason, with the number of times it was asked.
    """

    folder: Path
    rig: Rig
    logs: tuple[RunLog, ...]
    models: Mapping[str, str]
    trajectory: Trajectory | None
    tracks: TracksAt | None
    scans: ScansAt | None
    images: ImagesAt | None
    image_sizes: Mapping[str, tuple[int, int] | None]
    words: tuple[Mapping[str, tuple[str, ...]], tuple[str, ...]]
    dropped: Counter[str] = field(default_factory=Counter)

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Open a finished run.

        Raises:
            InputError: If the folder holds no finished run of `percept detect`, or a damaged one.
        """
        record = _record(folder)
        if not any((folder / f"detections_{d}d.parquet").is_file() for d in "23"):
            raise InputError("is no run of `percept detect`", where=folder, remedy=_REMEDY)
        poses = folder / "poses.parquet"
        models = record.config.models or {}
        return cls(
            folder=folder,
            rig=load_rig(folder / "rig.yaml"),
            logs=_logs(record),
            models={name: _described(model, record.inputs) for name, model in models.items()},
            trajectory=read_poses(poses) if poses.is_file() else None,
            tracks=_opened(TracksAt, folder / "tracks.parquet"),
            scans=ScansAt(folder) if (folder / "detections_3d.parquet").is_file() else None,
            images=ImagesAt(folder) if (folder / "detections_2d.parquet").is_file() else None,
            image_sizes={one.name: one.image_size for one in record.config.cameras or ()},
            words=(
                {name: model.class_names for name, model in models.items()},
                tuple(record.config.tracking.classes),
            ),
        )

    def image_boxes(self, camera: str, stamp_ns: int) -> dict[str, Detections2D]:
        """Return what each network found in an image; none if the run did not look at it."""
        found = None if self.images is None else self.images.at(camera, stamp_ns)
        return found or {}

    def solids(
        self, stamp_ns: int, T_world_base: Transform | None = None, *, trial: bool = False
    ) -> SolidBoxes:
        """Return the 3D boxes at a time, in the base frame: of tracks, or else of scans.

        Args:
            stamp_ns: The time.
            T_world_base: Where the vehicle is then, in the frame of the tracks; None asks the
                run's own poses.
            trial: Whether to take tracks that were not confirmed too.
        """
        if self.tracks is None:
            return self._of_scans(stamp_ns)
        tracks = tracks_between(*self.tracks.around(stamp_ns), stamp_ns)
        if tracks is None:
            return SolidBoxes.none()
        base = self.rig.base_frame
        if tracks.frame_id == base:
            return solids_of_tracks(tracks, Transform.identity(base, base), trial=trial)
        if T_world_base is None or T_world_base.target != tracks.frame_id:
            T_world_base = None if self.trajectory is None else self.trajectory.at(stamp_ns)
        if T_world_base is None:
            self.dropped["moments without a pose, which have no 3D boxes"] += 1
            return SolidBoxes.none()
        return solids_of_tracks(tracks, T_world_base.inverse(), trial=trial)

    def evidence(self, config: PreLabelConfig | None = None) -> tuple[FrameEvidence, ...]:
        """Return what is known of a moment in each second of the run, in the order of time.

        Args:
            config: Settings of pre-labels; None takes those that hold without a file.
        """
        return self._evidence if config is None else tuple(self._evidence_of(config))

    @cached_property
    def _evidence(self) -> tuple[FrameEvidence, ...]:
        return tuple(self._evidence_of(PreLabelConfig()))

    def _evidence_of(self, config: PreLabelConfig) -> Iterator[FrameEvidence]:
        vocabulary = Vocabulary.of(*self.words, config.categories)
        for stamp_ns in self._moments():
            views = [
                self._view(camera, image_ns, stamp_ns)
                for camera, image_ns in self._images_near(stamp_ns)
            ]
            yield evidence_of_views(stamp_ns, views, self.solids(stamp_ns), vocabulary, config)

    def _moments(self) -> list[int]:
        """Return the stamps of scans, or else of images, at least a step apart."""
        stamps = self.scans.stamps_ns.tolist() if self.scans is not None else []
        if not stamps and self.images is not None and self.images.cameras:
            stamps = self.images.stamps_ns(self.images.cameras[0]).tolist()
        moments: list[int] = []
        for stamp_ns in stamps:
            if not moments or stamp_ns - moments[-1] >= _EVIDENCE_STEP_NS:
                moments.append(stamp_ns)
        return moments

    def _images_near(self, stamp_ns: int) -> Iterator[tuple[str, int]]:
        """Yield the image of each camera that is nearest to a time, if one is near."""
        if self.images is None:
            return
        for camera in self.images.cameras:
            nearest = self.images.nearest(camera, stamp_ns)
            if nearest is not None and abs(nearest - stamp_ns) <= _WITHIN_NS:
                yield camera, nearest

    def _view(self, camera: str, image_ns: int, stamp_ns: int) -> ImageView:
        sensor = self.rig.cameras().get(camera)
        return ImageView(
            found=self.image_boxes(camera, image_ns),
            image_size=self.image_sizes.get(camera),
            camera=sensor,
            offset_ns=image_ns - stamp_ns,
            vehicle_place=self._moved(stamp_ns, image_ns),
        )

    def _moved(self, from_ns: int, to_ns: int) -> Transform | None:
        """Return `T_base_then_base` between two times; None where it is not known."""
        if self.trajectory is None:
            return None
        T_world_base, T_world_then = self.trajectory.at(from_ns), self.trajectory.at(to_ns)
        if T_world_base is None or T_world_then is None:
            return None
        return T_world_then.inverse() @ T_world_base

    def _of_scans(self, stamp_ns: int) -> SolidBoxes:
        found = [] if self.scans is None else self.scans.at(stamp_ns, _WITHIN_NS)
        places = {sensor.frame: sensor.T_base_sensor for sensor in self.rig.lidars().values()}
        base = self.rig.base_frame
        places[base] = Transform.identity(base, base)
        placed = [(scan, T) for scan in found if (T := places.get(scan.frame_id)) is not None]
        if len(placed) < len(found):
            self.dropped["scans of LiDARs of unknown place"] += len(found) - len(placed)
        return solids_of_scans([scan for scan, _ in placed], [T for _, T in placed])


def _record(folder: Path) -> _Record:
    path = folder / "run.json"
    if not path.is_file():
        raise InputError("holds no finished run", where=folder, remedy=_REMEDY)
    try:
        record = _Record.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise InputError(
            "cannot be read as the record of a run", where=path, remedy="Detect again"
        ) from error
    if not record.inputs:
        raise InputError("names no log that the run has read", where=path, remedy="Detect again")
    return record


def _logs(record: _Record) -> tuple[RunLog, ...]:
    """Return the logs: they come first among the inputs, before networks and maps.

    The command says which files are parts of one log, such as a ROS 2 folder.
    """
    models = {model.path for model in (record.config.models or {}).values()}
    given = [Path(value) for key, value in pairwise(record.command) if key == "--bag"]
    given += [
        Path(part.removeprefix("--bag=")) for part in record.command if part.startswith("--bag=")
    ]
    logs: dict[Path, set[str]] = {}
    for one in record.inputs:
        path = Path(one.path)
        if one.path not in models and path.suffix not in _MAPS:
            log = next((g for g in given if g == path or g in path.parents), path)
            logs.setdefault(log, set()).add(f"{one.bytes}:{one.sha256_head}")
    return tuple(RunLog(path=path, contents=frozenset(some)) for path, some in logs.items())


def _opened(kind: type[TracksAt], path: Path) -> TracksAt | None:
    return kind(path) if path.is_file() else None


def _described(model: _Model, inputs: tuple[_Input, ...]) -> str:
    """Return what is known of a network's file: its name and the digest of its head."""
    digest = next((one.sha256_head for one in inputs if one.path == model.path), "")
    return f"{Path(model.path).name} {digest}".strip()
