"""Reference lines of OpenDRIVE in the plane: line, arc, spiral, poly3 and paramPoly3.

ASAM OpenDRIVE 1.7, sections 7.4 to 7.7: each piece begins at (x, y) with a heading and has its
own coordinates u along that heading and v to its left; s is the length along the curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Curve", "arc", "line", "param_poly3", "poly3", "spiral"]

_F64 = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_TABLE_STEP_M = 0.05
_MOST_STEPS = 20_000

# Of lengths (N,) along a piece: u, v (N,) and the heading (N,) against that of its start.
Curve = Callable[[_F64], tuple[_F64, _F64, _F64]]


def line(lengths: _F64) -> tuple[_F64, _F64, _F64]:
    """Return the points of a straight line."""
    return lengths, np.zeros_like(lengths), np.zeros_like(lengths)


def arc(curvature: float) -> Curve:
    """Return an arc; a curvature above 0 turns left."""
    return spiral(curvature, curvature, 1.0)


def spiral(curvature_start: float, curvature_end: float, length: float) -> Curve:
    """Return a clothoid: its curvature is linear in the length.

    The heading is k0 s + (k1 - k0) s^2 / (2 L); its cosine and sine are integrated by Gauss and
    Legendre over pieces that turn by less than half a radian.
    """
    rate = (curvature_end - curvature_start) / length

    def heading(s: _F64) -> _F64:
        turned: _F64 = curvature_start * s + 0.5 * rate * s**2
        return turned

    def curve(lengths: _F64) -> tuple[_F64, _F64, _F64]:
        steepest = max(abs(curvature_start), abs(curvature_end))
        end = float(lengths.max(initial=0.0))
        knots = np.linspace(0.0, end, min(int(2 * steepest * end), _MOST_STEPS) + 2)
        middles, halves = (knots[1:] + knots[:-1]) / 2, np.diff(knots) / 2
        to_knots = np.concatenate([[0j], np.cumsum(_integral(heading, middles, halves))])
        row = np.clip(np.searchsorted(knots, lengths, side="right") - 1, 0, len(knots) - 2)
        rest = (lengths - knots[row]) / 2
        places = to_knots[row] + _integral(heading, knots[row] + rest, rest)
        return places.real, places.imag, heading(lengths)

    return curve


def _integral(
    heading: Callable[[_F64], _F64], middles: _F64, halves: _F64
) -> NDArray[np.complex128]:
    """Return the integrals (N,) of exp(i heading) over intervals by middles and half widths."""
    at = middles[:, None] + halves[:, None] * _NODES
    integral: NDArray[np.complex128] = halves * (np.exp(1j * heading(at)) @ _WEIGHTS)
    return integral


@dataclass(frozen=True, slots=True)
class _Cubic:
    """a + b p + c p^2 + d p^3."""

    coefficients: tuple[float, ...]

    def __call__(self, p: _F64) -> _F64:
        value: _F64 = np.polynomial.polynomial.polyval(p, np.array(self.coefficients))
        return value

    def slope(self, p: _F64) -> _F64:
        _, b, c, d = self.coefficients
        value: _F64 = b + 2 * c * p + 3 * d * p**2
        return value


def param_poly3(u: tuple[float, ...], v: tuple[float, ...], p_of_s: float) -> Curve:
    """Return a curve of two cubics (a, b, c, d) of a parameter p = s * p_of_s."""
    of_u, of_v = _Cubic(u), _Cubic(v)

    def curve(lengths: _F64) -> tuple[_F64, _F64, _F64]:
        p = lengths * p_of_s
        return of_u(p), of_v(p), np.arctan2(of_v.slope(p), of_u.slope(p))

    return curve


def poly3(v: tuple[float, ...], length: float) -> Curve:
    """Return a curve v = a + b u + c u^2 + d u^3, whose u is found from the length along it."""
    of_v = _Cubic(v)
    # u never outruns s: the curve is at least as long as its u.
    table = np.linspace(0.0, length, min(int(length / _TABLE_STEP_M), _MOST_STEPS) + 2)
    middles, halves = (table[1:] + table[:-1]) / 2, np.diff(table) / 2
    speeds = np.hypot(1.0, of_v.slope(middles[:, None] + halves[:, None] * _NODES))
    along = np.concatenate([[0.0], np.cumsum(halves * (speeds @ _WEIGHTS))])

    def curve(lengths: _F64) -> tuple[_F64, _F64, _F64]:
        u = np.interp(lengths, along, table)
        return u, of_v(u), np.arctan(of_v.slope(u))

    return curve
