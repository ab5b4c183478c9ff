"""Charts for reports, as SVG text: crisp at any size, every name escaped.

They share the dark card of the pictures from above and the colours of the classes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from percept.core.errors import GeometryError
from percept.export.canvas import Rgb
from percept.export.palette import class_colours, hex_colour

__all__ = ["Stretch", "histogram", "share_curves", "state_lanes", "timeline"]

_WIDTH = 720
_LEFT, _RIGHT, _TOP = 58, 18, 46
_PLOT = _WIDTH - _LEFT - _RIGHT
_BARS_HEIGHT = 200
_PANEL_HEIGHT = 96
_PANEL_GAP = 34
_CURVES_HEIGHT = 300
_LANE_HEIGHT, _LANE_GAP = 14, 8
_LANE_NAMES = 132
_FINEST_PX = 0.25
_LINES = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7")
_FLASHING = " flashing"
_HATCH, _HATCHED_GREY = "url(#hatch)", "url(#hatched)"
_STRIPES = 'width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"'
_HATCHING = (
    f'<defs><pattern id="hatch" {_STRIPES}><rect width="3" height="6" fill="#14181c"/></pattern>'
    f'<pattern id="hatched" {_STRIPES}><rect width="6" height="6" fill="#a0abb6"/>'
    '<rect width="3" height="6" fill="#14181c"/></pattern></defs>'
)
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#a0abb6}.title{font-size:15px;font-weight:600;"
    "fill:#e4e8ec}.grid{stroke:#3a424a;stroke-width:1}.end{text-anchor:end}.mid{text-anchor:middle}"
)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of a lane.

    Attributes:
        start_s: Where it begins.
        end_s: Where it ends.
        state: What it shows; a ` flashing` behind it is drawn as a hatching.
    """

    start_s: float
    end_s: float
    state: str


def histogram(
    title: str, x_label: str, bins: Sequence[str], counts: Mapping[str, Sequence[int]]
) -> str:
    """Draw counts by bin as bars, stacked by class.

    Args:
        title: What is shown.
        x_label: What the bins are.
        bins: Name of each bin.
        counts: By class, the count in each bin.

    Returns:
        An SVG document.

    Raises:
        GeometryError: If a class has another number of counts than there are bins.
    """
    if any(len(row) != len(bins) for row in counts.values()):
        raise GeometryError(f"'{title}' needs a count for each of its {len(bins)} bins")
    sums = [sum(row[k] for row in counts.values()) for k in range(len(bins))]
    ticks = _ticks(max(sums, default=0), whole=True)
    colours = _colours(counts)
    legend = list(_legend(colours))
    top = _TOP + (20 * (1 + (len(legend) - 1) // 6) if legend else 0)
    bottom = top + _BARS_HEIGHT
    body = [*legend, *_grid(ticks, top, _BARS_HEIGHT)]
    step = _PLOT / max(len(bins), 1)
    for k, name in enumerate(bins):
        x, y = _LEFT + (k + 0.12) * step, float(bottom)
        for label, row in counts.items():
            height = _BARS_HEIGHT * row[k] / ticks[-1]
            y -= height
            if row[k]:
                said = f"{label}, {name}: {row[k]}"
                body.append(_bar(x, y, 0.76 * step, height, colours[label], said))
        body.append(_text(x + 0.38 * step, bottom + 18, name, "mid"))
    body.append(_text(_LEFT + _PLOT / 2, bottom + 40, x_label, "mid"))
    return _document(title, bottom + 54, body)


def timeline(title: str, seconds: Sequence[float], series: Mapping[str, Sequence[float]]) -> str:
    """Draw values over time, a panel for each series, from zero up.

    Args:
        title: What is shown.
        seconds: Time of each value, ascending, s.
        series: By name with its unit, the values; NaN leaves a gap.

    Returns:
        An SVG document.

    Raises:
        GeometryError: If a series has another length than the times.
    """
    if any(len(values) != len(seconds) for values in series.values()):
        raise GeometryError(f"'{title}' needs a value for each of its {len(seconds)} times")
    start = min(seconds, default=0.0)
    ticks = _ticks(max(seconds, default=0.0) - start)
    xs = [_LEFT + _PLOT * (t - start) / ticks[-1] for t in seconds]
    body: list[str] = []
    top = _TOP + 18
    for row, (name, values) in enumerate(series.items()):
        levels = _ticks(max((v for v in values if math.isfinite(v)), default=0.0), most=3)
        body.append(_text(_LEFT, top - 8, name))
        body += _grid(levels, top, _PANEL_HEIGHT)
        ys = [top + _PANEL_HEIGHT * (1 - max(v, 0.0) / levels[-1]) for v in values]
        body += _line(xs, ys, _LINES[row % len(_LINES)])
        top += _PANEL_HEIGHT + _PANEL_GAP
    bottom = top - _PANEL_GAP
    body += [_text(_LEFT + _PLOT * t / ticks[-1], bottom + 18, f"{t:g} s", "mid") for t in ticks]
    return _document(title, bottom + 32, body)


def share_curves(
    title: str,
    x_label: str,
    y_label: str,
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
) -> str:
    """Draw shares against shares, both from 0 to 1, a curve for each class.

    Args:
        title: What is shown.
        x_label: What goes to the right.
        y_label: What goes up.
        curves: By class, the values to the right and those up; NaN leaves a gap.

    Returns:
        An SVG document.

    Raises:
        GeometryError: If a curve has more values one way than the other.
    """
    if any(len(xs) != len(ys) for xs, ys in curves.values()):
        raise GeometryError(f"'{title}' needs as many values to the right as up")
    ticks = _ticks(1.0)
    colours = _colours(curves)
    legend = list(_legend(colours))
    top = _TOP + 20 * ((len(legend) + 5) // 6) + 18
    bottom = top + _CURVES_HEIGHT
    body = [*legend, _text(_LEFT, top - 8, y_label), *_grid(ticks, top, _CURVES_HEIGHT)]
    for label, (xs, ys) in curves.items():
        places = [_LEFT + _PLOT * x for x in xs]
        heights = [top + _CURVES_HEIGHT * (1 - y) for y in ys]
        body += _line(places, heights, colours[label])
    body += [_text(_LEFT + _PLOT * t, bottom + 18, f"{t:g}", "mid") for t in ticks]
    body.append(_text(_LEFT + _PLOT / 2, bottom + 40, x_label, "mid"))
    return _document(title, bottom + 54, body)


def state_lanes(
    title: str, lanes: Mapping[str, Sequence[Stretch]], colours: Mapping[str, Rgb], *, end_s: float
) -> str:
    """Draw states over time, a lane for each name, from 0 s on.

    Stretches that are finer than a quarter of a pixel give way to the one behind them.

    Args:
        title: What is shown.
        lanes: By name, the stretches in order; where there is none the lane is empty.
        colours: Of every state without its ` flashing`.
        end_s: Where the time axis has to reach.

    Returns:
        An SVG document.
    """
    ticks = _ticks(end_s)
    plot = _PLOT - _LANE_NAMES + _LEFT
    per_s = plot / ticks[-1]
    states = {s.state.removesuffix(_FLASHING) for lane in lanes.values() for s in lane}
    flash = any(s.state.endswith(_FLASHING) for lane in lanes.values() for s in lane)
    shown = {state: hex_colour(colours[state]) for state in colours if state in states}
    legend = list(_legend(shown | ({"flashing": _HATCHED_GREY} if flash else {})))
    top = _TOP + 20 * ((len(legend) + 5) // 6) + 6
    bottom = top + len(lanes) * (_LANE_HEIGHT + _LANE_GAP)
    body = [_HATCHING, *legend]
    for tick in ticks:
        x = _LANE_NAMES + tick * per_s
        body.append(f'<path class="grid" d="M{x:.1f} {top - 4}V{bottom}"/>')
        body.append(_text(x, bottom + 16, f"{tick:g} s", "mid"))
    for row, (name, lane) in enumerate(lanes.items()):
        y = top + row * (_LANE_HEIGHT + _LANE_GAP)
        short = name if len(name) <= 18 else f"\u2026{name[-17:]}"
        body.append(_text(_LANE_NAMES - 8, y + 11, short, "end"))
        body.append(f'<path class="grid" d="M{_LANE_NAMES} {y + _LANE_HEIGHT / 2}h{plot}"/>')
        body += _lane(lane, y, per_s, shown)
    return _document(title, bottom + 30, body)


def _lane(
    lane: Sequence[Stretch], y: float, per_s: float, colours: Mapping[str, str]
) -> Iterator[str]:
    starts = [round(stretch.start_s * per_s / _FINEST_PX) * _FINEST_PX for stretch in lane]
    for place, stretch in enumerate(lane):
        x = starts[place]
        if place + 1 < len(lane) and starts[place + 1] <= x:
            continue
        width = max(stretch.end_s * per_s - x, _FINEST_PX)
        state = stretch.state.removesuffix(_FLASHING)
        said = f"{stretch.state}, {stretch.start_s:.1f} to {stretch.end_s:.1f} s"
        yield _bar(_LANE_NAMES + x, y, width, _LANE_HEIGHT, colours[state], said)
        if state != stretch.state:
            yield _bar(_LANE_NAMES + x, y, width, _LANE_HEIGHT, _HATCH, said)


def _ticks(highest: float, *, most: int = 5, whole: bool = False) -> list[float]:
    """Return round numbers from 0 to at least the highest value, which may be 0."""
    rough = (highest if highest > 0 else 1.0) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(f * power for f in (1, 2, 2.5, 5, 10) if f * power >= rough * (1 - 1e-9))
    step = math.ceil(step) if whole else step
    count = max(1, math.ceil(highest / step - 1e-9))
    return [round(k * step, 10) for k in range(count + 1)]


def _colours(labels: Collection[str]) -> dict[str, str]:
    rgb = class_colours(labels)
    return {label: hex_colour(rgb[label]) for label in labels}


def _legend(colours: Mapping[str, str]) -> Iterator[str]:
    for k, (label, colour) in enumerate(colours.items()):
        x, y = _LEFT + (k % 6) * _PLOT / 6, _TOP + 20 * (k // 6)
        name = label if len(label) <= 13 else f"{label[:12]}\u2026"
        yield _bar(x, y - 10, 11, 11, colour, label) + _text(x + 17, y, name)


def _grid(ticks: Sequence[float], top: float, height: float) -> Iterator[str]:
    for tick in ticks:
        y = top + height * (1 - tick / ticks[-1])
        yield f'<path class="grid" d="M{_LEFT} {y:.1f}h{_PLOT}"/>'
        yield _text(_LEFT - 8, y + 4, f"{tick:,g}", "end")


def _line(xs: Sequence[float], ys: Sequence[float], colour: str) -> Iterator[str]:
    """Draw the runs of finite values as lines, and lone values as dots."""
    run: list[str] = []
    for x, y in [*zip(xs, ys, strict=True), (0.0, math.nan)]:
        if math.isfinite(y):
            run.append(f"{x:.1f} {y:.1f}")
        elif run:
            path = "M" + "L".join(run if len(run) > 1 else run * 2)
            yield (
                f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.8" '
                'stroke-linejoin="round" stroke-linecap="round"/>'
            )
            run = []


def _bar(x: float, y: float, width: float, height: float, fill: str, title: str) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{fill}">'
        f"<title>{escape(title)}</title></rect>"
    )


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    mark = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}"{mark}>{escape(text)}</text>'


def _document(title: str, height: float, body: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height:.0f}" '
        f'width="{_WIDTH}" height="{height:.0f}" role="img" aria-label="{escape(title)}">'
        f'<style>{_STYLE}</style><rect width="100%" height="100%" rx="8" fill="#14181c"/>'
        + _text(_LEFT, 28, title, "title")
        + "".join(body)
        + "</svg>\n"
    )
