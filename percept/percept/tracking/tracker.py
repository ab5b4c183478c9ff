"""The tracker: detections of all sensors, in any order, become objects with identities.

After aUToTrackV3 of aUToronto: boxes in space move the tracks, boxes in images only speak about
their classes, and what arrives late is put at its place in time (`percept.tracking.rollback`).
Every scan is a step for all tracks: that one sensor did not see an object says nothing but
that time has passed, so sensors that look elsewhere, or have other rates, do no harm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.tracking.config import TrackerConfig
from percept.tracking.histories import histories_of
from percept.tracking.history import TrackHistory
from percept.tracking.measurement import (
    ImageMeasurement,
    Measurement,
    ScanMeasurement,
    placed_boxes,
)
from percept.tracking.rollback import Timeline
from percept.tracking.step import Stepper
from percept.tracking.track_table import TrackTable, boxes_of, empty_table

__all__ = ["Tracker"]

_F64 = NDArray[np.float64]


_NO_POSES = (
    "without poses the tracks stay in the frame of the detections, and velocities are relative to "
    "the vehicle; new tracks begin with the motion that most of the others share"
)


class Tracker:
    """Tracks objects through the detections of a drive.

    Args:
        config: Settings.
        poses: `T_inertial_vehicle` over time. Detections in the frame `poses.source` are brought
            into `poses.target`. Without poses the frame of the detections is taken for one that
            does not move.
        cameras: The cameras of the rig by name, with their places in `poses.source` (without
            poses: in the frame of the detections).

    Attributes:
        config: The settings that are in effect: without poses those for a frame that moves.
        classes: Names of the classes that tracks can have.
        dropped: What could not be used, counted by reason.
        frame_id: Frame of the tracks; empty until it is known.
        notes: What else should be known about the tracks.
    """

    def __init__(
        self,
        config: TrackerConfig = TrackerConfig(),  # noqa: B008  settings are frozen
        *,
        poses: Trajectory | None = None,
        cameras: Mapping[str, CameraSensor] | None = None,
    ) -> None:
        self.config = config if poses is not None else config.in_moving_frame()
        self.dropped: Counter[str] = Counter()
        self.frame_id = poses.target if poses is not None else ""
        self.notes = () if poses is not None else (_NO_POSES,)
        self._poses = poses
        self._sensors = dict(cameras or {})
        self._cameras = {name: sensor.camera() for name, sensor in self._sensors.items()}
        self._stepper = Stepper(self.config, frame_moves=poses is None)
        self._timeline = Timeline(self._stepper, round(config.rollback_window_s * 1e9))
        self.classes = self._stepper.classes.names

    def push(self, detections: Detections3D | Detections2D) -> None:
        """Take detections in; nothing is returned, see `tracks`.

        They may come in any order within the window of the settings. A scan without
        detections is one that saw nothing, and should be given, too.
        """
        measurement: Measurement | None
        if isinstance(detections, Detections3D):
            measurement = self._scan(detections)
        else:
            measurement = self._image(detections)
        if measurement is not None and not self._timeline.insert(measurement):
            self.dropped["measurements later than the rollback window"] += 1

    def tracks(self, stamp_ns: int) -> Tracks:
        """Return the tracks at any time.

        They are what follows from the measurements with stamps up to then, predicted from the
        last of these; none before the first one.
        """
        state = self._timeline.before(stamp_ns)
        if state is None:
            return self._as_tracks(empty_table(len(self.classes)), stamp_ns)
        if state.stamp_ns == stamp_ns:
            return self._as_tracks(state.tracks, stamp_ns)
        tracks = self._stepper.predicted(state, stamp_ns)
        return self._as_tracks(tracks[self._stepper.living(tracks, stamp_ns)], stamp_ns)

    def histories(self) -> list[TrackHistory]:
        """Return every track that there was, at each scan from its birth to its end, by id.

        The last steps of those that ended are predictions without a detection. What images said
        about the class shows at the next scan.
        """
        return sorted(self.each_history(), key=lambda history: history.track_id)

    def each_history(self) -> Iterator[TrackHistory]:
        """Yield the same one by one, in the order in which they ended: a drive's take much memory.

        The tracks of the whole drive are made again, which takes as long as it did before.
        """
        return histories_of(self._timeline.states())

    def _scan(self, detections: Detections3D) -> ScanMeasurement | None:
        pose = self._pose(detections.stamp_ns)
        if self._poses is None:
            self.frame_id = self.frame_id or detections.frame_id
        boxes = np.array(detections.boxes_m, dtype=np.float64)
        if detections.frame_id != self.frame_id:
            if self._poses is None or detections.frame_id != self._poses.source:
                self.dropped[f"scans in '{detections.frame_id}', a frame without poses"] += 1
                return None
            placed = placed_boxes(detections, self._poses)
            if placed is None:
                self.dropped["scans at times without a pose"] += 1
                return None
            boxes = placed
        words = self._stepper.classes.words(detections.labels)
        used = self._used(words, detections.labels, detections.confidences)
        used &= self._finite(boxes, detections.confidences)
        boxes, words = boxes[used], words[used]
        away = boxes[:, :2] - (0.0 if pose is None else pose.translation_m[:2])
        variances = self._stepper.columns.centre_variances(words, np.hypot(away[:, 0], away[:, 1]))
        offsets_s = np.asarray(detections.offsets_ns[used] * 1e-9, dtype=np.float64)
        return ScanMeasurement(
            detections.stamp_ns, detections.sensor, boxes, variances, words,
            detections.confidences[used].astype(np.float64), offsets_s,
        )  # fmt: skip

    def _pose(self, stamp_ns: int) -> Transform | None:
        return None if self._poses is None else self._poses.at(stamp_ns)

    def _image(self, detections: Detections2D) -> ImageMeasurement | None:
        sensor = self._sensors.get(detections.camera)
        if sensor is None or sensor.T_base_sensor is None:
            self.dropped[f"images of '{detections.camera}', a camera without a place"] += 1
            return None
        T_camera_inertial = sensor.T_base_sensor.inverse()
        if self._poses is not None:
            pose = self._pose(detections.stamp_ns)
            if pose is None:
                self.dropped["images at times without a pose"] += 1
                return None
            T_camera_inertial = T_camera_inertial @ pose.inverse()
        words = self._stepper.classes.words(detections.labels)
        used = self._used(words, detections.labels, detections.confidences)
        return ImageMeasurement(
            detections.stamp_ns, detections.camera, detections.boxes_px[used], words[used],
            detections.confidences[used], self._cameras[detections.camera], T_camera_inertial,
        )  # fmt: skip

    def _used(
        self, words: NDArray[np.int64], labels: tuple[str, ...], confidences: _F64
    ) -> NDArray[np.bool_]:
        named = words >= 0
        for row in np.flatnonzero(~named):
            self.dropped[f"boxes labelled '{labels[row]}', which is no class of tracks"] += 1
        sure = confidences >= self._stepper.columns.keep_scores[words]
        if not sure[named].all():
            self.dropped["boxes below the score of their class"] += int((named & ~sure).sum())
        return named & sure

    def _finite(self, boxes: _F64, confidences: _F64) -> NDArray[np.bool_]:
        finite: NDArray[np.bool_] = np.isfinite(boxes).all(axis=1) & np.isfinite(confidences)
        if not finite.all():
            self.dropped["boxes that are not finite"] += int((~finite).sum())
        return finite

    def _as_tracks(self, tracks: TrackTable, stamp_ns: int) -> Tracks:
        position_sd_m, velocity_sd_mps = _larger_sd(tracks["covariance"])
        return Tracks(
            stamp_ns=stamp_ns,
            frame_id=self.frame_id,
            ids=tracks["id"].copy(),
            boxes_m=boxes_of(tracks),
            velocities_mps=tracks["state"][:, 3:5].copy(),
            labels=tuple([self.classes[kind] for kind in tracks["kind"].tolist()]),
            label_probabilities=tracks["belief"].max(axis=1, initial=0.0),
            states=tuple(["full" if full else "trial" for full in tracks["full"].tolist()]),
            position_sd_m=position_sd_m,
            velocity_sd_mps=velocity_sd_mps,
            observed=tracks["seen_ns"] == stamp_ns,
            scores=tracks["score"].copy(),
        )


def _larger_sd(covariances: _F64) -> _F64:
    """Return the larger standard deviation (2, N), in any direction, of position and velocity."""
    x, y = (0, 3), (1, 4)
    a, b, c = covariances[:, x, x].T, covariances[:, x, y].T, covariances[:, y, y].T
    larger: _F64 = np.sqrt((a + c) / 2 + np.hypot((a - c) / 2, b))
    return larger
