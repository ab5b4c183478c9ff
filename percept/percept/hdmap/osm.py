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
from typing import Any, NamedTuple, cast

from lxml import etree

from percept.core.errors import InputError
from percept.hdmap.elements import Member

__all__ = ["OsmFile", "OsmNode", "OsmRelation", "OsmWay", "parse_file", "read_osm"]

_LARGEST_FILE_BYTES = 512 * 1024 * 1024
_CHUNK_BYTES = 1 << 20


class OsmNode(NamedTuple):
    """A point: degrees where it has them, and its tags."""

    latitude_deg: float
    longitude_deg: float
    tags: Mapping[str, str]


class OsmWay(NamedTuple):
    """Points in order, by their ids, and tags."""

    nodes: tuple[int, ...]
    tags: Mapping[str, str]


class OsmRelation(NamedTuple):
    """Members in order, and tags."""

    members: tuple[Member, ...]
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
    parse_file(path, target)
    return target.file


def parse_file(path: Path, target: object) -> None:
    """Give the events of an XML file to a target of lxml, which has to refuse document types.

    Raises:
        InputError: If the file cannot be read, is larger than 512 MiB, or is no XML.
    """
    parser = etree.XMLParser(
        # Its stubs ask for handlers of texts and comments, of which there are as many as elements.
        target=cast("Any", target),
        # With False `&amp;` stays `&#38;` in values; a document has no entities of its own, since
        # one with a document type is refused.
        resolve_entities=cast("Any", "internal"),
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
    # Its text is this with the place once more.
    return " ".join((error.msg or "it ends early").split())


class _Target:
    """Takes the parser's events and fills an `OsmFile`; holds one element at a time."""

    def __init__(self, path: Path) -> None:
        self.file = OsmFile()
        self._path = path
        self._depth = 0
        self._tag = ""
        self._attributes: Mapping[str, str] = {}
        self._tags: dict[str, str] = {}
        self._nodes: list[int] = []
        self._members: list[Member] = []
        self._keep = {
            "node": self._keep_node,
            "way": self._keep_way,
            "relation": self._keep_relation,
            "MetaInfo": self._keep_meta,
        }

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse the document: a map needs no document type, an attack does."""
        del name, public, system
        raise InputError("has a document type, which maps do not have", where=self._path)

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Begin an element; the root has to be `osm`."""
        self._depth += 1
        if self._depth == 3:
            if tag == "tag":
                self._tags[attributes.get("k", "")] = attributes.get("v", "")
            elif tag == "nd":
                self._nodes.append(self._integer(attributes, "ref"))
            elif tag == "member":
                self._members.append(self._member(attributes))
        elif self._depth == 2:
            self._tag, self._attributes = tag, attributes
            self._tags, self._nodes, self._members = {}, [], []
        elif self._depth == 1 and tag != "osm":
            raise InputError(f"is no OSM file; its root is <{tag}>", where=self._path)

    def end(self, tag: str) -> None:
        """End an element, and keep it unless it is deleted."""
        self._depth -= 1
        if self._depth == 1 and tag in self._keep and self._attributes.get("action") != "delete":
            self._keep[tag]()

    def close(self) -> None:
        """End the document."""

    def _member(self, attributes: Mapping[str, str]) -> Member:
        kind, role = attributes.get("type", ""), attributes.get("role", "")
        return Member(kind, role, self._integer(attributes, "ref"))

    def _keep_node(self) -> None:
        latitude, longitude = self._degrees("lat", 90.0), self._degrees("lon", 180.0)
        self.file.nodes[self._new_id(self.file.nodes)] = OsmNode(latitude, longitude, self._tags)

    def _keep_way(self) -> None:
        self.file.ways[self._new_id(self.file.ways)] = OsmWay(tuple(self._nodes), self._tags)

    def _keep_relation(self) -> None:
        relation = OsmRelation(tuple(self._members), self._tags)
        self.file.relations[self._new_id(self.file.relations)] = relation

    def _keep_meta(self) -> None:
        self.file.meta = dict(self._attributes)

    def _new_id(self, taken: Mapping[int, object]) -> int:
        identity = self._integer(self._attributes, "id")
        if identity in taken:
            raise InputError(f"{self._tag} {identity} stands in it twice", where=self._path)
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
        return f"{self._tag} {self._attributes.get('id', 'without an id')[:40]}"
