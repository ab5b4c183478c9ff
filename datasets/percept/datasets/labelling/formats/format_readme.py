"""The README of an export: how the tool opens it, and what is lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = ["write_readme"]


def write_readme(folder: Path, title: str, opening: Sequence[str], losses: Sequence[str]) -> None:
    """Write `README.md` into the folder of an export.

    Args:
        folder: The folder.
        title: Name of the format.
        opening: Lines of Markdown: where things are and how to open them.
        losses: What the format cannot hold, as sentences.
    """
    lost = [f"- {loss}" for loss in losses] or ["- Nothing."]
    lines = [f"# {title}", "", *opening, "", "## What is lost", *lost]
    (folder / "README.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
