"""nuScenes annotations of 3D boxes, and the instances that join them over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.labelling.formats.nuscenes_tables import (
    Table,
    chain,
    pose_parts,
    token,
    visibility_token,
)
from percept.datasets.labelling.labelled_set import Keyframe

__all__ = ["AnnotationTables"]

_F64 = NDArray[np.float64]


class AnnotationTables:
    """Gathers the annotations of a scene, and links those of one track."""

    def __init__(self) -> None:
        self._instances: dict[str, tuple[str, Table]] = {}
        self._attributes: dict[str, str] = {}

    def add(
        self, keyframe: Keyframe, scene: str, T_global_base: Transform, points: NDArray[np.float32]
    ) -> None:
        """Add the boxes of a keyframe; those of a scene come in order of time.

        Args:
            keyframe: The keyframe.
            scene: Name of its scene.
            T_global_base: Where the vehicle was.
            points: (P, 3) or wider, the scan in the base frame.
        """
        visible = _visible_shares(keyframe)
        solids = keyframe.solids
        for row, box in enumerate(solids.boxes_m):
            number, track, label = (
                int(solids.ids[row]),
                int(solids.track_ids[row]),
                solids.labels[row],
            )
            instance = token(
                "instance", scene, label, *(("track", track) if track >= 0 else (number,))
            )
            counted, confidence = int(solids.points[row]), float(solids.confidences[row])
            annotation = {
                "token": token("sample_annotation", scene, number),
                "sample_token": token("sample", keyframe.drive, keyframe.stamp_ns),
                "instance_token": instance,
                "visibility_token": visibility_token(visible.get(number, np.nan)),
                "attribute_tokens": self._attribute(solids.sources[row]),
                **pose_parts(T_global_base @ _box_place(box, T_global_base.source)),
                "size": [float(box[4]), float(box[3]), float(box[5])],
                "num_lidar_pts": counted if counted >= 0 else _points_inside(points, box),
                "num_radar_pts": 0,
                "source": solids.sources[row],
                "score": confidence if np.isfinite(confidence) else None,
            }
            self._instances.setdefault(instance, (label, []))[1].append(annotation)

    def scene_tables(self) -> dict[str, Table]:
        """Return `instance` and `sample_annotation` of the scene, and begin the next one."""
        instances: Table = []
        annotations: Table = []
        for instance, (label, rows) in self._instances.items():
            chain(rows)
            annotations += rows
            instances.append(
                {
                    "token": instance,
                    "category_token": token("category", label),
                    "nbr_annotations": len(rows),
                    "first_annotation_token": rows[0]["token"],
                    "last_annotation_token": rows[-1]["token"],
                }
            )
        self._instances = {}
        return {"instance": instances, "sample_annotation": annotations}

    def attribute_table(self) -> Table:
        """Return `attribute`: one for each source of boxes of all scenes."""
        return [
            {
                "token": key,
                "name": f"prelabel.{source}",
                "description": f"A pre-label of {source}, which no person has looked at.",
            }
            for key, source in self._attributes.items()
        ]

    def _attribute(self, source: str) -> list[str]:
        if not source:
            return []
        key = token("attribute", source)
        self._attributes[key] = source
        return [key]


def _visible_shares(keyframe: Keyframe) -> dict[int, float]:
    """Return by id of 3D boxes the share that the image shows in which most is visible."""
    shares: dict[int, float] = {}
    for frame in keyframe.frames:
        visible = 1 - frame.boxes.occluded
        for number, share in zip(frame.boxes.solids.tolist(), visible.tolist(), strict=True):
            if np.isfinite(share):
                shares[number] = max(share, shares.get(number, 0.0))
    return shares


def _box_place(box: _F64, base_frame: str) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, 0.0, box[6])
    matrix[:3, 3] = box[:3]
    return Transform(base_frame, "box", matrix)


def _points_inside(points: NDArray[np.float32], box: _F64) -> int:
    cos, sin = np.cos(box[6]), np.sin(box[6])
    x, y, z = (points[:, :3] - box[:3]).T
    local: tuple[Any, ...] = (cos * x + sin * y, cos * y - sin * x, z)
    inside = [np.abs(part) <= size / 2 for part, size in zip(local, box[3:6], strict=True)]
    return int(np.logical_and.reduce(inside).sum())
