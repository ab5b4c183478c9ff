"""From one scan to classified boxes: ground, clusters, boxes, classes.

The stages work in a level frame (z up, origin at the sensor); boxes come back in the cloud's
own frame. For a tilted sensor the centres are mapped exactly, and the yaw is the direction of
the length laid into the sensor's x-y plane; length, width and height stay those of the upright
box, so that a 5 degree tilt shifts a car's corner by about 7 cm.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from percept.core.errors import ConfigError, GeometryError
from percept.core.results import Detections3D
from percept.core.samples import PointCloud
from percept.core.settings import Settings
from percept.lidar.boxes import BoxConfig, FittedBoxes, fit_boxes
from percept.lidar.classify import Classification, ClusterFeatures, Rules, classify_clusters
from percept.lidar.cluster import ClusterConfig, cluster_points
from percept.lidar.density import fill_of
from percept.lidar.elevation import ground_height_at
from percept.lidar.ground import GroundConfig, segment_ground
from percept.lidar.intensity import IntensityConfig, IntensityScale, normalise_intensity
from percept.lidar.mounting import Mounting, check_sensor_height
from percept.lidar.result import ScanResult

__all__ = ["LidarConfig", "LidarDetector", "ObjectClusterConfig"]


class ObjectClusterConfig(ClusterConfig):
    """Clustering with the smallest size from which a cluster says something about its class."""

    min_points: int = Field(default=10, ge=1)


class LidarConfig(Settings):
    """All settings of the LiDAR half of `percept detect`.

    Attributes:
        level: Turn the points upright by the rig, or else by the ground plane that is found.
        sensor_height_m: Height of the sensor over the ground; estimated where it is None.
        min_range_m: Points nearer than this are the vehicle itself.
        max_range_m: Points farther than this are left out.
        max_length_m: Clusters longer than this are buildings and hedges, not objects.
        ground: Ground segmentation; its sensor height is set by `sensor_height_m` above.
        cluster: Euclidean clustering.
        boxes: Box fit.
        intensity: What is known of the sensor's intensity.
        rules: A rules file for the classes; the one that ships with percept where it is None.
    """

    level: bool = True
    sensor_height_m: float | None = None
    min_range_m: float = Field(default=1.0, ge=0)
    max_range_m: float = Field(default=100.0, gt=0)
    max_length_m: float = Field(default=25.0, gt=0)
    ground: GroundConfig = Field(default_factory=GroundConfig)
    cluster: ObjectClusterConfig = Field(default_factory=ObjectClusterConfig)
    boxes: BoxConfig = Field(default_factory=BoxConfig)
    intensity: IntensityConfig = Field(default_factory=IntensityConfig)
    rules: Path | None = None

    @model_validator(mode="after")
    def _check_together(self) -> LidarConfig:
        if "sensor_height_m" in self.ground.model_fields_set:
            raise ConfigError(
                "the sensor height stands in 'sensor_height_m', not in 'ground.sensor_height_m'"
            )
        if self.sensor_height_m is not None:
            check_sensor_height(self.sensor_height_m, where="sensor_height_m")
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(
                f"min_range_m {self.min_range_m} must be below max_range_m {self.max_range_m}"
            )
        return self


@dataclass(frozen=True, slots=True, eq=False)
class LidarDetector:
    """Finds and classifies objects in the scans of one sensor; `prepare_detector` makes it.

    Attributes:
        config: Settings.
        mounting: Height over the ground, and the rotation that levels the points.
        rules: Classes.
        intensity_scale: How intensity becomes rho; None where the sensor has none.
        density: (90,) profile of `estimate_density`; None where not known.
        sensor: Name that the detections carry.
    """

    config: LidarConfig
    mounting: Mounting
    rules: Rules
    intensity_scale: IntensityScale | None = None
    density: NDArray[np.float64] | None = None
    sensor: str = ""

    def detect(self, cloud: PointCloud) -> ScanResult:
        """Find the objects of one scan; the same cloud gives the same bits, times aside.

        Args:
            cloud: A scan in the frame of the mounting; it may be empty.

        Raises:
            GeometryError: If the cloud is in another frame.
        """
        watch, dropped = _Stopwatch(), Counter[str]()
        with watch.measure("ground"):
            kept = self._in_range(cloud, dropped)
            points = self.levelled(kept)
            ground = segment_ground(points, self.ground_config)
        with watch.measure("cluster"):
            ids = self._cluster(points, ground, dropped)
        with watch.measure("boxes"):
            boxes, ids = self._fit(points, ids, dropped)
        with watch.measure("classify"):
            features = self._describe(kept, points, ground, ids, boxes)
            classes = classify_clusters(features, self.rules)
            detections = self._detections(kept, ids, boxes, classes)
        return ScanResult(kept, ground, ids, detections, watch.timings_ms, dict(dropped))

    @property
    def ground_config(self) -> GroundConfig:
        """Settings of the ground segmentation with this sensor's height."""
        return self.config.ground.model_copy(update={"sensor_height_m": self.mounting.height_m})

    def levelled(self, cloud: PointCloud) -> NDArray[np.float32]:
        """Return the points (N, 3) float32 in the level frame, metres.

        Raises:
            GeometryError: If the cloud is not in the frame that the mounting was found in.
        """
        expected = self.mounting.T_level_sensor.source
        if cloud.frame != expected:
            raise GeometryError(
                f"a cloud in frame '{cloud.frame}' came to the detector of frame '{expected}'",
                where=cloud.topic,
                remedy="Detect on logs whose frames differ one by one",
            )
        rotation = self.mounting.T_level_sensor.rotation.astype(np.float32)
        return np.ascontiguousarray(cloud.points_xyz @ rotation.T)

    def _in_range(self, cloud: PointCloud, dropped: Counter[str]) -> PointCloud:
        config = self.config
        squared = np.einsum("ij,ij->i", cloud.points_xyz, cloud.points_xyz)
        near = squared < config.min_range_m**2
        far = squared > config.max_range_m**2
        _count(dropped, "points not finite", cloud.dropped_nonfinite)
        _count(dropped, f"points nearer than {config.min_range_m:g} m", np.count_nonzero(near))
        _count(dropped, f"points farther than {config.max_range_m:g} m", np.count_nonzero(far))
        outside = near | far
        return cloud.select(~outside) if outside.any() else cloud

    def _cluster(
        self, points: NDArray[np.float32], ground: NDArray[np.bool_], dropped: Counter[str]
    ) -> NDArray[np.int32]:
        """Cluster what is not ground, and leave out and count what is too small or too large."""
        config = self.config.cluster
        standing = np.flatnonzero(~ground)
        every_size = config.model_copy(update={"min_points": 1, "max_points": None})
        found = cluster_points(points[standing], every_size)
        sizes = np.bincount(found, minlength=1)
        small = (sizes > 0) & (sizes < config.min_points)
        large = sizes > (config.max_points or len(points))
        _count(dropped, f"clusters below {config.min_points} points", np.count_nonzero(small))
        _count(dropped, f"points in clusters below {config.min_points}", sizes[small].sum())
        _count(dropped, f"clusters above {config.max_points} points", np.count_nonzero(large))
        ids = np.full(len(points), -1, np.int32)
        ids[standing] = _renumbered(found, (sizes > 0) & ~small & ~large)
        return ids

    def _fit(
        self, points: NDArray[np.float32], ids: NDArray[np.int32], dropped: Counter[str]
    ) -> tuple[FittedBoxes, NDArray[np.int32]]:
        boxes = fit_boxes(points, ids, self.config.boxes)
        keep = boxes.boxes_m[:, 3] <= self.config.max_length_m
        if keep.all():
            return boxes, ids
        reason = f"clusters longer than {self.config.max_length_m:g} m"
        _count(dropped, reason, np.count_nonzero(~keep))
        return boxes.select(keep), _renumbered(ids, keep)

    def _describe(
        self,
        cloud: PointCloud,
        points: NDArray[np.float32],
        ground: NDArray[np.bool_],
        ids: NDArray[np.int32],
        boxes: FittedBoxes,
    ) -> ClusterFeatures:
        _, _, z, length, width, height, _ = boxes.boxes_m.T
        ground_z = ground_height_at(boxes.boxes_m[:, :2], points[ground], -self.mounting.height_m)
        # Where the ground is not seen it is taken from elsewhere, but no object reaches below it.
        ground_z = np.minimum(ground_z, z - height / 2)
        rho = np.full(len(boxes), np.nan)
        if self.intensity_scale is not None and cloud.intensity is not None:
            inside = np.flatnonzero(ids >= 0)
            range_m = np.linalg.norm(points[inside], axis=1)
            values = normalise_intensity(cloud.intensity[inside], range_m, self.intensity_scale)
            rho = _mean_by_cluster(values, ids[inside], len(boxes))
        return ClusterFeatures(
            length_m=length,
            width_m=width,
            height_m=z + height / 2 - ground_z,
            clearance_m=z - height / 2 - ground_z,
            fill=np.full(len(boxes), np.nan)
            if self.density is None
            else fill_of(boxes, self.density),
            surface=boxes.surface,
            rho=rho,
        )

    def _detections(
        self,
        cloud: PointCloud,
        ids: NDArray[np.int32],
        boxes: FittedBoxes,
        classes: Classification,
    ) -> Detections3D:
        intensity = np.full(len(boxes), np.nan)
        if cloud.intensity is not None:
            intensity = _mean_by_cluster(cloud.intensity, ids, len(boxes))
        return Detections3D(
            stamp_ns=cloud.stamp_ns,
            sensor=self.sensor,
            frame_id=cloud.frame,
            boxes_m=_rotated(boxes.boxes_m, self.mounting.T_level_sensor.rotation.T),
            labels=classes.labels,
            confidences=classes.confidences,
            mean_intensity=intensity,
            points=boxes.points,
            offsets_ns=_offsets_ns(cloud, ids, len(boxes)),
        )


def _offsets_ns(cloud: PointCloud, ids: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """Return (K,) the mean time of the points of each cluster; 0 where points have no times."""
    if cloud.offset_ns is None:
        return np.zeros(count, np.int64)
    inside = ids >= 0
    number = np.bincount(ids[inside], minlength=count)
    total = np.bincount(ids[inside], cloud.offset_ns[inside], minlength=count)
    return np.rint(total / np.maximum(number, 1)).astype(np.int64)


def _count(dropped: Counter[str], reason: str, number: int | np.integer) -> None:
    if number:
        dropped[reason] += int(number)


def _renumbered(ids: NDArray[np.int32], keep: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Number the clusters to keep 0, 1, ... in their old order, and all others -1."""
    new = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
    renumbered: NDArray[np.int32] = np.append(new, np.int32(-1))[ids]
    return renumbered


def _mean_by_cluster(
    values: NDArray[np.float32], ids: NDArray[np.int32], count: int
) -> NDArray[np.float64]:
    """Return the mean of the finite values of each cluster, or NaN where there are none."""
    usable = (ids >= 0) & np.isfinite(values)
    number = np.bincount(ids[usable], minlength=count)
    total = np.bincount(ids[usable], values[usable], minlength=count)
    mean = np.full(count, np.nan)
    np.divide(total, number, out=mean, where=number > 0)
    return mean


def _rotated(boxes_m: NDArray[np.float64], R_b_a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return boxes (K, 7) of frame a in frame b, of the same origin; yaw in (-pi, pi]."""
    rotated: NDArray[np.float64] = boxes_m.copy()
    rotated[:, :3] = boxes_m[:, :3] @ R_b_a.T
    yaw = boxes_m[:, 6]
    heading = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1) @ R_b_a.T
    rotated[:, 6] = np.arctan2(heading[:, 1], heading[:, 0])
    return rotated


@dataclass(slots=True)
class _Stopwatch:
    """The one place where the pipeline looks at the clock."""

    timings_ms: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.timings_ms[stage] = 1e3 * (time.perf_counter() - start)
