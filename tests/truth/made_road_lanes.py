"""Lanes on a made road against its truth, by the scores of `percept eval lanes`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from percept.core.rig import load_rig
from percept.core.samples import CameraImage
from percept.datasets import open_recording
from percept.evaluation.lane_scores import RoadLaneScores
from percept.evaluation.lanes import SeenFrame, SeenLine, score_road_lanes
from percept.evaluation.road_truth import read_road_markings
from percept.evaluation.runs import read_poses
from percept.lanes import LaneConfig, detect_lanes

__all__ = ["RoadLaneFigures", "road_lane_figures"]

_REACH_M = 15.0
_STOP_REACH_M = (5.2, 12.0)  # nearer ones are below the image
_SURE = 0.1


@dataclass(frozen=True, slots=True)
class RoadLaneFigures:
    """What the project promises of lines up to 15 m and of stop lines up to 12 m.

    Attributes:
        lateral_m: Mean absolute lateral error; `lateral_95_m` is its 95th percentile.
        type_share: Share of the length of all lines that were seen with the right type.
        type_unknown_share: Share of it with a type that is said to be unknown.
        colour_share: Share of it with the right colour.
        both_share: Share of the images with both lines of the lane.
        stops_m: Errors of stop lines.
        stops_found: How many were found, of `stops_there`.
        false_stops: Stop lines where none is.
    """

    lateral_m: float
    lateral_95_m: float
    type_share: float
    type_unknown_share: float
    colour_share: float
    both_share: float
    stops_m: tuple[float, ...]
    stops_found: int
    stops_there: int
    false_stops: int

    def missed(self) -> Iterator[str]:
        """Yield what the project promises and is not so."""
        if self.lateral_m > 0.05:
            yield f"mean lateral error {self.lateral_m:.3f} m"
        if self.type_share < 0.95:
            yield f"type right for {self.type_share:.3f}"
        if self.colour_share < 0.95:
            yield f"colour right for {self.colour_share:.3f}"
        if max(np.abs(self.stops_m), default=0.0) > 0.3:
            yield f"stop line off by {max(np.abs(self.stops_m)):.2f} m"

    def __str__(self) -> str:
        stops = ", ".join(f"{off:+.2f}" for off in self.stops_m)
        return (
            f"lateral {self.lateral_m:.3f} m, 95 % {self.lateral_95_m:.3f} m; "
            f"type {self.type_share:.3f} (unknown {self.type_unknown_share:.3f}), "
            f"colour {self.colour_share:.3f}; both lines {self.both_share:.3f}; stop lines "
            f"[{stops}], found {self.stops_found} of {self.stops_there}, false {self.false_stops}"
        )


def road_lane_figures(drive: Path, config: LaneConfig, *, every: int = 5) -> RoadLaneFigures:
    """Detect lanes in every Nth image of a made drive, and hold them against its truth."""
    camera = load_rig(drive / "truth" / "rig.yaml").cameras()["cam_front"]
    frames = []
    with open_recording([drive / "drive.mcap"]) as recording:
        for k, sample in enumerate(recording.samples(topics=[str(camera.topic)])):
            if k % every == 0 and isinstance(sample, CameraImage):
                found = detect_lanes(np.asarray(sample.pixels), camera, config)
                lines = tuple(
                    SeenLine(
                        side=line.side,
                        points_m=line.points_m,
                        type=line.type,
                        colour=line.colour,
                    )
                    for line in found.lines
                    if line.confidence > _SURE
                )
                stops = tuple(stop.distance_m for stop in found.stop_lines)
                frames.append(SeenFrame(stamp_ns=sample.stamp_ns, lines=lines, stop_lines_m=stops))
    markings = read_road_markings(drive / "truth" / "markings.geojson")
    poses = read_poses(drive / "truth" / "poses.parquet")
    return _figures(score_road_lanes(frames, markings, poses))


def _figures(scores: RoadLaneScores) -> RoadLaneFigures:
    lateral = np.abs(scores.lateral[scores.lateral[:, 0] < _REACH_M, 1])
    low, high = _STOP_REACH_M
    there = (scores.stops_ahead > low) & (scores.stops_ahead <= high)
    near = (scores.stops[:, 0] > low) & (scores.stops[:, 0] <= high)
    return RoadLaneFigures(
        lateral_m=float(lateral.mean()),
        lateral_95_m=float(np.percentile(lateral, 95)),
        type_share=scores.right_type_m / scores.length_m,
        type_unknown_share=scores.unknown_type_m / scores.length_m,
        colour_share=scores.right_colour_m / scores.length_m,
        both_share=scores.both_sides / scores.frames,
        stops_m=tuple(scores.stops[near, 1].tolist()),
        stops_found=int(scores.stops_found[there].sum()),
        stops_there=int(there.sum()),
        false_stops=scores.false_stops,
    )
