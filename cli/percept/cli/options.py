"""Options that several commands share, so that they read and behave the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percept.core.errors import UsageError

__all__ = [
    "BagOption",
    "ConfigOption",
    "EndOption",
    "ForceOption",
    "JsonOption",
    "OutOption",
    "StartOption",
    "named_values",
]

BagOption = Annotated[
    list[Path],
    typer.Option(
        "--bag",
        help="The log: a ROS 1 .bag, a ROS 2 folder, a bare .db3 or .mcap, or a folder of "
        "scans. Repeat it for several logs of one drive.",
        show_default=False,
    ),
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="YAML file with settings; flags win over it.")
]
EndOption = Annotated[
    float | None, typer.Option("--end", help="Stop this many seconds after the log's start.")
]
ForceOption = Annotated[
    bool, typer.Option("--force", help="Write into --out although it is not empty.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else there.")
]
OutOption = Annotated[
    Path, typer.Option("--out", help="Run folder; new or empty.", show_default=False)
]
StartOption = Annotated[
    float | None, typer.Option("--start", help="Begin this many seconds after the log's start.")
]


def named_values(entries: list[str], flag: str) -> dict[str, str]:
    """Split repeated `NAME=VALUE` options.

    Raises:
        UsageError: If an entry has no name or a name comes twice.
    """
    values: dict[str, str] = {}
    for entry in entries:
        name, equals, value = entry.partition("=")
        if not equals or not name or not value:
            raise UsageError(f"{flag} '{entry}' is not of the form NAME=VALUE")
        if name in values:
            raise UsageError(f"{flag} names '{name}' twice")
        values[name] = value
    return values
