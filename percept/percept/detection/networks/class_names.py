"""Names of classes: the 80 of COCO, or from a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from percept.core.errors import InputError

__all__ = ["as_class_names", "coco_names", "read_class_names"]

_MAX_BYTES = 1 << 20
_MAX_NAMES = 10_000
_MAX_LENGTH = 100
_REMEDY = "Give a text file with one name a line, or YAML with 'names:'"

_COCO = """\
person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant,
stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe,
backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite,
baseball bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork,
knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake,
chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard,
cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""


def coco_names() -> tuple[str, ...]:
    """Return the 80 classes of COCO, in the order in which detectors number them."""
    return tuple(_COCO.replace("\n", " ").split(", "))


def read_class_names(path: Path) -> tuple[str, ...]:
    """Read class names by number.

    Args:
        path: Text with one name a line, or YAML (`.yaml`, `.yml`) with `names:`, a list or a
            mapping from number to name, as training data sets of YOLO have it.

    Raises:
        InputError: If the file cannot be read, names no class, or one twice.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError("too large for class names", where=path, remedy=_REMEDY)
        text = path.read_text(encoding="utf-8-sig")
    except OSError as e:
        raise InputError(f"cannot be read ({e.strerror})", where=path, remedy=_REMEDY) from e
    except UnicodeDecodeError as e:
        raise InputError("this is no text", where=path, remedy=_REMEDY) from e
    if path.suffix.lower() in (".yaml", ".yml"):
        return as_class_names(_yaml_names(text, path), path)
    return as_class_names(text.rstrip().splitlines(), path)


def _yaml_names(text: str, path: Path) -> object:
    import yaml

    try:
        # This loader makes nothing but text: a lamp state `off` is a name, not a truth value.
        # libyaml's is faster, and crashes on deep nesting.
        content: Any = yaml.load(text, yaml.BaseLoader)  # noqa: S506 - safer than the safe one
    except yaml.YAMLError as e:
        raise InputError("this is no YAML", where=path, remedy=_REMEDY) from e
    except RecursionError as e:
        raise InputError("its YAML is nested too deeply", where=path, remedy=_REMEDY) from e
    if not isinstance(content, dict) or "names" not in content:
        raise InputError("it has no 'names'", where=path, remedy=_REMEDY)
    return content["names"]


def as_class_names(names: object, where: object) -> tuple[str, ...]:
    """Check names that come from elsewhere.

    Args:
        names: A list, or a mapping whose keys are the numbers from 0 on.
        where: What they come from, for the error.

    Raises:
        InputError: If they are neither, or a name is empty, twice there or no plain text.
    """
    if isinstance(names, dict):
        by_number = {str(number): name for number, name in names.items()}
        if by_number.keys() != {str(k) for k in range(len(names))}:
            raise InputError(
                f"class numbers must run from 0 to {len(names) - 1} without a gap", where=where
            )
        names = [by_number[str(k)] for k in range(len(names))]
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError("class names must be a list", where=where, remedy=_REMEDY)
    listed = [str(n).strip() if isinstance(n, str | int) else "" for n in names]
    if not 0 < len(listed) <= _MAX_NAMES:
        raise InputError(f"{len(listed)} class names", where=where, remedy=_REMEDY)
    for number, name in enumerate(listed):
        if not name or len(name) > _MAX_LENGTH or not name.isprintable():
            raise InputError(
                f"the name of class {number} is empty or no plain text",
                where=where,
                remedy=_REMEDY,
            )
    name, times = Counter(listed).most_common(1)[0]
    if times > 1:
        raise InputError(f"the class name '{name}' is there {times} times", where=where)
    return tuple(listed)
