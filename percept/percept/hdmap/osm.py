"""OSM XML as Lanelet2 maps are written in: nodes, ways and relations, and nothing else of XML.

Elements that an editor has marked as deleted (``action="delete"``) are not there. Documents
with a document type are refused, so that no entity is ever resolved, and nothing is fetched. The
parser builds no tree: memory holds what a map has, not what a file says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from percept.core.errors import InputError

__all__ = ["OsmFile", "OsmMember", "OsmNode", "OsmRelation", "OsmWay", "read_osm"]

_LARGEST_FILE_BYTES = 512 * 1024 * 1024
_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class OsmNode:
    """A point: degrees where it has them, and its tags."""

    latitude_deg: float
    longitude_deg: float
    tags: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class OsmWay:
    """Points in order, by their ids, and tags."""

    nodes: tuple[int, ...]
    tags: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class OsmMember:
    """A member of a relation: `node`, `way` or `relation`, its role, and its id."""

    kind: str
    role: str
    ref: int


@dataclass(frozen=True, slots=True)
class OsmRelation:
    """Members in order, and tags."""

    members: tuple[OsmMember, ...]
    tags: Mapping[str, str]


@dataclass(slots=True)
class OsmFile:
    """What stands in a file.

    Attributes:
        nodes: Points by id; NaN where latitude and longitude are not given.
        ways: Line strings and polygons by id.
        relations: Lanelets, areas and rules by id.
        meta: Attributes of the `MetaInfo` element; empty where there is none.
    """

    nodes: dict[int, OsmNode] = field(default_factory=dict)
    ways: dict[int, OsmWay] = field(default_factory=dict)
    relations: dict[int, OsmRelation] = field(default_factory=dict)
    meta: dict[str, str] = field(default_factory=dict)


def read_osm(path: Path) -> OsmFile:
    """Read a file in one pass, without holding its text.

    Raises:
        InputError: If the file cannot be read, is larger than 512 MiB, is no OSM XML, has a
            document type, or an element lacks what it needs; the element and line are named.
    """
    target = _Target(path)
    parser = etree.XMLParser(
        target=target,
        resolve_entities=False,
        load_dtd=False,
        no_network=True,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        _feed(path, parser)
        parser.close()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    except etree.XMLSyntaxError as error:
        raise InputError(f"is no XML ({_one_line(error)})", where=path) from error
    return target.file


def _feed(path: Path, parser: etree.XMLParser) -> None:
    size = path.stat().st_size
    if size > _LARGEST_FILE_BYTES:
        raise InputError(
            f"has {size / 2**20:.0f} MiB; maps may have {_LARGEST_FILE_BYTES >> 20}", where=path
        )
    if not size:
        raise InputError("is empty", where=path)
    with path.open("rb") as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            parser.feed(chunk)


def _one_line(error: etree.XMLSyntaxError) -> str:
    return " ".join(str(error).split())


class _Target:
    """Takes the parser's events and fills an `OsmFile`; holds one element at a time."""

    def __init__(self, path: Path) -> None:
        self.file = OsmFile()
        self._path = path
        self._depth = 0
        self._open: str | None = None
        self._attributes: dict[str, str] = {}
        self._tags: dict[str, str] = {}
        self._nodes: list[int] = []
        self._members: list[OsmMember] = []

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse the document: a map needs no document type, an attack does."""
        del name, public, system
        raise InputError("has a document type, which maps do not have", where=self._path)

    def start(self, tag: str | bytes, attrib: Mapping[str | bytes, str | bytes]) -> None:
        """Begin an element; the root has to be `osm`."""
        tag, attributes = str(tag), {str(key): str(value) for key, value in attrib.items()}
        self._depth += 1
        if self._depth == 1 and tag != "osm":
            raise InputError(f"is no OSM file; its root is <{tag}>", where=self._path)
        if self._depth == 2:
            self._open = tag
            self._attributes = attributes
            self._tags, self._nodes, self._members = {}, [], []
        elif self._depth == 3:
            self._add_part(tag, attributes)

    def end(self, tag: str | bytes) -> None:
        """End an element, and keep it unless it is deleted."""
        self._depth -= 1
        if self._depth == 1:
            if self._attributes.get("action") != "delete":
                self._keep(str(tag))
            self._open = None

    def data(self, data: str | bytes) -> None:
        """Take no notice of text between elements."""

    def comment(self, text: str | bytes) -> None:
        """Take no notice of comments."""

    def close(self) -> None:
        """End the document."""

    def _add_part(self, tag: str, attributes: Mapping[str, str]) -> None:
        if tag == "tag":
            self._tags[attributes.get("k", "")] = attributes.get("v", "")
        elif tag == "nd":
            self._nodes.append(self._integer(attributes, "ref"))
        elif tag == "member":
            kind, role = attributes.get("type", ""), attributes.get("role", "")
            self._members.append(OsmMember(kind, role, self._integer(attributes, "ref")))

    def _keep(self, tag: str) -> None:
        if tag == "MetaInfo":
            self.file.meta = self._attributes
        elif tag == "node":
            latitude, longitude = self._degrees("lat", 90.0), self._degrees("lon", 180.0)
            node = OsmNode(latitude, longitude, self._tags)
            self.file.nodes[self._new_id(self.file.nodes)] = node
        elif tag == "way":
            way = OsmWay(tuple(self._nodes), self._tags)
            self.file.ways[self._new_id(self.file.ways)] = way
        elif tag == "relation":
            relation = OsmRelation(tuple(self._members), self._tags)
            self.file.relations[self._new_id(self.file.relations)] = relation

    def _new_id(self, taken: Mapping[int, object]) -> int:
        identity = self._integer(self._attributes, "id")
        if identity in taken:
            raise InputError(f"{self._open} {identity} stands in it twice", where=self._path)
        return identity

    def _integer(self, attributes: Mapping[str, str], name: str) -> int:
        text = attributes.get(name, "")
        try:
            number = int(text)
        except ValueError:
            number = 2**63
        if not -(2**63) <= number < 2**63:
            raise InputError(f"{self._place()}: {name}='{text[:40]}' is no id", where=self._path)
        return number

    def _degrees(self, name: str, largest: float) -> float:
        """Return an angle of the open node; NaN where it is not given or empty."""
        text = self._attributes.get(name, "")
        if not text:
            return math.nan
        try:
            degrees = float(text)
        except ValueError:
            degrees = math.inf
        if not abs(degrees) <= largest:
            raise InputError(
                f"{self._place()}: {name}='{text[:40]}' is no angle in degrees", where=self._path
            )
        return degrees

    def _place(self) -> str:
        return f"{self._open} {self._attributes.get('id', 'without an id')[:40]}"
