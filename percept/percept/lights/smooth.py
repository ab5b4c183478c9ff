"""Hindsight: what all images say of each moment (backward pass of the forward-backward method)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.lights.beliefs import Beliefs, Sightings, likelihoods
from percept.lights.chain import LightChain

__all__ = ["smoothed_beliefs"]

_LONG_AGO_NS = 10**12


def smoothed_beliefs(
    steps: Sequence[tuple[Beliefs, Sightings]], chain: LightChain
) -> list[Beliefs]:
    """Return the beliefs of each step with hindsight.

    gamma = alpha * beta, normalised (Rabiner 1989, equations 25 to 27). Counts of a light are
    those of the end of its life, so that what is reported of it does not begin late.

    Args:
        steps: In order of time: the filtered beliefs and the sightings that went into them.
        chain: How lights go on.
    """
    smoothed: list[Beliefs] = []
    message: NDArray[np.float64] = np.zeros((0, chain.space.size))
    for beliefs, sightings in reversed(steps):
        backward: NDArray[np.float64] = np.ones(beliefs.posteriors.shape)
        whole = replace(
            beliefs,
            flashed=np.zeros(len(beliefs), bool),
            likely_since_ns=beliefs.born_ns - _LONG_AGO_NS,
        )
        if smoothed and len(beliefs):
            later = smoothed[-1]
            here, there = _same_lives(beliefs, later)
            step = chain.step(later.stamp_ns - beliefs.stamp_ns)
            backward[here] = message[there] @ step.T
            backward[here] /= backward[here].max(axis=1, keepdims=True)
            whole = _with_counts(whole, later, here, there)
        weighed = beliefs.posteriors * backward
        weighed /= weighed.sum(axis=1, keepdims=True)
        smoothed.append(replace(whole, posteriors=weighed.astype(np.float32)))
        rows = np.searchsorted(beliefs.ids, sightings.ids)
        backward[rows] *= likelihoods(chain.space, sightings.readings, sightings.weights)
        message = backward
    return smoothed[::-1]


def _same_lives(first: Beliefs, second: Beliefs) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of lights that are in both, and of which neither died in between."""
    _, here, there = np.intersect1d(first.ids, second.ids, assume_unique=True, return_indices=True)
    alike = first.born_ns[here] == second.born_ns[there]
    return here[alike], there[alike]


def _with_counts(
    beliefs: Beliefs, later: Beliefs, here: NDArray[np.intp], there: NDArray[np.intp]
) -> Beliefs:
    columns = {}
    for name in ("detections", "read_s", "interval_s"):
        column = getattr(beliefs, name).copy()
        column[here] = getattr(later, name)[there]
        columns[name] = column
    return replace(beliefs, **columns)
