"""What kind of detector a network is: from its tensors, with its metadata as a hint.

The shapes allow one or more readings; what the network says about a grey and a textured picture
rules out the wrong ones; and the class names, where they are known, must be as many as the
classes. What is then not certain is refused, with what was seen.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError, UsageError
from percept.detection.images.pixels import PIXEL_FORMATS
from percept.detection.networks.cells import strides_of
from percept.detection.networks.class_names import as_class_names, coco_names
from percept.detection.networks.decode import NAMES, main_table
from percept.detection.networks.hints import Hints, read_hints
from percept.detection.networks.input_size import choose_input_size, trial_pictures
from percept.detection.networks.layout import Layout, PixelFormat
from percept.detection.networks.network import Network
from percept.detection.networks.readings import (
    Reading,
    objection,
    possible_readings,
    two_classes_at_once,
)
from percept.detection.networks.special_outputs import GRIDS, special_readings, what_else_it_is

__all__ = ["identify"]

_COCO_CLASSES = 80
# A network with embedded suppression does not tell how many classes it has.
_MOST_CLASSES = 1000
_TABLES = ("v8", "v8-last", "v5", "yolox", "end2end", "rt-detr", "rt-detr-end2end")
_TASKS = {
    "segment": "segmentation",
    "pose": "pose",
    "obb": "rotated boxes",
    "classify": "classification",
}
_BGR255 = PixelFormat("bgr", 1.0)
_WITHOUT_NMS = ("end2end", "v7-end2end", "rt-detr", "rt-detr-end2end", "v3")


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """A network and what it puts out for the two trial pictures."""

    network: Network
    size: tuple[int, int]
    grey: list[NDArray[Any]]
    textured: list[NDArray[Any]]

    @property
    def says_something(self) -> bool:
        """Whether any output holds anything but zeros."""
        return any(output.any() for output in (*self.grey, *self.textured))

    def __str__(self) -> str:
        pairs = zip(self.network.outputs, self.grey, strict=True)
        listed = "; ".join(str(replace(s, shape=o.shape)) for s, o in pairs)
        return f"{listed} for an input of {self.size[0]} x {self.size[1]}"


def identify(
    network: Network,
    *,
    layout: str | None = None,
    class_names: Sequence[str] | None = None,
    input_size: tuple[int, int] | None = None,
    pixels: str | None = None,
) -> Layout:
    """Find out how images go into a network and how its output is read.

    Args:
        network: It is run twice.
        layout: Name of the layout, where the user knows it.
        class_names: By number; otherwise from the metadata, or COCO's where there are 80 classes.
        input_size: (width, height), for a network with dynamic shapes.
        pixels: Name of the pixel format that it takes (see `PIXEL_FORMATS`), where the user
            knows it.

    Raises:
        UsageError: If what was asked for does not fit the network.
        InputError: If the network is no detector, or more than one layout fits.
    """
    hints = read_hints(network.metadata)
    size, why_size = choose_input_size(network, hints, input_size)
    wanted = None if pixels is None else _pixels_named(pixels)
    shown = _show(network, size, wanted)
    given = None if class_names is None else as_class_names(class_names, "class names")
    names = hints.class_names if given is None else given
    count = None if names is None else len(names)
    reading, why = (
        _found(shown, hints, count, given=given is not None)
        if layout is None
        else _asked_for(shown, layout)
    )
    _check_count(shown, reading, count, given=given is not None)
    resolved, why_names = _names(reading, given, hints)
    made = _input_format(reading, shown)
    chosen, why_pixels = _pixels(made.pixels, wanted, network)
    return replace(
        made,
        class_names=resolved,
        counts_classes=names is not None or reading.class_count is not None,
        channels_last=network.channels_last,
        pixels=chosen,
        why=(
            f"layout: {why}",
            f"input: {size[0]} x {size[1]}, {why_size}",
            f"classes: {why_names}",
            f"pixels: {why_pixels}",
        ),
    )


def _show(network: Network, size: tuple[int, int], pixels: PixelFormat | None) -> _Shown:
    if strange := [s for s in network.outputs if not s.dtype.startswith(("float", "int", "uint"))]:
        raise InputError(
            f"it is no detector: its output {strange[0]} is {strange[0].dtype}",
            where=network.path,
        )
    scales = (1 / 255, 1.0) if pixels is None else (pixels.scale,)
    whites = (255.0,) if network.image.dtype == "uint8" else tuple(255 * s for s in scales)
    try:
        tried = (_shown_with(network, size, white) for white in whites)
        # One that is made for the other range may put out nothing but zeros.
        first = next(tried)
        return (
            first if first.says_something else next((s for s in tried if s.says_something), first)
        )
    except InputError as e:
        if None not in network.image.shape[1:]:
            raise
        raise InputError(
            e.what, where=e.where, remedy="Give the input size that it was exported for"
        ) from e


def _shown_with(network: Network, size: tuple[int, int], white: float) -> _Shown:
    grey, textured = trial_pictures(network, size, white)
    return _Shown(network, size, network.run(grey), network.run(textured))


def _asked_for(shown: _Shown, layout: str) -> tuple[Reading, str]:
    """Return the reading of the name that the user gave, if the shapes allow it."""
    if layout not in NAMES:
        near = difflib.get_close_matches(layout, NAMES, n=1)
        raise UsageError(
            f"there is no layout '{layout}'",
            remedy=f"Did you mean '{near[0]}'" if near else f"Take one of {', '.join(NAMES)}",
        )
    if what := what_else_it_is(shown.network.outputs, shown.grey):
        raise _refused(shown, what)
    readings = _readings(shown)
    for reading in readings:
        if reading.name == layout:
            against = _objection(reading, shown)
            return reading, f"{layout}, as asked for" + (f", although {against}" if against else "")
    fits = ", ".join(r.name for r in readings) or "none"
    raise UsageError(
        f"the outputs ({shown}) cannot be of the layout '{layout}'",
        where=shown.network.path,
        remedy=f"Layouts that their shapes allow: {fits}",
    )


def _found(shown: _Shown, hints: Hints, count: int | None, *, given: bool) -> tuple[Reading, str]:
    """Return the only reading that is possible."""
    if hints.task in _TASKS:
        raise _refused(shown, f"its metadata say that it is for {_TASKS[hints.task]}")
    if what := what_else_it_is(shown.network.outputs, shown.grey):
        raise _refused(shown, what)
    readings = _readings(shown)
    if any(r.name in GRIDS for r in readings):
        raise _with_grids(shown, readings)
    against = {
        r.name: _objection(r, shown) or (_no_class(r, shown) if count is None else None)
        for r in readings
    }
    standing = [r for r in readings if against[r.name] is None]
    if not standing:
        reasons = "; ".join(f"as '{name}' {why}" for name, why in against.items())
        raise _refused(shown, reasons or "no layout has such a shape", doubtful=bool(reasons))
    fitting = [r for r in standing if count is None or r.class_count in (None, count)]
    if not fitting:
        raise _wrong_count(shown, standing, count or 0, given=given)
    if len(fitting) > 1 and count is None:
        # Nothing speaks for an objectness, and unnamed networks are mostly those of COCO.
        coco = [r for r in fitting if (r.name, r.class_count) == ("v8-last", _COCO_CLASSES)]
        fitting = coco or fitting
    if len(fitting) > 1:
        raise _ambiguous(shown, fitting)
    return fitting[0], f"{fitting[0].name}, since {_main_name(shown)} has {fitting[0].why}"


def _readings(shown: _Shown) -> list[Reading]:
    special = special_readings(shown.grey)
    if special or not any(o.ndim == 3 for o in shown.grey):
        return special
    table = main_table(shown.grey)
    batch = shown.network.image.shape[0] or 1
    return possible_readings(table.shape[1:], shown.size) if len(table) == batch else []


def _objection(reading: Reading, shown: _Shown) -> str | None:
    if reading.name not in _TABLES:
        return None
    grey, textured = (main_table(o)[0].astype(np.float64) for o in (shown.grey, shown.textured))
    return objection(reading, grey, textured, shown.size)


def _no_class(reading: Reading, shown: _Shown) -> str | None:
    """Object to a reading whose number of classes nobody confirms, where one of them is none."""
    if reading.name not in ("v8", "v8-last"):
        return None
    table = main_table(shown.textured)[0].astype(np.float64)
    if not two_classes_at_once(table.T if reading.name == "v8" else table):
        return None
    return "its objects would be of two classes at once: one is an objectness or an angle"


def _main_name(shown: _Shown) -> str:
    at = next((i for i, o in enumerate(shown.grey) if o.ndim == 3), 0)
    return str(replace(shown.network.outputs[at], shape=shown.grey[at].shape))


def _refused(shown: _Shown, what: str, *, doubtful: bool = False) -> InputError:
    return InputError(
        f"this network cannot be read as a detector: {what} (outputs: {shown})",
        where=shown.network.path,
        remedy="Give a network for detection, exported with its boxes decoded"
        + ("; or say the layout, if it is one of these all the same" if doubtful else ""),
    )


def _with_grids(shown: _Shown, readings: list[Reading]) -> InputError:
    names = " or ".join(f"'{r.name}'" for r in readings)
    return InputError(
        f"it puts out raw grids ({shown}), and does not say which anchors they belong to",
        where=shown.network.path,
        remedy=f"Export it with the boxes decoded (YOLOv7: --grid), or say the layout {names} if "
        "it was trained with the anchors that this network was published with",
    )


def _ambiguous(shown: _Shown, readings: list[Reading]) -> InputError:
    listed = " or ".join(f"'{r.name}' with {r.class_count or 'some'} classes" for r in readings)
    return InputError(
        f"its output ({shown}) could be {listed}",
        where=shown.network.path,
        remedy="Say the layout, or give the class names",
    )


def _check_count(shown: _Shown, reading: Reading, count: int | None, *, given: bool) -> None:
    if count is None:
        return
    if reading.class_count not in (None, count):
        raise _wrong_count(shown, [reading], count, given=given)
    if reading.name not in ("end2end", "rt-detr-end2end"):
        return
    seen = max(int(main_table(o)[..., 5].max(initial=-1)) for o in (shown.grey, shown.textured))
    if seen >= count:
        raise _wrong_count(shown, [replace(reading, class_count=seen + 1)], count, given=given)


def _wrong_count(
    shown: _Shown, readings: list[Reading], names: int, *, given: bool
) -> InputError | UsageError:
    listed = " or ".join(f"{r.class_count} classes (as '{r.name}')" for r in readings)
    what = f"the network has {listed}, but "
    if given:
        return UsageError(
            f"{what}{names} class names were given ({shown})",
            where=shown.network.path,
            remedy="Give one name for each class, in their order",
        )
    return InputError(
        f"{what}its metadata name {names} ({shown})",
        where=shown.network.path,
        remedy="It may be a network for rotated boxes, poses or masks; if not, give class names",
    )


def _names(
    reading: Reading, given: tuple[str, ...] | None, hints: Hints
) -> tuple[tuple[str, ...], str]:
    if given is not None:
        return given, f"{len(given)} names were given"
    if hints.class_names is not None:
        return hints.class_names, f"{len(hints.class_names)} names from its metadata"
    problem = f" ({hints.names_problem})" if hints.names_problem else ""
    if reading.class_count == _COCO_CLASSES and not problem:
        return coco_names(), "those of COCO, since there are 80 and the network names none"
    count = reading.class_count or _MOST_CLASSES
    names = tuple(f"class_{k}" for k in range(count))
    return names, f"numbered, since its metadata name none{problem}; give class names"


def _input_format(reading: Reading, shown: _Shown) -> Layout:
    """Return the layout with what networks of its kind were trained on."""
    made = Layout(
        name=reading.name,
        class_names=(),
        input_size=shown.size,
        needs_nms=reading.name not in _WITHOUT_NMS,
    )
    if reading.name == "yolox" or (reading.name == "v5" and _is_decoded_yolox(shown)):
        return replace(made, fit="corner", pixels=_BGR255)
    if reading.name in ("rt-detr", "rt-detr-end2end", "v4"):
        return replace(made, fit="stretch")
    return replace(made, pad=128) if reading.name in ("v3", "v4-grid") else made


def _is_decoded_yolox(shown: _Shown) -> bool:
    """Tell YOLOX from YOLOv6 where both have one decoded box a cell: YOLOv6's objectness is 1."""
    table = main_table(shown.textured)
    unsure = (table[..., 4] > 0) & (table[..., 4] < 1)
    return strides_of(shown.size, table.shape[1]) is not None and bool(unsure.any())


def _pixels_named(name: str) -> PixelFormat:
    if name not in PIXEL_FORMATS:
        raise UsageError(
            f"there is no pixel format '{name}'",
            remedy=f"Take one of {', '.join(PIXEL_FORMATS)}",
        )
    return PIXEL_FORMATS[name]


def _pixels(
    usual: PixelFormat, wanted: PixelFormat | None, network: Network
) -> tuple[PixelFormat, str]:
    takes_bytes = network.image.dtype == "uint8"
    if wanted is not None:
        if takes_bytes and wanted.scale != 1:
            raise UsageError(
                "the network takes bytes, so pixels cannot be scaled to 0..1",
                where=network.path,
                remedy="Take the pixels 'rgb255' or 'bgr255'",
            )
        return wanted, f"{_words(wanted)}, as asked for"
    if takes_bytes:
        taken = replace(usual, scale=1.0)
        return taken, f"{_words(taken)}, since the network takes bytes"
    return usual, f"{_words(usual)}, as networks of this layout do"


def _words(pixels: PixelFormat) -> str:
    return f"{pixels.order.upper()} 0..{'255' if pixels.scale == 1 else '1'}"
