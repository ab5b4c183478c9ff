"""The part of a report that is about traffic lights, and about who was late, over one time axis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import pairwise

from percept.core.clock import seconds_from_ns
from percept.core.health import StreamHealth
from percept.core.results import LightStates
from percept.export.canvas import Rgb
from percept.export.charts import Stretch, state_lanes
from percept.export.light_states import LIGHT_COLOURS, NOT_SEEN, shown_state
from percept.export.report import Block, Paragraph, Section, Table, svg_picture

__all__ = ["LightSummary", "light_sections"]

_LANES = 24
_ROWS = 100
_COLOURS: dict[str, Rgb] = {
    **LIGHT_COLOURS,
    "dark": (0, 0, 0),
    "in time": (32, 120, 84),
    "late": (213, 94, 0),
}


class LightSummary:
    """Gathers the traffic lights of a run for its report: for each its changes of state.

    Attributes:
        moments: Moments that were added.
        first_ns: Time of the first one, or None.
        last_ns: Time of the last one, or None.
    """

    def __init__(self) -> None:
        self.moments = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self._changes: dict[int, list[tuple[int, str]]] = {}
        self._cameras: dict[int, Counter[str]] = {}

    def add(self, lights: LightStates) -> None:
        """Add a moment; moments come in order of time."""
        self.moments += 1
        self.first_ns = lights.stamp_ns if self.first_ns is None else self.first_ns
        self.last_ns = lights.stamp_ns
        states = {int(i): shown_state(lights, row) for row, i in enumerate(lights.ids)}
        for light_id in {*self._changes, *states}:
            changes = self._changes.setdefault(light_id, [])
            state = states.get(light_id, "")
            if state != (changes[-1][1] if changes else ""):
                changes.append((lights.stamp_ns, state))
        for light_id, cameras in zip(lights.ids.tolist(), lights.cameras, strict=True):
            self._cameras.setdefault(light_id, Counter()).update(cameras)

    @property
    def count(self) -> int:
        """Number of lights."""
        return len(self._changes)

    def longest(self, most: int) -> list[int]:
        """Return the ids of the lights that were followed for longest, in ascending order."""
        followed = {
            light_id: sum(end_ns - start_ns for start_ns, end_ns, _ in self.stretches(light_id))
            for light_id in self._changes
        }
        return sorted(sorted(followed, key=lambda i: (-followed[i], i))[:most])

    def cameras(self, light_id: int) -> list[str]:
        """Return the cameras that saw a light, the one that saw it most first."""
        return [camera for camera, _ in self._cameras[light_id].most_common()]

    def stretches(self, light_id: int) -> Iterator[tuple[int, int, str]]:
        """Yield start, end and state of each stretch in which a light was known."""
        end_ns = self.last_ns or 0
        for (start_ns, state), (next_ns, _) in pairwise([*self._changes[light_id], (end_ns, "")]):
            if state:
                yield start_ns, next_ns, state


def light_sections(
    lights: LightSummary | None, health: Mapping[str, StreamHealth] | None = None
) -> tuple[Section, ...]:
    """Return the sections of a report about traffic lights and about health.

    Args:
        lights: The lights; None where they were not followed.
        health: By name, when sensors and detectors were late, as `run_health` gives it.
    """
    lanes = _lanes(lights, health or {})
    sections = []
    if lanes:
        sections.append(Section("Lights and health over time", tuple(lanes)))
    if lights is not None:
        sections.append(Section("Traffic lights", tuple(_light_table(lights))))
    if health:
        sections.append(Section("Health", tuple(_health_table(health))))
    return tuple(sections)


def _lanes(lights: LightSummary | None, health: Mapping[str, StreamHealth]) -> list[Block]:
    starts = [found.start_ns for found in health.values()]
    ends = [found.end_ns for found in health.values()]
    if lights is not None and lights.first_ns is not None and lights.last_ns is not None:
        starts.append(lights.first_ns)
        ends.append(lights.last_ns)
    if not starts:
        return []
    zero_ns, end_s = min(starts), seconds_from_ns(max(ends) - min(starts))
    lanes = {}
    if lights is not None:
        for light_id in lights.longest(_LANES):
            lanes[f"light {light_id}"] = _stretches(lights.stretches(light_id), zero_ns)
    for name, found in health.items():
        lanes[name] = _stretches(_health_stretches(found), zero_ns)
    chart = state_lanes("Lights and health over time", lanes, _COLOURS, end_s=end_s)
    more = 0 if lights is None else lights.count - _LANES
    caption = f"{more:,} more lights, followed for less long, are not drawn." if more > 0 else ""
    return [svg_picture(chart, "Lanes of states over time", caption)]


def _stretches(stretches: Iterator[tuple[int, int, str]], zero_ns: int) -> list[Stretch]:
    return [
        Stretch(seconds_from_ns(start - zero_ns), seconds_from_ns(end - zero_ns), state)
        for start, end, state in stretches
    ]


def _health_stretches(found: StreamHealth) -> Iterator[tuple[int, int, str]]:
    now_ns = found.start_ns
    for span in found.spans:
        yield now_ns, span.start_ns, "in time"
        yield span.start_ns, span.end_ns, "late"
        now_ns = span.end_ns
    if now_ns < found.end_ns:
        yield now_ns, found.end_ns, "in time"


def _light_table(lights: LightSummary) -> list[Block]:
    if not lights.count:
        return [Paragraph("No traffic light was seen or expected.")]
    table = Table(
        ("light", "followed s", "seen", "changes", "shows", "cameras"),
        tuple(_light_row(lights, light_id) for light_id in lights.longest(_ROWS)),
        "Each light for as long as it was followed. 'dark' is a housing that was seen and of which "
        "no lamp shone; what was not seen says nothing about the light.",
    )
    more = lights.count - _ROWS
    text = f"And {more:,} more lights, which were followed for less long."
    return [table, Paragraph(text)] if more > 0 else [table]


def _light_row(lights: LightSummary, light_id: int) -> tuple[str, ...]:
    stretches = [*lights.stretches(light_id)]
    spent: Counter[str] = Counter()
    for start_ns, end_ns, state in stretches:
        spent[state] += end_ns - start_ns
    # A light that was lost and found again as it was has not changed.
    decided = [state for _, _, state in stretches if state not in (NOT_SEEN, "unknown")]
    changes = sum(before != after for before, after in pairwise(decided))
    known_ns = max(spent.total(), 1)
    return (
        str(light_id),
        f"{seconds_from_ns(spent.total()):.1f}",
        f"{1 - spent[NOT_SEEN] / known_ns:.0%}",
        f"{changes:,}",
        ", ".join(f"{state} {ns / known_ns:.0%}" for state, ns in spent.most_common()),
        ", ".join(lights.cameras(light_id)),
    )


def _health_table(health: Mapping[str, StreamHealth]) -> list[Block]:
    rows = []
    for name, found in health.items():
        late = found.lateness
        rows.append(
            (
                name,
                f"{found.messages:,}",
                "" if found.rate_hz is None else f"{found.rate_hz:.2f}",
                "" if found.nominal_hz is None else f"{found.nominal_hz:.2f}",
                "" if late is None else f"{late.timeout_s:.2f}",
                "" if late is None else f"{late.late_share:.1%}",
                "" if late is None else f"{late.late_spans:,}",
                "" if late is None or not late.late_spans else f"{late.longest_s:.2f}",
            )
        )
    header = ("stream", "results", "Hz", "expected Hz", "timeout s", "late", "times", "longest s")
    return [
        Table(
            header,
            tuple(rows),
            "Whether sensors and detectors delivered in time: late while more than the timeout has "
            "passed since the last result. The expected rate is that of the median interval where "
            "none was given.",
        )
    ]
