"""What an object is: a hidden Markov model over its classes, fed by what detectors say.

alpha <- (C conf) * (A alpha), normalised (Burnett et al., aUToTrack, 2019). C says how
probable each word of a detector is for each true class; conf spreads what the detector did not
give to its word over the other words; A lets the belief fade, so that it can be revised.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.class_words import common_word, kind_of_word, plain_word
from percept.tracking.config import TrackerConfig

__all__ = ["ClassModel", "class_of_word"]

_F64 = NDArray[np.float64]

_UNKNOWN = "unknown"
_LEAST_CONFIDENCE = 0.05
_MOST_CONFIDENCE = 0.98
_FOCUS = 2.0
_LEAST_PROBABILITY = 0.01


def class_of_word(word: str, classes: Mapping[str, int]) -> int:
    """Return the index of the class that a detector's word stands for, or -1.

    Case, blanks and hyphens do not matter. A word that is a class itself stands for that.
    """
    words = (word, plain_word(word), common_word(word), kind_of_word(word))
    return next((classes[word] for word in words if word in classes), -1)


class ClassModel:
    """The hidden Markov model with the matrices of some settings.

    Attributes:
        names: Of the classes, in the order of all columns.
        confusion: (C, C) float64 probability of each word (row) for each true class (column).
    """

    def __init__(self, config: TrackerConfig) -> None:
        self.names = tuple(config.classes)
        self.confusion = _confusion(config)
        self._change_per_s = config.class_change_per_s

    def words(self, labels: tuple[str, ...]) -> NDArray[np.int64]:
        """Return the (N,) index of the class that each label stands for, or -1."""
        index = {name: number for number, name in enumerate(self.names)}
        return np.array([class_of_word(label, index) for label in labels], dtype=np.int64)

    def evidence(self, words: NDArray[np.int64], confidences: _F64) -> _F64:
        """Return C conf: the (N, C) likelihoods of the classes given N words.

        Args:
            words: (N,) indices of classes.
            confidences: (N,); those outside 0..1, as of networks that give logits, are clipped.
        """
        given = np.clip(confidences, _LEAST_CONFIDENCE, _MOST_CONFIDENCE)
        others = max(len(self.names) - 1, 1)
        said = np.repeat(((1 - given) / others)[:, None], len(self.names), axis=1)
        said[np.arange(len(words)), words] = given
        likelihood: _F64 = said @ self.confusion
        return likelihood

    def prior(self) -> _F64:
        """Return the (C,) belief before anything was said."""
        return np.full(len(self.names), 1.0 / len(self.names))

    def updated(self, belief: _F64, evidence: _F64) -> _F64:
        """Return the beliefs (N, C) after evidence (N, C)."""
        product = belief * evidence
        normalised: _F64 = product / product.sum(axis=1, keepdims=True)
        return normalised

    def faded(self, belief: _F64, dt_s: float) -> _F64:
        """Return A alpha: the beliefs (N, C) after a time without evidence."""
        stay = float(np.exp(-self._change_per_s * dt_s))
        return stay * belief + (1 - stay) / len(self.names)

    def focal_cost(self, belief: _F64, words: NDArray[np.int64], confidences: _F64) -> _F64:
        """Return how little the words (M,) fit to the beliefs (N, C): (N, M), 0 for a fit.

        The focal loss -(1 - p)^2 log p (Lin et al., 2017) of the probability of the word,
        relative to that for an object of its own class; of an unsure word less is asked.
        """
        probability = (belief @ self.confusion.T)[:, words]
        fit = np.minimum(probability / np.diag(self.confusion)[words], 1.0)
        fit = 1 - np.clip(confidences, 0.0, 1.0) * (1 - fit)
        fit = np.maximum(fit, _LEAST_PROBABILITY)
        cost: _F64 = -((1 - fit) ** _FOCUS) * np.log(fit)
        return cost


def _confusion(config: TrackerConfig) -> _F64:
    """Return P(word | true class), each column of which sums to 1."""
    names = tuple(config.classes)
    matrix = np.full((len(names), len(names)), config.confusion_floor)
    for column, true in enumerate(names):
        if _UNKNOWN in names and true != _UNKNOWN:
            matrix[names.index(_UNKNOWN), column] = config.unknown_share
        for word, share in config.confusions.get(true, {}).items():
            if word in names:
                matrix[names.index(word), column] = share
        matrix[column, column] = 0.0
        matrix[column, column] = max(1.0 - matrix[:, column].sum(), config.confusion_floor)
    normalised: _F64 = matrix / matrix.sum(axis=0)
    return normalised
