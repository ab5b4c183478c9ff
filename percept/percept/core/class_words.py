"""Words of detectors and data sets for classes: which mean the same, and which are of one kind.

Two networks may say `person` and `pedestrian` of the same thing; one that says `bus` may mean
what another, coarser one says `truck` of. What a class is called decides, and never its number:
networks count their classes in whatever order.
"""

from __future__ import annotations

__all__ = ["common_word", "kind_of_word", "plain_word"]

_SAME = {
    "person": "pedestrian", "people": "pedestrian", "walker": "pedestrian",
    "bicyclist": "cyclist", "motorbike": "motorcycle", "regular_vehicle": "car",
    "traffic_cone": "cone", "construction_cone": "cone", "construction_barrel": "barrel",
    "traffic_barrel": "barrel", "traffic_sign": "sign",
}  # fmt: skip
_KINDS = {
    "person_sitting": "pedestrian", "stroller": "pedestrian", "wheelchair": "pedestrian",
    "bicycle": "cyclist", "motorcycle": "cyclist", "rider": "cyclist",
    "motorcyclist": "cyclist", "wheeled_rider": "cyclist",
    "van": "car", "vehicle": "car", "suv": "car", "pickup": "car",
    "bus": "truck", "box_truck": "truck", "large_vehicle": "truck", "truck_cab": "truck",
    "trailer": "truck", "vehicular_trailer": "truck", "school_bus": "truck",
    "articulated_bus": "truck", "construction_vehicle": "truck", "tram": "truck",
    "barrier": "barricade", "stop_sign": "sign", "animal": "deer", "misc": "unknown",
}  # fmt: skip


def plain_word(word: str) -> str:
    """Return a word in lower case, with underscores for blanks and hyphens."""
    return word.strip().lower().replace(" ", "_").replace("-", "_")


def common_word(word: str) -> str:
    """Return the word that stands for all that mean the same: `pedestrian` for `Person`."""
    plain = plain_word(word)
    return _SAME.get(plain, plain)


def kind_of_word(word: str) -> str:
    """Return the kind of object that a word stands for: `truck` for `Bus`; itself if it has none.

    The kinds are the classes that tracks have by default.
    """
    common = common_word(word)
    return _KINDS.get(common, common)
