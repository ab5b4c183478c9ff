"""One pass over a log: each wanted image is decoded once, and its files are written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from percept.cli.dataset.drives import DrivePlan
from percept.cli.dataset.journal import CollectedImage, CollectedScan, Journal
from percept.core.errors import DecodeError, InputError
from percept.core.samples import CameraImage, PointCloud
from percept.core.transform import Transform
from percept.datasets.labelling.choice.moments import Moment, taken_ns
from percept.datasets.labelling.images.image_files import ImageWriter
from percept.datasets.labelling.names import safe_name
from percept.datasets.labelling.scan_files import write_scan
from percept.datasets.recording import Recording, UndecodedMessage
from percept.detection.cores import available_cores
from percept.detection.runner import ordered_map

__all__ = ["Collector"]


@dataclass(slots=True)
class _ScanJob:
    moment: Moment
    wanted: set[str]
    messages: dict[str, UndecodedMessage] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _ImageJob:
    topic: str
    stamp_ns: int
    message: UndecodedMessage | None


def _reason(error: InputError) -> str:
    """Return why a message is left out, in words that its like share: reasons are counted."""
    if not isinstance(error, DecodeError):
        return error.what
    return re.sub(r"\b\d+\b", "N", error.what.partition(" (")[0])


class Collector:
    """Writes the files of one log's keyframes, and says in a journal what is there.

    Args:
        folder: Where the files go.
        plan: The log.
        writer: Writes images.
        journal: What is finished already is not done again.
        with_scans: Whether points are wanted.
    """

    def __init__(
        self,
        folder: Path,
        plan: DrivePlan,
        writer: ImageWriter,
        journal: Journal,
        *,
        with_scans: bool,
    ) -> None:
        self._folder = folder
        self._plan = plan
        self._writer = writer
        self._journal = journal
        self._images = {
            (topic, stamp_ns)
            for moment in plan.moments
            for topic, stamp_ns in moment.images.items()
            if (plan.name, topic, stamp_ns) not in journal.images
        }
        self._scans: dict[tuple[str, int], _ScanJob] = {}
        for moment in plan.moments if with_scans else ():
            if moment.scans and (plan.name, moment.instant.stamp_ns) not in journal.scans:
                job = _ScanJob(moment, set(moment.scans))
                self._scans |= dict.fromkeys(moment.scans.items(), job)
        (folder / "scans").mkdir(exist_ok=True)

    def __len__(self) -> int:
        """Return the number of messages that are wanted and not there yet."""
        return len(self._images) + len(self._scans)

    def run(self, recording: Recording, on_done: Callable[[int], None]) -> None:
        """Go through the log.

        Args:
            recording: The log.
            on_done: Is called with the number of messages that are finished.

        Raises:
            OSError: If a file cannot be written.
        """
        if not len(self):
            return
        done = 0
        with closing(
            ordered_map(self._work, self._jobs(recording), workers=available_cores())
        ) as all_:
            for collected in all_:
                self._journal.add(collected)
                done += 1 if isinstance(collected, CollectedImage) else len(collected.offsets_ns)
                on_done(done)

    def _jobs(self, recording: Recording) -> Iterator[_ImageJob | _ScanJob]:
        topics = {topic for topic, _ in (*self._images, *self._scans)}
        for message in recording.undecoded(topics=topics):
            stamp_ns = taken_ns(
                message.stamp_ns,
                message.log_time_ns,
                unstamped=message.topic in self._plan.stamps.unstamped,
            )
            key = (message.topic, stamp_ns)
            if key in self._images:
                self._images.remove(key)
                yield _ImageJob(message.topic, stamp_ns, message)
            elif key in self._scans:
                job = self._scans.pop(key)
                job.messages[message.topic] = message
                if job.messages.keys() == job.wanted:
                    yield job
            if not self._images and not self._scans:
                return
        # What the log did not bring a second time, such as a file that changed meanwhile.
        for topic, stamp_ns in sorted(self._images):
            yield _ImageJob(topic, stamp_ns, None)
        yield from {id(job): job for job in self._scans.values()}.values()

    def _work(self, job: _ImageJob | _ScanJob) -> CollectedImage | CollectedScan:
        return self._image(job) if isinstance(job, _ImageJob) else self._scan(job)

    def _image(self, job: _ImageJob) -> CollectedImage:
        plan, topic = self._plan, job.topic
        camera = safe_name(plan.streams[topic].name)
        stem = f"{plan.name}_{camera}_{job.stamp_ns}"
        written, failure = None, ""
        try:
            if job.message is None:
                raise InputError("was not in the log a second time", where=topic)
            (image,) = job.message.decode()
            if not isinstance(image, CameraImage):
                raise InputError("is no image", where=topic)
            written = self._writer.write(image, stem, plan.lenses.get(topic))
        except InputError as error:
            failure = _reason(error)
        return CollectedImage(
            drive=plan.name, topic=topic, stamp_ns=job.stamp_ns, written=written, failure=failure
        )

    def _scan(self, job: _ScanJob) -> CollectedScan:
        key_ns = job.moment.instant.stamp_ns
        clouds, places, motions = [], [], []
        offsets_ns: dict[str, int] = {}
        failures: dict[str, int] = {}
        for topic in self._plan.lidars:  # in their order, whichever came first
            message = job.messages.get(topic)
            if message is None:
                continue
            lidar = self._plan.lidars[topic]
            try:
                (cloud,) = message.decode()
            except DecodeError as error:
                why = f"scans on {topic}: {_reason(error)}"
                failures[why] = failures.get(why, 0) + 1
                continue
            if isinstance(cloud, PointCloud) and lidar.T_base_sensor is not None:
                clouds.append(cloud)
                places.append(lidar.T_base_sensor)
                stamp_ns = job.moment.scans[topic]
                motions.append(self._motion(stamp_ns, key_ns))
                offsets_ns[lidar.name] = stamp_ns - key_ns
        file = f"scans/{self._plan.name}_{key_ns}.bin"
        points = write_scan(self._folder / file, clouds, places, motions) if clouds else 0
        return CollectedScan(
            drive=self._plan.name,
            key_ns=key_ns,
            file=file if clouds else "",
            stamp_ns=key_ns + next(iter(offsets_ns.values()), 0),
            points=points,
            offsets_ns=offsets_ns,
            failures=failures,
        )

    def _motion(self, then_ns: int, key_ns: int) -> Transform | None:
        """Return `T_base_base_then`: from the base frame at a time into that at the keyframe's."""
        poses = self._plan.poses
        if poses is None or then_ns == key_ns:
            return None
        then, at_key = poses.at(then_ns), poses.at(key_ns)
        return None if then is None or at_key is None else at_key.inverse() @ then
