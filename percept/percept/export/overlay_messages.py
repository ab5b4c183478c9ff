"""The ROS 2 messages of the overlay, built by their definitions and serialized as CDR."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from percept.core.clock import NS_PER_S
from percept.core.results import Detections3D
from percept.export.canvas import Rgb
from percept.export.palette import class_colour

__all__ = [
    "DETECTION_2D_ARRAY",
    "DETECTION_3D_ARRAY",
    "IMAGE_ANNOTATIONS",
    "MARKER_ARRAY",
    "TRANSFORMS",
    "OverlayMessages",
    "Values",
    "detection_3d_array",
    "header",
    "marker_array",
    "rgba",
]

Values = Mapping[str, object]
"""Fields of a message; those that are missing are zero, empty or false."""


DETECTION_2D_ARRAY = "vision_msgs/msg/Detection2DArray"
DETECTION_3D_ARRAY = "vision_msgs/msg/Detection3DArray"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
IMAGE_ANNOTATIONS = "foxglove_msgs/msg/ImageAnnotations"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_DEFINITIONS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    DETECTION_3D_ARRAY: "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y\n",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "vision_msgs/msg/BoundingBox2D": (
        "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
    DETECTION_2D_ARRAY: "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
    "foxglove_msgs/msg/Point2": "float64 x\nfloat64 y\n",
    "foxglove_msgs/msg/Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n",
    "foxglove_msgs/msg/CircleAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nfloat64 diameter\n"
        "float64 thickness\nfoxglove_msgs/Color fill_color\nfoxglove_msgs/Color outline_color\n"
    ),
    "foxglove_msgs/msg/PointsAnnotation": (
        "builtin_interfaces/Time timestamp\nuint8 type\nfoxglove_msgs/Point2[] points\n"
        "foxglove_msgs/Color outline_color\nfoxglove_msgs/Color[] outline_colors\n"
        "foxglove_msgs/Color fill_color\nfloat64 thickness\n"
    ),
    "foxglove_msgs/msg/TextAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nstring text\n"
        "float64 font_size\nfoxglove_msgs/Color text_color\nfoxglove_msgs/Color background_color\n"
    ),
    IMAGE_ANNOTATIONS: (
        "foxglove_msgs/CircleAnnotation[] circles\nfoxglove_msgs/PointsAnnotation[] points\n"
        "foxglove_msgs/TextAnnotation[] texts\n"
    ),
}
_CUBE, _TEXT = 1, 9
_ADD, _DELETE_ALL = 0, 3
_TEXT_HEIGHT_M = 0.6
_PLAIN = (float, int, str)
_ZEROS = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}


class OverlayMessages:
    """Serializes messages that are given as plain values; holds their definitions."""

    def __init__(self) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        for name, definition in _DEFINITIONS.items():
            self._store.register(get_types_from_msg(definition, name))
        self._layouts: dict[str, tuple[dict[str, FieldDesc], dict[str, Any]]] = {}

    def definition(self, msgtype: str) -> str:
        """Return a definition with all that it depends on, as mcap's `ros2msg` wants it."""
        text, _ = self._store.generate_msgdef(msgtype, ros_version=2)
        return text

    def serialize(self, values: Values, msgtype: str) -> bytes:
        """Return a message as CDR.

        Args:
            values: Its fields.
            msgtype: Name of its type.
        """
        return bytes(self._store.serialize_cdr(self._message(msgtype, values), msgtype))

    def _message(self, msgtype: str, values: Values) -> object:
        fields, zeros = self._fields(msgtype)
        given = {
            name: value if isinstance(value, _PLAIN) else self._value(fields[name], value)
            for name, value in values.items()
        }
        return self._store.types[msgtype](**(zeros | given))

    def _fields(self, msgtype: str) -> tuple[dict[str, FieldDesc], dict[str, Any]]:
        """Return what the fields of a type are, and their values where none is given."""
        if msgtype not in self._layouts:
            fields = dict(self._store.get_msgdef(msgtype).fields)
            zeros: dict[str, Any] = {name: self._zero(desc) for name, desc in fields.items()}
            self._layouts[msgtype] = fields, zeros
        return self._layouts[msgtype]

    def _value(self, desc: FieldDesc, given: Any) -> object:  # noqa: ANN401 - by the definition
        match desc:
            case (Nodetype.NAME, str(name)):
                return self._message(name, given)
            case (Nodetype.SEQUENCE, (inner, _)):
                return [self._value(inner, item) for item in given]
        raise TypeError(f"{given!r} cannot be a {desc}")

    def _zero(self, desc: FieldDesc) -> object:
        match desc:
            case (Nodetype.BASE, (str(name), _)):
                return _ZEROS.get(name, 0)
            case (Nodetype.NAME, str(name)):
                return self._message(name, {})
            case (_, ((Nodetype.BASE, (str(name), _)), int(count))):
                return np.zeros(count, dtype=name)
            case _:
                return []


def detection_3d_array(detections: Detections3D, ids: Sequence[str] = ()) -> Values:
    """Return a `vision_msgs/msg/Detection3DArray` with one hypothesis a box.

    Args:
        detections: The boxes.
        ids: Of each box, what tells its object from others over time; empty where not known.
    """
    head = header(detections.stamp_ns, detections.frame_id)
    found = [
        {
            "header": head,
            "results": [
                {"hypothesis": {"class_id": label, "score": score}, "pose": {"pose": pose}}
            ],
            "bbox": {"center": pose, "size": size},
            "id": identity,
        }
        for (label, score, pose, size), identity in zip(
            _boxes(detections), ids or [""] * len(detections), strict=True
        )
    ]
    return {"header": head, "detections": found}


def marker_array(
    detections: Detections3D, ids: Sequence[str] = (), more: Sequence[Values] = ()
) -> Values:
    """Return a `visualization_msgs/msg/MarkerArray` with a cube and a text for each box.

    Its first marker wipes those of the scan before.

    Args:
        detections: The boxes.
        ids: What stands before the class of each box; empty for nothing.
        more: Further markers, behind those of the boxes.
    """
    head = header(detections.stamp_ns, detections.frame_id)
    markers: list[Values] = [{"header": head, "action": _DELETE_ALL}]
    for number, (label, score, pose, size) in enumerate(_boxes(detections)):
        shared = {"header": head, "id": number, "action": _ADD}
        place, turn = pose["position"], pose["orientation"]
        above = {**place, "z": place["z"] + size["z"] / 2 + _TEXT_HEIGHT_M / 2}
        text = f"{label} {score:.2f}"
        markers += [
            {
                **shared,
                "ns": "boxes",
                "type": _CUBE,
                "pose": pose,
                "scale": size,
                "color": rgba(class_colour(label), 0.5),
            },
            {
                **shared,
                "ns": "labels",
                "type": _TEXT,
                "pose": {"position": above, "orientation": turn},
                "scale": {"z": _TEXT_HEIGHT_M},
                "color": rgba(class_colour(label), 1.0),
                "text": f"{ids[number]} {text}" if ids else text,
            },
        ]
    return {"markers": [*markers, *more]}


def _boxes(
    detections: Detections3D,
) -> Iterator[tuple[str, float, dict[str, dict[str, float]], dict[str, float]]]:
    """Yield label, confidence, pose and size of each box."""
    for label, score, box in zip(
        detections.labels, detections.confidences.tolist(), detections.boxes_m, strict=True
    ):
        x, y, z, length, width, height, yaw_rad = box.tolist()
        pose = {
            "position": {"x": x, "y": y, "z": z},
            "orientation": {
                "x": 0.0,
                "y": 0.0,
                "z": math.sin(yaw_rad / 2),
                "w": math.cos(yaw_rad / 2),
            },
        }
        yield label, score, pose, {"x": length, "y": width, "z": height}


def header(stamp_ns: int, frame_id: str) -> Values:
    """Return a `std_msgs/msg/Header`."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}


def rgba(rgb: Rgb, alpha: float) -> Values:
    """Return a `std_msgs/msg/ColorRGBA` of a colour 0..255 and an opacity 0..1."""
    red, green, blue = (value / 255 for value in rgb)
    return {"r": red, "g": green, "b": blue, "a": alpha}
