"""Which sensor moved, when some pairs of sensors disagree with the rig and others do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from percept.calib.check.axes import base_sd, check_pair, reversed_measurement
from percept.calib.check.result import AXES, AxisVerdict, PairCheck
from percept.calib.limits import CheckLimits

__all__ = ["find_movers", "seen_from_the_others"]

_F64 = NDArray[np.float64]


def find_movers(
    pairs: Sequence[PairCheck], T_base_sensor: Mapping[str, _F64], limits: CheckLimits
) -> tuple[tuple[str, ...], ...]:
    """Return the smallest groups of sensors whose moves explain all that disagrees.

    A group explains a rig when every pair outside of it holds, and when each sensor in it is seen
    at one and the same new place by all sensors outside. One group says which sensors moved;
    several say that it was one of them.

    Args:
        pairs: The pairs that were compared.
        T_base_sensor: (4, 4) by the rig.
        limits: The limits.
    """
    judged = [pair for pair in pairs if pair.judged]
    if not any(pair.moved for pair in judged):
        return ()
    names = sorted({name for pair in judged for name in (pair.sensor, pair.against)})
    for count in range(1, len(names) + 1):
        groups = [
            group
            for group in combinations(names, count)
            if _explains(group, judged, T_base_sensor, limits)
        ]
        if groups:
            return tuple(groups)
    return (tuple(names),)


def _explains(
    group: tuple[str, ...],
    judged: Sequence[PairCheck],
    T_base_sensor: Mapping[str, _F64],
    limits: CheckLimits,
) -> bool:
    if any(pair.moved and not {pair.sensor, pair.against} & set(group) for pair in judged):
        return False
    for name in group:
        views = [
            view
            for view in seen_from_the_others(name, judged, T_base_sensor, limits)
            if view.against not in group
        ]
        if not all(_alike(*two, T_base_sensor, limits) for two in combinations(views, 2)):
            return False
    return True


def seen_from_the_others(
    name: str,
    pairs: Sequence[PairCheck],
    T_base_sensor: Mapping[str, _F64],
    limits: CheckLimits,
) -> list[PairCheck]:
    """Return the pairs of a sensor, turned so that it is the one that is looked at."""
    views = []
    for pair in pairs:
        if pair.sensor == name:
            views.append(pair)
        elif pair.against == name:
            views.append(check_pair(reversed_measurement(pair.measured), T_base_sensor, limits))
    return views


def _alike(
    a: PairCheck, b: PairCheck, T_base_sensor: Mapping[str, _F64], limits: CheckLimits
) -> bool:
    """Whether two sensors see a third one off by the same, where both can judge it."""
    judged = np.array([_judged(a, name) and _judged(b, name) for name in AXES])
    sd = np.hypot(
        base_sd(T_base_sensor[a.against], a.measured.covariance),
        base_sd(T_base_sensor[b.against], b.measured.covariance),
    )
    least = np.repeat([limits.moved_m, limits.moved_deg], 3)
    apart = np.abs(a.deltas() - b.deltas())
    return bool((apart <= np.maximum(limits.moved_sd * sd, least))[judged].all())


def _judged(pair: PairCheck, name: str) -> bool:
    """Whether an axis can be compared: its control was found, whatever it says of a move."""
    control = pair.measured.controls.get(name)
    return (control is not None and control.detected) or (
        pair.axes[name].verdict is not AxisVerdict.NOT_JUDGED
    )
