"""OSM XML written: a layer of new features, and a change of ways that are there.

Both open in JOSM. The layer is for looking and drawing by hand and is never uploaded; the change
(OsmChange, osmium's and JOSM's `.osc`) is applied as it stands.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as Xml

from percept.hdmap.osm import OsmWay

__all__ = ["LayerFeature", "write_osm_change", "write_osm_layer"]

_LONGEST_VALUE = 255  # what OSM allows a tag's value
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_VERSION = "1"  # Lanelet2 files are no database: all elements have their first version


@dataclass(frozen=True, slots=True)
class LayerFeature:
    """A new feature: K pairs of degrees north and east, a node if there is one, and its tags."""

    places_deg: tuple[tuple[float, float], ...]
    tags: Mapping[str, str]


def write_osm_layer(path: Path, features: Sequence[LayerFeature]) -> None:
    """Write features as new nodes and ways, with negative ids, of a layer that is not uploaded.

    Args:
        path: An `.osm` file.
        features: Each with at least one place.
    """
    root = Xml.Element("osm", version="0.6", generator="percept", upload="never")
    lines: list[tuple[LayerFeature, list[int]]] = []
    made = 0
    for feature in features:
        single = len(feature.places_deg) == 1
        refs = []
        for latitude, longitude in feature.places_deg:
            made -= 1
            node = Xml.SubElement(root, "node", id=str(made), visible="true")
            node.set("lat", f"{latitude:.9f}")
            node.set("lon", f"{longitude:.9f}")
            refs.append(made)
            if single:
                _add_tags(node, feature.tags)
        if not single:
            lines.append((feature, refs))
    for number, (feature, refs) in enumerate(lines, start=1):
        way = Xml.SubElement(root, "way", id=str(made - number), visible="true")
        _add_refs(way, refs)
        _add_tags(way, feature.tags)
    _write(path, root)


def write_osm_change(path: Path, ways: Mapping[int, OsmWay]) -> None:
    """Write ways as they shall be, as an OsmChange that modifies them.

    Args:
        path: An `.osc` file.
        ways: By id, all nodes and all tags of each.
    """
    root = Xml.Element("osmChange", version="0.6", generator="percept")
    if ways:
        modify = Xml.SubElement(root, "modify")
        for identity, way in sorted(ways.items()):
            changed = Xml.SubElement(modify, "way", id=str(identity), version=_VERSION)
            _add_refs(changed, way.nodes)
            _add_tags(changed, way.tags)
    _write(path, root)


def _add_refs(way: Xml.Element, refs: Sequence[int]) -> None:
    for ref in refs:
        Xml.SubElement(way, "nd", ref=str(ref))


def _add_tags(element: Xml.Element, tags: Mapping[str, str]) -> None:
    for key, value in tags.items():
        text = _NO_XML.sub("\ufffd", value)[:_LONGEST_VALUE]
        Xml.SubElement(element, "tag", k=_NO_XML.sub("\ufffd", key), v=text)


def _write(path: Path, root: Xml.Element) -> None:
    Xml.indent(root)
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
