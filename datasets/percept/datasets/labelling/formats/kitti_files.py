"""Files and counts that both of KITTI's benchmarks have."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.formats.camera_views import CameraView
from percept.datasets.labelling.formats.kitti_boxes import tilt_deg
from percept.datasets.labelling.labelled_set import Keyframe, SolidBoxes

__all__ = ["KittiLosses", "calibration_text", "write_classes", "write_csv"]


class KittiLosses:
    """Counts what KITTI's formats cannot hold."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._standing_ns = 0
        self._tilt_deg = 0.0

    def skip(self, keyframe: Keyframe) -> None:
        """Count a keyframe without scan."""
        self._counts["images of keyframes without a scan are left out"] += len(keyframe.frames)

    def add(self, views: Sequence[CameraView], solids: SolidBoxes) -> None:
        """Count what the views of a keyframe lose."""
        shown = [number for view in views for number in view.boxes.solids.tolist()]
        unseen = int(np.isin(solids.ids, shown, invert=True).sum())
        self._counts["3D boxes have no rectangle in any image and are left out"] += unseen
        for view in views:
            lost = "rectangles lie outside the images without distortion"
            self._counts[lost] += view.left_out
            self._tilt_deg = max(self._tilt_deg, tilt_deg(view.T_camera_base))
            if not view.moved:
                self._counts[
                    "images are calibrated as if the vehicle stood, up to {ms:.0f} ms"
                ] += 1
                self._standing_ns = max(self._standing_ns, abs(view.frame.offset_ns))

    def sentences(self, more: Iterable[str]) -> tuple[str, ...]:
        """Return what is lost, as sentences, with more that always is."""
        lean = (
            "KITTI's 3D boxes stand upright in the camera's frame: centres, sizes and headings are "
            f"right, but the boxes lean by the camera's tilt, up to {self._tilt_deg:.1f} deg."
        )
        counted = (
            f"{count} {what.format(ms=self._standing_ns * 1e-6)}."
            for what, count in self._counts.items()
            if count
        )
        return (*more, lean, *counted)


def calibration_text(
    sensor: CameraSensor, T_camera_base: Transform, names: tuple[str, str, str]
) -> str:
    """Return a calibration file: P0 to P3, and three matrices by the names that they have.

    Args:
        sensor: The rectified camera; all four projections are its own.
        T_camera_base: From the frame of the scans into the camera's.
        names: What stands before the rectifying rotation, which is none; before the transform
            from the scans to the camera; and before that from the vehicle to the scans, none too.
    """
    P = np.column_stack([sensor.camera().K, np.zeros(3)])
    values: dict[str, NDArray[np.float64]] = {f"P{index}:": P for index in range(4)}
    matrices = (np.eye(3), T_camera_base.matrix[:3], np.eye(4)[:3])
    values |= dict(zip(names, matrices, strict=True))
    return "".join(
        f"{name} {' '.join(f'{number + 0.0:.12e}' for number in value.ravel())}\n"
        for name, value in values.items()
    )


def write_classes(folder: Path, types: dict[str, str]) -> None:
    """Write KITTI's words for classes: `classes.csv`, and for Datumaro `dataset_meta.json`."""
    write_csv(folder / "classes.csv", ("type", "label"), [(t, name) for name, t in types.items()])
    words = {str(number): word for number, word in enumerate(types.values())}
    text = json.dumps({"label_map": words}, indent=2, ensure_ascii=False)
    (folder / "dataset_meta.json").write_text(text + "\n", encoding="utf-8")


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table with a line of names."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
