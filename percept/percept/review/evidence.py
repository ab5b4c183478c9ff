"""Evidence pictures, from the run's own folder and nowhere else."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["read_evidence"]

_FOLDER = "evidence"
_PNG = b"\x89PNG\r\n\x1a\n"
_LARGEST_BYTES = 64 * 1024 * 1024


def read_evidence(run: Path, name: str) -> bytes | None:
    """Return a PNG file below `evidence/` of a run.

    A table may come from anybody: a name that leads out of the folder, also through a symbolic
    link, is refused, and so is what is no PNG.

    Args:
        run: The run folder.
        name: Path of the picture relative to the run.

    Returns:
        The file's bytes; None where there is no such picture.
    """
    try:
        home = run.resolve(strict=True) / _FOLDER
        path = (run / name).resolve(strict=True)
        if home not in path.parents or not path.is_file():
            return None
        # It is opened as what it was resolved to, and by no link that was put there since.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
            content = file.read(_LARGEST_BYTES)
    except (OSError, ValueError, RuntimeError):  # no name for a file; links in a circle
        return None
    return content if content.startswith(_PNG) else None
