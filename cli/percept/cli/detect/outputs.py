"""What a run leaves while it works: its journals, the summaries for the report, and the view."""

from __future__ import annotations

import heapq
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from percept.cli.detect.lidar_part import LidarPart
from percept.cli.detect.one_pass import Done
from percept.cli.detect.over_time import OverTime
from percept.cli.track.outputs import TABLES, add_to_overlay, add_to_view, write_tables
from percept.core.errors import UsageError
from percept.detection.space.placing import PlacedImage
from percept.export.camera_summary import CameraSummary
from percept.export.detection_summary import DetectionSummary
from percept.export.finished import FinishedFrame, FinishedImage, detections_of, image_of
from percept.export.image_table import IMAGES_2D, image_rows
from percept.export.journal import FrameJournal, ImageJournal
from percept.export.overlay import OverlayWriter
from percept.export.projection import project_cloud
from percept.export.scan_table import SCANS_3D, scan_rows
from percept.export.tables import DETECTIONS_2D, DETECTIONS_3D, write_parquet
from percept.export.view import ViewCamera, ViewWriter
from percept.lidar.result import ScanResult

if TYPE_CHECKING:  # the networks' runtime is not loaded where no network runs
    from percept.cli.detect.camera_part import CameraPart

__all__ = ["OUTPUTS", "RunOutputs"]

_Finished: TypeAlias = tuple[FinishedFrame | FinishedImage, Any]

_SCANS, _IMAGES = ".journal", ".journal-images"
# The view's writer waits for ever once the disk is full, and holds a few megabytes back.
_LEAST_FREE_BYTES = 64 << 20
OUTPUTS = (
    "detections_3d.parquet",
    "detections_2d.parquet",
    "images_2d.parquet",
    "scans_3d.parquet",
    *TABLES,
    "rig.yaml",
    "view.rrd",
    "report.html",
    "overlay.mcap",
    _SCANS,
    _IMAGES,
)
"""Names of all that a run writes into its folder, besides `run.json`."""


class RunOutputs:
    """Takes scans and images as they are finished; a context manager.

    What it took survives the end of the process, and a resumed run goes on behind it.

    Args:
        folder: The run folder.
        fingerprint: Text that stands for the inputs and the settings.
        lidars: The LiDAR half, or None.
        cameras: The camera half, or None.
        resume: Whether to go on with what an earlier session left.

    Attributes:
        scans: What was found in scans.
        images: What was found in images; None without the camera half.
        done: What an earlier session finished.

    Raises:
        UsageError: If the folder holds another unfinished run.
    """

    def __init__(
        self,
        folder: Path,
        fingerprint: str,
        lidars: LidarPart | None,
        cameras: CameraPart | None,
        *,
        resume: bool,
    ) -> None:
        self._folder = folder
        self._lidars, self._cameras = lidars, cameras
        self._places = cameras.places(lidars) if cameras is not None else {}
        self._stack = ExitStack()
        with ExitStack() as stack:
            self._scan_journal = stack.enter_context(
                FrameJournal(folder / _SCANS, fingerprint, resume=resume)
            )
            self._image_journal = stack.enter_context(
                ImageJournal(folder / _IMAGES, fingerprint, resume=resume)
            )
            self.done = Done(
                next_scan=self._scan_journal.next_frame, next_image=self._image_journal.next_frame
            )
            self._view = stack.enter_context(self._open_view(fingerprint))
            self._stack = stack.pop_all()
        self.scans = DetectionSummary()
        self.images = CameraSummary([m.name for m in cameras.models] if cameras else [])
        self._recall()

    def _open_view(self, run_id: str) -> ViewWriter:
        lidars, cameras = self._lidars, self._cameras
        return ViewWriter(
            self._folder / "view.rrd",
            run_id=run_id,
            T_root_frames=lidars.transforms if lidars is not None else (),
            frames_expected=lidars.scans_expected if lidars is not None else 0,
            cameras=_view_cameras(lidars, cameras),
            models=[model.name for model in cameras.models] if cameras is not None else (),
            images_expected=cameras.images_expected if cameras is not None else 0,
            resume=self.done != Done(),
        )

    def _recall(self) -> None:
        """Bring what an earlier session finished into the summaries."""
        for scan, rows in self._scan_journal.read():
            detections = detections_of(scan, rows)
            self.scans.add_finished(scan, detections)
            self._view.recall(detections)
        for image, rows in self._image_journal.read():
            result = image_of(image, rows)
            self.images.add_finished(image, result)
            self._view.recall_image(result)

    def add_scan(self, frame: int, result: ScanResult) -> None:
        """Take a finished scan.

        Raises:
            UsageError: If the disk is nearly full.
        """
        self._check_room()
        self._scan_journal.append(frame, result)
        self.scans.add(frame, result)
        self._view.add(frame, result)

    def add_image(self, image: PlacedImage) -> None:
        """Take a finished image.

        Raises:
            UsageError: If the disk is nearly full.
        """
        self._check_room()
        self._image_journal.append(image.result)
        self.images.add(image.result)
        place = self._places.get(image.result.camera)
        clouds = [
            project_cloud(scan.cloud.points_xyz, place.T_camera_clouds[stream], place.camera)
            for stream, scan in image.scans.items()
            if place is not None and image.result.image is not None
        ]
        # Of several clouds that which shows the most.
        self._view.add_image(image.result, max(clouds, key=len, default=None))

    def _check_room(self) -> None:
        free_bytes = shutil.disk_usage(self._folder).free
        if free_bytes < _LEAST_FREE_BYTES:
            raise UsageError(
                f"only {free_bytes >> 20} MB are left on its disk",
                where=self._folder,
                remedy="Make room, and go on with --resume",
            )

    def write_detections(self) -> None:
        """Write the tables of what was found in single scans and images."""
        if self._lidars is not None:
            path = self._folder / "detections_3d.parquet"
            write_parquet(path, DETECTIONS_3D, self._scan_journal.batches())
            scans = (scan_rows(scan, len(rows)) for scan, rows in self._scan_journal.read())
            write_parquet(self._folder / "scans_3d.parquet", SCANS_3D, scans)
        if self._cameras is not None:
            path = self._folder / "detections_2d.parquet"
            write_parquet(path, DETECTIONS_2D, self._image_journal.batches())
            looked_at = (image_rows(image) for image, _ in self._image_journal.read())
            write_parquet(self._folder / "images_2d.parquet", IMAGES_2D, looked_at)

    def write_rest(self, over_time: OverTime | None, *, overlay: bool) -> list[str]:
        """Write all other files but the report, and return what should be known of them."""
        if over_time is not None:
            write_tables(self._folder, over_time.followed)
            add_to_view(self._view, over_time.trajectory, over_time.followed)
            self._view.add_health(over_time.health)
        notes = self._view.close().as_text()
        if overlay:
            self._write_overlay(over_time)
        return [notes]

    def _write_overlay(self, over_time: OverTime | None) -> None:
        with OverlayWriter(self._folder / "overlay.mcap", models=self.images.models) as overlay:
            scans: Iterator[_Finished] = self._scan_journal.read()
            images: Iterator[_Finished] = self._image_journal.read()
            for finished, rows in heapq.merge(scans, images, key=_log_time_ns):
                if isinstance(finished, FinishedImage):
                    overlay.add_image(image_of(finished, rows), finished.frame_id)
                else:
                    overlay.add(detections_of(finished, rows), finished.log_time_ns)
            if over_time is not None:
                add_to_overlay(
                    overlay, over_time.trajectory, over_time.followed, self._log_times_ns()
                )

    def _log_times_ns(self) -> dict[int, int]:
        """Return when scans and images were recorded, by their stamps."""
        finished: Iterator[_Finished] = chain(self._scan_journal.read(), self._image_journal.read())
        return {one.stamp_ns: one.log_time_ns for one, _ in finished}

    def remove_journals(self) -> None:
        """Delete the journals: the run is complete."""
        self._scan_journal.remove()
        self._image_journal.remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)


def _log_time_ns(item: _Finished) -> int:
    return item[0].log_time_ns


def _view_cameras(lidars: LidarPart | None, cameras: CameraPart | None) -> list[ViewCamera]:
    """Return the cameras for the view; those placed in another frame than the LiDARs float."""
    roots = {transform.target for transform in lidars.transforms} if lidars is not None else set()
    found = []
    for camera in cameras.cameras.values() if cameras is not None else ():
        place = camera.T_base_sensor
        roots = roots or ({place.target} if place is not None else set())
        T_root_camera = place if place is not None and place.target in roots else None
        found.append(
            ViewCamera(name=camera.name, camera=camera.camera, T_root_camera=T_root_camera)
        )
    return found
