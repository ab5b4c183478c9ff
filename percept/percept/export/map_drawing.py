"""A map as a picture: PNG and SVG."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

import cv2
import numpy as np

from percept.export.canvas import (
    FIXED_SHIFT,
    TEXT,
    Image,
    blank,
    draw_scale_bar,
    fixed_point,
    round_length,
    with_header,
)
from percept.export.map_scene import LEGEND, MapScene, Shape
from percept.export.palette import hex_colour

__all__ = ["map_image", "map_png", "map_svg"]

_HEAD_PX = 56
_KEY_PX = 210
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#a0abb6}.title{font-size:15px;font-weight:600;"
    "fill:#e4e8ec}path{stroke-linecap:butt;stroke-linejoin:round}"
)


def map_image(scene: MapScene, title: str) -> Image:
    """Return a picture (H, W, 3) uint8 BGR of a map, with a legend and a scale bar."""
    image = blank(scene.width_px, scene.height_px)
    for shape in scene.shapes:
        _draw(image, shape)
    draw_scale_bar(image, scene.px_per_m)
    return with_header(image, title, LEGEND)


def map_png(scene: MapScene, title: str) -> bytes:
    """Return `map_image` as the bytes of a PNG file."""
    _, png = cv2.imencode(".png", map_image(scene, title))
    return png.tobytes()


def _draw(image: Image, shape: Shape) -> None:
    lines = [fixed_point(line) for line in shape.lines_px]
    colour = shape.colour[::-1]
    if not shape.width_px:
        cv2.fillPoly(image, lines, colour, cv2.LINE_AA, FIXED_SHIFT)
        return
    cv2.polylines(
        image,
        lines,
        isClosed=False,
        color=colour,
        thickness=max(1, round(shape.width_px)),
        lineType=cv2.LINE_AA,
        shift=FIXED_SHIFT,
    )


def map_svg(scene: MapScene, title: str) -> str:
    """Return a map as an SVG document: every shape says what it is when it is pointed at."""
    columns = max(1, min(len(LEGEND), (scene.width_px - 24) // _KEY_PX))
    rows = -(-len(LEGEND) // columns)
    head = _HEAD_PX + 20 * rows
    width, height = max(scene.width_px, _KEY_PX + 24), scene.height_px + head
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" role="img" aria-label="{escape(title)}"><style>{_STYLE}</style>'
        '<rect width="100%" height="100%" fill="#14181c"/>'
        f'<text x="12" y="26" class="title">{escape(title)}</text>{"".join(_legend(columns))}'
        f'<g transform="translate(0 {head})">{"".join(map(_path, scene.shapes))}'
        f"{''.join(_bar(scene))}</g></svg>\n"
    )


def _legend(columns: int) -> Iterator[str]:
    for k, (text, colour) in enumerate(LEGEND):
        x, y = 12 + _KEY_PX * (k % columns), 42 + 20 * (k // columns)
        yield f'<rect x="{x}" y="{y}" width="11" height="11" fill="{hex_colour(colour)}"/>'
        yield f'<text x="{x + 17}" y="{y + 10}">{escape(text)}</text>'


def _path(shape: Shape) -> str:
    way = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in line) for line in shape.lines_px)
    colour = hex_colour(shape.colour)
    paint = (
        f'fill="none" stroke="{colour}" stroke-width="{shape.width_px:.2f}"'
        if shape.width_px
        else f'fill="{colour}"'
    )
    return f'<path d="{way}" {paint}><title>{escape(shape.name)}</title></path>'


def _bar(scene: MapScene) -> Iterator[str]:
    length = round_length(scene.width_px / 8 / scene.px_per_m)
    y, right = scene.height_px - 18, 16 + length * scene.px_per_m
    ends = np.array([(16, y - 5), (16, y), (right, y), (right, y - 5)])
    way = "L".join(f"{x:.1f} {row:.1f}" for x, row in ends)
    yield f'<path d="M{way}" fill="none" stroke="{hex_colour(TEXT)}" stroke-width="2"/>'
    yield f'<text x="{right + 8:.1f}" y="{y + 3}">{length:g} m</text>'
