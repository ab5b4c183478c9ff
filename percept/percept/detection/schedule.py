"""Several networks, each at its own rate: which of them looks at which image."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from percept.core.errors import UsageError

__all__ = ["ModelSchedule", "parse_model_argument"]

_FORM = re.compile(r"(?P<name>[^=]+)=(?P<path>(?!@every=).+?)(?:@every=(?P<every>.*))?")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True, slots=True)
class ModelSchedule:
    """Whose turn it is.

    The images of each camera are counted for themselves, from the first of the log window, so
    that every camera gets its share of a slow network, and a resumed run goes on in step.

    Attributes:
        every: By name of a model N: it looks at every Nth image of each camera.
    """

    every: Mapping[str, int]

    def models_at(self, number: int) -> tuple[str, ...]:
        """Return the models that look at image `number`, from 0, of a camera, in fixed order."""
        return tuple(name for name, every in self.every.items() if number % every == 0)


def parse_model_argument(text: str) -> tuple[str, str, int]:
    """Read `NAME=FILE` or `NAME=FILE@every=N`.

    Returns:
        The name, the file as it was given, and N, 1 where it is not given.

    Raises:
        UsageError: If it is of another form, or N is no whole number from 1.
    """
    found = _FORM.fullmatch(text)
    if found is None or _NAME.fullmatch(found["name"]) is None:
        raise UsageError(
            f"--model '{text}' is not of the form NAME=FILE.onnx or NAME=FILE.onnx@every=N",
            remedy="A name has letters, digits, '_', '-' and '.', such as near=small.onnx@every=2",
        )
    every = "1" if found["every"] is None else found["every"]
    if not (every.isascii() and every.isdigit() and int(every) > 0):
        raise UsageError(
            f"--model '{text}' says every={every}, which is no whole number from 1",
            remedy="1 is every image, 5 every fifth of each camera",
        )
    return found["name"], found["path"], int(every)
