"""Which image of the detections is which of the labels, and which classes are compared."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from percept.core.errors import InputError, UsageError
from percept.core.labels import ANY_LABEL, LabelledImage, LabelSet

__all__ = ["ImagePairs", "pair_images"]

_IMAGE_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm"}
_SHOWN = 5
_MOST_SILENT = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class ImagePairs:
    """Labels and detections, image by image, in one vocabulary.

    Attributes:
        images: (labels, detections) of each image that is compared.
        classes: The classes that are compared, in alphabetical order.
        foreign: Number of detections by class that the labels do not have; they are left out.
        dropped: Images, and detections in them, that only one of both has, by reason.
        notes: What a reader of the figures has to know.
        doubts: What makes it likely that the wrong images are compared.
    """

    images: tuple[tuple[LabelledImage, LabelledImage], ...]
    classes: tuple[str, ...]
    foreign: Mapping[str, int]
    dropped: Mapping[str, int]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def pair_images(truth: LabelSet, found: LabelSet, label_map: Mapping[str, str]) -> ImagePairs:
    """Bring labels and detections together.

    An image that the detections do not list has none, unless they list all images that were
    looked at: then it is left out and counted. An image that the labels do not list is left out
    and counted: it may be one without objects, or one that nobody has labelled.

    Args:
        truth: The labels.
        found: The detections.
        label_map: New name by class name, for both.

    Raises:
        UsageError: If the map names a class that neither has.
        InputError: If there are no images, not one image or class is in both, or the detections
            hold regions to ignore, as labels do.
    """
    if any(image.ignore.any() for image in found.images):
        raise InputError(
            "the detections hold regions to ignore, which only labels have",
            where=_where(found),
            remedy="Give what a detector found as --detections",
        )
    _check_map(label_map, (*truth.class_names, *found.class_names))
    truth, found = _renamed(truth, label_map), _renamed(found, label_map)
    dropped: Counter[str] = Counter()
    notes: list[str] = []
    images = _paired(truth, found, dropped, notes)
    doubts = (*_other_folders(images), *_silent(images, found))
    classes = _classes(truth, found, images)
    foreign = Counter(label for _, b in images for label in b.labels if label not in classes)
    return ImagePairs(
        images, classes, dict(foreign.most_common()), dict(dropped), tuple(notes), doubts
    )


def _check_map(label_map: Mapping[str, str], known: Iterable[str]) -> None:
    names = sorted(set(known))
    for old in label_map:
        if old not in names:
            near = difflib.get_close_matches(old, names, n=1, cutoff=0.0)
            raise UsageError(
                f"neither the labels nor the detections have a class '{old}'",
                where=f"--map {old}={label_map[old]}",
                remedy=f"Did you mean '{near[0]}'? Classes: {_listed(names)}" if near else None,
            )


def _renamed(labels: LabelSet, label_map: Mapping[str, str]) -> LabelSet:
    if not label_map:
        return labels
    return replace(
        labels,
        images=tuple(
            replace(image, labels=tuple(label_map.get(name, name) for name in image.labels))
            for image in labels.images
        ),
        categories={k: label_map.get(name, name) for k, name in labels.categories.items()},
    )


def _paired(
    truth: LabelSet, found: LabelSet, dropped: Counter[str], notes: list[str]
) -> tuple[tuple[LabelledImage, LabelledImage], ...]:
    if not truth.images:
        raise InputError("the labels hold no image", where=_where(truth))
    key = _join_key(truth, found)
    if key is _last_part:
        notes.append("images are brought together by the last parts of their names")
    detections = {key(image.name): image for image in found.images}
    pairs = []
    for image in truth.images:
        partner = detections.pop(key(image.name), None)
        if partner is None and found.complete:
            dropped["labelled images that the detector did not look at"] += 1
            continue
        pairs.append((image, partner or LabelledImage.of(image.name)))
    if detections:
        lost = sum(len(image) for image in detections.values())
        dropped["detections in images without labels"] = lost
        dropped["images with detections and without labels"] = len(detections)
        if not truth.complete:
            notes.append(
                "the labels do not list images without objects: false detections in such images "
                "are not counted"
            )
    return tuple(pairs)


def _other_folders(images: Iterable[tuple[LabelledImage, LabelledImage]]) -> Iterator[str]:
    """Say which images are brought together although their folders have other names."""
    pairs = [(PurePosixPath(_stem(a.name)), PurePosixPath(_stem(b.name))) for a, b in images]
    others = [(a, b) for a, b in pairs if len({a.parent.name, b.parent.name, ""}) > 2]
    if others:
        yield (
            f"images are brought together from folders of other names ({len(others)}), such as "
            f"'{others[0][0]}' with '{others[0][1]}': are they the same?"
        )


def _silent(
    images: Iterable[tuple[LabelledImage, LabelledImage]], found: LabelSet
) -> Iterator[str]:
    """Say whether a detector that does not list its images may not have seen all of them."""
    with_objects = [pair for pair in images if not pair[0].ignore.all()]
    silent = sum(not len(detections) for _, detections in with_objects)
    if not found.complete and silent > _MOST_SILENT * len(with_objects):
        yield (
            f"{silent} of {len(with_objects)} images with objects have no detection: did the "
            "detector look at them?"
        )


def _join_key(truth: LabelSet, found: LabelSet) -> Callable[[str], str]:
    """Return what images are brought together by: their whole names, or the last parts of them."""
    ours = [_stem(image.name) for image in truth.images]
    theirs = [_stem(image.name) for image in found.images]
    if not theirs or set(ours) & set(theirs):
        return _stem
    short, other = ([_last_part(name) for name in part] for part in (ours, theirs))
    unique = len(set(short)) == len(short) and len(set(other)) == len(other)
    if unique and set(short) & set(other):
        return _last_part
    raise InputError(
        f"no image of the detections is one of the labels (detections: {_listed(theirs)}; "
        f"labels: {_listed(ours)})",
        where=_where(found),
        remedy="Give the labels of the same images, named alike",
    )


def _stem(name: str) -> str:
    path = PurePosixPath(name.replace("\\", "/"))
    return str(path.with_suffix("") if path.suffix.lower() in _IMAGE_SUFFIXES else path)


def _last_part(name: str) -> str:
    return PurePosixPath(_stem(name)).name


def _classes(
    truth: LabelSet,
    found: LabelSet,
    images: Sequence[tuple[LabelledImage, LabelledImage]],
) -> tuple[str, ...]:
    """Return the classes to compare: those of the labels that either side has a box of."""
    objects = Counter(
        label
        for image, _ in images
        for label, ignored in zip(image.labels, image.ignore, strict=True)
        if label != ANY_LABEL and not ignored
    )
    detections = Counter(label for _, image in images for label in image.labels)
    if objects and detections and not set(objects) & set(found.class_names):
        raise InputError(
            f"no class is in both: the labels have {_listed(sorted(objects))}, the detections "
            f"{_listed(sorted(detections))}",
            where=_where(found),
            remedy=f"Say which are the same, as --map {_example(objects, detections)}",
        )
    known = truth.class_names or found.class_names
    return tuple(sorted(name for name in known if objects[name] or detections[name]))


def _example(objects: Iterable[str], detections: Iterable[str]) -> str:
    folded = {name.casefold(): name for name in detections}
    for name in objects:
        if name.casefold() in folded:
            return f"{name}={folded[name.casefold()]}"
    return f"{min(objects)}={min(detections)}"


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_SHOWN])
    return shown if len(names) <= _SHOWN else f"{shown} and {len(names) - _SHOWN} more"


def _where(labels: LabelSet) -> str | None:
    return str(labels.files[0]) if labels.files else None
