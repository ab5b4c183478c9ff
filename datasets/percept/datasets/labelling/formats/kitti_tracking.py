"""KITTI's tracking benchmark: a sequence for each camera of each stretch of a drive.

A sequence has one calibration, so the points of each scan are moved to where they are at the
image's time. They are in the vehicle's base frame then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.kitti_boxes import kitti_rows, kitti_types, row_text
from percept.datasets.labelling.formats.kitti_files import (
    KittiLosses,
    calibration_text,
    write_classes,
    write_csv,
)
from percept.datasets.labelling.formats.scenes import scenes_of
from percept.datasets.labelling.formats.solid_needs import check_solid_needs, rectified_file
from percept.datasets.labelling.labelled_set import SPLITS, Keyframe, LabelledSet, Split
from percept.datasets.labelling.placing import place_file

__all__ = ["export_kitti_tracking"]

_NAME = "kitti-tracking"
_MATRICES = ("R_rect", "Tr_velo_cam", "Tr_imu_velo")  # without colons, as the benchmark has them
_SEQUENCE_COLUMNS = ("sequence", "drive", "camera", "split", "frames")
_FRAME_COLUMNS = ("sequence", "number", "frame", "keyframe", "stamp_ns", "file")
_OPENING = (
    "KITTI's tracking benchmark: `training/` has `image_02`, `label_02`, `calib` and `velodyne`,",
    "and `evaluate_tracking.seqmap.train` and so on: the sequences of each split, as TrackEval",
    "reads them, which knows KITTI's own classes only.",
    "",
    "- A sequence is one camera over one stretch of a drive in one split: `sequences.csv`.",
    "  `frames.csv` says which image of `../frames.parquet` each of its frames is. Its frames are",
    "  keyframes, so the time between two may differ.",
    "- `velodyne` is in the vehicle's base frame at the image's time: all LiDARs in one cloud.",
    "- `classes.csv` has KITTI's word for each class: its name without white space.",
    "- Images are without distortion, P2 counts pixels from the centre of the first, boxes from",
    "  its outer edge. P0, P1 and P3 repeat P2.",
    "- A rectangle without 3D box has size -1, place -1000 and turn -10. Occluded is 0 up to 10 %",
    "  hidden, 1 up to half, 2 above, 3 unknown, which scores leave out; truncated goes by the",
    "  same shares, -1 is unknown.",
)


@dataclass(frozen=True, slots=True, eq=False)
class _Sequence:
    """The images of one camera in one scene."""

    drive: str
    camera: str
    split: Split
    moments: tuple[tuple[Keyframe, CameraView], ...]


def export_kitti_tracking(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as KITTI's tracking benchmark.

    Args:
        labelled: The set; its rectified images are PNG.
        folder: The folder to fill.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If there is no scan, or a camera has no lens, place or rectified PNG.
    """
    check_solid_needs(labelled, _NAME, suffix=".png")
    types, losses = kitti_types(labelled.categories), KittiLosses()
    for name in ("image_02", "label_02", "calib", "velodyne"):
        (folder / "training" / name).mkdir(parents=True)
    writer = _Writer(labelled, folder, types)
    for number, sequence in enumerate(_sequences(labelled, losses)):
        writer.write(f"{number:04d}", sequence)
    writer.finish()
    write_classes(folder, types)
    told = losses.sentences(writer.losses())
    write_readme(folder, "KITTI tracking", _OPENING, told)
    return told


def _sequences(labelled: LabelledSet, losses: KittiLosses) -> Iterator[_Sequence]:
    """Yield the sequences of each scene, cameras in the order in which they appear."""
    for scene in scenes_of(labelled.keyframes):
        by_camera: dict[str, list[tuple[Keyframe, CameraView]]] = {}
        for keyframe in scene.keyframes:
            if keyframe.scan is None:
                losses.skip(keyframe)
                continue
            views = tuple(camera_views(labelled, keyframe))
            losses.add(views, keyframe.solids)
            for view in views:
                by_camera.setdefault(view.frame.camera, []).append((keyframe, view))
        for camera, moments in by_camera.items():
            yield _Sequence(scene.drive, camera, scene.split, tuple(moments))


class _Writer:
    """Writes sequences and their lists, and counts the boxes without a track."""

    def __init__(self, labelled: LabelledSet, folder: Path, types: dict[str, str]) -> None:
        self._labelled = labelled
        self._root = folder
        self._folder = folder / "training"
        self._types = types
        self._trackless = 0
        self._sequences: list[tuple[str, str, str, Split, int]] = []
        self._frames: list[tuple[object, ...]] = []

    def write(self, name: str, sequence: _Sequence) -> None:
        """Write a sequence."""
        (self._folder / "image_02" / name).mkdir()
        (self._folder / "velodyne" / name).mkdir()
        for number, (keyframe, view) in enumerate(sequence.moments):
            image = rectified_file(view.frame, _NAME, ".png")
            target = self._folder / "image_02" / name / f"{number:06d}.png"
            place_file(self._labelled.folder / image, target)
            self._write_points(
                self._folder / "velodyne" / name / f"{number:06d}.bin", keyframe, view
            )
        view = sequence.moments[0][1]
        calibration = calibration_text(view.sensor, view.T_base_camera.inverse(), _MATRICES)
        (self._folder / "calib" / f"{name}.txt").write_text(calibration, encoding="utf-8")
        labels = "".join(f"{line}\n" for line in self._lines(sequence))
        (self._folder / "label_02" / f"{name}.txt").write_text(labels, encoding="utf-8")
        self._sequences.append(
            (name, sequence.drive, sequence.camera, sequence.split, len(sequence.moments))
        )

    def finish(self) -> None:
        """Write the lists of sequences and frames."""
        write_csv(self._root / "sequences.csv", _SEQUENCE_COLUMNS, self._sequences)
        write_csv(self._root / "frames.csv", _FRAME_COLUMNS, self._frames)
        for split in SPLITS:
            text = "".join(
                f"{name} empty 000000 {frames:06d}\n"
                for name, _, _, of, frames in self._sequences
                if of == split
            )
            path = self._folder / f"evaluate_tracking.seqmap.{split}"
            path.write_text(text, encoding="utf-8")

    def losses(self) -> tuple[str, ...]:
        """Return what labels cannot hold, as sentences."""
        told = (
            "Box ids, confidences and sources of boxes: a label has no place for them.",
            "Velocities, poses and positions on the earth: there is no `oxts`.",
        )
        if not self._trackless:
            return told
        return (
            *told,
            f"{self._trackless} boxes have no track: each has a number of its own, above those of "
            "the tracks of its sequence.",
        )

    def _write_points(self, path: Path, keyframe: Keyframe, view: CameraView) -> None:
        if keyframe.scan is None:
            return
        points = np.fromfile(self._labelled.folder / keyframe.scan.file, dtype="<f4").reshape(-1, 4)
        points[:, :3] = view.T_then_base.apply(points[:, :3])
        points.tofile(path)

    def _lines(self, sequence: _Sequence) -> Iterator[str]:
        tracks = [
            max(view.boxes.track_ids.max(initial=-1), keyframe.solids.track_ids.max(initial=-1))
            for keyframe, view in sequence.moments
        ]
        free = int(max(tracks)) + 1
        for number, (keyframe, view) in enumerate(sequence.moments):
            taken: set[int] = set()
            rows = kitti_rows(view, keyframe.solids)
            for label, track, row in zip(
                view.boxes.labels, view.boxes.track_ids.tolist(), rows, strict=True
            ):
                if track < 0 or track in taken:
                    track, free = free, free + 1
                    self._trackless += 1
                taken.add(track)
                yield f"{number} {track} {row_text(self._types[label], row, whole_truncated=True)}"
