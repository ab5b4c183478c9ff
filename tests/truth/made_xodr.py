"""Small OpenDRIVE files, written road by road."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = ["geometry", "lane", "mark", "road", "write_xodr"]


def geometry(
    shape: str, *, s: float = 0.0, x: float = 0.0, y: float = 0.0, hdg: float = 0.0, length: float
) -> str:
    """Return a piece of a reference line with its shape, such as `<line/>`."""
    return (
        f'<geometry s="{s!r}" x="{x!r}" y="{y!r}" hdg="{hdg!r}" length="{length!r}">'
        f"{shape}</geometry>"
    )


def mark(kind: str = "solid", colour: str = "white", start: float = 0.0, **more: object) -> str:
    """Return a road mark."""
    said = "".join(f' {name}="{value}"' for name, value in more.items())
    return f'<roadMark sOffset="{start}" type="{kind}" color="{colour}"{said}/>'


def lane(identity: int, *inside: str, width: Sequence[float] = (3.5, 0.0, 0.0, 0.0)) -> str:
    """Return a lane; that of the middle has no width."""
    said = " ".join(f'{name}="{value!r}"' for name, value in zip("abcd", width, strict=True))
    wide = f'<width sOffset="0" {said}/>'
    return (
        f'<lane id="{identity}" type="driving">{wide if identity else ""}{"".join(inside)}</lane>'
    )


def road(
    pieces: Sequence[str],
    lanes: Sequence[tuple[int, str]] = (),
    *,
    length: float,
    identity: str = "1",
    profiles: str = "",
    offset: str = "",
    sections: Sequence[str] = (),
) -> str:
    """Return a road of one section of lanes (id and text), or of sections as they are given."""
    sides = (("left", 1), ("center", 0), ("right", -1))
    inside = "".join(
        f"<{name}>{''.join(text for k, text in lanes if (k > 0) - (k < 0) == sign)}</{name}>"
        for name, sign in sides
    )
    section = "".join(sections) or f'<laneSection s="0">{inside}</laneSection>'
    return (
        f'<road id="{identity}" length="{length!r}" junction="-1"><planView>{"".join(pieces)}'
        f"</planView>{profiles}<lanes>{offset}{section}</lanes></road>"
    )


def write_xodr(path: Path, *roads: str, header: str = "") -> Path:
    """Write a file of roads."""
    text = f"<OpenDRIVE><header revMajor='1' revMinor='7'>{header}</header>{''.join(roads)}"
    path.write_text(f"<?xml version='1.0'?>\n{text}</OpenDRIVE>", encoding="utf-8")
    return path
