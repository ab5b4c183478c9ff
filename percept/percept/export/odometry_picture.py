"""Ways of the vehicle from above, as SVG text: all sources over each other, breaks marked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.core.trajectory import Trajectory
from percept.export.canvas import round_length

__all__ = ["way_picture"]

_F = NDArray[np.float64]
_WIDTH, _TALLEST, _LEAST_TALL = 720.0, 720.0, 220.0
_MARGIN, _TOP = 40.0, 66.0
_COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
_BREAK = "#ff5c5c"
_MOST_POINTS = 2000
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#a0abb6}.title{font-size:15px;font-weight:600;"
    "fill:#e4e8ec}.begin{fill:none;stroke:#e4e8ec;stroke-width:2}"
)


class _Paper(NamedTuple):
    """Where metres lie on the picture: pixels a metre, and the metres of its lower left corner."""

    scale: float
    left_m: float
    top_m: float
    height: float

    def place(self, points_m: _F) -> _F:
        """Return the pixels (N, 2) of points (N, 2); y goes up in metres and down in pixels."""
        x = _MARGIN + self.scale * (points_m[:, 0] - self.left_m)
        y = _TOP + self.scale * (self.top_m - points_m[:, 1])
        return np.column_stack([x, y])


def way_picture(title: str, ways: Mapping[str, Trajectory]) -> str:
    """Draw ways from above, x to the right and y up, in one frame.

    Nothing is drawn through gaps and jumps: their ends are marked in red. A ring marks the
    beginning of the first way, and a bar tells the scale.

    Args:
        title: What is shown.
        ways: By name, trajectories in one frame; the first one is on top.

    Returns:
        An SVG document.
    """
    paper = _paper([way.matrices[:, :2, 3] for way in ways.values()])
    body: list[str] = []
    for row, (name, way) in reversed([*enumerate(ways.items())]):
        body += _way(way, paper, _COLOURS[row % len(_COLOURS)], name, on_top=row == 0)
    for row, name in enumerate(ways):
        x = _MARGIN + 130 * row
        body.append(f'<rect x="{x:.0f}" y="40" width="11" height="11" fill="{_COLOURS[row % 5]}"/>')
        body.append(f'<text x="{x + 17:.0f}" y="50">{escape(name)}</text>')
    body += _bar(paper)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:.0f} {paper.height:.0f}" '
        f'width="{_WIDTH:.0f}" height="{paper.height:.0f}" role="img" '
        f'aria-label="{escape(title)}"><style>{_STYLE}</style>'
        f'<rect width="100%" height="100%" rx="8" fill="#14181c"/>'
        f'<text x="{_MARGIN:.0f}" y="28" class="title">{escape(title)}</text>'
        f"{''.join(body)}</svg>\n"
    )


def _paper(ways: Sequence[_F]) -> _Paper:
    every = np.concatenate(ways)
    low, high = every.min(axis=0), every.max(axis=0)
    span = np.maximum(high - low, 1.0)
    room = _WIDTH - 2 * _MARGIN
    scale = min(room / span[0], (_TALLEST - _TOP - _MARGIN) / span[1])
    tall = max(_TOP + scale * span[1] + _MARGIN, _LEAST_TALL)
    middle = (low + high) / 2
    half = (tall - _TOP - _MARGIN) / 2 / scale
    return _Paper(float(scale), float(middle[0] - room / 2 / scale), float(middle[1] + half), tall)


def _way(way: Trajectory, paper: _Paper, colour: str, name: str, *, on_top: bool) -> Iterator[str]:
    pixels = paper.place(way.matrices[:, :2, 3])
    width = 2.4 if on_top else 1.6
    for part in _parts(way):
        shown = pixels[part]
        every = max(1, len(shown) // _MOST_POINTS)
        shown = np.vstack([shown[::every], shown[-1:]])
        line = "L".join(f"{x:.1f} {y:.1f}" for x, y in shown)
        yield (
            f'<path d="M{line}" fill="none" stroke="{colour}" stroke-width="{width}" '
            f'stroke-linejoin="round" stroke-linecap="round"><title>{escape(name)}</title></path>'
        )
    for place in np.searchsorted(way.stamps_ns, way.gaps_ns.ravel()):
        x, y = pixels[min(int(place), len(pixels) - 1)]
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{_BREAK}"/>'
    if on_top:
        x, y = pixels[0]
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="6" class="begin"/>'


def _parts(way: Trajectory) -> list[NDArray[np.intp]]:
    """Return the places of the poses of each part without a gap."""
    cuts = np.searchsorted(way.stamps_ns, way.gaps_ns[:, 1], side="left")
    return [part for part in np.split(np.arange(len(way)), cuts) if len(part)]


def _bar(paper: _Paper) -> Iterator[str]:
    length_m = round_length(110 / paper.scale)
    width, y = length_m * paper.scale, paper.height - 16
    x = _WIDTH - _MARGIN - width
    yield f'<path d="M{x:.1f} {y}h{width:.1f}" stroke="#e4e8ec" stroke-width="3"/>'
    yield f'<text x="{x:.1f}" y="{y - 7:.0f}">{length_m:g} m</text>'
