"""Reads the scans and images of one scene from a log, once it is known where the scene is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from percept.core.errors import InsufficientDataError
from percept.core.samples import CameraImage, PointCloud, Sample
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.recording import Recording
from percept.datasets.sensors import read_static_transforms
from percept.datasets.stops.motion import at_one_instant
from percept.datasets.stops.stillness import StillSpan
from percept.datasets.stops.stop import SceneConfig, Stop

__all__ = ["SceneReader"]

_BASE_FRAMES = ("base_link", "base_footprint", "vehicle", "ego_vehicle")
_LOG_DELAY_NS = 300_000_000
_REACH_NS = 1_500_000_000
_LONG_NS, _SETTLE_NS = 500_000_000, 200_000_000
_HALF_PERIOD_NS = 60_000_000
_ROTATION_DOUBT_RAD = float(np.radians(1.0))


@dataclass(frozen=True, slots=True)
class SceneReader:
    """Reads scenes.

    Attributes:
        recording: The log.
        cloud_topics: Of the LiDARs; the first one sets the pace.
        image_topics: Of the cameras.
        settings: How scenes are taken.
        window: First and last log time that may be read, or None.
        log_times: Log times of the scans of the first LiDAR by their stamps.
    """

    recording: Recording
    cloud_topics: tuple[str, ...]
    image_topics: tuple[str, ...]
    settings: SceneConfig
    window: tuple[int | None, int | None]
    log_times: Mapping[int, int]

    def stop(self, spans: Sequence[StillSpan], left_out: int) -> Stop:
        """Return a stop: the scans in the middle of its spans together, the sharpest images.

        Args:
            spans: Where it is; several of one place, in the order of time, or one.
            left_out: How many spans of the log were not chosen, for the note.
        """
        scans: dict[str, list[PointCloud]] = {topic: [] for topic in self.cloud_topics}
        seen: dict[str, list[CameraImage]] = {topic: [] for topic in self.image_topics}
        for span in spans:
            first_ns, last_ns, middle_ns = _core(span)
            samples = self._near(first_ns, last_ns, middle_ns)
            for topic, some in scans.items():
                some += self._scans(samples[topic], first_ns, last_ns, len(spans))
            for topic, images in seen.items():
                inside = [s for s in samples[topic] if first_ns <= s.stamp_ns <= last_ns]
                images += [s for s in inside if isinstance(s, CameraImage)]
        notes = [f"{left_out} more stops in the log were left out"] if left_out else []
        notes += [f"no scan of {topic}" for topic, some in scans.items() if not some]
        notes += [f"no image of {topic}" for topic, images in seen.items() if not images]
        return Stop(
            _core(spans[0])[0],
            _core(spans[-1])[1],
            {t: np.concatenate([s.points_xyz for s in some]) for t, some in scans.items() if some},
            {
                t: max(images[: self.settings.most_images], key=_sharpness)
                for t, images in seen.items()
                if images
            },
            {t: some[0].frame for t, some in scans.items() if some},
            "; ".join(notes),
            spans[0].place,
            max(span.held_cells for span in spans),
        )

    def _scans(
        self, samples: Sequence[Sample], first_ns: int, last_ns: int, parts: int
    ) -> list[PointCloud]:
        """Return scans with points inside a span, or the nearest one, as many as fit one part."""
        clouds = [s for s in samples if isinstance(s, PointCloud) and len(s)]
        inside = [s for s in clouds if first_ns <= s.stamp_ns <= last_ns] or clouds[:1]
        return inside[: max(self.settings.most_scans // parts, 1)]

    def keyframe(
        self, stamp_ns: int, number: int, motion: Trajectory, places: Mapping[str, Transform]
    ) -> Stop:
        """Return one scan of every LiDAR and the nearest image of every camera at one instant.

        The instant is that of the first camera's image, or the middle of the first LiDAR's scan.

        Args:
            stamp_ns: Stamp of a scan of the first LiDAR.
            number: Of the scene: every one is a place of its own.
            motion: Of the vehicle.
            places: `T_base_sensor` of the LiDARs by topic.
        """
        samples = self._near(stamp_ns - _HALF_PERIOD_NS, stamp_ns + _HALF_PERIOD_NS, stamp_ns)
        images = {
            topic: next(s for s in samples[topic] if isinstance(s, CameraImage))
            for topic in self.image_topics
            if samples[topic]
        }
        scans = {t: [s for s in samples[t] if isinstance(s, PointCloud)] for t in self.cloud_topics}
        scans = {topic: found for topic, found in scans.items() if found}
        first = scans[self.cloud_topics[0]][0]
        instant_ns = next((i.stamp_ns for i in images.values()), _middle_ns(first))
        clouds, frames, gap_ns = {}, {}, 0
        notes = []
        for topic, found in scans.items():
            scan = min(found, key=lambda s: abs(_middle_ns(s) - instant_ns))
            clouds[topic] = at_one_instant(scan, motion, places[topic], instant_ns)
            frames[topic] = scan.frame
            gap_ns = max(gap_ns, abs(_middle_ns(scan) - instant_ns))
            if scan.offset_ns is None:
                notes.append(f"no time per point in {topic}: its points were moved as a whole")
        missing = [
            t for t in (*self.cloud_topics, *self.image_topics) if t not in (*scans, *images)
        ]
        notes += [f"nothing of {topic}" for topic in missing]
        notes.append(_motion_note(motion, instant_ns, gap_ns))
        return Stop(
            stamp_ns, stamp_ns, clouds, images, frames, "; ".join(notes), number, moving=True
        )

    def places(self, given: Mapping[str, Transform]) -> dict[str, Transform]:
        """Return `T_base_sensor` of the LiDARs by topic, as given or from the log.

        Raises:
            InsufficientDataError: If one is not known.
        """
        tree = read_static_transforms(self.recording)
        places = dict(given)
        for topic in self.cloud_topics:
            if topic in places:
                continue
            first = next(iter(self.recording.samples(topics=[topic])), None)
            frame = first.frame if first is not None else ""
            found = (tree.lookup(base, frame) for base in _BASE_FRAMES if frame)
            T_base_sensor = next((place for place in found if place is not None), None)
            if T_base_sensor is None:
                raise InsufficientDataError(
                    f"no stop found, and the place of {topic} on the vehicle is not known, which "
                    "is needed to bring the points of a moving vehicle to one instant",
                    where=self.recording.paths[0],
                    remedy="Stand still for 2 s at each place, or give a rig with rough places",
                )
            places[topic] = T_base_sensor
        return places

    def _near(self, first_ns: int, last_ns: int, middle_ns: int) -> dict[str, list[Sample]]:
        """Return the samples of all topics about a span of stamps, the nearest to the middle first.

        What is kept is bounded: twice what a scene can take of each topic.
        """
        topics = (*self.cloud_topics, *self.image_topics)
        kept: dict[str, list[Sample]] = {topic: [] for topic in topics}
        most = 2 * max(self.settings.most_scans, self.settings.most_images)
        delay_ns = self._delay_ns(middle_ns)
        lowest, highest = self.window
        start_ns = max(first_ns + delay_ns - _LOG_DELAY_NS, lowest or 0)
        end_ns = last_ns + delay_ns + _LOG_DELAY_NS
        end_ns = end_ns if highest is None else min(end_ns, highest)
        for sample in self.recording.samples(topics=topics, start_ns=start_ns, end_ns=end_ns):
            if first_ns - _HALF_PERIOD_NS <= sample.stamp_ns <= last_ns + _HALF_PERIOD_NS:
                found = kept[sample.topic]
                found.append(sample)
                found.sort(key=lambda s: abs(s.stamp_ns - middle_ns))
                del found[most:]
        return kept

    def _delay_ns(self, stamp_ns: int) -> int:
        """Return how much later than its stamp the nearest scan of the first LiDAR was logged."""
        nearest = min(self.log_times, key=lambda known_ns: abs(known_ns - stamp_ns))
        return self.log_times[nearest] - nearest


def _core(span: StillSpan) -> tuple[int, int, int]:
    """Return first, last and middle stamp of the part of a span that is read.

    At the ends of a span a board may still settle, which its ranges show late.
    """
    middle_ns = (span.first_ns + span.last_ns) // 2
    length_ns = span.last_ns - span.first_ns
    settle_ns = min(_SETTLE_NS, length_ns // 4) if length_ns >= _LONG_NS else 0
    first_ns, last_ns = span.first_ns + settle_ns, span.last_ns - settle_ns
    return max(first_ns, middle_ns - _REACH_NS), min(last_ns, middle_ns + _REACH_NS), middle_ns


def _sharpness(image: CameraImage) -> float:
    """Return the variance of the Laplacian (Pech-Pacheco 2000): large where edges are sharp."""
    import cv2

    pixels = image.pixels if image.pixels.ndim == 2 else image.pixels[..., 1]
    return float(cv2.Laplacian(np.ascontiguousarray(pixels), cv2.CV_32F).var())


def _middle_ns(scan: PointCloud) -> int:
    if scan.offset_ns is None or not len(scan):
        return scan.stamp_ns
    return scan.stamp_ns + (int(scan.offset_ns.min()) + int(scan.offset_ns.max())) // 2


def _motion_note(motion: Trajectory, instant_ns: int, gap_ns: int) -> str:
    before, after = (motion.at(instant_ns + shift) for shift in (-50_000_000, 50_000_000))
    if before is None or after is None:
        return "at the edge of the odometry"
    way_m = float(np.linalg.norm(after.translation_m - before.translation_m))
    doubt_mm = 1e3 * _ROTATION_DOUBT_RAD * way_m / 2
    return (
        f"moving at {10 * way_m:.1f} m/s; scans up to {gap_ns / 1e6:.0f} ms apart brought to one "
        f"instant; each degree by which a given place is turned wrong adds {doubt_mm:.0f} mm"
    )
