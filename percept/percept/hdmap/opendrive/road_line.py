"""The reference line of a road in space, and what depends on the length along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from percept.hdmap.opendrive import curves
from percept.hdmap.opendrive.document import Numbers

__all__ = ["PiecewiseCubic", "RoadLine", "read_road_line"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PiecewiseCubic:
    """A value over the length: from each start on, a cubic of the distance to it.

    Attributes:
        starts: (K,) float64, rising.
        coefficients: (K, 4) float64 a, b, c, d.
    """

    starts: _F64
    coefficients: _F64

    @classmethod
    def of(cls, elements: Sequence[etree._Element], numbers: Numbers, start: str) -> PiecewiseCubic:
        """Read elements with a start and `a`, `b`, `c`, `d`."""
        rows = sorted(numbers.numbers(element, f"{start} a b c d") for element in elements)
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        return cls(table[:, 0], table[:, 1:])

    def __call__(self, lengths: _F64) -> _F64:
        """Return the values (N,) at lengths (N,); 0 before the first start."""
        if not len(self.starts):
            return np.zeros_like(lengths)
        row = np.searchsorted(self.starts, lengths, side="right") - 1
        away = lengths - self.starts[np.maximum(row, 0)]
        a, b, c, d = self.coefficients[np.maximum(row, 0)].T
        values: _F64 = np.where(row >= 0, a + away * (b + away * (c + away * d)), 0.0)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    start: float
    x: float
    y: float
    heading: float
    curve: curves.Curve


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoadLine:
    """The reference line of a road.

    Attributes:
        length: Of the road, metres.
        pieces: Pieces of the line in the plane by their starts.
        elevation: Height over the length.
        superelevation: Roll over the length, radians; above 0 the left side is higher.
        lane_offset: By how much lane 0 lies left of the line.
    """

    length: float
    pieces: tuple[_Piece, ...]
    elevation: PiecewiseCubic
    superelevation: PiecewiseCubic
    lane_offset: PiecewiseCubic

    @property
    def breaks(self) -> _F64:
        """Lengths at which one of the pieces that it is made of begins."""
        starts = (self.elevation.starts, self.superelevation.starts, self.lane_offset.starts)
        return np.concatenate([*starts, [piece.start for piece in self.pieces]])

    def points(self, lengths: _F64, offsets: _F64) -> _F64:
        """Return points (N, 3) at lengths (N,), offsets (N,) to the left of lane 0."""
        xyh = np.empty((len(lengths), 3))
        starts = np.array([piece.start for piece in self.pieces])
        row = np.maximum(np.searchsorted(starts, lengths, side="right") - 1, 0)
        for k, piece in enumerate(self.pieces):
            there = row == k
            if there.any():
                u, v, turned = piece.curve(np.maximum(lengths[there] - piece.start, 0.0))
                cosine, sine = np.cos(piece.heading), np.sin(piece.heading)
                xyh[there, 0] = piece.x + u * cosine - v * sine
                xyh[there, 1] = piece.y + u * sine + v * cosine
                xyh[there, 2] = piece.heading + turned
        left = offsets + self.lane_offset(lengths)
        roll = self.superelevation(lengths)
        level = left * np.cos(roll)
        return np.column_stack(
            [
                xyh[:, 0] - level * np.sin(xyh[:, 2]),
                xyh[:, 1] + level * np.cos(xyh[:, 2]),
                self.elevation(lengths) + left * np.sin(roll),
            ]
        )


def read_road_line(road: etree._Element, numbers: Numbers) -> RoadLine:
    """Read the reference line of a road.

    Raises:
        InputError: If it has none, or a number of it is none.
    """
    pieces = [_read_piece(element, numbers) for element in road.iterfind("planView/geometry")]
    if not pieces:
        raise numbers.error("has no reference line")
    elevation = road.findall("elevationProfile/elevation")
    roll = road.findall("lateralProfile/superelevation")
    offset = road.findall("lanes/laneOffset")
    return RoadLine(
        length=numbers.number(road, "length"),
        pieces=tuple(sorted(pieces, key=lambda piece: piece.start)),
        elevation=PiecewiseCubic.of(elevation, numbers, "s"),
        superelevation=PiecewiseCubic.of(roll, numbers, "s"),
        lane_offset=PiecewiseCubic.of(offset, numbers, "s"),
    )


def _read_piece(element: etree._Element, numbers: Numbers) -> _Piece:
    start, x, y, heading = (numbers.number(element, name) for name in ("s", "x", "y", "hdg"))
    return _Piece(start, x, y, heading, _read_curve(element, numbers))


def _read_curve(element: etree._Element, numbers: Numbers) -> curves.Curve:
    length = numbers.number(element, "length")
    shape = next((child for child in element if child.tag in _SHAPES), None)
    if shape is None:
        raise numbers.error("has a piece of its reference line without a known shape")
    if shape.tag == "line" or length <= 0:
        return curves.line
    if shape.tag == "arc":
        return curves.arc(numbers.number(shape, "curvature"))
    if shape.tag == "spiral":
        start, end = (numbers.number(shape, name) for name in ("curvStart", "curvEnd"))
        return curves.spiral(start, end, length)
    if shape.tag == "poly3":
        return curves.poly3(numbers.numbers(shape, "a b c d"), length)
    share = 1.0 if shape.get("pRange") == "arcLength" else 1.0 / length
    u, v = (numbers.numbers(shape, f"a{axis} b{axis} c{axis} d{axis}") for axis in "UV")
    return curves.param_poly3(u, v, share)


_SHAPES = frozenset({"line", "arc", "spiral", "poly3", "paramPoly3"})
