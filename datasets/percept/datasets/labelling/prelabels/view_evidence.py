"""What the images and 3D boxes of a moment say of how much a label there would teach.

An object is disputed where a network, or the LiDAR, should have found it and did not. Nobody is
asked for what it does not know: a network without the class `deer` says nothing of deer.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.categories import CategoryConfig, category_of, kind_of
from percept.datasets.labelling.prelabels.config import PreLabelConfig
from percept.datasets.labelling.prelabels.linked_view import (
    ImageView,
    LinkedView,
    accepted_solids,
    link_view,
)
from percept.datasets.labelling.prelabels.network_boxes import overlaps
from percept.datasets.labelling.prelabels.solid_matches import is_known

__all__ = ["Vocabulary", "evidence_of_views"]

# A lower object may be too far away, or stand too low, for enough points of a LiDAR.
_LEAST_SHARE_OF_IMAGE = 0.08


@dataclass(frozen=True, slots=True, kw_only=True)
class Vocabulary:
    """The kinds of objects that each source knows.

    Attributes:
        networks: By the name of the network.
        solids: Of 3D boxes.
    """

    networks: Mapping[str, frozenset[str]] = field(default_factory=dict)
    solids: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls,
        networks: Mapping[str, Collection[str]],
        solids: Collection[str],
        config: CategoryConfig,
    ) -> Self:
        """Return the kinds of the class names that sources have.

        Args:
            networks: Class names by the name of the network.
            solids: Those of 3D boxes.
            config: What classes are called.
        """
        return cls(
            networks={name: _kinds(words, config) for name, words in networks.items()},
            solids=_kinds(solids, config),
        )


def evidence_of_views(
    stamp_ns: int,
    views: Sequence[ImageView],
    solids: SolidBoxes,
    vocabulary: Vocabulary,
    config: PreLabelConfig,
) -> FrameEvidence:
    """Return what is known of a moment.

    Args:
        stamp_ns: The moment.
        views: Its images.
        solids: Its 3D boxes.
        vocabulary: What each source knows.
        config: Settings of pre-labels: what is none is no evidence.
    """
    ignored: Counter[str] = Counter()
    accepted = accepted_solids(solids, config, ignored)
    labels: list[str] = []
    confidences: list[float] = []
    disputed = 0
    in_images = np.zeros(len(accepted), bool)
    for view in views:
        linked = link_view(view, accepted, config, ignored)
        labels += [*linked.seen.labels, *(accepted.labels[row] for row in linked.alone)]
        confidences += linked.seen.confidences.tolist()
        confidences += accepted.confidences[linked.alone].tolist()
        disputed += int(np.count_nonzero(_disputed_boxes(view, linked, vocabulary, config)))
        disputed += _missed_by_networks(view, linked, accepted, vocabulary)
        in_images[linked.matches[linked.matches >= 0]] = True
        in_images[linked.alone] = True
    objects = len(labels)
    for row in np.flatnonzero(is_known(accepted.labels) & ~in_images).tolist():
        labels.append(accepted.labels[row])
        confidences.append(float(accepted.confidences[row]))
    return FrameEvidence(
        stamp_ns=stamp_ns,
        labels=tuple(labels),
        confidences=np.array(confidences, dtype=np.float64),
        disagreement=disputed / objects if objects else 0.0,
    )


def _disputed_boxes(
    view: ImageView, linked: LinkedView, vocabulary: Vocabulary, config: PreLabelConfig
) -> NDArray[np.bool_]:
    """Return (M,) which 2D boxes another network, or the LiDAR, should have found and did not."""
    seen, said = linked.seen, linked.said
    kinds = np.array([kind_of(label) for label in seen.labels], dtype=object)
    said_kinds = np.array([kind_of(label) for label in said.labels], dtype=object)
    found = overlaps(seen.boxes_px, said.boxes_px) > config.linking.same_iou
    found &= kinds[:, None] == said_kinds[None]
    sources = np.array(said.sources, dtype=object)
    disputed = np.zeros(len(seen), bool)
    for name in view.found:
        known = _among(kinds, vocabulary.networks.get(name, frozenset()))
        disputed |= known & ~found[:, sources == name].any(axis=1)
    judged = linked.projected is not None and len(linked.projected.depths_m)
    if judged and view.image_size is not None:
        heights = seen.boxes_px[:, 3] - seen.boxes_px[:, 1]
        near = heights >= _LEAST_SHARE_OF_IMAGE * view.image_size[1]
        disputed |= near & _among(kinds, vocabulary.solids) & (linked.matches < 0)
    return disputed


def _missed_by_networks(
    view: ImageView, linked: LinkedView, solids: SolidBoxes, vocabulary: Vocabulary
) -> int:
    """Return how many 3D boxes no network found of those that one should have found."""
    known: frozenset[str] = frozenset().union(
        *(vocabulary.networks.get(name, frozenset()) for name in view.found)
    )
    return sum(kind_of(solids.labels[row]) in known for row in linked.alone.tolist())


def _among(kinds: NDArray[np.object_], some: frozenset[str]) -> NDArray[np.bool_]:
    return np.array([kind in some for kind in kinds.tolist()], dtype=bool)


def _kinds(words: Collection[str], config: CategoryConfig) -> frozenset[str]:
    categories = (category_of(word, config) for word in words)
    return frozenset(kind_of(category) for category in categories if category)
