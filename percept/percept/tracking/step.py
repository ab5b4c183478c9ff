"""One step of the tracker: a state and a measurement make the next state, and nothing else does.

That a step depends on nothing but its two arguments is what makes going back in time exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.tracking.association import Candidates, assign, pair_costs
from percept.tracking.class_columns import ClassColumns
from percept.tracking.class_model import ClassModel
from percept.tracking.common_motion import common_motion
from percept.tracking.config import TrackerConfig
from percept.tracking.filter import (
    aligned_shapes,
    turn_to_course,
    update_positions,
    update_shapes,
    widened,
)
from percept.tracking.image_match import match_in_image
from percept.tracking.life_cycle import alive, confirmed, without_duplicates
from percept.tracking.measurement import ImageMeasurement, Measurement, ScanMeasurement
from percept.tracking.motion import predict_turns
from percept.tracking.track_table import (
    TrackerState,
    TrackTable,
    boxes_of,
    copied,
    empty_table,
    joined,
    put,
    taken,
)

__all__ = ["Stepper"]

_F64 = NDArray[np.float64]
_Index = NDArray[np.intp]


class Stepper:
    """The rules by which a state follows from the one before, with the settings of a tracker.

    Args:
        config: The settings.
        frame_moves: Whether the frame of the tracks moves with the vehicle.

    Attributes:
        classes: The hidden Markov model of the classes.
        columns: Their settings.
    """

    def __init__(self, config: TrackerConfig, *, frame_moves: bool) -> None:
        self.classes = ClassModel(config)
        self.columns = ClassColumns.of(config)
        self._config = config
        self._frame_moves = frame_moves

    def start(self) -> TrackerState:
        """Return the state before the first measurement."""
        return TrackerState(0, empty_table(len(self.classes.names)), 0, scan=False)

    def predicted(self, state: TrackerState, stamp_ns: int) -> TrackTable:
        """Return the tracks of a state at a time that is not earlier."""
        tracks = copied(state.tracks)
        dt_s = (stamp_ns - state.stamp_ns) * 1e-9
        if len(tracks) and dt_s > 0:
            walks = self.columns.walks[tracks["kind"]]
            walks[:, 2] *= tracks["turns"]
            tracks["state"], tracks["covariance"], _ = predict_turns(
                tracks["state"], tracks["covariance"], np.full(len(tracks), dt_s), walks
            )
            tracks["belief"] = self.classes.faded(tracks["belief"], dt_s)
        tracks["observed"] = False
        return tracks

    def living(self, tracks: TrackTable, stamp_ns: int) -> NDArray[np.bool_]:
        """Return (N,) which tracks have not gone unseen for too long."""
        expire, prune = self.columns.t_expire_ns, self.columns.t_prune_ns
        return alive(tracks, stamp_ns, expire[tracks["kind"]], prune[tracks["kind"]])

    def step(self, state: TrackerState, measurement: Measurement) -> TrackerState:
        """Return the state after a measurement that is not older than the state."""
        tracks = self.predicted(state, measurement.stamp_ns)
        if isinstance(measurement, ImageMeasurement):
            self._classify(tracks, measurement)
            stamp_ns, next_id = measurement.stamp_ns, state.next_id
            return TrackerState(stamp_ns, tracks, next_id, scan=False)
        return self._scanned(state, tracks, measurement)

    def _scanned(
        self, state: TrackerState, tracks: TrackTable, scan: ScanMeasurement
    ) -> TrackerState:
        rows, columns = self._associate(tracks, scan)
        if len(rows):
            self._update(tracks, rows, scan, columns)
        spare = scan.confidences >= self.columns.birth_scores[scan.words]
        spare[columns] = False
        born = self._born(scan, np.flatnonzero(spare), state.next_id, tracks)
        tracks = joined(taken(tracks, self.living(tracks, scan.stamp_ns)), born)
        tracks = taken(tracks, without_duplicates(tracks, self._config.duplicate_overlap))
        return TrackerState(scan.stamp_ns, tracks, state.next_id + len(born), scan=True)

    def _associate(self, tracks: TrackTable, scan: ScanMeasurement) -> tuple[_Index, _Index]:
        """Match in two stages: weak detections only with tracks that no sure one continues.

        After ByteTrack (Zhang et al., 2022): a weak box where an object is expected is most
        likely that object, and elsewhere most likely none.
        """
        if not len(tracks) or not len(scan.words):
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        costs = pair_costs(
            Candidates(boxes_of(tracks), tracks["covariance"][:, :2, :2]),
            Candidates(scan.boxes_m, _planar(scan.variances_m2)),
            self._gates(tracks, scan),
            self.classes.focal_cost(tracks["belief"], scan.words, scan.confidences),
            self._config.weights,
        )
        miss = self._config.weights.miss
        sure = scan.confidences >= self.columns.birth_scores[scan.words]
        if sure.all():
            return assign(costs, miss)
        rows, columns = assign(np.where(sure, costs, np.inf), miss)
        costs[rows] = np.inf
        costs[:, sure] = np.inf
        more_rows, more_columns = assign(costs, miss)
        return np.concatenate([rows, more_rows]), np.concatenate([columns, more_columns])

    def _gates(self, tracks: TrackTable, scan: ScanMeasurement) -> _F64:
        """Return the (N, M) farthest distances of pairs, which grow while a track is not seen."""
        unseen_s = (scan.stamp_ns - tracks["seen_ns"]) * 1e-9
        near, speed = self.columns.gates_m, self.columns.gate_speeds_mps
        of_tracks = near[tracks["kind"]] + speed[tracks["kind"]] * unseen_s
        of_words = near[scan.words] + speed[scan.words] * unseen_s[:, None]
        gates: _F64 = np.minimum(of_tracks[:, None], of_words)
        return gates

    def _update(
        self, tracks: TrackTable, rows: _Index, scan: ScanMeasurement, columns: _Index
    ) -> None:
        """Put matched detections into their tracks, in place."""
        found = taken(tracks, rows)
        boxes, scores = scan.boxes_m[columns], scan.confidences[columns]
        # Where it is at the time of the scan, if it was measured a little earlier or later.
        boxes[:, :2] -= found["state"][:, 3:5] * scan.offsets_s[columns, None]
        aligned, agreed = aligned_shapes(found["shape"], boxes[:, 3:])
        found["measured"] = boxes
        found["variances"] = widened(scan.variances_m2[columns], found["shape"], aligned)
        found["state"], found["covariance"] = update_positions(
            found["state"], found["covariance"], boxes[:, :3], found["variances"]
        )
        found["hits"] += 1
        found["score"] += (scores - found["score"]) / found["hits"]
        found["seen_ns"], found["observed"] = scan.stamp_ns, True
        self._believe(found, scan.words[columns], scores)
        self._reshape(found, aligned, agreed)
        found["full"] = confirmed(found, self.columns.t_birth_ns[found["kind"]])
        put(tracks, rows, found)

    def _reshape(self, found: TrackTable, aligned: _F64, agreed: NDArray[np.bool_]) -> None:
        """Let aligned sizes and yaws (N, 4) into the tracks, in place."""
        gains = np.maximum(1.0 / found["hits"], self._config.size_gain)
        found["shape"], found["facing"] = turn_to_course(
            update_shapes(found["shape"], aligned, gains),
            found["facing"],
            found["state"],
            found["covariance"],
            agreed,
            self.columns.elongated[found["kind"]],
        )

    def _believe(self, found: TrackTable, words: NDArray[np.int64], scores: _F64) -> None:
        """Let the words of a detector speak about the classes, in place."""
        evidence = self.classes.evidence(words, scores)
        found["belief"] = self.classes.updated(found["belief"], evidence)
        found["kind"] = found["belief"].argmax(axis=1)

    def _born(
        self, scan: ScanMeasurement, chosen: _Index, first_id: int, others: TrackTable
    ) -> TrackTable:
        """Return new trial tracks, one for each chosen detection."""
        born = empty_table(len(self.classes.names), len(chosen))
        if not len(chosen):
            return born
        boxes, scores = scan.boxes_m[chosen], scan.confidences[chosen]
        born["id"] = first_id + np.arange(len(chosen))
        born["born_ns"] = born["seen_ns"] = scan.stamp_ns
        born["measured"], born["variances"] = boxes, scan.variances_m2[chosen]
        born["shape"], born["score"] = boxes[:, 3:], scores
        born["hits"], born["facing"], born["observed"] = 1, 1.0, True
        born["belief"] = self.classes.prior()
        self._believe(born, scan.words[chosen], scores)
        born["turns"] = self.columns.turns[born["kind"]]
        born["full"] = self.columns.t_birth_ns[born["kind"]] == 0
        born["state"][:, :3] = boxes[:, :3]
        born["covariance"][:, range(3), range(3)] = born["variances"]
        born["covariance"][:, range(3, 6), range(3, 6)] = self.columns.birth_variances[born["kind"]]
        if self._frame_moves:
            scene = common_motion(others[others["observed"] & others["full"]])
            born["state"][:, 3:5], spread = scene.at(boxes[:, :2])
            born["covariance"][:, 3:5, 3:5] += spread
        return born

    def _classify(self, tracks: TrackTable, image: ImageMeasurement) -> None:
        """Let the boxes of an image speak about the classes of the tracks, in place."""
        if not len(tracks) or not len(image.words):
            return
        matched = match_in_image(
            boxes_of(tracks), image.T_camera_inertial, image.camera, image.boxes_px,
            self.classes.focal_cost(tracks["belief"], image.words, image.confidences),
            self._config.image,
        )  # fmt: skip
        columns = np.flatnonzero(matched >= 0)
        found = taken(tracks, matched[columns])
        self._believe(found, image.words[columns], image.confidences[columns])
        put(tracks, matched[columns], found)


def _planar(variances_m2: _F64) -> _F64:
    """Return the covariances (N, 2, 2) of x and y with variances (N, 3) of x, y, z."""
    spread = np.zeros((len(variances_m2), 2, 2))
    spread[:, (0, 1), (0, 1)] = variances_m2[:, :2]
    return spread
