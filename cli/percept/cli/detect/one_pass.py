"""One pass over a log: scans and images go through one pool and come back in log order.

The calling thread reads messages without decoding images, and brings scans together that belong
together. Workers detect in scans, decode images and run the networks. What an earlier session
finished is not done again, but for the scans that tell where the boxes are in images that it left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeAlias

from percept.cli.detect.lidar_part import LidarPart
from percept.cli.detect.lidar_streams import ScanFeed
from percept.core.errors import DecodeError
from percept.core.samples import CameraImage, PointCloud
from percept.datasets.recording import Recording, UndecodedMessage
from percept.detection.cores import available_cores
from percept.detection.result import ImageResult
from percept.detection.runner import ImageJob, ordered_map
from percept.lidar.result import ScanResult

if TYPE_CHECKING:  # the networks' runtime is not loaded where no network runs
    from percept.cli.detect.camera_part import CameraPart

__all__ = [
    "DepthIntake",
    "Done",
    "Finished",
    "FinishedDepth",
    "FinishedScan",
    "ImageIntake",
    "Intake",
    "ScanIntake",
    "results_of",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What an earlier session of a resumed run finished.

    Attributes:
        next_scan: Number of the first scan that is not finished.
        next_image: Number of the first image that is not.
    """

    next_scan: int = 0
    next_image: int = 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FinishedScan:
    """One scan, after detection.

    Attributes:
        frame: Number of the scan in the run, from 0.
        result: What was found.
        again: Whether an earlier session finished it too: only images wait for it.
    """

    frame: int
    result: ScanResult
    again: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FinishedDepth:
    """One depth image.

    Attributes:
        cameras: Names of the cameras whose view it shows.
        image: The image; None where it cannot be decoded.
    """

    cameras: tuple[str, ...]
    image: CameraImage | None


Finished: TypeAlias = FinishedScan | FinishedDepth | ImageResult
_Job: TypeAlias = Callable[[], Finished]


class Intake(Protocol):
    """Turns messages of some topics into jobs.

    Attributes:
        topics: The topics.
        seen: Scans or images that came so far.
    """

    topics: tuple[str, ...]
    seen: int

    def take(self, message: UndecodedMessage) -> Iterator[_Job]:
        """Take a message, and yield the jobs that are complete with it."""
        ...

    def end(self) -> Iterator[_Job]:
        """Yield what is left at the end of the log."""
        ...


class ScanIntake:
    """The scans of a log as jobs, those together that belong together.

    Args:
        part: The LiDAR half.
        done: What is finished already.
        again_from_ns: Stamp from which finished scans are judged again; None for never.

    Attributes:
        topics: Topics of the LiDARs.
        dropped: Scans that were left out, by reason.
        seen: Scans that came, finished ones too.
    """

    def __init__(self, part: LidarPart, done: Done, again_from_ns: int | None) -> None:
        self.topics = part.streams.topics
        self.dropped: Counter[str] = Counter()
        self.seen = 0
        self._part = part
        self._next_scan = done.next_scan
        self._again_from_ns = again_from_ns
        self._feed = ScanFeed(part.streams)

    def take(self, message: UndecodedMessage) -> Iterator[_Job]:
        """Decode a message, and yield the scans that are complete with it."""
        try:
            samples = message.decode()
        except DecodeError:
            return  # the recording counts and names it
        for scan in samples:
            if isinstance(scan, PointCloud):
                yield from self._jobs(self._feed.push(scan))

    def end(self) -> Iterator[_Job]:
        """Yield what is left at the end of the log."""
        yield from self._jobs(self._feed.flush())

    def _jobs(self, complete: list[tuple[str, tuple[PointCloud, ...]]]) -> Iterator[_Job]:
        for stream, scans in complete:
            if stream not in self._part.detectors:
                self.dropped[f"scans of {stream} without a point"] += 1
                continue
            frame, self.seen = self.seen, self.seen + 1
            again = frame < self._next_scan
            if not again or self._is_asked_for(scans[0].stamp_ns):
                yield partial(self._detect, frame, stream, scans, again=again)

    def _detect(
        self, frame: int, stream: str, scans: tuple[PointCloud, ...], *, again: bool
    ) -> FinishedScan:
        result = self._part.detect(stream, scans)
        return FinishedScan(frame=frame, result=result, again=again)

    def _is_asked_for(self, stamp_ns: int) -> bool:
        return self._again_from_ns is not None and stamp_ns >= self._again_from_ns


class DepthIntake:
    """The depth images of a log as jobs.

    Args:
        cameras: Names of the cameras whose view they show, by topic.
        from_ns: Stamp from which images are left that need them; None where all are.

    Attributes:
        topics: Topics of depth images.
        seen: Depth images that came.
    """

    def __init__(self, cameras: Mapping[str, Sequence[str]], from_ns: int | None) -> None:
        self.topics = tuple(cameras)
        self.seen = 0
        self._cameras = cameras
        self._from_ns = from_ns

    def take(self, message: UndecodedMessage) -> Iterator[_Job]:
        """Yield the job of a depth image."""
        self.seen += 1
        stamp_ns = message.log_time_ns if message.stamp_ns is None else message.stamp_ns
        if self._from_ns is None or stamp_ns >= self._from_ns:
            yield partial(_depth_in, message, tuple(self._cameras[message.topic]))

    def end(self) -> Iterator[_Job]:
        """Yield nothing: a depth image is complete when it comes."""
        yield from ()


class ImageIntake:
    """The images of a log as jobs for the models whose turn it is.

    Args:
        part: The camera half.
        done: What is finished already.

    Attributes:
        topics: Topics of the cameras.
        seen: Images that came, finished ones too.
        off_turn: Images at which it was no model's turn.
    """

    def __init__(self, part: CameraPart, done: Done) -> None:
        self.topics = tuple(part.cameras)
        self.seen = 0
        self.off_turn = 0
        self._part = part
        self._done = done
        self._by_camera: Counter[str] = Counter()

    def take(self, message: UndecodedMessage) -> Iterator[_Job]:
        """Yield the job of an image, if there is one."""
        frame, self.seen = self.seen, self.seen + 1
        camera = self._part.cameras[message.topic].name
        models = self._part.schedule.models_at(self._by_camera[camera])
        self._by_camera[camera] += 1
        if not models:
            self.off_turn += 1
        elif frame >= self._done.next_image:
            job = ImageJob(
                frame=frame,
                camera=camera,
                stamp_ns=message.stamp_ns,
                log_time_ns=message.log_time_ns,
                models=models,
                load=partial(_image_in, message),
            )
            yield partial(self._part.detect, job)

    def end(self) -> Iterator[_Job]:
        """Yield nothing: an image is complete when it comes."""
        yield from ()


def results_of(
    recording: Recording, window_ns: tuple[int | None, int | None], intakes: Sequence[Intake]
) -> Generator[Finished, None, None]:
    """Read a log once, and yield what is found in the order of the log, by all cores.

    Args:
        recording: The log.
        window_ns: First and last log time that are wanted.
        intakes: What turns its messages into jobs.
    """
    by_topic = {topic: intake for intake in intakes for topic in intake.topics}
    start_ns, end_ns = window_ns

    def jobs() -> Iterator[_Job]:
        for message in recording.undecoded(topics=[*by_topic], start_ns=start_ns, end_ns=end_ns):
            yield from by_topic[message.topic].take(message)
        for intake in intakes:
            yield from intake.end()

    return ordered_map(_work, jobs(), workers=available_cores())


def _work(job: _Job) -> Finished:
    return job()


def _depth_in(message: UndecodedMessage, cameras: tuple[str, ...]) -> FinishedDepth:
    try:
        return FinishedDepth(cameras=cameras, image=_image_in(message))
    except DecodeError:  # the recording counts and names it
        return FinishedDepth(cameras=cameras, image=None)


def _image_in(message: UndecodedMessage) -> CameraImage:
    for sample in message.decode():
        if isinstance(sample, CameraImage):
            return sample
    raise DecodeError("the message holds no image", where=message.topic)
