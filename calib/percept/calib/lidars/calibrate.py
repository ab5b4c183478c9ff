"""Any number of LiDARs in the frame of one of them.

Each sensor is registered with the reference over all scenes at once; where the two share too
little, with a sensor that is placed already. The registrations are the edges of a graph: its
round trips check them, its maximum spanning tree places the sensors, and a pose graph adjusts
all of them together. One sensor that fails does not spoil the others.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.evidence import RigEvidence, usable_edges
from percept.calib.lidars.judgement import conclude
from percept.calib.lidars.pair import LidarCalibrationConfig, register_views, view_of
from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.result import LidarCalibration
from percept.calib.lidars.rig_graph import maximum_spanning_tree, place_along
from percept.calib.lidars.scenes import CalibrationScenes, prepare_scenes
from percept.calib.lidars.view import SensorView, UnusableCloud
from percept.calib.limits import LidarLimits
from percept.core.errors import UsageError

__all__ = ["calibrate_lidars"]

_F64 = NDArray[np.float64]
_Pairs = dict[tuple[str, str], PairRegistration]

_OVERLAP_CELL_M = 0.5


def calibrate_lidars(
    scenes: Sequence[Mapping[str, NDArray[np.floating]]],
    reference: str,
    config: LidarCalibrationConfig | None = None,
    initial: Mapping[str, _F64] | None = None,
    progress: Callable[[float], None] | None = None,
) -> LidarCalibration:
    """Place LiDARs in the frame of a reference one, and say how far that can be trusted.

    No guess is needed. What was measured is never changed.

    Args:
        scenes: For each scene the points (N, 3) of each sensor, metres, in its own frame, taken
            at one moment or while nothing moved. A sensor may be missing in some.
        reference: Name of the sensor whose frame everything is given in.
        config: Settings; None for the defaults.
        initial: `T_reference_sensor` (4, 4) of sensors whose place is known roughly: one more
            hypothesis, and what the result must not be worse than.
        progress: Called with the share that is done, 0 to 1.

    Raises:
        UsageError: If there is no scene, the reference is in none, or it is the only sensor.
        InputError: If two sensors have the same cloud.
        GeometryError: If an array is no (N, 3).
    """
    names = _sensor_names(scenes, reference)
    limits = LidarLimits()
    start = {n: np.asarray(T, dtype=np.float64) for n, T in (initial or {}).items() if n in names}
    start[reference] = np.eye(4)
    prepared = prepare_scenes(scenes, reference, limits)
    search = _Search(prepared, config or LidarCalibrationConfig(), start, progress, len(names))
    others = [name for name in names if name != reference]
    search.register({(reference, name): None for name in others})
    search.chain(reference, others)
    search.close(reference, limits)
    return conclude(RigEvidence(reference, tuple(others), prepared, search.found, start, limits))


def _sensor_names(scenes: Iterable[Mapping[str, object]], reference: str) -> list[str]:
    names = list(dict.fromkeys(name for scene in scenes for name in scene))
    if not names:
        raise UsageError("no scene has a cloud", remedy="Give clouds of two LiDARs or more")
    if reference not in names:
        raise UsageError(
            f"no cloud of the reference '{reference}'", remedy=f"Choose from {', '.join(names)}"
        )
    if len(names) == 1:
        raise UsageError(
            f"'{reference}' is the only LiDAR", remedy="Give clouds of two LiDARs or more"
        )
    return names


class _Search:
    """The registrations of a rig, as they are made."""

    def __init__(
        self,
        scenes: CalibrationScenes,
        config: LidarCalibrationConfig,
        start: Mapping[str, _F64],
        progress: Callable[[float], None] | None,
        sensors: int,
    ) -> None:
        self.found: _Pairs = {}
        self._views: dict[int, SensorView | UnusableCloud] = {}  # by identity of the cloud
        self._scenes = scenes
        self._config = config
        self._start = start
        self._progress = progress or (lambda _share: None)
        self._expected = sensors * (sensors - 1) / 2

    def register(
        self, wanted: Mapping[tuple[str, str], _F64 | None], *, local: bool = False
    ) -> None:
        """Register pairs (target, source) over the scenes that both have, some at a time.

        Args:
            wanted: For each pair a guess of `T_target_source`, or None for the given places.
            local: Look near the guess only.
        """
        pairs = [pair for pair in wanted if self._scenes.of(*pair)]

        def one(pair: tuple[str, str]) -> PairRegistration:
            given = wanted[pair]
            return register_views(
                [(self._views[id(a)], self._views[id(b)]) for a, b in self._scenes.of(*pair)],
                self._config,
                initial=self._guess(*pair) if given is None else given,
                names=self._scenes.numbers(*pair),
                local=local,
            )

        # Most of the time goes into neighbour searches and kernels without Python's lock.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            self._prepare(pairs, pool)
            for pair, found in zip(pairs, pool.map(one, pairs), strict=True):
                self.found[pair] = found
                self._progress(min(len(self.found) / self._expected, 1.0))

    def _prepare(self, pairs: Sequence[tuple[str, str]], pool: ThreadPoolExecutor) -> None:
        """Work out once what several pairs need of a cloud."""
        clouds = {id(c): c for pair in pairs for both in self._scenes.of(*pair) for c in both}
        new = [key for key in clouds if key not in self._views]
        views = pool.map(lambda key: view_of(clouds[key], self._config), new)
        self._views.update(zip(new, views, strict=True))

    def _guess(self, target: str, source: str) -> _F64 | None:
        if target not in self._start or source not in self._start:
            return None
        return np.asarray(np.linalg.inv(self._start[target]) @ self._start[source])

    def placed(self, reference: str) -> dict[str, _F64]:
        """Return `T_reference_sensor` of the sensors that usable registrations reach."""
        tree = maximum_spanning_tree(usable_edges(self.found), reference)
        return {n: p.T_root_sensor for n, p in place_along(tree, reference).items()}

    def chain(self, reference: str, others: Sequence[str]) -> None:
        """Register what the reference does not reach with sensors that it does."""
        waiting = [name for name in others if name not in self.placed(reference)]
        tried = set(self.found)
        while True:
            placed = self.placed(reference)
            steps = [
                (target, source)
                for target in placed
                for source in waiting
                if source not in placed and (target, source) not in tried
            ]
            if not steps:
                return
            tried.add(steps[0])
            self.register({steps[0]: None})

    def close(self, reference: str, limits: LidarLimits) -> None:
        """Register the other pairs that share a view, from where the chain puts them.

        They are what the round trips are made of: each of them can show an error of another.
        """
        placed = self.placed(reference)
        wanted: dict[tuple[str, str], _F64 | None] = {}
        for target, source in combinations(placed, 2):
            if {(target, source), (source, target)} & set(self.found):
                continue
            T_target_source = np.linalg.inv(placed[target]) @ placed[source]
            shared = _shared_view(self._scenes.of(target, source), T_target_source)
            if shared >= limits.overlap_worth_a_loop:
                wanted[target, source] = T_target_source
        self.register(wanted, local=True)


def _shared_view(clouds: Sequence[tuple[_F64, _F64]], T_target_source: _F64) -> float:
    """Return the share of the source's occupied cells that the target occupies too."""
    shared, every = 0, 0
    for target, source in clouds:
        moved = source @ T_target_source[:3, :3].T + T_target_source[:3, 3]
        cells = _cells(moved)
        shared += len(cells & _cells(target))
        every += len(cells)
    return shared / max(every, 1)


def _cells(points: _F64) -> set[tuple[int, ...]]:
    cells = np.unique(np.floor(points / _OVERLAP_CELL_M).astype(np.int64), axis=0)
    return set(map(tuple, cells.tolist()))
