"""Where the images of a data set are from, coloured by split: a drawing for its report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from percept.export.canvas import round_length
from percept.export.palette import class_colours, hex_colour

__all__ = ["SPLIT_COLOURS", "split_maps"]

SPLIT_COLOURS = {
    name: hex_colour(rgb) for name, rgb in class_colours(("train", "val", "test")).items()
} | {"left out": "#7c8792"}
"""Colour of each part of a data set in maps; in charts they are the same."""

_F64 = NDArray[np.float64]
_EARTH_M = 6371008.8
_APART_M = 5_000.0
_MOST_AREAS = 6
_WIDTH, _LEAST_HEIGHT, _MOST_HEIGHT = 720, 220, 720
_BORDER, _TOP = 36, 64
_DOT_PX = 3.0
_LEAST_SIDE_M = 60.0
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#a0abb6}.title{font-size:15px;font-weight:600;"
    "fill:#e4e8ec}.bar{stroke:#e4e8ec;stroke-width:2;fill:none}"
)


def split_maps(places: Mapping[str, _F64]) -> tuple[str, ...]:
    """Draw places from above, north up; those that are kilometres apart in drawings of their own.

    Places that fall on one dot are drawn as one.

    Args:
        places: By a name of `SPLIT_COLOURS`, (N, 2) latitude and longitude in degrees, finite.

    Returns:
        SVG documents, that with the most places first, six at most; none without places.
    """
    named = {name: spots for name, spots in places.items() if len(spots)}
    if not named:
        return ()
    every = np.concatenate(list(named.values()))
    groups = _areas(every)
    most = sorted(range(groups.max() + 1), key=lambda group: -int((groups == group).sum()))
    starts = np.cumsum([0, *(len(spots) for spots in named.values())])
    drawn = []
    for number, group in enumerate(most[:_MOST_AREAS], 1):
        held = {
            name: every[start:end][groups[start:end] == group]
            for name, start, end in zip(named, starts[:-1], starts[1:], strict=True)
        }
        title = "Where the images are from"
        title += f", area {number} of {len(most)}" if len(most) > 1 else ""
        drawn.append(_drawing(title, {name: spots for name, spots in held.items() if len(spots)}))
    return tuple(drawn)


def _areas(places: _F64) -> NDArray[np.intp]:
    """Return of each place (N, 2) the number of the area it is in, from 0.

    Places are first gathered to cells of a hundredth of a degree, so that their number does not
    matter, and cells that are near each other are one area.
    """
    cells, inverse = np.unique(np.floor(places * 100), axis=0, return_inverse=True)
    pairs = KDTree(_unit(cells / 100) * _EARTH_M).query_pairs(_APART_M, output_type="ndarray")
    near = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cells),) * 2)
    _, areas = connected_components(near, directed=False)
    return np.asarray(areas, dtype=np.intp)[inverse.reshape(-1)]


def _unit(places: _F64) -> _F64:
    latitude, longitude = np.radians(places).T
    across = np.cos(latitude)
    return np.column_stack(
        [across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude)]
    )


def _drawing(title: str, places: Mapping[str, _F64]) -> str:
    middle = np.median(np.concatenate(list(places.values())), axis=0)
    metres = {name: _local(spots, middle) for name, spots in places.items()}
    every = np.concatenate(list(metres.values()))
    low, high = every.min(axis=0), every.max(axis=0)
    side = np.maximum(high - low, _LEAST_SIDE_M)
    centre = (low + high) / 2
    tallest = _MOST_HEIGHT - _TOP - 2 * _BORDER
    scale = min((_WIDTH - 2 * _BORDER) / side[0], tallest / side[1])
    height = max(_TOP + 2 * _BORDER + float(high[1] - low[1]) * scale, _LEAST_HEIGHT)
    origin = np.array([_WIDTH / 2, (_TOP + height) / 2])
    body = [*_legend(places)]
    for name in reversed(SPLIT_COLOURS):  # what was left out lies below what was kept
        if name in metres:
            pixels = origin + (metres[name] - centre) * [scale, -scale]
            body += _dots(name, pixels)
    body += _bar(scale, height)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height:.0f}" '
        f'width="{_WIDTH}" height="{height:.0f}" role="img" aria-label="{escape(title)}">'
        f'<style>{_STYLE}</style><rect width="100%" height="100%" rx="8" fill="#14181c"/>'
        f'<text class="title" x="24" y="28">{escape(title)}</text>{"".join(body)}</svg>\n'
    )


def _local(places: _F64, middle: _F64) -> _F64:
    """Return metres east and north of the middle; exact enough to look at."""
    turn = (places[:, 1] - middle[1] + 180.0) % 360.0 - 180.0
    east = np.radians(turn) * np.cos(np.radians(middle[0]))
    return np.column_stack([east, np.radians(places[:, 0] - middle[0])]) * _EARTH_M


def _legend(places: Mapping[str, _F64]) -> Iterator[str]:
    x = 24.0
    for name in (name for name in SPLIT_COLOURS if name in places):
        text = f"{name}: {len(places[name]):,}"
        yield f'<circle cx="{x + 5:.0f}" cy="46" r="5" fill="{SPLIT_COLOURS[name]}"/>'
        yield f'<text x="{x + 15:.0f}" y="50">{text}</text>'
        x += 34 + 7 * len(text)


def _dots(name: str, pixels: _F64) -> Iterator[str]:
    """Draw places as dots of one path, one for each square that has any."""
    cells = np.unique(np.rint(pixels / _DOT_PX), axis=0) * _DOT_PX
    marks = "".join(f"M{x:.0f} {y:.0f}h0" for x, y in cells.tolist())
    width = 4 if name == "left out" else 7
    yield (
        f'<path d="{marks}" stroke="{SPLIT_COLOURS[name]}" stroke-width="{width}" '
        f'stroke-linecap="round"><title>{name}</title></path>'
    )


def _bar(scale: float, height: float) -> Sequence[str]:
    length = round_length(_WIDTH / 6 / scale / 1.6)
    right, row = 24 + length * scale, height - 18
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    return (
        f'<path class="bar" d="M24 {row - 5:.0f}v5H{right:.1f}v-5"/>',
        f'<text x="{right + 8:.0f}" y="{row:.0f}">{text}, north up</text>',
    )
