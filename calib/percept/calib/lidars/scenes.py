"""The clouds of a calibration made fit to count: finite, of one sensor each, of different places.

A scene that is there twice would agree with itself, and a vehicle that did not move shows the
same surfaces again: neither says anything about how far the answer can be trusted. Clouds of
one place are therefore joined into one scene.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.calib.lidars.levelling import find_planes
from percept.calib.limits import LidarLimits
from percept.core.errors import GeometryError, InputError

__all__ = ["CalibrationScenes", "prepare_scenes"]

_F64 = NDArray[np.float64]

_SAME_CLOUD_M = 2e-3  # a cloud that was written in another format, as text for example
_PLACE_VOXEL_M = 0.5
_PLACE_NEAR_M = 3.0  # closer is the vehicle itself, which is everywhere the same
_PLACE_POINTS = 3000
_OFF_PLANE_M = 0.4
_FEWEST_STANDING = 30


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationScenes:
    """Clouds by scene and sensor.

    Attributes:
        clouds: (N, 3) float64 finite points by sensor, for each scene; a sensor may lack some.
        names: The numbers that each scene was given under, from 1 on, such as "2" or "1+3".
        dropped: What was left out, by reason.
        doubts: What is odd about the clouds, in words.
    """

    clouds: tuple[dict[str, _F64], ...]
    names: tuple[str, ...]
    dropped: dict[str, int]
    doubts: tuple[str, ...]

    def of(self, target: str, source: str) -> list[tuple[_F64, _F64]]:
        """Return the clouds of two sensors in all scenes that both have."""
        return [(c[target], c[source]) for c in self.clouds if target in c and source in c]

    def numbers(self, target: str, source: str) -> list[str]:
        """Return the names of the scenes of `of`, in its order."""
        together = zip(self.names, self.clouds, strict=True)
        return [name for name, c in together if target in c and source in c]


def prepare_scenes(
    scenes: Sequence[Mapping[str, NDArray[np.floating]]], reference: str, limits: LidarLimits
) -> CalibrationScenes:
    """Drop what is not finite or there twice, and join scenes of one place.

    Args:
        scenes: Points (N, 3) in metres by sensor name, each in the sensor's own frame.
        reference: The sensor by which places are told apart.
        limits: When two clouds show one place.

    Raises:
        GeometryError: If an array is no (N, 3).
        InputError: If two sensors have the same cloud.
    """
    dropped: Counter[str] = Counter()
    clouds = [_finite(scene, number, dropped) for number, scene in enumerate(scenes, 1)]
    doubts = _drop_repeated(clouds, dropped)
    joined, names, moved = _join_places(clouds, reference, limits)
    again = sum(name.count("+") for name in names)
    if again:
        dropped["scenes joined with another of the same place"] = again
    return CalibrationScenes(tuple(joined), tuple(names), dict(dropped), (*doubts, *moved))


def _finite(
    scene: Mapping[str, NDArray[np.floating]], number: int, dropped: Counter[str]
) -> dict[str, _F64]:
    """Return the clouds of a scene as finite points; a cloud without any is left out."""
    kept: dict[str, _F64] = {}
    for name, given in scene.items():
        points = np.asarray(given, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise GeometryError(
                f"points are (N, 3), not {points.shape}", where=f"scene {number}, {name}"
            )
        # Many drivers write 0 0 0 where nothing came back.
        sound = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
        if not sound.all():
            dropped[f"points of {name} that are not finite or at its origin"] += int((~sound).sum())
        if sound.any():
            kept[name] = points[sound]
        else:
            dropped[f"clouds of {name} without a point"] += 1
    return kept


def _drop_repeated(clouds: list[dict[str, _F64]], dropped: Counter[str]) -> list[str]:
    """Remove clouds that are there twice.

    Raises:
        InputError: If one cloud stands for two sensors.
    """
    every = [(number, name) for number, scene in enumerate(clouds) for name in scene]
    doubts = []
    for (i, name), (j, other) in combinations(every, 2):
        if name not in clouds[i] or other not in clouds[j]:
            continue
        if not _same_cloud(clouds[i][name], clouds[j][other]):
            continue
        if name != other:
            raise InputError(
                f"'{name}' in scene {i + 1} and '{other}' in scene {j + 1} are the same cloud",
                remedy="Give each sensor its own clouds",
            )
        del clouds[j][other]
        dropped[f"clouds of {name} that are there twice"] += 1
        doubts.append(f"scene {j + 1} has the same cloud of '{name}' as scene {i + 1}")
    return doubts


def _same_cloud(a: _F64, b: _F64) -> bool:
    return a.shape == b.shape and bool(np.abs(a - b).max() < _SAME_CLOUD_M)


def _join_places(
    clouds: Sequence[Mapping[str, _F64]], reference: str, limits: LidarLimits
) -> tuple[list[dict[str, _F64]], list[str], list[str]]:
    """Return scenes of different places, what they are made of, and what contradicts itself."""
    places: list[list[int]] = []
    doubts: list[str] = []
    for number, scene in enumerate(clouds):
        if not scene:
            continue
        home = next(
            (p for p in places if _same_place(clouds[p[0]], scene, reference, limits)), None
        )
        if home is None:
            places.append([number])
            continue
        others = [n for n in scene if n in clouds[home[0]] and n != reference]
        moved = [n for n in others if not _same_place(clouds[home[0]], scene, n, limits)]
        if moved:
            places.append([number])
            doubts.append(
                f"'{reference}' sees one place in scenes {home[0] + 1} and {number + 1}, "
                f"'{moved[0]}' sees two: it was moved, or clouds are mixed up"
            )
        else:
            home.append(number)
    joined = []
    for place in places:
        names = sorted({name for number in place for name in clouds[number]})
        joined.append(
            {
                name: np.concatenate([clouds[n][name] for n in place if name in clouds[n]])
                for name in names
            }
        )
    return joined, ["+".join(str(number + 1) for number in place) for place in places], doubts


def _same_place(
    known: Mapping[str, _F64], scene: Mapping[str, _F64], sensor: str, limits: LidarLimits
) -> bool:
    """Whether a sensor's cloud lies on another one of it, as it does when nothing has moved."""
    if sensor not in known or sensor not in scene:
        return False
    cloud = scene[sensor]
    few = _spread(cloud)
    # On a flat road the rings are alike everywhere: what stands out of it has to be the same too.
    return _lies_on(few, known[sensor], limits) and _lies_on(
        _standing_out(few, cloud), known[sensor], limits
    )


def _spread(points: _F64) -> _F64:
    """Return points (K, 3) that are spread evenly over the surroundings, without the vehicle."""
    far = points[(points**2).sum(axis=1) > _PLACE_NEAR_M**2]
    _, first = np.unique(np.floor(far / _PLACE_VOXEL_M), axis=0, return_index=True)
    few = far[np.sort(first)]
    spread: _F64 = few[:: max(1, -(-len(few) // _PLACE_POINTS))]
    return spread


def _standing_out(few: _F64, cloud: _F64) -> _F64:
    """Return the points off the largest plane; all of them where that leaves next to nothing."""
    planes = find_planes(cloud, 1)
    if not planes:
        return few
    rest: _F64 = few[np.abs(few @ planes[0].normal + planes[0].height_m) > _OFF_PLANE_M]
    return rest if len(rest) >= _FEWEST_STANDING else few


def _lies_on(few: _F64, known: _F64, limits: LidarLimits) -> bool:
    if len(few) == 0:
        return False
    distances, _ = cKDTree(known).query(few, distance_upper_bound=limits.same_place_m)
    return bool(np.isfinite(distances).mean() > limits.same_place_share)
