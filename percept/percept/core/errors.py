"""Every error that percept raises on purpose, and the exit code that each one ends with.

::

    PerceptError
    ├── UsageError              2  a flag, a setting or an output folder is wrong
    │   └── ConfigError         2  a configuration or rig file says something it may not
    ├── InputError              3  the data cannot be used
    │   ├── RecordingError      3  a log cannot be opened or read
    │   ├── TopicNotFoundError  3  the log has no such topic
    │   ├── DecodeError         3  one message cannot be decoded
    │   └── GeometryError       3  shapes, frames or heights that cannot be right
    ├── InsufficientDataError   4  the run came to an end, but there is too little to judge
    └── DependencyError         5  a part that is needed is not installed

A message says what is wrong, where, and what to do about it. The command line turns
a `PerceptError` into one line; everything else is a bug and keeps its traceback.
"""

from __future__ import annotations

__all__ = [
    "ConfigError",
    "DecodeError",
    "DependencyError",
    "GeometryError",
    "InputError",
    "InsufficientDataError",
    "PerceptError",
    "RecordingError",
    "TopicNotFoundError",
    "UsageError",
]


class PerceptError(Exception):
    """Base of all expected errors.

    Args:
        what: What is wrong, as a clause without a final full stop.
        where: The file, topic or setting that it is about.
        remedy: What the user can do, as a sentence without a final full stop.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: object = None, remedy: str | None = None) -> None:
        self.what = what
        self.where = None if where is None else str(where)
        self.remedy = remedy
        text = what if self.where is None else f"{self.where}: {what}"
        super().__init__(text if remedy is None else f"{text}. {remedy}.")


class UsageError(PerceptError):
    """A flag, a setting or an output folder is wrong."""

    exit_code = 2


class ConfigError(UsageError):
    """A configuration or rig file says something that it may not."""


class InputError(PerceptError):
    """The data that was given cannot be used."""

    exit_code = 3


class RecordingError(InputError):
    """A log cannot be opened or read."""


class TopicNotFoundError(InputError):
    """The log has no such topic."""


class DecodeError(InputError):
    """One message or file cannot be decoded."""


class GeometryError(InputError):
    """Shapes, frames or heights that cannot be right."""


class InsufficientDataError(PerceptError):
    """There is too little data to come to a result that could be judged."""

    exit_code = 4


class DependencyError(PerceptError):
    """A part that is needed is not installed."""

    exit_code = 5
