"""The options of `percept detect` that speak of models."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from percept.cli.detect.request import ModelRequest
from percept.core.errors import UsageError
from percept.detection.models import builtin_model
from percept.detection.schedule import parse_model_argument

__all__ = ["model_file", "model_flags", "model_requests"]

_BUILTIN = "builtin"
_SIZE = re.compile(r"([1-9]\d{0,4})x([1-9]\d{0,4})")


def model_requests(models: Sequence[str], classes: Sequence[str]) -> tuple[ModelRequest, ...]:
    """Read `--model` and `--classes`.

    Raises:
        UsageError: If one cannot be read, or two models have one name.
    """
    requests: dict[str, ModelRequest] = {}
    for text in models:
        name, file, every = parse_model_argument(text)
        if name in requests:
            raise UsageError(f"--model names '{name}' twice")
        requests[name] = ModelRequest(name=name, path=model_file(file), every=every)
    for name, file in by_model(list(requests), "--classes", classes).items():
        requests[name] = replace(requests[name], classes=Path(file))
    return tuple(requests.values())


def model_flags(
    names: Sequence[str],
    *,
    layout: Sequence[str] = (),
    pixels: Sequence[str] = (),
    input_size: Sequence[str] = (),
    tiles: Sequence[str] = (),
    score: float | None = None,
    iou: float | None = None,
    others: Mapping[str, object] | None = None,
) -> dict[str, dict[str, Any]]:
    """Return what the options say of each model's `YoloConfig`.

    Args:
        names: All models.
        layout: `--layout`; like those below `NAME=VALUE`, or a value for all models.
        pixels: `--pixels`.
        input_size: `--input-size`.
        tiles: `--tiles`.
        score: `--score`, for all models.
        iou: `--iou`, for all models.
        others: Options by name that only make sense with models; None and False are not given.

    Raises:
        UsageError: If an entry names no model or is no size, or there are no models.
    """
    shared = {"score": score, "iou": iou}
    given = {"--score": score, "--iou": iou, **(others or {})}
    for flag, value in () if names else given.items():
        if value is not None and value is not False:
            raise UsageError(f"{flag} is for --model, which is not given")
    flags: dict[str, dict[str, Any]] = {name: dict(shared) for name in names}
    for key, flag, entries in (
        ("layout", "--layout", layout),
        ("pixels", "--pixels", pixels),
        ("input_size", "--input-size", input_size),
        ("tiles", "--tiles", tiles),
    ):
        for name, value in by_model(names, flag, entries).items():
            flags[name][key] = value if key in ("layout", "pixels") else _size(value, flag)
    return flags


def by_model(names: Sequence[str], flag: str, entries: Sequence[str]) -> dict[str, str]:
    """Return the value of each model: `NAME=VALUE` for one, a bare value for all others.

    Raises:
        UsageError: If an entry names no model, one is named twice, or there are no models.
    """
    if entries and not names:
        raise UsageError(f"{flag} is for --model, which is not given")
    named: dict[str, str] = {}
    for_all: list[str] = []
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals:
            for_all.append(entry)
            continue
        if name not in names or not value:
            raise UsageError(
                f"{flag} '{entry}' names no model",
                remedy=f"Models are {', '.join(names)}; give NAME=VALUE, or a value for all",
            )
        if name in named:
            raise UsageError(f"{flag} names '{name}' twice")
        named[name] = value
    if len(for_all) > 1:
        raise UsageError(f"{flag} is given for all models twice", remedy="Give NAME=VALUE")
    return {**dict.fromkeys(names, *for_all), **named} if for_all else named


def _size(text: str, flag: str) -> tuple[int, int]:
    found = _SIZE.fullmatch(text)
    if found is None:
        raise UsageError(f"{flag} '{text}' is not of the form 640x384")
    return int(found[1]), int(found[2])


def model_file(text: str) -> Path:
    """Return the ONNX file that an argument names: the word `builtin` is the one that ships."""
    return builtin_model() if text == _BUILTIN else Path(text)
