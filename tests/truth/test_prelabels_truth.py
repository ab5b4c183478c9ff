"""Pre-labels of the synthetic world: which 3D box each 2D box shows, from exact boxes of both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import ImageBoxes, SolidBoxes
from percept.datasets.labelling.prelabels.label_keyframe import ImageView, PreLabelConfig, link
from percept.datasets.labelling.prelabels.network_boxes import overlaps
from percept.datasets.labelling.prelabels.project_solids import project_solids
from percept.datasets.labelling.prelabels.run_solids import solids_of_scans
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.render import RenderConfig
from percept.datasets.synthetic.truth import object_rows
from percept.datasets.synthetic.visible import VisibleBoxes, picture_with_boxes

SCENES = [(3, 1.0, "cam_front"), (9, 3.0, "cam_left"), (41, 2.0, "cam_front"), (8, 9.0, "cam_rear")]
_SIZE = ("x", "y", "z", "length", "width", "height", "yaw_rad")


@dataclass(frozen=True)
class Scene:
    camera: CameraSensor
    seen: VisibleBoxes
    solids: SolidBoxes
    ids: NDArray[np.int64]
    drive: Drive
    time_s: float

    def place(self, time_s: float) -> Transform:
        return Transform("map", "base_link", self.drive.ego.poses(np.array([time_s]))[0])


@lru_cache(maxsize=8)
def scene(seed: int, time_s: float, name: str) -> Scene:
    """What a camera of a drive sees, and the objects about it in the base frame."""
    drive = Drive(DriveConfig(seed=seed, cameras=(name,)))
    (camera,) = drive.cameras
    assert camera.T_base_sensor is not None
    T_map_base = Transform("map", "base_link", drive.ego.poses(np.array([time_s]))[0])
    _, seen = picture_with_boxes(
        drive.world,
        camera.pinhole(),
        (T_map_base @ camera.T_base_sensor).inverse(),
        time_s,
        float(T_map_base.translation_m[0]),
        RenderConfig(supersampling=1, noise_sd=0.0),
    )
    stamp_ns = round(drive.ego.start_ns + time_s * 1e9)
    rows = object_rows(drive.world, drive.ego, stamp_ns, {})
    found = Detections3D(
        stamp_ns,
        "truth",
        "map",
        np.array([[row[key] for key in _SIZE] for row in rows]),
        tuple(row["label"] for row in rows),
        np.ones(len(rows)),
    )
    ids = np.array([row["track_id"] for row in rows])
    solids = solids_of_scans([found], [T_map_base.inverse()])
    turn = T_map_base.rotation[:2, :2]
    velocities = np.array([[row["vx"], row["vy"]] for row in rows]) @ turn
    return Scene(
        camera, seen, replace(solids, track_ids=ids, velocities_mps=velocities), ids, drive, time_s
    )


def view(
    one: Scene,
    seen: VisibleBoxes,
    offset_ns: int = 0,
    vehicle_place: Transform | None = None,
) -> ImageView:
    rows = seen.visible > 0.4
    labels = tuple(label for label, row in zip(seen.labels, rows, strict=True) if row)
    boxes = Detections2D(0, "camera", seen.boxes_px[rows], labels, np.full(rows.sum(), 0.9))
    return ImageView(
        found={"net": boxes},
        image_size=one.camera.image_size,
        camera=one.camera,
        offset_ns=offset_ns,
        vehicle_place=vehicle_place,
    )


def linked(boxes: ImageBoxes, seen: VisibleBoxes, ids: NDArray[np.int64]) -> tuple[int, ...]:
    """How many boxes are of objects that are known in 3D, are linked with them, or with others."""
    shown = seen.ids[overlaps(boxes.boxes_px, seen.boxes_px).argmax(axis=1)]
    networks = np.array([source == "net" for source in boxes.sources])
    asked = networks & np.isin(shown, ids)
    right = boxes.track_ids[asked] == shown[asked]
    wrong = ~right & (boxes.track_ids[asked] >= 0)
    return int(asked.sum()), int(right.sum()), int(wrong.sum())


def test_boxes_are_linked_with_their_objects() -> None:
    counts = np.zeros(3, dtype=int)
    for seed, time_s, name in SCENES:
        one = scene(seed, time_s, name)
        boxes = link(view(one, one.seen), one.solids, PreLabelConfig())
        counts += linked(boxes, one.seen, one.ids)
    asked, right, wrong = counts.tolist()
    assert asked > 60
    assert right >= 0.95 * asked
    assert wrong <= 0.02 * asked


@pytest.mark.parametrize("offset_s", [-0.1, 0.1])
def test_motion_between_scan_and_image_is_taken_into_account(offset_s: float) -> None:
    one = scene(41, 2.0, "cam_front")
    before = scene(41, 2.0 - offset_s, "cam_front")  # when the 3D boxes were measured
    T_then_before = one.place(one.time_s).inverse() @ before.place(before.time_s)
    moved = link(
        view(one, one.seen, offset_ns=round(offset_s * 1e9), vehicle_place=T_then_before),
        before.solids,
        PreLabelConfig(),
    )
    exact = link(view(one, one.seen), one.solids, PreLabelConfig())
    _, right, wrong = linked(moved, one.seen, before.ids)
    assert right >= linked(exact, one.seen, one.ids)[1] - 1
    assert wrong == 0
    blind = link(view(one, one.seen), before.solids, PreLabelConfig())
    assert linked(blind, one.seen, before.ids)[1] < right


def test_projected_boxes_hold_what_is_seen() -> None:
    """A box around an object appears around its picture, and not much larger."""
    gaps = []
    for seed, time_s, name in SCENES:
        one = scene(seed, time_s, name)
        assert one.camera.T_base_sensor is not None
        projected = project_solids(
            one.solids.boxes_m, one.camera.T_base_sensor.inverse(), one.camera.camera()
        )
        row_of = {int(number): row for row, number in enumerate(one.ids)}
        for number, box, visible in zip(
            one.seen.ids.tolist(), one.seen.boxes_px, one.seen.visible, strict=True
        ):
            if visible > 0.97 and number in row_of:
                gaps.append(projected.boxes_px[row_of[number]] - box)
    outside = np.array(gaps) * [-1, -1, 1, 1]
    assert len(outside) > 15
    # Half a pixel in either direction would be seen here: boxes count from the edge of pixels.
    assert outside.min() > -1.2
    assert np.median(outside, axis=0) == pytest.approx(np.full(4, 0.6), abs=0.8)


def test_what_hides_and_cuts_objects_is_estimated() -> None:
    off = []
    for seed, time_s, name in SCENES:
        one = scene(seed, time_s, name)
        assert one.camera.T_base_sensor is not None
        projected = project_solids(
            one.solids.boxes_m, one.camera.T_base_sensor.inverse(), one.camera.camera()
        )
        shown = 1 - projected.truncated
        shown *= 1 - np.nan_to_num(projected.occluded, nan=1.0)
        for number, visible in zip(one.seen.ids, one.seen.visible, strict=True):
            off += (shown[one.ids == number] - visible).tolist()
    assert np.abs(off).mean() < 0.11
