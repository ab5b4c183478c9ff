"""A map as shapes on a picture: what is drawn, apart from the kind of file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.polyline import along_m, beside, points_at
from percept.export.canvas import Rgb
from percept.hdmap import HdMap, Lanelet, MapLight, MapMarking

__all__ = ["LEGEND", "MapScene", "Shape", "map_scene"]

_F64 = NDArray[np.float64]

_WHITE, _YELLOW, _OTHER = (236, 240, 244), (250, 200, 40), (120, 190, 240)
_UNPAINTED, _ROAD, _FOOT, _AREA = (96, 106, 116), (38, 44, 51), (34, 58, 66), (52, 42, 60)
_STOP, _LIGHT, _ARROW = (226, 84, 64), (64, 200, 140), (86, 180, 233)
LEGEND: tuple[tuple[str, Rgb], ...] = (
    ("white paint", _WHITE),
    ("yellow paint", _YELLOW),
    ("paint of another colour", _OTHER),
    ("not painted: kerb, edge, virtual", _UNPAINTED),
    ("stop line", _STOP),
    ("traffic light", _LIGHT),
    ("driving direction", _ARROW),
)

_COLOURS = {"white": _WHITE, "yellow": _YELLOW}
_MARGIN_PX = 24.0
_LEAST_PX = 160
_MOST_PX_PER_M = 40.0
_LINE_WIDTH_M, _STOP_WIDTH_M = 0.15, 0.4
_GAP_M, _GAP_PX = 0.12, 3.0
_DASH_M, _DASH_PX = 3.0, 4.0
_ARROW_M, _ARROW_PX = 2.0, 5.0
_PAIRS = {
    "solid_solid": ("solid", "solid"),
    "solid_dashed": ("solid", "dashed"),
    "dashed_solid": ("dashed", "solid"),
}
_WALKED = frozenset({"crosswalk", "walkway", "shared_walkway", "pedestrian_lane", "stairs"})


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Lines or one filled outline in one colour.

    Attributes:
        lines_px: Each (K, 2) float64 columns and rows.
        colour: Red, green, blue.
        width_px: Of the lines; 0 fills the outline.
        name: What it is, with words of the map in it: to be escaped.
    """

    lines_px: tuple[_F64, ...]
    colour: Rgb
    width_px: float
    name: str


@dataclass(frozen=True, slots=True, eq=False)
class MapScene:
    """A map seen from above, x to the right and y up.

    Attributes:
        width_px: Of the picture.
        height_px: Of the picture.
        px_per_m: Its scale.
        shapes: What is drawn, the lowest first.
    """

    width_px: int
    height_px: int
    px_per_m: float
    shapes: tuple[Shape, ...]


def map_scene(hd_map: HdMap, size_px: int = 1600) -> MapScene:
    """Lay out a map on a picture.

    Args:
        hd_map: The map.
        size_px: Longer side of the picture.
    """
    every = [*hd_map.shapes.values()] or [hd_map.points.xyz_map]
    points = np.concatenate(every)[:, :2]
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.maximum(high - low, 1.0)
    scale = min((size_px - 2 * _MARGIN_PX) / float(span.max()), _MOST_PX_PER_M)
    sides = np.maximum(np.ceil(span * scale + 2 * _MARGIN_PX), _LEAST_PX)
    sheet = _Sheet(scale, (low + high) / 2, sides)
    return MapScene(int(sides[0]), int(sides[1]), scale, tuple(sheet.shapes(hd_map)))


@dataclass(frozen=True, slots=True, eq=False)
class _Sheet:
    """Where metres lie on the picture: its scale, its middle in metres, its sides in pixels."""

    scale: float
    middle_m: _F64
    sides_px: _F64

    def place(self, points_map: _F64) -> _F64:
        away = (points_map[:, :2] - self.middle_m) * self.scale
        return np.column_stack(
            [self.sides_px[0] / 2 + away[:, 0], self.sides_px[1] / 2 - away[:, 1]]
        )

    def shapes(self, hd_map: HdMap) -> Iterator[Shape]:
        for area in hd_map.areas.values():
            yield Shape((self.place(area.outer_map),), _AREA, 0.0, f"area {area.area_id}")
        for lanelet in hd_map.lanelets.values():
            outline = np.concatenate([lanelet.right_map, lanelet.left_map[::-1]])
            colour = _FOOT if lanelet.subtype in _WALKED else _ROAD
            name = f"lanelet {lanelet.lanelet_id} {lanelet.subtype}"
            yield Shape((self.place(outline),), colour, 0.0, name)
        for marking in sorted(hd_map.markings, key=lambda one: (one.painted, one.kind)):
            yield self._of_marking(marking)
        for lanelet in hd_map.lanelets.values():
            yield self._of_arrow(lanelet)
        for light in hd_map.lights:
            yield self._of_light(light)

    def _of_marking(self, marking: MapMarking) -> Shape:
        name = f"{marking.name}: {marking.kind} {marking.type} {marking.colour}"
        if marking.kind == "stop_line":
            return Shape(
                (self.place(marking.points_map),), _STOP, self._width(_STOP_WIDTH_M, 2.0), name
            )
        if not marking.painted:
            return Shape((self.place(marking.points_map),), _UNPAINTED, 1.0, name)
        return Shape(
            tuple(self.place(line) for line in self._paint(marking)),
            _COLOURS.get(marking.colour, _OTHER),
            self._line_width(marking),
            name,
        )

    def _line_width(self, marking: MapMarking) -> float:
        return self._width(marking.width_m if marking.width_m > 0 else _LINE_WIDTH_M, 1.0)

    def _width(self, width_m: float, least_px: float) -> float:
        return max(width_m * self.scale, least_px)

    def _paint(self, marking: MapMarking) -> Iterator[_F64]:
        """Yield the lines of a marking in metres: dashes as dashes, pairs as pairs."""
        points = marking.points_map[:, :2]
        words = _PAIRS.get(marking.type, (marking.type,))
        apart = self._line_width(marking) / self.scale + max(_GAP_M, _GAP_PX / self.scale)
        for k, word in enumerate(words):
            line = points if len(words) == 1 else beside(points, apart * (0.5 - k))
            if word == "dashed":
                yield from _dashes(line, max(_DASH_M, _DASH_PX / self.scale))
            else:
                yield line

    def _of_arrow(self, lanelet: Lanelet) -> Shape:
        """Return an arrow head in the middle of a lanelet, in its direction."""
        (left, left_along), (right, right_along) = (
            _middle(side[:, :2]) for side in (lanelet.left_map, lanelet.right_map)
        )
        along = left_along + right_along
        length = float(np.hypot(*along))
        along = along / length if length > 0 else np.array([1.0, 0.0])
        tip = max(_ARROW_M, _ARROW_PX / self.scale) / 2 * along
        across = np.array([-tip[1], tip[0]]) * 0.7
        middle = (left + right) / 2
        head = self.place(np.array([middle - tip + across, middle + tip, middle - tip - across]))
        return Shape((head,), _ARROW, 1.2, f"lanelet {lanelet.lanelet_id}")

    def _of_light(self, light: MapLight) -> Shape:
        """Return the lower edge of a light with a tick towards whom it faces."""
        low = light.corners_map[:2, :2]
        middle = low.mean(axis=0)
        tick = middle + light.facing[:2] * max(1.5, 7.0 / self.scale)
        lines = (self.place(low), self.place(np.array([middle, tick])))
        return Shape(lines, _LIGHT, self._width(0.2, 2.0), f"traffic light {light.light_id}")


def _middle(line: _F64) -> tuple[_F64, _F64]:
    """Return the point half way along a line (K, 2), and the step of the line there."""
    along = along_m(line)
    half = along[-1] / 2
    row = min(int(np.searchsorted(along, half, side="right")) - 1, len(line) - 2)
    return points_at(line, np.array([half]))[0], line[row + 1] - line[row]


def _dashes(line: _F64, dash_m: float) -> Iterator[_F64]:
    """Yield pieces of a line (K, 2), as long as the gaps between them."""
    along = along_m(line)
    for start in np.arange(0.0, along[-1], 2 * dash_m).tolist():
        end = min(start + dash_m, float(along[-1]))
        inside = along[(along > start) & (along < end)]
        yield points_at(line, np.concatenate([[start], inside, [end]]))
