"""Pictures of findings, cut from the images of the logs at the looks that show them best."""

from __future__ import annotations

import math
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from percept.cli.map.drive import DriveFacts
from percept.cli.progress import progress_bar
from percept.core.errors import DecodeError
from percept.core.map_findings import Discrepancy, Kind, Look
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.recording import Recording
from percept.export.canvas import Image, as_bgr
from percept.export.map_evidence import EvidenceLook, evidence_of_look, write_evidence
from percept.hdmap import HdMap
from percept.hdmap.validate import StretchOffset

__all__ = ["FOLDER", "cut_evidence"]

FOLDER = "evidence"
_MOST = 500
_AROUND_NS = 2_000_000_000  # an image is written to the log within two seconds of its stamp


def cut_evidence(
    findings: Sequence[Discrepancy],
    folder: Path,
    *,
    drives: Sequence[DriveFacts],
    hd_map: HdMap,
    offsets: Sequence[StretchOffset],
    check_interrupt: Callable[[], None],
) -> dict[str, str]:
    """Write a picture for each finding that an image shows; the folder gets its name when whole.

    Args:
        findings: The findings, those that matter most first.
        folder: The run folder; pictures go into `evidence/` in it.
        drives: The drives, in their order.
        hd_map: The map.
        offsets: How the poses lie against the map.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Returns:
        By finding's id, the picture relative to the run folder.
    """
    shown = findings[:_MOST]
    by_drive: defaultdict[int, list[tuple[int, Discrepancy, Look]]] = defaultdict(list)
    for number, finding in enumerate(shown):
        look = _best_look(finding, drives)
        if look is not None:
            by_drive[look.drive].append((number, finding, look))
    written: dict[str, str] = {}
    if not by_drive:
        return written
    unfinished = folder / f".{FOLDER}.unfinished"
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    done = 0
    try:
        with progress_bar("cutting evidence", len(shown)) as advance:
            for number, wanted in by_drive.items():
                stretches = [offset for offset in offsets if offset.drive == number]
                with open_recording([drives[number].bag]) as recording:
                    for row, finding, look in wanted:
                        check_interrupt()
                        picture = _picture(
                            recording, drives[number], finding, look, hd_map, stretches
                        )
                        if picture is not None:
                            name = f"{row + 1:04d}.png"
                            write_evidence(unfinished / name, picture)
                            written[finding.finding_id] = f"{FOLDER}/{name}"
                        done += 1
                        advance(done)
        unfinished.replace(folder / FOLDER)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return written


def _best_look(finding: Discrepancy, drives: Sequence[DriveFacts]) -> Look | None:
    """Return where a finding is seen best; an offset of all of the way in the middle of it."""
    if finding.kind is not Kind.GLOBAL_OFFSET:
        return next((k for look in finding.looks for k in _of_cameras(look, drives)), None)
    way = finding.points_expected_map
    middle = way[len(way) // 2].tolist()[:2]
    looks = (
        Look(number, sensor, stamp_ns, math.dist(drive.position_m(stamp_ns), middle))
        for number, drive in enumerate(drives)
        for sensor, stamp_ns in drive.grounds
    )
    return min(looks, key=lambda look: look.range_m, default=None)


def _of_cameras(look: Look, drives: Sequence[DriveFacts]) -> Iterator[Look]:
    """Yield a look, or for one of a LiDAR those of the cameras at its time."""
    drive = drives[look.drive]
    names = sorted((c.name for c in drive.cameras.values()), key=lambda name: name != look.sensor)
    for name in names:
        if (name, look.stamp_ns) in drive.grounds:
            yield replace(look, sensor=name)


def _picture(
    recording: Recording,
    drive: DriveFacts,
    finding: Discrepancy,
    look: Look,
    hd_map: HdMap,
    stretches: Sequence[StretchOffset],
) -> Image | None:
    """Return the picture of a finding; None where the look does not show it."""
    camera = _camera_of(drive.cameras, look.sensor)
    image = None if camera is None else _image_at(recording, camera, look)
    T_map_base = drive.poses.at(look.stamp_ns)
    ground = drive.grounds.get((look.sensor, look.stamp_ns))
    if camera is None or image is None or T_map_base is None or ground is None:
        return None
    lateral_m, heading_rad = _shift_at(T_map_base, stretches)
    place = EvidenceLook(camera, T_map_base, ground.height, lateral_m, heading_rad)
    return evidence_of_look(finding, as_bgr(image.pixels), place, hd_map.markings)


def _shift_at(T_map_base: Transform, stretches: Sequence[StretchOffset]) -> tuple[float, float]:
    """Return how paint lay left of the map and was turned, on the nearest stretch of this way."""
    x, y, _ = T_map_base.translation_m.tolist()
    (ahead_x, *_), (ahead_y, *_), _ = T_map_base.rotation.tolist()
    known = [
        stretch
        for stretch in stretches
        if stretch.lines > 0
        and ahead_x * math.cos(stretch.yaw_rad) + ahead_y * math.sin(stretch.yaw_rad) > 0
    ]
    if not known:
        return 0.0, 0.0
    near = min(known, key=lambda stretch: math.hypot(stretch.x_m - x, stretch.y_m - y))
    return near.lateral_m, near.heading_rad


def _camera_of(cameras: dict[str, CameraSensor], name: str) -> CameraSensor | None:
    return next((camera for camera in cameras.values() if camera.name == name), None)


def _image_at(recording: Recording, camera: CameraSensor, look: Look) -> CameraImage | None:
    """Return the image of a look, or None where it cannot be read any more."""
    messages = recording.undecoded(
        topics=[camera.topic or camera.name],
        start_ns=look.stamp_ns - _AROUND_NS,
        end_ns=look.stamp_ns + _AROUND_NS,
    )
    for message in messages:
        stamp_ns = message.log_time_ns if message.stamp_ns is None else message.stamp_ns
        if stamp_ns != look.stamp_ns:
            continue
        try:
            samples = message.decode()
        except DecodeError:
            return None  # it could be decoded when it was looked at; the recording counts it
        for sample in samples:
            if isinstance(sample, CameraImage):
                return sample
    return None
