"""The pool that keeps the order, and the work on one image."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import DecodeError, GeometryError, InputError, RecordingError
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.detection.runner import ImageJob, detect_on_image, ordered_map


class Meter:
    """Jobs that count how many were read and not yet handed back."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.read = 0
        self.taken = 0
        self.most_open = 0

    def __iter__(self) -> Iterator[int]:
        for number in range(self.count):
            self.read += 1
            self.most_open = max(self.most_open, self.read - self.taken)
            yield number


class TestOrderedMap:
    @pytest.mark.parametrize("workers", [1, 2, 5])
    @pytest.mark.parametrize("ahead", [None, 1, 2, 40])
    def test_gives_every_result_in_the_order_of_the_jobs(
        self, workers: int, ahead: int | None
    ) -> None:
        # Every third job waits for the one behind it where there is a thread for both.
        done = [threading.Event() for _ in range(31)]
        both = workers > 1 and ahead != 1

        def work(number: int) -> int:
            if both and number % 3 == 0:
                assert done[number + 1].wait(10)
            done[number].set()
            return number * number

        found = list(ordered_map(work, range(30), workers=workers, ahead=ahead))
        assert found == [number * number for number in range(30)]

    def test_no_jobs_give_no_results(self) -> None:
        assert list(ordered_map(str, [], workers=2)) == []

    @pytest.mark.parametrize(("ahead", "most"), [(None, 6), (1, 1), (4, 4)])
    def test_reads_no_further_ahead_than_asked(self, ahead: int | None, most: int) -> None:
        meter = Meter(50)
        for _ in ordered_map(str, meter, workers=2, ahead=ahead):
            meter.taken += 1
        assert (meter.read, meter.taken) == (50, 50)
        assert meter.most_open == most

    def test_jobs_are_read_on_the_calling_thread_only(self) -> None:
        readers, workers = set(), set()

        def jobs() -> Iterator[int]:
            for number in range(20):
                readers.add(threading.get_ident())
                yield number

        def work(number: int) -> int:
            workers.add(threading.get_ident())
            return number

        list(ordered_map(work, jobs(), workers=2))
        assert readers == {threading.get_ident()}
        assert threading.get_ident() not in workers

    def test_endless_jobs_end_with_the_consumer(self) -> None:
        before = threading.active_count()
        results = ordered_map(str, iter(int, 1), workers=3)
        assert [next(results) for _ in range(5)] == ["0"] * 5
        results.close()
        assert threading.active_count() == before

    def test_an_exception_of_a_job_is_raised_in_its_place(self) -> None:
        before = threading.active_count()
        results = ordered_map(lambda n: 12 // (3 - n), range(100), workers=2)
        assert [next(results) for _ in range(3)] == [4, 6, 12]
        with pytest.raises(ZeroDivisionError):
            next(results)
        assert threading.active_count() == before
        assert list(results) == []

    def test_a_log_that_breaks_gives_first_what_came_before(self) -> None:
        def jobs() -> Iterator[int]:
            yield from range(4)
            raise RecordingError("the disk is gone")

        results = ordered_map(int, jobs(), workers=2, ahead=10)
        assert [next(results) for _ in range(4)] == [0, 1, 2, 3]
        with pytest.raises(RecordingError, match="the disk is gone"):
            next(results)

    def test_closing_begins_no_waiting_job(self) -> None:
        begun: list[int] = []
        second, go = threading.Event(), threading.Event()

        def work(number: int) -> int:
            begun.append(number)
            if number == 1:
                second.set()
                assert go.wait(10)
            return number

        results = ordered_map(work, range(50), workers=1, ahead=20)
        assert next(results) == 0
        assert second.wait(10)
        later = threading.Timer(0.1, go.set)
        later.start()
        results.close()
        later.join()
        assert begun == [0, 1]


def image(height: int = 8, width: int = 6) -> CameraImage:
    pixels = np.full((height, width, 3), 7, np.uint8)
    return CameraImage(topic="/cam", stamp_ns=5, log_time_ns=9, pixels=pixels, encoding="jpeg")


class Detector:
    """Finds one box a model, as large as the image, and remembers which images it saw."""

    def __init__(self, label: str, error: InputError | None = None) -> None:
        self.label = label
        self.error = error
        self.seen: list[int] = []

    def detect_one(self, pixels: NDArray[Any]) -> tuple[Detections2D, Mapping[str, float]]:
        if self.error is not None:
            raise self.error
        self.seen.append(id(pixels))
        box = np.array([[0.0, 0.0, pixels.shape[1], pixels.shape[0]]])
        found = Detections2D(0, "", box, (self.label,), np.array([0.5]))
        return found, {"prepare": 1.0, "network": 2.0, "boxes": 3.0}


def job(*models: str, load: Any = image, stamp_ns: int | None = 5) -> ImageJob:
    return ImageJob(
        frame=3, camera="front", stamp_ns=stamp_ns, log_time_ns=9, models=models, load=load
    )


class TestDetectOnImage:
    def test_decodes_once_for_the_models_whose_turn_it_is(self) -> None:
        loads = []
        detectors = {name: Detector(name) for name in ("a", "b", "c")}

        def load() -> CameraImage:
            loads.append(1)
            return image()

        result = detect_on_image(job("c", "a", load=load), detectors)
        assert len(loads) == 1
        assert list(result.boxes) == list(result.timings_ms) == ["c", "a"]
        assert detectors["a"].seen == detectors["c"].seen == [id(result.image.pixels)]  # type: ignore[union-attr]
        assert not detectors["b"].seen
        assert (result.frame, result.camera, result.stamp_ns, result.log_time_ns) == (
            3,
            "front",
            5,
            9,
        )
        assert result.boxes["a"].stamp_ns == 5
        assert result.boxes["a"].camera == "front"
        assert result.timings_ms["c"] == {"prepare": 1.0, "network": 2.0, "boxes": 3.0}
        assert result.decode_ms > 0
        assert result.failure is None

    def test_an_image_without_a_stamp_has_the_log_time(self) -> None:
        result = detect_on_image(job("a", stamp_ns=None), {"a": Detector("a")})
        assert result.stamp_ns == result.boxes["a"].stamp_ns == 9

    def test_an_image_that_cannot_be_decoded_is_a_result_that_says_why(self) -> None:
        def load() -> CameraImage:
            raise DecodeError("the jpeg image is cut off", where="/cam", remedy="Record it again")

        result = detect_on_image(job("a", load=load), {"a": Detector("a")})
        assert result.failure == "the jpeg image is cut off"
        assert result.image is None
        assert not result.boxes
        assert (result.frame, result.stamp_ns) == (3, 5)

    def test_a_model_that_cannot_judge_an_image_is_named_and_the_others_go_on(self) -> None:
        error = GeometryError("an image of 0 x 6 pixels")
        detectors = {"a": Detector("a", error), "b": Detector("b"), "c": Detector("c", error)}
        result = detect_on_image(job("a", "b", "c"), detectors)
        assert result.failure == "a: an image of 0 x 6 pixels; c: an image of 0 x 6 pixels"
        assert list(result.boxes) == ["b"]
        assert result.image is not None

    def test_a_bug_is_no_failure_of_the_image(self) -> None:
        with pytest.raises(KeyError):
            detect_on_image(job("unknown"), {"a": Detector("a")})
