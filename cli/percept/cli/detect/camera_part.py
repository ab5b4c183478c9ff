"""The camera half of `percept detect`: what is settled before the first image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any

from percept.cli.detect.camera_place import camera_place
from percept.cli.detect.lidar_part import LidarPart
from percept.cli.detect.light_states import with_light_states
from percept.cli.detect.models import RunningModel, probed
from percept.core.errors import UsageError
from percept.core.samples import CameraImage
from percept.datasets.cameras import CameraStream
from percept.datasets.recording import Recording, samples_of
from percept.detection.images.undistort import Undistorter
from percept.detection.result import ImageResult
from percept.detection.runner import ImageDetector, ImageJob, detect_on_image
from percept.detection.schedule import ModelSchedule
from percept.detection.space.lensless import LenslessDetector
from percept.detection.space.placing import CameraPlace

__all__ = ["CameraPart", "plan_cameras"]

_PROBED_IMAGES = 2  # of each camera
_MOST_READ = 400
_WHOLE = 0.99


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraPart:
    """The cameras of a run and the networks that look at them.

    Attributes:
        cameras: Cameras by topic.
        models: Networks in the order in which they look at an image.
        schedule: Whose turn it is.
        detectors: By camera, what looks at its images, by name of the network.
        messages_in_log: Images of these cameras, with depth images and those that no network sees.
        images_expected: Images that will be looked at.
    """

    cameras: Mapping[str, CameraStream]
    models: tuple[RunningModel, ...]
    schedule: ModelSchedule
    detectors: Mapping[str, Mapping[str, ImageDetector]]
    messages_in_log: int
    images_expected: int

    def detect(self, job: ImageJob) -> ImageResult:
        """Return what the networks find in an image; for several threads at once."""
        return with_light_states(detect_on_image(job, self.detectors[job.camera]))

    def describe(self) -> list[dict[str, Any]]:
        """Return what was used of each camera, in the types of JSON."""
        return [_describe(camera) for camera in self.cameras.values()]

    def places(self, lidars: LidarPart | None) -> dict[str, CameraPlace]:
        """Return where the cameras are among the LiDARs, as far as lenses and places are known."""
        places = {camera.name: camera_place(camera, lidars) for camera in self.cameras.values()}
        return {name: place for name, place in places.items() if place is not None}

    @property
    def depth_topics(self) -> dict[str, list[str]]:
        """Names of cameras by the topic of the depth images that show their view."""
        topics: dict[str, list[str]] = {}
        for camera in self.cameras.values():
            if camera.depth_topic is not None and camera.camera is not None:
                topics.setdefault(camera.depth_topic, []).append(camera.name)
        return topics

    @property
    def dropped(self) -> dict[str, int]:
        """Boxes that the networks put out and that were left out, by network and reason."""
        dropped = Counter[str]()
        for model in self.models:
            counts = Counter(model.detector.dropped)
            for detectors in self.detectors.values():
                if isinstance(lensless := detectors[model.name], LenslessDetector):
                    counts += lensless.dropped
            dropped.update({f"{model.name}: {why}": count for why, count in counts.items()})
        return dict(dropped)

    @property
    def notes(self) -> list[str]:
        """What a user should know of cameras and networks, as sentences."""
        cameras = [
            f"{camera.name}: {note}" for camera in self.cameras.values() for note in camera.notes
        ]
        models = [f"{model.name}: {note}" for model in self.models for note in model.notes]
        return [*cameras, *self._unseen_rims(), *models]

    def _unseen_rims(self) -> list[str]:
        shares = {
            camera: detector.seen_share
            for camera, detectors in self.detectors.items()
            for detector in detectors.values()
            if isinstance(detector, LenslessDetector)
        }
        return [
            f"{camera}: an image without its lens shows {share:.0%} of the recorded one; "
            "nothing is found at the rim"
            for camera, share in shares.items()
            if share < _WHOLE
        ]


def plan_cameras(
    recording: Recording,
    cameras: Iterable[CameraStream],
    models: Iterable[RunningModel],
    *,
    undistort: bool,
    window_ns: tuple[int | None, int | None],
) -> CameraPart:
    """Settle how the networks look at the cameras, and whether they find anything at first.

    Args:
        recording: The log.
        cameras: The cameras.
        models: The networks.
        undistort: Whether the lens is taken out of the images.
        window_ns: First and last log time that are wanted.

    Raises:
        UsageError: If a lens is to be taken out that is not known, or two cameras are one topic.
    """
    by_topic = _by_topic(cameras)
    first = list(_first_images(recording, by_topic, window_ns))
    models = tuple(probed(model, first) for model in models)
    schedule = ModelSchedule({model.name: model.every for model in models})
    topics, depths = recording.topics(), {camera.depth_topic for camera in by_topic.values()}
    counts = [topic.count for topic in topics if topic.topic in by_topic]
    return CameraPart(
        cameras=by_topic,
        models=models,
        schedule=schedule,
        detectors={
            camera.name: _detectors_of(camera, models, undistort=undistort)
            for camera in by_topic.values()
        },
        messages_in_log=sum(counts) + sum(t.count for t in topics if t.topic in depths),
        images_expected=sum(bool(schedule.models_at(k)) for n in counts for k in range(n)),
    )


def _by_topic(cameras: Iterable[CameraStream]) -> dict[str, CameraStream]:
    by_topic: dict[str, CameraStream] = {}
    for camera in cameras:
        other = by_topic.setdefault(camera.topic, camera)
        if other is not camera:
            raise UsageError(
                f"'{other.name}' and '{camera.name}' are one camera",
                where=camera.topic,
                remedy="Name each topic once, in --topic or in the rig",
            )
    return by_topic


def _detectors_of(
    camera: CameraStream, models: tuple[RunningModel, ...], *, undistort: bool
) -> dict[str, ImageDetector]:
    if not undistort:
        return {model.name: model.detector for model in models}
    if camera.camera is None:
        raise UsageError(
            f"the lens of {camera.name} is not known",
            where="--undistort",
            remedy="Give --rig with its intrinsics, or leave the images as they are",
        )
    undistorter = Undistorter(camera.camera)
    return {model.name: LenslessDetector(model.detector, undistorter) for model in models}


def _first_images(
    recording: Recording,
    cameras: Mapping[str, CameraStream],
    window_ns: tuple[int | None, int | None],
) -> Iterator[CameraImage]:
    """Yield the first images of each camera that can be decoded."""
    start_ns, end_ns = window_ns
    messages = recording.undecoded(topics=[*cameras], start_ns=start_ns, end_ns=end_ns)
    missing = dict.fromkeys(cameras, _PROBED_IMAGES)
    for message in islice(messages, _MOST_READ):
        if missing.get(message.topic):
            for image in samples_of([message]):
                if isinstance(image, CameraImage):
                    missing[message.topic] -= 1
                    yield image
        if not any(missing.values()):
            return


def _describe(camera: CameraStream) -> dict[str, Any]:
    lens, place = camera.camera, camera.T_base_sensor
    return {
        "name": camera.name,
        "topic": camera.topic,
        "frame": camera.frame,
        "image_size": None if camera.image_size is None else list(camera.image_size),
        "lens": None if lens is None else lens.model,
        "K": None if lens is None else lens.K.tolist(),
        "distortion": None if lens is None else lens.distortion.tolist(),
        "T_base_camera": None if place is None else place.matrix.tolist(),
        "notes": list(camera.notes),
    }
