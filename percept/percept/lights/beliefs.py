"""What is believed of all lights at one moment, and how an image changes it (forward filter)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.light_words import Reading
from percept.lights.chain import LightChain
from percept.lights.config import DecisionConfig
from percept.lights.decision import decide
from percept.lights.states import LightStateSpace

__all__ = ["Beliefs", "Sightings", "likelihoods", "observe", "predict"]

_LONGEST_INTERVAL_S = 1.0
_NEVER_NS = np.iinfo(np.int64).min // 2
_SAME_INSTANT_S = 0.02
_INTERVAL_GAIN = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """What one image says of lights, each at most once.

    Attributes:
        stamp_ns: Time of the image.
        camera: Number of the camera.
        ids: (N,) int64 which light.
        readings: (N,) int64 values of `Reading`.
        weights: (N,) float64 in 0..1 how far each reading is to be believed.
    """

    stamp_ns: int
    camera: int
    ids: NDArray[np.int64]
    readings: NDArray[np.int64]
    weights: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Beliefs:
    """All L lights that are alive at a moment.

    Attributes:
        stamp_ns: The moment.
        ids: (L,) int64, rising.
        born_ns: (L,) int64 first sight; with the id it names one life of a light.
        posteriors: (L, S) float32 probabilities of the states.
        detections: (L,) int64 number of boxes so far.
        seen_ns: (L,) int64 last sight.
        read_s: (L,) float64 for how long its lamps were read, gaps not counted.
        interval_s: (L,) float64 running mean of the time between readings.
        likely_since_ns: (L,) int64 since when flashing is probable enough; far off while not.
        flashed: (L,) bool whether it was called flashing.
        seen_by_ns: (L, C) int64 last sight by each camera.
    """

    stamp_ns: int
    ids: NDArray[np.int64]
    born_ns: NDArray[np.int64]
    posteriors: NDArray[np.float32]
    detections: NDArray[np.int64]
    seen_ns: NDArray[np.int64]
    read_s: NDArray[np.float64]
    interval_s: NDArray[np.float64]
    likely_since_ns: NDArray[np.int64]
    flashed: NDArray[np.bool_]
    seen_by_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def none(cls, space: LightStateSpace) -> Beliefs:
        """Return the beliefs before anything was seen."""
        return cls.born(space, 0, 0, np.zeros(0, np.int64))

    @classmethod
    def born(
        cls, space: LightStateSpace, cameras: int, stamp_ns: int, ids: NDArray[np.int64]
    ) -> Beliefs:
        """Return lights of which nothing is known but that they are there."""
        count = len(ids)
        return cls(
            stamp_ns=stamp_ns,
            ids=ids,
            born_ns=np.full(count, stamp_ns, np.int64),
            posteriors=np.tile(space.prior.astype(np.float32), (count, 1)),
            detections=np.zeros(count, np.int64),
            seen_ns=np.full(count, stamp_ns, np.int64),
            read_s=np.zeros(count),
            interval_s=np.full(count, _LONGEST_INTERVAL_S),
            likely_since_ns=np.full(count, -_NEVER_NS),
            flashed=np.zeros(count, bool),
            seen_by_ns=np.full((count, cameras), _NEVER_NS),
        )

    def may_flash(self, config: DecisionConfig) -> NDArray[np.bool_]:
        """Return (L,) whether each was read long and often enough to be called flashing."""
        often = self.interval_s <= 1 / config.slowest_hz
        long = self.read_s >= config.flash_in_view_s - _SAME_INSTANT_S
        held_s = (self.stamp_ns - self.likely_since_ns) / 1e9
        may: NDArray[np.bool_] = often & long & (held_s >= config.flashing_hold_s - _SAME_INSTANT_S)
        return may

    def subset(self, kept: NDArray[np.bool_] | NDArray[np.int64]) -> Beliefs:
        """Return some of the lights, in the order asked for."""
        return self._with({name: getattr(self, name)[kept] for name in _COLUMNS})

    def joined(self, others: Beliefs) -> Beliefs:
        """Return these lights and others, by rising id."""
        columns = {
            name: np.concatenate([getattr(self, name), getattr(others, name)]) for name in _COLUMNS
        }
        return self._with(columns).subset(np.argsort(columns["ids"], kind="stable"))

    def _with(self, columns: dict[str, Any]) -> Beliefs:
        return Beliefs(stamp_ns=self.stamp_ns, **columns)


_COLUMNS = (
    "ids", "born_ns", "posteriors", "detections", "seen_ns", "read_s", "interval_s",
    "likely_since_ns", "flashed",
    "seen_by_ns",
)  # fmt: skip


def predict(beliefs: Beliefs, stamp_ns: int, chain: LightChain, death_s: float) -> Beliefs:
    """Return the beliefs at a later time, without the lights that were not seen for too long."""
    alive = stamp_ns - beliefs.seen_ns <= round(death_s * 1e9)
    kept = beliefs if alive.all() else beliefs.subset(alive)
    posteriors = kept.posteriors
    if len(kept):
        posteriors = posteriors @ chain.step(stamp_ns - beliefs.stamp_ns)
    return replace(kept, stamp_ns=stamp_ns, posteriors=posteriors)


def likelihoods(
    space: LightStateSpace, readings: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (N, S): how probable each reading is in each state; 1 where it says nothing."""
    told = readings < Reading.UNREADABLE
    weight = weights[:, None]
    rows = space.emissions.T[np.where(told, readings, 0)]
    return np.where(told[:, None], weight * rows + (1 - weight) / 4, 1.0)


def observe(
    beliefs: Beliefs,
    sightings: Sightings,
    chain: LightChain,
    config: DecisionConfig,
) -> Beliefs:
    """Return the beliefs after an image at their very time; lights not among them are born.

    Bayes' rule for each light that was seen (Rabiner 1989, equation 20). Nothing at all changes
    for one that was not seen: it may be hidden, and a dark housing has to be seen to be dark.
    """
    space = chain.space
    if not len(sightings.ids):
        return beliefs
    beliefs = _with_camera(beliefs, sightings.camera)
    new = sightings.ids[~np.isin(sightings.ids, beliefs.ids)]
    if len(new):
        cameras = beliefs.seen_by_ns.shape[1]
        beliefs = beliefs.joined(Beliefs.born(space, cameras, sightings.stamp_ns, new))
    rows = np.searchsorted(beliefs.ids, sightings.ids)
    posteriors = beliefs.posteriors.copy()
    weighed = posteriors[rows] * likelihoods(space, sightings.readings, sightings.weights)
    posteriors[rows] = weighed / weighed.sum(axis=1, keepdims=True)
    noted = _note_sight(replace(beliefs, posteriors=posteriors), sightings, rows)
    return _note_flashing(noted, posteriors @ space.to_classes, config)


def _note_flashing(
    beliefs: Beliefs, classes: NDArray[np.float64], config: DecisionConfig
) -> Beliefs:
    """Return the beliefs with what is known of flashing brought up to date."""
    likely = classes[:, 4:].sum(axis=1) >= config.flashing
    since = np.where(likely, np.minimum(beliefs.likely_since_ns, beliefs.stamp_ns), -_NEVER_NS)
    noted = replace(beliefs, likely_since_ns=since)
    answers = decide(classes, config, may_flash=noted.may_flash(config), flashed=beliefs.flashed)
    return replace(noted, flashed=answers.flashing)


def _with_camera(beliefs: Beliefs, camera: int) -> Beliefs:
    """Return the beliefs with a column for a camera that is new."""
    lights, cameras = beliefs.seen_by_ns.shape
    if camera < cameras:
        return beliefs
    added = np.full((lights, camera + 1 - cameras), _NEVER_NS)
    return replace(beliefs, seen_by_ns=np.hstack([beliefs.seen_by_ns, added]))


def _note_sight(beliefs: Beliefs, sightings: Sightings, rows: NDArray[np.int64]) -> Beliefs:
    """Return the beliefs with counts and times brought up to date."""
    detections, seen = beliefs.detections.copy(), beliefs.seen_ns.copy()
    read, interval = beliefs.read_s.copy(), beliefs.interval_s.copy()
    seen_by = beliefs.seen_by_ns.copy()
    gap_s = np.minimum((sightings.stamp_ns - seen[rows]) / 1e9, _LONGEST_INTERVAL_S)
    told = (sightings.readings < Reading.UNREADABLE) & (gap_s > _SAME_INSTANT_S)
    gain = np.maximum(1 / np.maximum(detections[rows], 1), _INTERVAL_GAIN)
    interval[rows] += np.where(told, gain * (gap_s - interval[rows]), 0)
    read[rows] += np.where(told, gap_s, 0)
    detections[rows] += 1
    seen[rows] = sightings.stamp_ns
    seen_by[rows, sightings.camera] = sightings.stamp_ns
    return replace(
        beliefs, detections=detections, seen_ns=seen, read_s=read, interval_s=interval,
        seen_by_ns=seen_by,
    )  # fmt: skip
