"""Runs the independent readers of exports in their own environment."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

__all__ = ["read_with"]

_ROOT = Path(__file__).resolve().parents[2]
_PROGRAMS = _ROOT / "tests" / "oracles"
_ENVIRONMENT = _ROOT / ".oracles"
_SECONDS = 300


def read_with(program: str, *arguments: object) -> Any:
    """Return what a program of `tests/oracles` prints.

    Without its environment, or with that of other releases, the test fails: a format that nobody
    else has read is not known to be right.
    """
    wanted = (_PROGRAMS / "readers.txt").read_text("utf-8")
    made = _ENVIRONMENT / "readers.txt"
    if not made.is_file() or made.read_text("utf-8") != wanted:
        pytest.fail("the independent readers are not installed as pinned; run scripts/oracles")
    python = _ENVIRONMENT / "bin" / "python"
    command = [str(python), "-I", str(_PROGRAMS / program), *map(str, arguments)]
    done = subprocess.run(
        command,
        capture_output=True,
        check=False,
        encoding="utf-8",
        env={**os.environ, "MPLBACKEND": "Agg"},
        timeout=_SECONDS,
    )
    if done.returncode:
        pytest.fail(f"{program} cannot read the export:\n{done.stderr}")
    return json.loads(done.stdout)
