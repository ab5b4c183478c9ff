"""Regulatory elements of a map, from its relations."""

from __future__ import annotations

from collections.abc import Mapping

from percept.hdmap.elements import RegulatoryElement
from percept.hdmap.osm import OsmRelation

__all__ = ["map_rules"]


def map_rules(relations: Mapping[int, OsmRelation]) -> dict[int, RegulatoryElement]:
    """Return the regulatory elements of a map by id.

    Args:
        relations: Regulatory elements, among others.
    """
    return {
        identity: RegulatoryElement(
            rule_id=identity,
            subtype=relation.tags.get("subtype", ""),
            tags=relation.tags,
            members=relation.members,
        )
        for identity, relation in relations.items()
        if relation.tags.get("type") == "regulatory_element"
    }
