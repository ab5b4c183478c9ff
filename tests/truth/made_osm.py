"""Small Lanelet2 files, written element by element."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

__all__ = ["lanelet", "node", "relation", "way", "write_osm"]


def node(identity: int, x: float, y: float, z: float = 0.0, **tags: str) -> str:
    """Return a point by local coordinates, without latitude and longitude."""
    own = {"local_x": repr(x), "local_y": repr(y), "ele": repr(z), **tags}
    return f'<node id="{identity}" lat="" lon="">{_tags(own)}</node>'


def way(identity: int, nodes: Sequence[int], **tags: str) -> str:
    """Return a line string."""
    refs = "".join(f'<nd ref="{ref}"/>' for ref in nodes)
    return f'<way id="{identity}">{refs}{_tags(tags)}</way>'


def relation(identity: int, members: Sequence[tuple[str, str, int]], **tags: str) -> str:
    """Return a relation of members by kind, role and id."""
    listed = "".join(f'<member type="{k}" role="{r}" ref="{i}"/>' for k, r, i in members)
    return f'<relation id="{identity}">{listed}{_tags(tags)}</relation>'


def lanelet(identity: int, left: Sequence[int], right: Sequence[int], **tags: str) -> str:
    """Return a lanelet of line strings; a road unless a subtype is given."""
    members = [("way", "left", i) for i in left] + [("way", "right", i) for i in right]
    return relation(identity, members, **{"type": "lanelet", "subtype": "road", **tags})


def write_osm(path: Path, *elements: str) -> Path:
    """Write a file of elements."""
    path.write_text(f"<?xml version='1.0'?>\n<osm>{''.join(elements)}</osm>", encoding="utf-8")
    return path


def _tags(tags: dict[str, str]) -> str:
    return "".join(
        f'<tag k="{key.replace("__", ":")}" v={quoteattr(value)}/>' for key, value in tags.items()
    )
