"""What the splits of a data set share that they must not."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from percept.core.errors import PerceptError
from percept.datasets.labelling.check.inspection import Inspection, ListedImage, Part
from percept.datasets.labelling.choice.duplicates import DuplicateConfig, DuplicateFinder
from percept.datasets.labelling.places.distances import nearest_across
from percept.datasets.labels.boxes import as_number

__all__ = [
    "check_alike",
    "check_empty_splits",
    "check_places",
    "check_same_bytes",
    "check_split_names",
]

_CARD = "README.md"
_STATED = re.compile(r"least distance between splits that was asked for: ([0-9.eE+]+) m")
_LONGEST_CARD = 1 << 24
_ROUNDING_M = 1e-3
_GUARD = 0.8
"""Prepared images were held to each other before they were encoded anew and blurred. So two count
as alike here only if they are it clearly: an untouched data set is then not accused."""


def check_places(inspection: Inspection, frames: Sequence[Mapping[str, Any]]) -> None:
    """Report images of one split that are nearer to those of another than the stated margin.

    Args:
        inspection: Where to tell.
        frames: Rows of `frames.parquet`.
    """
    latitudes = [_number(row["latitude"]) for row in frames]
    longitudes = [_number(row["longitude"]) for row in frames]
    across = nearest_across(latitudes, longitudes, [row["split"] for row in frames])
    margin_m = _stated_margin(inspection)
    unknown = int(np.sum(~np.isfinite(np.add(latitudes, longitudes))))
    if unknown:
        inspection.add("margin-unknown", "frames.parquet", f"{unknown} images have no place")
    for one in across:
        if margin_m is None:
            least = float(one.distances_m.min())
            told = f"{one.part} and {one.other} are {least:.1f} m apart; no margin is stated"
            inspection.add("margin-unknown", "frames.parquet", told)
            continue
        for index in np.flatnonzero(one.distances_m < margin_m - _ROUNDING_M).tolist():
            near, far = frames[one.places[index]], frames[one.nearest[index]]
            inspection.add(
                "leak-distance",
                str(near["file"]),
                f"of {one.part}, {one.distances_m[index]:.1f} m from {far['file']} of {one.other}; "
                f"the margin is {margin_m:g} m",
            )


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _stated_margin(inspection: Inspection) -> float | None:
    """Return the margin that `run.json` states, or the data card; None where neither does."""
    margin = as_number(inspection.setting("split", "margin_m"))
    if math.isfinite(margin) and margin >= 0:
        return margin
    files = inspection.folder.files
    if _CARD not in files or files[_CARD].size > _LONGEST_CARD:
        return None
    found = _STATED.search(inspection.folder.path(_CARD).read_text("utf-8", errors="replace"))
    try:
        return None if found is None else float(found.group(1))
    except ValueError:
        return None


def check_same_bytes(inspection: Inspection, part: Part) -> None:
    """Report images of a part that are byte for byte another one."""
    first: dict[bytes, ListedImage] = {}
    for image in part.images.values():
        digest = inspection.pictures[image.name].digest
        known = first.setdefault(digest, image) if digest else image
        if known is not image:
            code = "same-file" if known.split == image.split else "leak-same-file"
            told = f"of {image.split}, the bytes of {known.name} of {known.split}"
            inspection.add(code, image.name, told)


def check_alike(inspection: Inspection, part: Part) -> None:
    """Report images of a part that show what another one shows, and are not the same bytes.

    What counts as alike is what the preparation held them to, else what it does by default.
    """
    config = _duplicates(inspection)
    by_split: defaultdict[str, list[ListedImage]] = defaultdict(list)
    for image in part.images.values():
        by_split[image.split].append(image)
    for images in by_split.values():
        groups: dict[object, int] = {}
        numbers = [
            None if one.group is None else groups.setdefault(one.group, len(groups))
            for one in images
        ]
        _find(inspection, images, numbers, DuplicateFinder(config), "near-duplicate")
    if len(by_split) > 1:
        # Images of one split are one group: only those of another split are found.
        order = {split: number for number, split in enumerate(by_split)}
        images = list(part.images.values())
        splits: list[int | None] = [order[one.split] for one in images]
        _find(inspection, images, splits, DuplicateFinder(config), "leak-near-duplicate")


def _find(
    inspection: Inspection,
    images: Sequence[ListedImage],
    groups: Sequence[int | None],
    finder: DuplicateFinder,
    code: str,
) -> None:
    offered: list[ListedImage] = []
    for image, group in zip(images, groups, strict=True):
        picture = inspection.pictures[image.name]
        if picture.look is None:
            continue
        offered.append(image)
        found = finder.offer(picture.look, group=group)
        if found is None:
            continue
        other = offered[found]
        if inspection.pictures[other.name].digest != picture.digest:
            told = f"of {image.split}, shows what {other.name} of {other.split} shows"
            inspection.add(code, image.name, told)


def _duplicates(inspection: Inspection) -> DuplicateConfig:
    """Return what counts as alike: what the preparation held it to, and clearly so."""
    stated = inspection.setting("selection", "duplicates")
    try:
        config = DuplicateConfig.model_validate(stated if isinstance(stated, dict) else {})
    except (ValidationError, PerceptError):
        config = DuplicateConfig()
    return DuplicateConfig(
        most_bits=int(config.most_bits * _GUARD), most_change=config.most_change * _GUARD
    )


def check_split_names(inspection: Inspection, tables: Part, part: Part) -> None:
    """Report images that a format has in another split than the tables."""
    for name, split in part.splits.items():
        known = tables.splits.get(name)
        if known is not None and known != split:
            inspection.add("split-differs", f"{part.name}: {name}", f"{split}, not {known}")


def check_empty_splits(inspection: Inspection, part: Part) -> None:
    """Report splits that a part says it has, and that have no images."""
    held = {image.split for image in part.images.values()}
    for split in sorted(part.stated - held):
        inspection.add("empty-split", part.name, f"{split} has no images")
