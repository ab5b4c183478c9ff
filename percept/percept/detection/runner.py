"""Work on many images at once, results in the order of the log.

`ordered_map` is the pool: the caller's thread reads jobs and takes results, workers do the rest.
What makes threads worth it lets go of Python's lock: JPEG decoding, resizing, the network and
the compiled kernels. `detect_on_image` is the work on one image.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

from numpy.typing import NDArray

from percept.core.errors import InputError, PerceptError
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.detection.result import ImageResult

__all__ = ["ImageDetector", "ImageJob", "detect_on_image", "ordered_map"]

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def ordered_map(
    function: Callable[[_Job], _Result],
    jobs: Iterable[_Job],
    *,
    workers: int,
    ahead: int | None = None,
) -> Generator[_Result, None, None]:
    """Yield `function(job)` for each job, in the order of the jobs, from a pool of threads.

    Jobs are read on the calling thread, and only when there is room for them, so that memory is
    that of `ahead` jobs and results. An exception of a job is raised in its place; where reading
    the jobs ends in a `PerceptError`, that comes behind the results of all jobs before it.
    Closing the iterator, or an exception, cancels what has not begun and waits for what runs.

    Args:
        function: The work; called from several threads at once.
        jobs: What to work on; may be endless.
        workers: Threads, at least 1.
        ahead: Most jobs that wait, run, or are done and not yet taken, at least 1; twice the
            workers and two more where it is None.
    """
    most = 2 * workers + 2 if ahead is None else ahead
    in_flight: deque[Future[_Result]] = deque()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="percept")
    try:
        for future in _submitted(pool, function, jobs):
            in_flight.append(future)
            if len(in_flight) >= most:
                yield in_flight.popleft().result()
        while in_flight:
            yield in_flight.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submitted(
    pool: ThreadPoolExecutor, function: Callable[[_Job], _Result], jobs: Iterable[_Job]
) -> Iterator[Future[_Result]]:
    """Hand in the jobs one by one; an expected error that ends them is the last of the futures."""
    try:
        for job in jobs:
            yield pool.submit(function, job)
    except PerceptError as error:
        failed: Future[_Result] = Future()
        failed.set_exception(error)
        yield failed


class ImageDetector(Protocol):
    """What finds boxes in an image, such as `YoloDetector`; several threads call it at once."""

    def detect_one(self, pixels: NDArray[Any]) -> tuple[Detections2D, Mapping[str, float]]:
        """Return the boxes in pixels of the image, and milliseconds by stage.

        Raises:
            GeometryError: If the pixels are no image, such as one of zero size.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageJob:
    """One image that waits to be decoded and looked at.

    Attributes:
        frame: Number of the image in the run, over all cameras, from 0.
        camera: Name of the camera.
        stamp_ns: Time of the image, or None where only the recorder's is known.
        log_time_ns: Time of recording.
        models: Names of the models whose turn it is.
        load: Decodes the image; called once, on a worker. Raises `DecodeError`.
    """

    frame: int
    camera: str
    stamp_ns: int | None
    log_time_ns: int
    models: tuple[str, ...]
    load: Callable[[], CameraImage]


def detect_on_image(job: ImageJob, detectors: Mapping[str, ImageDetector]) -> ImageResult:
    """Decode an image once and show it to every model whose turn it is, in the job's order.

    An image that cannot be used is a result with the reason in `failure`. Where one model
    cannot judge it, that model is named there and the boxes of the others are kept.

    Args:
        job: The image.
        detectors: Models by name; at least those of the job.
    """
    stamp_ns = job.log_time_ns if job.stamp_ns is None else job.stamp_ns
    result = ImageResult(
        frame=job.frame,
        camera=job.camera,
        stamp_ns=stamp_ns,
        log_time_ns=job.log_time_ns,
        image=None,
    )
    start = time.perf_counter()
    try:
        image = job.load()
    except InputError as error:
        return replace(result, failure=error.what)
    decode_ms = 1e3 * (time.perf_counter() - start)
    boxes: dict[str, Detections2D] = {}
    timings_ms: dict[str, Mapping[str, float]] = {}
    failures: list[str] = []
    for name in job.models:
        try:
            found, timings_ms[name] = detectors[name].detect_one(image.pixels)
        except InputError as error:
            failures.append(f"{name}: {error.what}")
        else:
            boxes[name] = replace(found, stamp_ns=stamp_ns, camera=job.camera)
    return replace(
        result,
        image=image,
        boxes=boxes,
        decode_ms=decode_ms,
        timings_ms=timings_ms,
        failure="; ".join(failures) or None,
    )
