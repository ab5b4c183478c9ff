"""Markdown of texts that come with a log, which may hold anything."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

__all__ = ["bullets", "markdown_table", "marked", "plain"]


def bullets(texts: Iterable[str]) -> Iterator[str]:
    """Return the lines of a list."""
    return (f"- {marked(text)}" for text in texts)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table."""
    yield _row(header)
    yield _row(["---"] * len(header))
    for row in rows:
        yield _row([marked(cell) for cell in row])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def marked(text: str) -> str:
    """Return a text on one line in which only pairs of backticks mean something: they hold code."""
    pieces = " ".join(text.split()).split("`")
    if len(pieces) % 2 == 0:
        return plain(text)
    for place, piece in enumerate(pieces):
        # Within code only the mark between columns has to be escaped.
        pieces[place] = piece.replace("|", "\\|") if place % 2 else _escaped(piece)
    return "`".join(pieces)


def plain(text: str) -> str:
    """Return a text that means nothing else in Markdown, on one line."""
    return _escaped(" ".join(text.split()))


def _escaped(text: str) -> str:
    for mark in "\\<>|*_[]#`":
        text = text.replace(mark, f"\\{mark}")
    return text
