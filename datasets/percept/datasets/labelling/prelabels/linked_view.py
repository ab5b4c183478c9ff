"""One image of a keyframe: which of its boxes and of the 3D boxes are one object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS, seconds_from_ns
from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.categories import UNKNOWN, category_of
from percept.datasets.labelling.prelabels.config import PreLabelConfig
from percept.datasets.labelling.prelabels.network_boxes import SeenBoxes, join_networks
from percept.datasets.labelling.prelabels.project_solids import ProjectedSolids, project_solids
from percept.datasets.labelling.prelabels.solid_matches import (
    LinkConfig,
    is_known,
    is_small,
    lone_solids,
    match_solids,
)

__all__ = ["ImageView", "LinkedView", "accepted_solids", "link_view", "solid_rows"]

_I64 = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageView:
    """An image of a keyframe, as linking needs it.

    Attributes:
        found: The boxes of each network that looked at it, by its name.
        image_size: (width, height) in pixels; None where it is not known, and boxes stay as they
            are.
        camera: The camera; None where its lens is not known.
        offset_ns: When it was taken minus the time of the 3D boxes.
        vehicle_place: `T_base_then_base`, from the base frame at the time of the 3D boxes into
            that at the image's; None where the motion is not known.
    """

    found: Mapping[str, Detections2D]
    image_size: tuple[int, int] | None
    camera: CameraSensor | None = None
    offset_ns: int = 0
    vehicle_place: Transform | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LinkedView:
    """The objects of one image.

    Attributes:
        seen: The M boxes of networks that are pre-labels, one for each object.
        said: All boxes of the networks by their categories, the unsure ones too.
        matches: (M,) int64 the 3D box of each, as a row; -1 where there is none.
        alone: (K,) int64 rows of the 3D boxes that the networks missed.
        projected: The 3D boxes in the image; None where that cannot be known.
    """

    seen: SeenBoxes
    said: SeenBoxes
    matches: _I64
    alone: _I64
    projected: ProjectedSolids | None


def accepted_solids(
    solids: SolidBoxes, config: PreLabelConfig, dropped: Counter[str]
) -> SolidBoxes:
    """Return the 3D boxes that may become labels, by the names of the data set."""
    labels = [category_of(label, config.categories) for label in solids.labels]
    kept = []
    for row, label in enumerate(labels):
        unsure = solids.confidences[row] < config.solids.of(label) and label != UNKNOWN
        if not label:
            dropped["3D boxes of classes that are left out"] += 1
        elif unsure:
            dropped["3D boxes below the threshold of their class"] += 1
        else:
            kept.append(row)
    return solid_rows(solids, kept, [labels[row] for row in kept])


def link_view(
    view: ImageView, solids: SolidBoxes, config: PreLabelConfig, dropped: Counter[str]
) -> LinkedView:
    """Find out what is one object in an image.

    Args:
        view: The image.
        solids: N 3D boxes as `accepted_solids` returns them.
        config: Settings.
        dropped: Takes what is left out, by reason.
    """
    said = _said(view, config)
    seen = _chosen(said, config, dropped)
    matches = np.full(len(seen), -1, dtype=np.int64)
    alone = np.zeros(0, dtype=np.int64)
    projected = _projected(view, solids, config.linking)
    if projected is not None:
        matches = match_solids(seen, solids.labels, projected, config.linking)
        alone, parts = lone_solids(seen, solids.labels, projected, matches, config.linking)
        dropped["3D boxes of an object that a 2D box shows already"] += parts
    elif len(solids):
        dropped["images that cannot be linked with 3D boxes"] += 1
    return LinkedView(seen=seen, said=said, matches=matches, alone=alone, projected=projected)


def solid_rows(solids: SolidBoxes, rows: Sequence[int], labels: Sequence[str]) -> SolidBoxes:
    """Return some 3D boxes with other classes."""
    chosen = np.array(rows, dtype=np.intp)
    return SolidBoxes(
        ids=solids.ids[chosen],
        boxes_m=solids.boxes_m[chosen],
        labels=tuple(labels),
        confidences=solids.confidences[chosen],
        sources=tuple(solids.sources[row] for row in rows),
        track_ids=solids.track_ids[chosen],
        velocities_mps=solids.velocities_mps[chosen],
        points=solids.points[chosen],
    )


def _said(view: ImageView, config: PreLabelConfig) -> SeenBoxes:
    """Return the boxes of all networks, inside the image and with their categories."""
    seen = SeenBoxes.of(view.found)
    border = np.array(view.image_size or (np.inf, np.inf), dtype=np.float64)
    return replace(
        seen,
        boxes_px=np.clip(seen.boxes_px, 0, np.tile(border, 2)),
        labels=tuple(category_of(label, config.categories) for label in seen.labels),
    )


def _chosen(seen: SeenBoxes, config: PreLabelConfig, dropped: Counter[str]) -> SeenBoxes:
    """Return the boxes that are pre-labels, one for each object."""
    sizes = seen.boxes_px[:, 2:] - seen.boxes_px[:, :2]
    small = is_small(sizes, config.linking)
    kept = []
    for row, label in enumerate(seen.labels):
        if not label:
            dropped["2D boxes of classes that are left out"] += 1
        elif seen.confidences[row] < config.images.of(label):
            dropped["2D boxes below the threshold of their class"] += 1
        elif small[row]:
            dropped["2D boxes that are too small"] += 1
        else:
            kept.append(row)
    seen = seen.select(np.array(kept, dtype=np.intp))
    rows = join_networks(seen, config.linking.same_iou, config.linking.any_iou)
    dropped["2D boxes of an object that another network found better"] += len(seen) - len(rows)
    return seen.select(rows)


def _projected(view: ImageView, solids: SolidBoxes, config: LinkConfig) -> ProjectedSolids | None:
    """Return the 3D boxes as the image shows them; None where that cannot be known."""
    if view.camera is None or view.camera.T_base_sensor is None:
        return None
    if view.vehicle_place is None and abs(view.offset_ns) > config.still_ms * NS_PER_MS:
        return None
    T_camera_base = view.camera.T_base_sensor.inverse()
    if view.vehicle_place is not None:
        T_camera_base = T_camera_base @ view.vehicle_place
    boxes_m = solids.boxes_m.copy()
    moved = np.nan_to_num(solids.velocities_mps) * seconds_from_ns(view.offset_ns)
    boxes_m[:, :2] += moved
    return project_solids(
        boxes_m, T_camera_base, view.camera.camera(), hiding=is_known(solids.labels)
    )
