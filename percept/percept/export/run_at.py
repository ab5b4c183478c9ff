"""What a finished run found at any time: its tracks, scans and images, looked up by stamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.export.finished import FinishedFrame, detections_of
from percept.export.image_table import IMAGES_2D
from percept.export.run_detections import BOXES_2D, boxes_by_model
from percept.export.scan_table import read_scans
from percept.export.sorted_table import SortedTable
from percept.export.table_reader import column, read_batches, texts
from percept.export.tables import DETECTIONS_3D
from percept.export.track_table import TRACKS, TRACKS_MAY_LACK, tracks_of

__all__ = ["ImagesAt", "ScansAt", "TracksAt"]

_LOOKS_MAY_LACK = ("model", "failure")


class TracksAt:
    """The tracks of a run.

    Args:
        path: A `tracks.parquet`.

    Raises:
        InputError: If it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._table = SortedTable(path, TRACKS, "stamp_ns", may_lack=TRACKS_MAY_LACK)

    def around(self, stamp_ns: int) -> tuple[Tracks | None, Tracks | None]:
        """Return the last moment at or before a time, and the first one after it."""
        before, after = self._table.around(stamp_ns)
        return self._moment(before), self._moment(after)

    def _moment(self, stamp_ns: int | None) -> Tracks | None:
        return None if stamp_ns is None else tracks_of(self._path, self._table.rows(stamp_ns))


class ScansAt:
    """What was found in the scans of a run.

    Args:
        run: Its folder, with `scans_3d.parquet` and `detections_3d.parquet`.

    Raises:
        InputError: If a table cannot be read.

    Attributes:
        stamps_ns: (S,) int64 times of all scans, rising.
    """

    def __init__(self, run: Path) -> None:
        scans = sorted(
            (scan for scan, _ in read_scans(run / "scans_3d.parquet")),
            key=lambda scan: (scan.stamp_ns, scan.sensor, scan.frame),
        )
        self._scans: list[FinishedFrame] = scans
        self.stamps_ns = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
        self._boxes = SortedTable(
            run / "detections_3d.parquet", DETECTIONS_3D, "frame", may_lack=("mean_intensity",)
        )

    def at(self, stamp_ns: int, within_ns: int) -> list[Detections3D]:
        """Return the scan of each sensor nearest to a time, within some ns."""
        low, high = np.searchsorted(
            self.stamps_ns, [stamp_ns - within_ns, stamp_ns + within_ns + 1]
        ).tolist()
        nearest: dict[str, FinishedFrame] = {}
        for scan in self._scans[low:high]:
            best = nearest.get(scan.sensor)
            if best is None or abs(scan.stamp_ns - stamp_ns) < abs(best.stamp_ns - stamp_ns):
                nearest[scan.sensor] = scan
        return [detections_of(scan, self._boxes.rows(scan.frame)) for scan in nearest.values()]


class ImagesAt:
    """What networks found in the images of a run.

    Of two images of one camera and one time the first counts.

    Args:
        run: Its folder, with `images_2d.parquet` and `detections_2d.parquet`.

    Raises:
        InputError: If a table cannot be read.

    Attributes:
        models: Names of the networks, in their order.
    """

    def __init__(self, run: Path) -> None:
        path = run / "images_2d.parquet"
        self._looks = SortedTable(path, IMAGES_2D, "frame", may_lack=_LOOKS_MAY_LACK)
        self._boxes = SortedTable(
            run / "detections_2d.parquet", BOXES_2D, "frame", may_lack=("light_state",)
        )
        frames: dict[str, list[NDArray[np.int64]]] = {}
        models: dict[str, None] = {}
        for batch in read_batches(path, IMAGES_2D, may_lack=_LOOKS_MAY_LACK):
            cameras = np.array(texts(batch, "camera"), dtype=object)
            numbers = np.column_stack([column(batch, "stamp_ns"), column(batch, "frame")])
            for camera in dict.fromkeys(cameras.tolist()):
                frames.setdefault(camera, []).append(numbers[cameras == camera])
            models |= dict.fromkeys(batch.column("model").drop_null().to_pylist())
        self.models = tuple(models)
        self._frames = {camera: _by_stamp(parts) for camera, parts in frames.items()}

    def stamps_ns(self, camera: str) -> NDArray[np.int64]:
        """Return (I,) times of the images of a camera, rising; none of one that is not known."""
        return self._frames.get(camera, _by_stamp([]))[:, 0]

    def nearest(self, camera: str, stamp_ns: int) -> int | None:
        """Return the time of the image of a camera that is nearest to a time; None without any."""
        stamps_ns = self.stamps_ns(camera)
        if not len(stamps_ns):
            return None
        return int(stamps_ns[np.abs(stamps_ns - stamp_ns).argmin()])

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras, in the order in which they come."""
        return tuple(self._frames)

    def at(self, camera: str, stamp_ns: int) -> dict[str, Detections2D] | None:
        """Return what each network found in an image; None if the run did not look at it.

        A network that could not judge the image is not among them; one that found nothing is.
        The label of a traffic light whose state was read from its picture ends with that state.

        Raises:
            InputError: If a table cannot be read.
        """
        stamps_ns = self.stamps_ns(camera)
        place = int(np.searchsorted(stamps_ns, stamp_ns))
        if place == len(stamps_ns) or stamps_ns[place] != stamp_ns:
            return None
        frame = int(self._frames[camera][place, 1])
        models = self._looks.rows(frame).column("model").drop_null().to_pylist()
        return boxes_by_model(stamp_ns, camera, self._boxes.rows(frame), models)


def _by_stamp(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return stamps and frames (I, 2) in the order of stamps, each stamp once."""
    rows = np.concatenate([np.zeros((0, 2), np.int64), *parts])
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    first = np.unique(rows[:, 0], return_index=True)[1]
    ordered: NDArray[np.int64] = rows[first]
    return ordered
