"""`percept map review` as a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

COMMAND = (sys.executable, "-m", "percept.cli", "map", "review")


@contextmanager
def review_server(run: Path, *options: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start the command, and yield the address that it prints first."""
    process = subprocess.Popen(
        [*COMMAND, str(run), "--no-browser", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip(), process
    finally:
        process.kill()
        process.communicate()
