"""Traffic lights of the map against those that a drive saw: which is gone, which is new.

A light of the map that a network never marks, though it hangs in view, is gone; boxes that belong
to no light of the map and meet in one place in space are a new one. What the network can do is
measured on the lights of the map themselves: a network that does not know them says nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.light_words import light_label
from percept.core.map_findings import Discrepancy, Kind, Look
from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.settings import Settings
from percept.core.sight_lines import is_hidden
from percept.core.transform import Transform
from percept.hdmap.light import MapLight
from percept.lights.association import match_lights
from percept.lights.projection import ProjectionConfig, project_lights
from percept.lights.rays import RayCluster, RayClusters

__all__ = ["LightCheckConfig", "LightFindings", "LightMapChecker"]

_F64 = NDArray[np.float64]
_SAME_PLACE_M, _OWN_SIZE_M = 2.5, 1.0
_ONE_LIGHT_M = 6.0  # places of one light that were never seen together
_INDEPENDENT = 1 / 3  # looks that follow each other err together
_MOST_LOOKS = 3
_HALF_LIGHT_M = np.array([0.0, 0.0, 0.5])


class LightCheckConfig(Settings):
    """When a traffic light of the map is missing, and when one is missing in the map.

    Attributes:
        range_m: Lights further away are not looked for.
        facing_deg: Nor those that are turned away by more than this.
        min_height_px: Nor those that would be lower than this in the image.
        least_score: Boxes below it do not count.
        least_looks: Fewer looks at a light decide nothing.
        most_hits: A light is missing that was found in at most this share of the looks.
        least_recall: A network is of no use that finds a smaller share of the map's lights.
        least_height_m: Boxes of lower things over the road are no new lights.
    """

    range_m: float = Field(default=50.0, gt=0)
    facing_deg: float = Field(default=60.0, gt=0, le=90)
    min_height_px: float = Field(default=9.0, gt=0)
    least_score: float = Field(default=0.35, ge=0, le=1)
    least_looks: int = Field(default=6, ge=2)
    most_hits: float = Field(default=0.1, ge=0, lt=1)
    least_recall: float = Field(default=0.5, ge=0, le=1)
    least_height_m: float = Field(default=2.0, ge=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightFindings:
    """What became of the lights.

    Attributes:
        discrepancies: Lights that are missing, on the road or in the map.
        looks: By light of the map, in how many looks it hung in view.
        seen: In how many of them it was found.
        recall: Share of all looks in which the network found the light; NaN without any.
        notes: What a user should know, as sentences.
        dropped: Clusters of boxes that are no finding, by reason.
    """

    discrepancies: tuple[Discrepancy, ...]
    looks: Mapping[int, int]
    seen: Mapping[int, int]
    recall: float
    notes: tuple[str, ...]
    dropped: Mapping[str, int]

    @classmethod
    def not_compared(cls, why: str) -> LightFindings:
        """Return what is said where nobody looked for lights."""
        nothing: Mapping[int, int] = {}
        return cls(
            discrepancies=(),
            looks=nothing,
            seen=nothing,
            recall=float("nan"),
            notes=(why,),
            dropped={},
        )


@dataclass(slots=True)
class _Sighting:
    """What was seen of one light of the map."""

    looks: int = 0
    hits: int = 0
    drives: set[int] = field(default_factory=set)
    at: list[Look] = field(default_factory=list)


class LightMapChecker:
    """Takes the boxes of all looks, and says at the end which lights are missing.

    Args:
        lights: Of the map.
        config: Settings; None takes the defaults.
        chosen: Whether a person chose the network: one that nobody chose has to show first that
            it knows the lights of the map.
    """

    def __init__(
        self,
        lights: Sequence[MapLight],
        config: LightCheckConfig | None = None,
        *,
        chosen: bool = True,
    ) -> None:
        self._lights = tuple(lights)
        self._config = config or LightCheckConfig()
        self._chosen = chosen
        self._sightings = {light.light_id: _Sighting() for light in self._lights}
        self._clusters: list[tuple[int, RayClusters]] = []
        self._boxes = 0
        self._projection = ProjectionConfig(
            range_m=self._config.range_m,
            facing_deg=self._config.facing_deg,
            min_height_px=self._config.min_height_px,
        )

    def begin_drive(self) -> None:
        """Begin the next drive: its boxes meet in places of their own."""
        self._clusters.append((len(self._clusters), RayClusters()))

    def push(
        self,
        found: Detections2D,
        camera: CameraSensor,
        T_map_base: Transform,
        hiding_m: _F64 | None = None,
    ) -> None:
        """Take the boxes of an image.

        Args:
            found: All boxes; those that are no traffic lights are left alone.
            camera: Its lens and place.
            T_map_base: Where the vehicle was.
            hiding_m: (N, 7) boxes in the vehicle's frame that may hide a light, or None.

        Raises:
            ConfigError: If the rig does not say where the camera sits.
        """
        boxes = self._light_boxes(found)
        self._boxes += len(boxes)
        drive = len(self._clusters) - 1
        near = [light for light in self._lights if self._is_near(light, T_map_base)]
        projected = project_lights(near, T_map_base, camera, self._projection)
        matches = match_lights(projected, boxes)
        hit = dict.fromkeys(projected.ids[matches.pairs[:, 0]].tolist(), True)
        middles = {light.light_id: light.corners_map.mean(axis=0) for light in near}
        for row, light_id in enumerate(projected.ids.tolist()):
            hidden = _is_hidden(middles[light_id], camera, T_map_base, hiding_m)
            if light_id not in hit and (projected.inside[row] < 1 or hidden):
                continue
            sighting = self._sightings[light_id]
            sighting.looks += 1
            sighting.hits += light_id in hit
            sighting.drives.add(drive)
            sighting.at.append(
                Look(drive, camera.name, found.stamp_ns, float(projected.range_m[row]))
            )
        self._clusters[-1][1].push(boxes[matches.spare], camera, T_map_base, found.stamp_ns, drive)

    def finish(self) -> LightFindings:
        """Return what became of the lights."""
        looks = {i: sighting.looks for i, sighting in self._sightings.items()}
        seen = {i: sighting.hits for i, sighting in self._sightings.items()}
        total = sum(looks.values())
        recall = sum(seen.values()) / total if total else float("nan")
        dropped: Counter[str] = Counter()
        unfit = self._why_unfit(total, recall)
        found = () if unfit else (*self._gone(), *self._new(dropped))
        return LightFindings(
            discrepancies=tuple(found),
            looks=looks,
            seen=seen,
            recall=recall,
            notes=(unfit,) if unfit else (),
            dropped=dict(dropped),
        )

    def _light_boxes(self, found: Detections2D) -> _F64:
        keep = [
            row
            for row, label in enumerate(found.labels)
            if light_label(label) is not None and found.confidences[row] >= self._config.least_score
        ]
        order = np.array(keep, dtype=np.intp)[np.argsort(-found.confidences[keep], kind="stable")]
        return _one_a_light(found.boxes_px[order])

    def _is_near(self, light: MapLight, T_map_base: Transform) -> bool:
        away = light.corners_map[0, :2] - T_map_base.translation_m[:2]
        return float(np.hypot(*away)) <= self._config.range_m + 10

    def _why_unfit(self, looks: int, recall: float) -> str:
        """Return why the network says nothing of the lights; empty where it does."""
        if not self._boxes:
            return "Traffic lights are not compared: the network found none in any image."
        if self._chosen:
            return ""
        if looks < self._config.least_looks:
            return (
                "Traffic lights are not compared: too few of the map came into view to tell "
                "whether the built-in network knows them. Give --model."
            )
        if recall < self._config.least_recall:
            return (
                f"Traffic lights are not compared: the built-in network finds {recall:.0%} of "
                "those of the map. Give --model."
            )
        return ""

    def _gone(self) -> list[Discrepancy]:
        """Return the lights of the map that are not there."""
        config, found = self._config, []
        total = sum(s.looks for s in self._sightings.values())
        hits = sum(s.hits for s in self._sightings.values())
        for light in self._lights:
            sighting = self._sightings[light.light_id]
            if (
                sighting.looks < config.least_looks
                or sighting.hits > config.most_hits * sighting.looks
            ):
                continue
            # What the network can do is told by the other lights; a half is taken as known.
            recall = (hits - sighting.hits + 1) / (total - sighting.looks + 2)
            if recall < config.least_recall:
                continue
            unlikely = (1 - recall) ** (sighting.looks * _INDEPENDENT)
            edge = light.corners_map[:2]
            near, far = (f(look.range_m for look in sighting.at) for f in (min, max))
            found.append(
                Discrepancy(
                    finding_id=f"{Kind.TRAFFIC_LIGHT_MISSING}-{light.light_id}-0",
                    kind=Kind.TRAFFIC_LIGHT_MISSING,
                    map_element_id=light.light_id,
                    along_m=0.0,
                    offset_m=float("nan"),
                    length_m=float(np.linalg.norm(edge[1] - edge[0])),
                    sd_m=float("nan"),
                    observations=sighting.looks,
                    visits=len(sighting.drives),
                    confidence=float(1 - unlikely),
                    expected=f"traffic light {light.light_id}",
                    observed=f"none in {sighting.looks - sighting.hits} of {sighting.looks} "
                    f"looks from {near:.0f} to {far:.0f} m, where {recall:.0%} of the others "
                    "are found",
                    points_map=edge,
                    points_expected_map=light.corners_map[[0, 1, 2, 3, 0]],
                    looks=_nearest(sighting.at),
                )
            )
        return found

    def _new(self, dropped: Counter[str]) -> list[Discrepancy]:
        """Return lights that the map does not have; those of several drives are one."""
        found: list[tuple[RayCluster, int]] = []
        for drive, clusters in self._clusters:
            for cluster in clusters.places():
                why = self._why_no_light(cluster)
                if why:
                    dropped[why] += 1
                else:
                    found.append((cluster, drive))
        placed: list[tuple[RayCluster, set[int]]] = []
        for cluster, drive in sorted(found, key=lambda one: -len(one[0].looks)):
            same = [(_apart_m(cluster, other), k) for k, (other, _) in enumerate(placed)]
            apart_m, nearest = min(same, default=(np.inf, -1))
            if apart_m < _ONE_LIGHT_M:
                placed[nearest][1].add(drive)
            else:
                placed.append((cluster, {drive}))
        return [_new_light(cluster, drives) for cluster, drives in placed]

    def _why_no_light(self, cluster: RayCluster) -> str:
        """Return why boxes that meet in a place are no new light; empty where they are one."""
        if len(cluster.looks) < self._config.least_looks or cluster.share < 0.5:
            return "boxes of lights that too few looks confirm"
        if cluster.sd_m > 1.5:
            return "boxes of lights whose place is not known well"
        if cluster.height_m < self._config.least_height_m:
            return "boxes of lights that hang no higher than vehicles do"
        for light in self._lights:
            # One that faces the camera has had its own boxes; what hangs beside it is another.
            matched = self._sightings[light.light_id].hits > 0
            away = light.corners_map.mean(axis=0) - cluster.place_map
            nearest_m = _OWN_SIZE_M if matched else _SAME_PLACE_M
            if np.linalg.norm(away) < nearest_m + cluster.sd_m:
                return "boxes of lights of the map, seen from the side or behind"
        return ""


def _one_a_light(boxes_px: _F64) -> _F64:
    """Return boxes (N, 4), the surest first, without those that lie on a surer one.

    Networks suppress overlapping boxes of one class: a light read as red and as off has two.
    """
    kept: list[int] = []
    for row, box in enumerate(boxes_px):
        others = boxes_px[kept]
        low, high = np.maximum(others[:, :2], box[:2]), np.minimum(others[:, 2:], box[2:])
        shared = np.clip(high - low, 0.0, None).prod(axis=1)
        smaller = np.minimum(
            (others[:, 2:] - others[:, :2]).prod(axis=1), (box[2:] - box[:2]).prod()
        )
        if not (shared > 0.5 * smaller).any():
            kept.append(row)
    return boxes_px[kept]


def _apart_m(one: RayCluster, other: RayCluster) -> float:
    """Return how far two places are apart, metres; infinity for lights seen in one image.

    Where the poses tilt, the rays to one light meet in two places, one after the other.
    """
    looks = {(look.drive, look.sensor, look.stamp_ns) for look in one.looks}
    if any((look.drive, look.sensor, look.stamp_ns) in looks for look in other.looks):
        return float("inf")
    return float(np.linalg.norm(one.place_map - other.place_map))


def _is_hidden(
    point_map: _F64, camera: CameraSensor, T_map_base: Transform, hiding_m: _F64 | None
) -> bool:
    if hiding_m is None or camera.T_base_sensor is None:
        return False
    point = T_map_base.inverse().apply(point_map[None])
    return bool(is_hidden(camera.T_base_sensor.translation_m, point, hiding_m)[0])


def _new_light(cluster: RayCluster, drives: set[int]) -> Discrepancy:
    place = cluster.place_map
    near, far = (f(look.range_m for look in cluster.looks) for f in (min, max))
    return Discrepancy(
        finding_id=f"{Kind.TRAFFIC_LIGHT_MISSING_IN_MAP}-0-{place[0]:.0f}_{place[1]:.0f}",
        kind=Kind.TRAFFIC_LIGHT_MISSING_IN_MAP,
        map_element_id=0,
        along_m=0.0,
        offset_m=float("nan"),
        length_m=0.0,
        sd_m=cluster.sd_m,
        observations=len(cluster.looks),
        visits=len(drives),
        confidence=float(1 - 0.5 ** (len(cluster.looks) * _INDEPENDENT)) * cluster.share,
        expected="no traffic light",
        observed=f"traffic light {cluster.height_m:.1f} m over the road, in {len(cluster.looks)} "
        f"looks from {near:.0f} to {far:.0f} m, placed to {cluster.sd_m:.1f} m",
        points_map=np.vstack([place - _HALF_LIGHT_M, place + _HALF_LIGHT_M]),
        points_expected_map=np.zeros((0, 3)),
        looks=_nearest(cluster.looks),
    )


def _nearest(looks: Sequence[Look]) -> tuple[Look, ...]:
    """Return the looks at which a light is seen best: near, but not at the image's edge."""
    by_range = sorted(looks, key=lambda look: look.range_m)
    return tuple(by_range[len(by_range) // 4 :][:_MOST_LOOKS])
