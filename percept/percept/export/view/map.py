"""A map and the road that was seen on it, as rerun shows it: `view.rrd` of `percept map validate`.

Look by look with flat memory: the image, the paint in it on the map, the vehicle; the map and the
findings stand still.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation
from percept.core.map_findings import Discrepancy
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.export.canvas import Rgb, as_bgr, resized
from percept.export.map_evidence import NOTHING_SEEN
from percept.export.view.layout import TIMELINE, VEHICLE
from percept.export.view.recording import rrd_recording
from percept.export.view.stream import Turns
from percept.hdmap.elements import MapMarking

__all__ = ["MapView"]

_COLOURS: dict[str, Rgb] = {"white": (215, 220, 226), "yellow": (240, 190, 60)}
_UNPAINTED: Rgb = (90, 96, 104)
_FINDING: Rgb = (255, 70, 210)
_EXPECTED: Rgb = (0, 220, 255)
_WIDEST_PX = 640
_JPEG_QUALITY = 80
_FLUSH_LOOKS = 20
_BUDGET_BYTES = 512 * 1024 * 1024
_FAR_M = 10_000.0


class MapView:
    """Writes a view look by look; a context manager. An error leaves no file.

    Args:
        path: The file.
        run_id: What tells this run from others that are open in the same viewer.
        cameras: Names of the cameras.
        looks_expected: Looks that will come, about: of more than fit in the budget some are drawn.
        about_m: (3,) float64 a place of the map that is drawn near the origin: the viewer has 32
            bits a number, which is half a metre in UTM coordinates.
        budget_bytes: Bytes that the looks may take.
    """

    def __init__(
        self,
        path: Path,
        *,
        run_id: str,
        cameras: Sequence[str],
        looks_expected: int = 1,
        about_m: NDArray[np.float64] | None = None,
        budget_bytes: int = _BUDGET_BYTES,
    ) -> None:
        self._path = path
        self._unfinished = path.with_name(f".{path.name}.unfinished")
        self._recording = rrd_recording(self._unfinished, run_id, _layout(cameras))
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._turns = Turns(looks_expected, budget_bytes)
        far = np.zeros(3) if about_m is None else about_m
        self._shift_m = np.where(np.abs(far) > _FAR_M, -np.round(far, -3), 0.0)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a viewer should know, as sentences."""
        drawn, looks = self._turns.drawn, self._turns.frames
        said = [f"view.rrd shows {drawn} of {looks} looks: all are too much for a viewer."]
        moved = ", ".join(f"{metres:+.0f}" for metres in self._shift_m)
        shift = [f"view.rrd is drawn moved by ({moved}) m."] if self._shift_m.any() else []
        return (*(said if drawn < looks else []), *shift)

    def add_map(self, markings: Sequence[MapMarking]) -> None:
        """Draw the lines of the map."""
        colours = [_colour(marking) for marking in markings]
        lines = rr.LineStrips3D(
            [marking.points_map + self._shift_m for marking in markings],
            colors=colours,
            radii=rr.Radius.ui_points(1.5),
            labels=[f"{m.name}: {m.colour} {m.type}" for m in markings],
            show_labels=False,
        )
        self._log("world/map", lines, static=True)

    def add_look(
        self,
        stamp_ns: int,
        camera: str,
        pixels: NDArray[np.generic],
        T_map_base: Transform,
        paint: PaintObservation,
    ) -> None:
        """Draw an image and the paint that it shows.

        Args:
            stamp_ns: Time of the image.
            camera: Name of the camera.
            pixels: (H, W) or (H, W, 3) BGR of any depth.
            T_map_base: Where the vehicle was.
            paint: What was seen.
        """
        picture = _encoded(pixels)
        if not self._turns.take(camera, len(picture) + 16 * len(paint.strokes_m)):
            return
        self._recording.reset_time()
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))
        image = rr.EncodedImage(contents=picture, media_type="image/jpeg")
        self._log(f"cameras/{camera}", image)
        pose = rr.Transform3D(
            translation=T_map_base.translation_m + self._shift_m,
            quaternion=rr.Quaternion(xyzw=quat_xyzw_from_matrix(T_map_base.rotation)),
        )
        self._log(VEHICLE, pose)
        self._log(f"{VEHICLE}/axes", rr.TransformAxes3D(2.0))
        yellow = np.nan_to_num(paint.yellow, nan=0.0) > 0.5
        colours = np.where(yellow[:, None], _COLOURS["yellow"], _COLOURS["white"])
        strokes = rr.Points3D(
            T_map_base.apply(paint.strokes_m) + self._shift_m,
            colors=colours.astype(np.uint8),
            radii=rr.Radius.ui_points(2.5),
        )
        self._log(f"world/paint/{camera}", strokes)
        if self._turns.drawn % _FLUSH_LOOKS == 0:
            self._recording.flush()

    def add_findings(self, findings: Sequence[Discrepancy]) -> None:
        """Draw the findings, each with what the map says there."""
        self._recording.reset_time()
        seen = [f for f in findings if len(f.points_map) > 1 and f.kind not in NOTHING_SEEN]
        labels = [_words(finding) for finding in seen]
        strips = rr.LineStrips3D(
            [finding.points_map + self._shift_m for finding in seen],
            colors=_FINDING,
            radii=rr.Radius.ui_points(4.0),
            labels=labels,
        )
        self._log("world/findings/seen", strips, static=True)
        mapped = [finding for finding in findings if len(finding.points_expected_map) > 1]
        strips = rr.LineStrips3D(
            [finding.points_expected_map + self._shift_m for finding in mapped],
            colors=_EXPECTED,
            radii=rr.Radius.ui_points(3.0),
            labels=["" if f in seen else _words(f) for f in mapped],
        )
        self._log("world/findings/map", strips, static=True)
        for finding in findings:
            if finding.looks:
                at = np.datetime64(finding.looks[0].stamp_ns, "ns")
                self._recording.set_time(TIMELINE, timestamp=at)
                text = f"{finding.kind} {finding.map_element_id}: {finding.observed}"
                self._log("findings", rr.TextLog(text, level="WARN"))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._recording.disconnect()
        if kind is None:
            self._unfinished.replace(self._path)
        else:
            self._unfinished.unlink(missing_ok=True)

    def _log(self, entity: str, what: rr.AsComponents, *, static: bool = False) -> None:
        self._recording.log(entity, what, static=static, strict=True)


def _layout(cameras: Sequence[str]) -> rrb.Blueprint:
    eye = rrb.EyeControls3D(
        position=(-25, 0, 35), look_target=(12, 0, 0), eye_up=(0, 0, 1), tracking_entity=VEHICLE
    )
    scene = rrb.Spatial3DView(origin="world", name="Map, paint and findings", eye_controls=eye)
    images = [rrb.Spatial2DView(origin=f"cameras/{name}", name=name) for name in cameras]
    log = rrb.TextLogView(origin="findings", name="Findings")
    side = rrb.Vertical(*images, log)
    return rrb.Blueprint(
        rrb.Horizontal(scene, side, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        collapse_panels=True,
    )


def _words(finding: Discrepancy) -> str:
    return f"{finding.kind.replace('_', ' ')} ({finding.confidence:.2f}): {finding.observed}"


def _colour(marking: MapMarking) -> Rgb:
    return _COLOURS.get(marking.colour, _COLOURS["white"]) if marking.painted else _UNPAINTED


def _encoded(pixels: NDArray[np.generic]) -> bytes:
    """Return an image (H, W) or (H, W, 3) as JPEG."""
    picture = as_bgr(pixels)
    scale = min(1.0, _WIDEST_PX / picture.shape[1])
    small = resized(picture, scale) if scale < 1 else picture
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return data.tobytes()
