"""The work of a run: all scans and images that are not finished, brought out in log order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import islice

from percept.cli.detect.conclude import PassFacts
from percept.cli.detect.one_pass import (
    DepthIntake,
    Done,
    Finished,
    FinishedDepth,
    FinishedScan,
    ImageIntake,
    Intake,
    ScanIntake,
    results_of,
)
from percept.cli.detect.outputs import RunOutputs
from percept.cli.detect.plan import RunPlan
from percept.cli.progress import progress_bar
from percept.core.clock import NS_PER_MS
from percept.core.samples import CameraImage
from percept.datasets.recording import Recording
from percept.detection.cores import available_cores
from percept.detection.result import ImageResult
from percept.detection.runner import ordered_map
from percept.detection.space.placing import BoxPlacer
from percept.detection.space.scan_match import ImageMatch

__all__ = ["work_through"]

_RESUMED = (
    "The run was resumed: boxes that the networks left out, and images without a scan, are "
    "counted since then.",
)


def work_through(
    recording: Recording,
    plan: RunPlan,
    outputs: RunOutputs,
    check_interrupt: Callable[[], None],
) -> PassFacts:
    """Work on all scans and images that are not finished, and bring them out in log order.

    Args:
        recording: The log.
        plan: What is settled.
        outputs: Takes what is finished.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.
    """
    start_s = time.monotonic()
    placer = _placer(plan)
    again_from_ns = _again_from_ns(recording, plan, placer, outputs.done)
    scans = images = None
    intakes: list[Intake] = []
    if plan.lidars is not None:
        scans = ScanIntake(plan.lidars, outputs.done, again_from_ns)
        intakes.append(scans)
    if plan.cameras is not None:
        images = ImageIntake(plan.cameras, outputs.done)
        intakes += [images, DepthIntake(plan.cameras.depth_topics, again_from_ns)]
    with progress_bar("detecting", plan.expected) as advance:

        def step() -> None:
            advance(sum(intake.seen for intake in intakes))
            check_interrupt()

        _bring_out(recording, plan, intakes, placer, outputs, step)
    gap_ms = plan.config.camera.max_scan_gap_ms
    return PassFacts(
        dropped={
            **(scans.dropped if scans is not None else {}),
            **(plan.cameras.dropped if plan.cameras is not None else {}),
            **placer.dropped,
            **{
                f"images of {camera} without a scan or depth image within {gap_ms:g} ms": count
                for camera, count in placer.unmatched.items()
            },
        },
        off_turn=images.off_turn if images is not None else 0,
        wall_s=time.monotonic() - start_s,
        notes=_RESUMED if outputs.done != Done() else (),
    )


def _bring_out(
    recording: Recording,
    plan: RunPlan,
    intakes: list[Intake],
    placer: BoxPlacer,
    outputs: RunOutputs,
    step: Callable[[], None],
) -> None:
    """Pass all through two pools: one finds objects, the other tells where those in images are."""
    with closing(results_of(recording, plan.window_ns, intakes)) as results:
        matches = _matches(results, placer, outputs, step)
        with closing(ordered_map(placer.place, matches, workers=available_cores())) as images:
            for image in images:
                outputs.add_image(image)


def _matches(
    results: Iterator[Finished], placer: BoxPlacer, outputs: RunOutputs, step: Callable[[], None]
) -> Iterator[ImageMatch]:
    """Hand over finished scans, and yield images that wait for no other sensor any more."""
    for found in results:
        match found:
            case FinishedScan():
                if not found.again:
                    outputs.add_scan(found.frame, found.result)
                yield from placer.add_scan(found.result)
            case FinishedDepth(image=CameraImage() as depth):
                for camera in found.cameras:
                    yield from placer.add_depth(camera, depth)
            case ImageResult():
                yield from placer.add_image(found)
        step()
    yield from placer.end()


def _placer(plan: RunPlan) -> BoxPlacer:
    places = plan.cameras.places(plan.lidars) if plan.cameras is not None else {}
    return BoxPlacer(places, round(plan.config.camera.max_scan_gap_ms * NS_PER_MS))


def _again_from_ns(
    recording: Recording, plan: RunPlan, placer: BoxPlacer, done: Done
) -> int | None:
    """Return the stamp from which images that are not finished need scans that are."""
    if plan.cameras is None or placer.reach_ns is None or done == Done():
        return None
    start_ns, end_ns = plan.window_ns
    images = (
        image
        for image in recording.envelopes(topics=[*plan.cameras.cameras])
        if (start_ns is None or image.log_time_ns >= start_ns)
        and (end_ns is None or image.log_time_ns <= end_ns)
    )
    left = islice(images, done.next_image, None)
    stamps_ns = (i.log_time_ns if i.stamp_ns is None else i.stamp_ns for i in left)
    oldest_ns = min(stamps_ns, default=None)
    return None if oldest_ns is None else oldest_ns - placer.reach_ns
