"""The images that `percept lanes` looks at: files, or those of a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percept.cli.lanes.request import LaneRequest
from percept.cli.window import log_window_ns
from percept.core.errors import InputError, TopicNotFoundError, UsageError
from percept.core.rig import CameraSensor, load_rig
from percept.core.samples import CameraImage

if TYPE_CHECKING:
    from percept.datasets.recording import Recording

__all__ = ["LaneImage", "camera_of", "lane_images"]


@dataclass(frozen=True, slots=True, eq=False)
class LaneImage:
    """One image.

    Attributes:
        name: The file, or the topic and the number in it.
        stamp_ns: Its time, in a log.
        pixels: (H, W, 3) uint8 BGR.
    """

    name: str
    stamp_ns: int | None
    pixels: Any


def camera_of(request: LaneRequest) -> CameraSensor | None:
    """Return the camera of the rig, or None without a rig.

    Raises:
        UsageError: If the rig has no such camera, or several and none was named.
    """
    if request.rig is None:
        if request.camera is not None:
            raise UsageError("--camera names a camera of a rig", remedy="Give --rig")
        return None
    cameras = load_rig(request.rig).cameras()
    if request.camera is None and len(cameras) == 1:
        return next(iter(cameras.values()))
    if request.camera not in cameras:
        known = ", ".join(cameras) or "none"
        what = "several cameras" if request.camera is None else f"no camera '{request.camera}'"
        raise UsageError(
            f"the rig has {what}", where=request.rig, remedy=f"Give --camera; it has: {known}"
        )
    return cameras[request.camera]


@contextmanager
def lane_images(
    request: LaneRequest, camera: CameraSensor | None, dropped: Counter[str]
) -> Iterator[tuple[int | None, Iterator[LaneImage]]]:
    """Open what was asked for, and yield how many images there are, if known, and the images.

    Args:
        request: The request.
        camera: The camera, whose topic is that of a log where none was named.
        dropped: Counts what cannot be used, by reason.

    Raises:
        UsageError: If neither images nor a log were given, or both.
        InputError: If one cannot be read.
    """
    if bool(request.images) == bool(request.bags):
        raise UsageError("give either --image or --bag", remedy="Name at least one of them")
    if request.images:
        yield len(request.images), (_read(path) for path in request.images)
        return
    from percept.datasets import open_recording

    with open_recording(list(request.bags)) as recording:
        topic = _topic(recording, request, camera)
        yield _count(recording, request, topic), _of_log(recording, request, topic, dropped)


def _read(path: Path) -> LaneImage:
    from percept.calib.intrinsics.images import decode_image

    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    return LaneImage(str(path), None, decode_image(content, str(path)))


def _of_log(
    recording: Recording,
    request: LaneRequest,
    topic: str,
    dropped: Counter[str],
) -> Iterator[LaneImage]:
    from percept.export.canvas import as_bgr

    start_ns, end_ns = log_window_ns(recording, request.start_s, request.end_s)
    samples = recording.samples(topics=[topic], start_ns=start_ns, end_ns=end_ns)
    for number, sample in enumerate(samples):
        if not isinstance(sample, CameraImage):
            dropped[f"messages of {topic} that are no image"] += 1
        elif number % request.every == 0:
            yield LaneImage(f"{topic}#{number}", sample.stamp_ns, as_bgr(sample.pixels))


def _count(recording: Recording, request: LaneRequest, topic: str) -> int | None:
    """Return how many images of a log will be looked at; None for a part of it."""
    if request.start_s is not None or request.end_s is not None:
        return None
    messages = sum(info.count for info in recording.topics() if info.topic == topic)
    return -(-messages // request.every)


def _topic(recording: Recording, request: LaneRequest, camera: CameraSensor | None) -> str:
    known = [info.topic for info in recording.topics() if info.sample_type is CameraImage]
    wanted = request.topic or (None if camera is None else camera.topic)
    if wanted is None and len(known) == 1:
        return known[0]
    if wanted not in known:
        what = "no image topic was named" if wanted is None else f"no image topic '{wanted}'"
        raise TopicNotFoundError(
            what, remedy=f"Give --topic; the log has: {', '.join(known) or 'none'}"
        )
    return wanted
