"""LiDAR perception: ground, clusters, boxes, classes, and the pipeline of the four."""

from __future__ import annotations

from percept.lidar.boxes import BoxConfig, FittedBoxes, fit_boxes
from percept.lidar.classify import (
    Classification,
    ClusterFeatures,
    Rules,
    classify_clusters,
    load_rules,
)
from percept.lidar.cluster import ClusterConfig, cluster_points
from percept.lidar.ground import GroundConfig, segment_ground
from percept.lidar.intensity import (
    IntensityConfig,
    IntensityScale,
    estimate_intensity_scale,
    normalise_intensity,
)
from percept.lidar.merge import ScanGrouper, merge_clouds
from percept.lidar.mounting import Mounting, estimate_mounting
from percept.lidar.pipeline import LidarConfig, LidarDetector
from percept.lidar.prepare import prepare_detector
from percept.lidar.result import ScanResult

__all__ = [
    "BoxConfig",
    "Classification",
    "ClusterConfig",
    "ClusterFeatures",
    "FittedBoxes",
    "GroundConfig",
    "IntensityConfig",
    "IntensityScale",
    "LidarConfig",
    "LidarDetector",
    "Mounting",
    "Rules",
    "ScanGrouper",
    "ScanResult",
    "classify_clusters",
    "cluster_points",
    "estimate_intensity_scale",
    "estimate_mounting",
    "fit_boxes",
    "load_rules",
    "merge_clouds",
    "normalise_intensity",
    "prepare_detector",
    "segment_ground",
]
