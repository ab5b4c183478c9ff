"""Tracks, traffic lights and poses as ROS 2 messages with plain values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.results import Detections3D, LightStates, Tracks
from percept.core.trajectory import Trajectory
from percept.core.transform import quat_xyzw_from_matrix
from percept.export.light_states import LIGHT_COLOURS, shown_state
from percept.export.overlay_messages import (
    Values,
    detection_3d_array,
    header,
    marker_array,
    rgba,
)
from percept.export.palette import class_colour

__all__ = [
    "light_array",
    "light_markers",
    "track_array",
    "track_markers",
    "transform_messages",
]

_ARROW, _TRIANGLES = 0, 11
_DELETE_ALL = 3
_ARROW_WIDTH_M = 0.15
_SLOWEST_ARROW_MPS = 0.3
_POSE_STEP_NS = NS_PER_S // 50


def track_array(tracks: Tracks) -> Values:
    """Return a `vision_msgs/msg/Detection3DArray` of the full tracks, each with its id."""
    boxes, ids, _ = _full(tracks)
    return detection_3d_array(boxes, ids)


def track_markers(tracks: Tracks) -> Values:
    """Return a `visualization_msgs/msg/MarkerArray` of the full tracks.

    Each has a cube, a text with its id and class, and where it moves an arrow as long as its way
    in the next second.
    """
    boxes, ids, velocities_mps = _full(tracks)
    head = header(tracks.stamp_ns, tracks.frame_id)
    arrows = [
        {
            "header": head,
            "ns": "velocities",
            "id": number,
            "type": _ARROW,
            "pose": {"position": _point(box[:3]), "orientation": _turn(np.arctan2(vy, vx))},
            "scale": {"x": float(np.hypot(vx, vy)), "y": _ARROW_WIDTH_M, "z": _ARROW_WIDTH_M},
            "color": rgba(class_colour(label), 1.0),
        }
        for number, (box, label, (vx, vy)) in enumerate(
            zip(boxes.boxes_m, boxes.labels, velocities_mps, strict=True)
        )
        if np.hypot(vx, vy) >= _SLOWEST_ARROW_MPS
    ]
    return marker_array(boxes, ids, arrows)


def light_array(
    lights: LightStates, faces: Mapping[int, NDArray[np.float64]], frame_id: str
) -> Values:
    """Return a `vision_msgs/msg/Detection3DArray` of lights: class is what each shows.

    Args:
        lights: Their states.
        faces: By id, the corners (4, 3) of the faces; a light that has none is at the origin
            with no size.
        frame_id: Frame of the corners.
    """
    head = header(lights.stamp_ns, frame_id)
    found = []
    for row, light_id in enumerate(lights.ids.tolist()):
        state, score = shown_state(lights, row), float(lights.probabilities[row])
        detection: dict[str, object] = {
            "header": head,
            "results": [{"hypothesis": {"class_id": state, "score": score}}],
            "id": str(light_id),
        }
        if light_id in faces:
            corners = faces[light_id]
            size = dict(zip("xyz", np.ptp(corners, axis=0).tolist(), strict=True))
            detection["bbox"] = {"center": {"position": _point(corners.mean(axis=0))}, "size": size}
        found.append(detection)
    return {"header": head, "detections": found}


def light_markers(
    lights: LightStates, faces: Mapping[int, NDArray[np.float64]], frame_id: str
) -> Values:
    """Return a `visualization_msgs/msg/MarkerArray`: the faces in the colours that they show.

    Args:
        lights: Their states.
        faces: By id, the corners (4, 3) of the faces; a light that has none is left out.
        frame_id: Frame of the corners.
    """
    head = header(lights.stamp_ns, frame_id)
    markers: list[Values] = [{"header": head, "action": _DELETE_ALL}]
    for row, light_id in enumerate(lights.ids.tolist()):
        if light_id not in faces:
            continue
        corners = faces[light_id]
        markers.append(
            {
                "header": head,
                "ns": "lights",
                "id": row,
                "type": _TRIANGLES,
                "pose": {"orientation": {"w": 1.0}},
                "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
                "color": rgba(LIGHT_COLOURS[shown_state(lights, row)], 1.0),
                # Both sides, since a triangle is seen from one alone.
                "points": [_point(corners[i]) for i in (0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 3, 2)],
            }
        )
    return {"markers": markers}


def transform_messages(poses: Trajectory) -> Iterator[tuple[int, Values]]:
    """Yield stamps and `tf2_msgs/msg/TFMessage`s, with at least 20 ms between them."""
    before_ns: int | None = None
    for stamp_ns, matrix in zip(poses.stamps_ns.tolist(), poses.matrices, strict=True):
        if before_ns is not None and stamp_ns - before_ns < _POSE_STEP_NS:
            continue
        before_ns = stamp_ns
        quat = quat_xyzw_from_matrix(matrix[:3, :3]).tolist()
        transform = {
            "header": header(stamp_ns, poses.target),
            "child_frame_id": poses.source,
            "transform": {
                "translation": _point(matrix[:3, 3]),
                "rotation": dict(zip("xyzw", quat, strict=True)),
            },
        }
        yield stamp_ns, {"transforms": [transform]}


def _full(tracks: Tracks) -> tuple[Detections3D, list[str], NDArray[np.float64]]:
    """Return boxes, ids and velocities (N, 2) of the full tracks."""
    rows = [row for row, state in enumerate(tracks.states) if state == "full"]
    boxes = Detections3D(
        stamp_ns=tracks.stamp_ns,
        sensor="tracks",
        frame_id=tracks.frame_id,
        boxes_m=tracks.boxes_m[rows],
        labels=tuple(tracks.labels[row] for row in rows),
        confidences=tracks.label_probabilities[rows],
    )
    return boxes, [str(tracks.ids[row]) for row in rows], tracks.velocities_mps[rows]


def _point(xyz: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyz", xyz.tolist(), strict=True))


def _turn(yaw_rad: float) -> dict[str, float]:
    return {"z": float(np.sin(yaw_rad / 2)), "w": float(np.cos(yaw_rad / 2))}
