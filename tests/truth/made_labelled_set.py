"""A small labelled set with known content, for exporters and all that reads exports."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.labelling.labelled_set import (
    SPLITS,
    Drive,
    ImageBoxes,
    Keyframe,
    KeyScan,
    LabelledFrame,
    LabelledSet,
    SolidBoxes,
)
from percept.datasets.labelling.set_tables import write_set

__all__ = ["CATEGORIES", "SIZE", "make_labelled_set"]

SIZE = (320, 200)
CATEGORIES = ("car", "pedestrian", 'Straßenschild "<&>"')
_START_NS = 1_700_000_000_123_456_789
_K = (190.0, 191.0, 158.5, 99.25)
_DISTORTION = (-0.12, 0.03, 0.0004, -0.0006, 0.0)


def make_labelled_set(
    folder: Path,
    *,
    drives: int = 2,
    keyframes: int = 3,
    cameras: Sequence[str] = ("front", "left"),
    rectified_suffix: str | None = ".png",
    distorted: bool = True,
    with_scans: bool = True,
    located: bool = True,
) -> LabelledSet:
    """Write a set into a folder and return it.

    The keyframes of a drive are 0.5 s and 5 m apart, driven along x while turning. The first
    object of each keyframe has a track through its drive, the last one was drawn by a person, and
    the last image of each drive has no boxes. Each drive is in another split.

    Args:
        folder: Where it goes; made.
        drives: Number of drives.
        keyframes: Of each drive.
        cameras: Their names; each sits turned by 60 deg from the one before.
        rectified_suffix: Suffix of images without distortion; None makes none.
        distorted: Whether the lenses bend lines; if not, the recorded image is the rectified one
            unless its suffix has to be another.
        with_scans: Whether there are points and 3D boxes.
        located: Whether latitude and longitude are known.
    """
    for name in ("images", "rectified", "scans"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    sensors = {name: _camera(name, turn, bends=distorted) for turn, name in enumerate(cameras)}
    made = [_drive(number, sensors, with_scans=with_scans) for number in range(drives)]
    maker = _Maker(folder, sensors, rectified_suffix, distorted, with_scans, located)
    moments = [
        maker.keyframe(number, drive, step, last=step == keyframes - 1)
        for number, drive in enumerate(made)
        for step in range(keyframes)
    ]
    labelled = LabelledSet(
        folder=folder,
        name="made",
        categories=CATEGORIES,
        drives={drive.name: drive for drive in made},
        keyframes=tuple(moments),
        licence="CC-BY-4.0",
        created="2026-01-02T03:04:05Z",
    )
    write_set(labelled)
    return labelled


def _camera(name: str, turn: int, *, bends: bool) -> CameraSensor:
    optical = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0, np.radians(2), np.radians(60) * turn) @ optical
    matrix[:3, 3] = (1.5, 0.3 * turn, 1.6)
    return CameraSensor(
        name=name,
        topic=f"/{name}/image",
        frame=f"{name}_optical",
        image_size=SIZE,
        model="pinhole",
        K=_K,
        distortion=_DISTORTION if bends else (0.0,) * 5,
        T_base_sensor=Transform("base_link", f"{name}_optical", matrix),
    )


def _drive(number: int, sensors: dict[str, CameraSensor], *, with_scans: bool) -> Drive:
    return Drive(
        name=f"drive-{number:06x}",
        log=f"logs/drive {number}.mcap",
        fingerprint=f"{number:064x}",
        start_ns=_START_NS + number * 10**12,
        base_frame="base_link",
        cameras=sensors,
        lidars=("top",) if with_scans else (),
        models={"small": "sha256:00"},
    )


@dataclass
class _Maker:
    folder: Path
    sensors: dict[str, CameraSensor]
    suffix: str | None
    distorted: bool
    with_scans: bool
    located: bool
    keyframes: int = 0
    frames: int = 0
    boxes: int = 0
    solids: int = 0

    def keyframe(self, number: int, drive: Drive, step: int, *, last: bool) -> Keyframe:
        stamp_ns = drive.start_ns + step * 500_000_000
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_rpy(0.01, -0.02, 0.3 + 0.05 * step)
        pose[:3, 3] = (100 + 5.0 * step, 20.0 * number, 0.5)
        solids = self._solids(step) if self.with_scans else SolidBoxes.none()
        frames = []
        for turn, sensor in enumerate(self.sensors.values()):
            empty = last and turn == len(self.sensors) - 1
            boxes = ImageBoxes.none() if empty else self._image_boxes(turn, step, solids)
            frames.append(self._frame(drive, sensor, stamp_ns, turn, boxes))
        self.keyframes += 1
        return Keyframe(
            keyframe=self.keyframes - 1,
            drive=drive.name,
            stamp_ns=stamp_ns,
            split=SPLITS[number % len(SPLITS)],
            latitude=48.1 + 0.01 * number + 4.5e-5 * step if self.located else np.nan,
            longitude=11.5 if self.located else np.nan,
            reason="distance" if step else "first",
            score=0.25 * step,
            T_world_base=Transform("map", "base_link", pose),
            frames=tuple(frames),
            scan=_scan(self.folder, drive, stamp_ns, solids) if self.with_scans else None,
            solids=solids,
        )

    def _frame(
        self, drive: Drive, sensor: CameraSensor, stamp_ns: int, turn: int, boxes: ImageBoxes
    ) -> LabelledFrame:
        offset_ns = -7_000_000 * (turn + 1)
        stem = f"{drive.name}_{sensor.name}_{stamp_ns + offset_ns}"
        pixels = _picture(stem)
        file = f"images/{stem}.jpg"
        cv2.imwrite(str(self.folder / file), pixels)
        rectified = None if self.suffix is None else file
        if self.suffix is not None and (self.distorted or self.suffix != ".jpg"):
            rectified = f"rectified/{stem}{self.suffix}"
            cv2.imwrite(str(self.folder / rectified), pixels)
        place = np.eye(4)
        place[0, 3] = 0.07 * (turn + 1)  # 10 m/s, looked at before the keyframe's time
        self.frames += 1
        return LabelledFrame(
            frame=self.frames - 1,
            camera=sensor.name,
            stamp_ns=stamp_ns + offset_ns,
            offset_ns=offset_ns,
            file=file,
            rectified_file=rectified,
            image_size=SIZE,
            boxes=boxes,
            vehicle_place=Transform("base_link", "base_link", place),
        )

    def _solids(self, step: int) -> SolidBoxes:
        self.solids += 3
        return SolidBoxes(
            ids=np.arange(self.solids - 2, self.solids + 1),
            boxes_m=np.array(
                [
                    [12.0 + step, -1.25, 0.8, 4.6, 1.9, 1.6, 0.1 + 0.05 * step],
                    [9.0, 2.5 + 0.1 * step, 0.9, 0.6, 0.7, 1.8, -2.4],
                    [-15.0, 3.0, 1.2, 8.5, 2.5, 3.1, np.pi],
                ]
            ),
            labels=(CATEGORIES[0], CATEGORIES[1], CATEGORIES[0]),
            confidences=np.array([0.93, 0.51, np.nan]),
            sources=("tracks", "lidar", ""),
            track_ids=np.array([7, -1, 8]),
            velocities_mps=np.array([[2.0, 0.1], [np.nan, np.nan], [0.0, 0.0]]),
            points=np.array([120, 9, -1]),
        )

    def _image_boxes(self, turn: int, step: int, solids: SolidBoxes) -> ImageBoxes:
        self.boxes += 3
        shift = 3.0 * step + turn
        linked = [*solids.ids[:2].tolist(), 0] if len(solids) else [0, 0, 0]
        return ImageBoxes(
            ids=np.arange(self.boxes - 2, self.boxes + 1),
            boxes_px=np.array(
                [
                    [100.25 + shift, 80.5, 160.75 + shift, 120.125],
                    [40.0, 90.0 + shift, 52.3333333, 130.0],
                    [0.0, 0.0, 320.0, 33.0 + step],
                ]
            ),
            labels=CATEGORIES,
            confidences=np.array([0.875, 0.4, np.nan]),
            sources=("small", "lidar", ""),
            track_ids=np.array([7, -1, -1]),
            solids=np.array(linked, dtype=np.int64),
            truncated=np.array([0.0, 0.25, np.nan]),
            occluded=np.array([0.1, 0.6, np.nan]),
        )


def _picture(stem: str) -> NDArray[np.uint8]:
    """Return a picture that no other stem has."""
    random = np.random.default_rng(zlib.crc32(stem.encode()))
    small = random.integers(0, 256, (10, 16, 3), dtype=np.uint8)
    return cv2.resize(small, SIZE, interpolation=cv2.INTER_CUBIC).astype(np.uint8)


def _scan(folder: Path, drive: Drive, stamp_ns: int, solids: SolidBoxes) -> KeyScan:
    """Write points on the ground and in each box."""
    random = np.random.default_rng(stamp_ns % 2**32)
    ground = np.column_stack(
        [random.uniform(-30, 30, (400, 2)), np.zeros(400), random.uniform(0, 1, 400)]
    )
    inside = [
        np.column_stack([box[:3] + random.uniform(-0.2, 0.2, (30, 3)), np.full(30, 0.5)])
        for box in solids.boxes_m
    ]
    rows = np.vstack([ground, *inside]).astype(np.float32)
    file = f"scans/{drive.name}_{stamp_ns}.bin"
    rows.tofile(folder / file)
    return KeyScan(
        stamp_ns=stamp_ns, offset_ns=0, file=file, points=len(rows), offsets_ns={"top": 0}
    )
