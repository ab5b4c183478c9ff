"""3D boxes that came back in KITTI's labels, joined over the images of a moment.

An object stands in the label file of every camera that sees it. What one of them says anew counts;
an object is gone when no file has it any more that had it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.box_overlap import iou_bev
from percept.core.labels import LabelledImage
from percept.datasets.labelling.corrections.box_pairing import solid_likeness
from percept.datasets.labelling.formats.camera_views import CameraView
from percept.datasets.labelling.formats.kitti_boxes import from_camera_boxes, kitti_rows
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labels.kitti import kitti_objects
from percept.datasets.labels.kitti_tracking import from_kitti_boxes

__all__ = ["SolidCorrections", "ViewLabels", "read_camera_boxes"]

_F64 = NDArray[np.float64]

_ROUNDING_M = 0.03  # tools write two decimals of metres and of rad
_ONE_OBJECT_IOU = 0.3
_LARGEST_M = 1e4
_UNKNOWN_M = -999.0  # -1000 stands for an unknown place
_TWO_WAYS = "3D boxes that two images have differently; that of the larger rectangle counts"
_NOT_SHOWN = "3D boxes that no image shows, and that stay as they were"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ViewLabels:
    """One image of a moment and what its label file says.

    Attributes:
        view: The image.
        found: The rectangles.
        pairs: The row of the original box among those of the image as recorded, by row found.
        camera_boxes: (N, 7) float64 KITTI's 3D boxes of those found; NaN where there is none.
    """

    view: CameraView
    found: LabelledImage
    pairs: Mapping[int, int]
    camera_boxes: _F64


@dataclass(frozen=True, slots=True)
class _Statement:
    """What a file says anew of a 3D box: class and place, None where they stay; or that it is gone.

    The class of a rectangle may be another than that of its 3D box before anybody touched it.
    """

    area_px: float = 0.0
    label: str | None = None
    box_m: _F64 | None = None
    gone: bool = False


def read_camera_boxes(file: Path, found: LabelledImage) -> _F64:
    """Return the 3D boxes (N, 7) in KITTI's form of rectangles found; NaN where there is none.

    Raises:
        InputError: If the file cannot be read.
    """
    objects = iter(kitti_objects(file))  # in the order of those found, which are some of them
    rows = [
        next(values[7:14] for _, values in objects if values[3:7] == box)
        for box in found.boxes_px.tolist()
    ]
    boxes = np.array(rows, dtype=np.float64).reshape(-1, 7)
    usable = ((boxes[:, :3] > 0) & (boxes[:, :3] < _LARGEST_M)).all(axis=1)
    usable &= np.isfinite(boxes).all(axis=1) & (boxes[:, 3:6] > _UNKNOWN_M).all(axis=1)
    usable &= (boxes[:, 3:6] < _LARGEST_M).all(axis=1)
    boxes[~usable] = np.nan
    return boxes


class SolidCorrections:
    """The 3D boxes of a moment after a correction.

    Args:
        solids: As they were.
        views: The images that files came back for.
        numbers: Gives numbers to boxes that are new.
        dropped: Counts what could not be told.

    Attributes:
        solids: As they are now.
        links: For each view, the number of the 3D box by row found, where that is a new one.
    """

    def __init__(
        self,
        solids: SolidBoxes,
        views: Sequence[ViewLabels],
        numbers: Iterator[int],
        dropped: Counter[str],
    ) -> None:
        self._before = solids
        self._dropped = dropped
        statements: dict[int, list[_Statement]] = {}
        self.links: list[dict[int, int]] = []
        self._new: list[tuple[int, str, int, _F64]] = []  # number, class, track, box
        for labels in views:
            self._listen(labels, statements)
            self.links.append(self._added(labels, numbers))
        self.solids = self._joined(statements)

    def _listen(self, labels: ViewLabels, statements: dict[int, list[_Statement]]) -> None:
        """Note what a file says of the 3D boxes that it had."""
        boxes, written = labels.view.boxes, kitti_rows(labels.view, self._before)[:, 7:]
        at_of = {int(labels.view.frame.boxes.ids[row]): at for at, row in labels.pairs.items()}
        for row, number in enumerate(boxes.solids.tolist()):
            if not number:
                continue
            at = at_of.get(int(boxes.ids[row]))
            if at is None:
                statement = _Statement(gone=True)
            else:
                statement = _statement(labels, at, boxes.labels[row], written[row])
            statements.setdefault(number, []).append(statement)

    def _added(self, labels: ViewLabels, numbers: Iterator[int]) -> dict[int, int]:
        """Return the numbers of new 3D boxes by row found; one of two images has one number."""
        before = labels.view.frame.boxes
        links: dict[int, int] = {}
        for at, camera_box in enumerate(labels.camera_boxes):
            row = labels.pairs.get(at)
            if np.isnan(camera_box[0]) or (row is not None and before.solids[row]):
                continue
            box_m = from_camera_boxes(camera_box[None], labels.view.T_camera_base)
            label = labels.found.labels[at]
            links[at] = next((n for n, *_, box in self._new if _overlap(box, box_m)), 0)
            if not links[at]:
                links[at] = next(numbers)
                track = -1 if row is None else int(before.track_ids[row])
                self._new.append((links[at], label, track, box_m[0]))
        return links

    def _joined(self, statements: Mapping[int, Sequence[_Statement]]) -> SolidBoxes:
        before = self._before
        rows, boxes, labels, touched = [], [], [], []
        for row, number in enumerate(before.ids.tolist()):
            said = statements.get(number, ())
            self._dropped[_NOT_SHOWN] += not said
            if said and all(one.gone for one in said):
                continue
            box_m, label = self._decided(said, before.boxes_m[row], before.labels[row])
            rows.append(row)
            boxes.append(box_m)
            labels.append(label)
            touched.append(label != before.labels[row] or box_m is not before.boxes_m[row])
        return _solids(before, rows, boxes, labels, np.array(touched, bool), self._new)

    def _decided(self, said: Sequence[_Statement], box_m: _F64, label: str) -> tuple[_F64, str]:
        """Return the box and the class that count: of what was changed, in the largest image."""
        by_size = sorted(said, key=lambda one: -one.area_px)
        moved = [one.box_m for one in by_size if one.box_m is not None]
        labels = [one.label for one in by_size if one.label is not None]
        if (
            any(
                solid_likeness(moved[0][None], other[None]).shift[0, 0] > _ROUNDING_M
                for other in moved[1:]
            )
            or len(set(labels)) > 1
        ):
            self._dropped[_TWO_WAYS] += 1
        return (moved[0] if moved else box_m), (labels[0] if labels else label)


def _statement(labels: ViewLabels, at: int, label: str, written: _F64) -> _Statement:
    camera_box, found = labels.camera_boxes[at], labels.found.labels[at]
    x1, y1, x2, y2 = labels.found.boxes_px[at]
    area, new = float((x2 - x1) * (y2 - y1)), None if found == label else found
    if np.isnan(camera_box[0]) or _shift_m(camera_box, written) < _ROUNDING_M:
        return _Statement(area, new)
    moved = from_camera_boxes(camera_box[None], labels.view.T_camera_base)
    return _Statement(area, new, box_m=moved[0])


def _shift_m(camera_box: _F64, written: _F64) -> float:
    boxes, others = from_kitti_boxes(camera_box[None]), from_kitti_boxes(written[None])
    return float(solid_likeness(boxes, others).shift[0, 0])


def _overlap(box_m: _F64, other: _F64) -> bool:
    return bool(iou_bev(box_m.reshape(1, 7), other.reshape(1, 7))[0, 0] > _ONE_OBJECT_IOU)


def _solids(
    before: SolidBoxes,
    rows: Sequence[int],
    boxes: Sequence[_F64],
    labels: Sequence[str],
    touched: NDArray[np.bool_],
    new: Sequence[tuple[int, str, int, _F64]],
) -> SolidBoxes:
    kept, count = np.array(rows, np.intp), len(new)
    unknown = np.full(count, np.nan)
    sources = ["" if one else before.sources[row] for row, one in zip(rows, touched, strict=True)]
    confidences = np.where(touched, np.nan, before.confidences[kept])
    points = np.where(touched, -1, before.points[kept])
    return SolidBoxes(
        ids=np.concatenate([before.ids[kept], np.array([n for n, *_ in new], np.int64)]),
        boxes_m=np.array([*boxes, *(box for *_, box in new)], np.float64).reshape(-1, 7),
        labels=(*labels, *(label for _, label, _, _ in new)),
        confidences=np.concatenate([confidences, unknown]),
        sources=(*sources, *[""] * count),
        track_ids=np.concatenate(
            [before.track_ids[kept], np.array([t for _, _, t, _ in new], np.int64)]
        ),
        velocities_mps=np.concatenate([before.velocities_mps[kept], np.full((count, 2), np.nan)]),
        points=np.concatenate([points, np.full(count, -1)]),
    )
