"""What the networks found in an image, as ROS 2 messages with plain values.

Boxes are given from the edge of the image, as networks do: the left edge of the first pixel is 0.
"""

from __future__ import annotations

from percept.core.clock import NS_PER_S
from percept.core.results import Detections2D
from percept.detection.result import Positions
from percept.export.box_text import box_text
from percept.export.canvas import Rgb
from percept.export.overlay_messages import Values

__all__ = ["detection_2d_array", "image_annotations"]

_LINE_LOOP = 2
_LINE_PX = 2.0
_FONT_PX = 14.0


def detection_2d_array(found: Detections2D, frame_id: str) -> Values:
    """Return a `vision_msgs/msg/Detection2DArray` with one hypothesis a box.

    Args:
        found: The boxes.
        frame_id: Frame of the camera.
    """
    header = {"stamp": _stamp(found), "frame_id": frame_id}
    rows = zip(found.labels, found.confidences.tolist(), found.boxes_px.tolist(), strict=True)
    boxes = [
        {
            "header": header,
            "results": [{"hypothesis": {"class_id": label, "score": score}}],
            "bbox": {
                "center": {"position": {"x": (x1 + x2) / 2, "y": (y1 + y2) / 2}},
                "size_x": x2 - x1,
                "size_y": y2 - y1,
            },
        }
        for label, score, (x1, y1, x2, y2) in rows
    ]
    return {"header": header, "detections": boxes}


def image_annotations(found: Detections2D, positions: Positions | None, colour: Rgb) -> Values:
    """Return a `foxglove_msgs/msg/ImageAnnotations`: an outline and a text for each box.

    Args:
        found: The boxes.
        positions: Where they are in space, where any is known.
        colour: That of the model.
    """
    stamp = _stamp(found)
    rgba = dict(zip("rgba", (*(value / 255 for value in colour), 1.0), strict=True))
    outlines, texts = [], []
    for row, (x1, y1, x2, y2) in enumerate(found.boxes_px.tolist()):
        corners = ((x1, y1), (x2, y1), (x2, y2), (x1, y2))
        outlines.append(
            {
                "timestamp": stamp,
                "type": _LINE_LOOP,
                "points": [{"x": x, "y": y} for x, y in corners],
                "outline_color": rgba,
                "thickness": _LINE_PX,
            }
        )
        texts.append(
            {
                "timestamp": stamp,
                "position": {"x": x1, "y": y1},
                "text": box_text(found, row, positions),
                "font_size": _FONT_PX,
                "text_color": rgba,
                "background_color": {"a": 0.6},
            }
        )
    return {"points": outlines, "texts": texts}


def _stamp(found: Detections2D) -> Values:
    sec, nanosec = divmod(found.stamp_ns, NS_PER_S)
    return {"sec": sec, "nanosec": nanosec}
