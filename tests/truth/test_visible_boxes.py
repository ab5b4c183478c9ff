"""The 2D truth of the synthetic world, against rays that another program casts into it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from percept.core.cameras import PinholeCamera
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.synthetic.drive import Drive, DriveConfig, generate_drive
from percept.datasets.synthetic.raycast import cast_columns
from percept.datasets.synthetic.render import RenderConfig, render_image
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.street_mesh import street_mesh, street_parts
from percept.datasets.synthetic.visible import VisibleBoxes, picture_with_boxes
from percept.datasets.synthetic.world import World

REACH_M = 110.0
# Rays are half a pixel apart in the middle of the image.
RAY_STEP_RAD = 0.0012
OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
VIEWS = [(3, 1.0, "cam_front"), (3, 5.4, "cam_front"), (8, 9.0, "cam_rear"), (9, 3.0, "cam_left")]


@lru_cache(maxsize=4)
def scene(seed: int, time_s: float, name: str) -> tuple[Drive, CameraSensor, Transform]:
    """A camera of a drive at a time, and `T_cam_map`."""
    drive = Drive(DriveConfig(seed=seed, cameras=(name,)))
    (camera,) = drive.cameras
    assert camera.T_base_sensor is not None
    T_map_base = Transform("map", "base_link", drive.ego.poses(np.array([time_s]))[0])
    return drive, camera, (T_map_base @ camera.T_base_sensor).inverse()


@lru_cache(maxsize=4)
def seen(
    seed: int, time_s: float, name: str, supersampling: int = 2
) -> tuple[NDArray[np.uint8], VisibleBoxes]:
    drive, camera, T_cam_map = scene(seed, time_s, name)
    return picture_with_boxes(
        drive.world,
        camera.pinhole(),
        T_cam_map,
        time_s,
        float(T_cam_map.inverse().translation_m[0]),
        RenderConfig(supersampling=supersampling, noise_sd=0.0),
    )


def ray_boxes(
    world: World, camera: PinholeCamera, T_cam_map: Transform, time_s: float
) -> dict[int, NDArray[np.float64]]:
    """Boxes (x1, y1, x2, y2) of all that rays from the camera meet, by object."""
    T_map_cam = T_cam_map.inverse()
    T_map_body = T_map_cam.matrix.copy()
    T_map_body[:3, :3] = T_map_cam.rotation @ OPTICAL_FROM_BODY
    azimuths = np.arange(-0.72, 0.72, RAY_STEP_RAD)
    elevations = np.arange(-0.56, 0.56, RAY_STEP_RAD)
    x_m = float(T_map_cam.translation_m[0])
    packed = world.packed(time_s, x_m, REACH_M)
    _, what = cast_columns(
        azimuths,
        elevations,
        np.tile(T_map_body, (len(azimuths), 1, 1)),
        np.full(len(azimuths), time_s),
        packed.heights,
        packed.objects,
        packed.first,
        packed.primitives,
        packed.lines,
        packed.bars,
        400.0,
    )
    a, e = np.meshgrid(azimuths, elevations, indexing="ij")
    body = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
    pixels, inside = camera.project(body.reshape(-1, 3) @ OPTICAL_FROM_BODY.T)
    edges, hit = pixels + 0.5, what.ravel()
    boxes = {}
    for index in np.unique(hit[inside & (hit >= 0)]).tolist():
        of_object = edges[inside & (hit == index)]
        low, high = of_object.min(axis=0), of_object.max(axis=0)
        boxes[int(packed.ids[index])] = np.concatenate([low, high])
    return boxes


@pytest.mark.parametrize("view", VIEWS)
def test_boxes_are_where_rays_meet_the_objects(view: tuple[int, float, str]) -> None:
    drive, camera, T_cam_map = scene(*view)
    _, truth = seen(*view)
    assert len(truth) >= 3
    by_rays = ray_boxes(drive.world, camera.pinhole(), T_cam_map, view[1])
    found = dict(zip(truth.ids.tolist(), truth.boxes_px, strict=True))
    off = {i: float(np.abs(found[i] - box).max()) for i, box in by_rays.items() if i in found}
    shares = dict(zip(truth.ids.tolist(), truth.visible.tolist(), strict=True))
    # Of what is mostly hidden, a strip may be seen that is narrower than the rays are apart.
    assert max(error for identity, error in off.items() if shares[identity] > 0.7) < 1.5
    assert np.median(list(off.values())) < 0.75
    large = (truth.boxes_px[:, 2:] - truth.boxes_px[:, :2]).min(axis=1) > 2
    assert set(truth.ids[large].tolist()) <= set(by_rays)


@pytest.mark.parametrize("view", VIEWS)
def test_nothing_that_rays_meet_is_missing(view: tuple[int, float, str]) -> None:
    drive, camera, T_cam_map = scene(*view)
    _, truth = seen(*view)
    x_m = float(T_cam_map.inverse().translation_m[0])
    placed = {o.object_id: o for o in drive.world.objects(view[1], x_m, REACH_M)}
    expected = {
        identity
        for identity, box in ray_boxes(drive.world, camera.pinhole(), T_cam_map, view[1]).items()
        if identity in placed
        and placed[identity].shape.label in DETECTABLE
        and (box[2:] - box[:2]).min() > 2
    }
    assert expected <= set(truth.ids.tolist())
    hidden = {i for i, o in placed.items() if o.shape.label in DETECTABLE} - set(truth.ids.tolist())
    assert len(hidden) > 10


def test_unoccluded_objects_fill_the_extent_of_their_corners() -> None:
    drive, camera, T_cam_map = scene(*VIEWS[0])
    _, truth = seen(*VIEWS[0])
    x_m = float(T_cam_map.inverse().translation_m[0])
    parts = {
        part.placed.object_id: part.mesh_map
        for part in street_parts(drive.world, VIEWS[0][1], x_m)
        if part.placed is not None
    }
    compared = 0
    for identity, box, share in zip(truth.ids, truth.boxes_px, truth.visible, strict=True):
        corners, inside = camera.pinhole().project(T_cam_map.apply(parts[int(identity)].vertices))
        if share < 0.999 or not inside.all():
            continue
        edges = corners + 0.5
        extent = np.concatenate([edges.min(axis=0), edges.max(axis=0)])
        assert np.abs(box - extent).max() < 1.5
        compared += 1
    assert compared >= 5


def test_what_is_hidden_or_cut_says_so() -> None:
    _, truth = seen(*VIEWS[0])
    assert ((truth.visible > 0) & (truth.visible <= 1)).all()
    assert (truth.visible < 0.5).any()
    assert (truth.visible > 0.95).any()
    cut = (truth.boxes_px[:, 0] == 0) | (truth.boxes_px[:, 2] == 640)
    assert cut.any()
    assert (truth.visible[cut] < 1).all()


def test_lights_count_from_the_front_by_the_lamp_that_shines() -> None:
    states, behind = set(), 0
    for time_s in (1.0, 4.5, 6.5, 19.0, 19.7, 20.2, 34.0):
        drive, _, T_cam_map = scene(3, time_s, "cam_front")
        _, truth = seen(3, time_s, "cam_front", 1)
        x_m = float(T_cam_map.inverse().translation_m[0])
        labels = dict(zip(truth.ids.tolist(), truth.labels, strict=True))
        for signal in drive.world.signals(x_m, REACH_M):
            label = labels.get(signal.head.object_id)
            # Heads for traffic along -x are seen from behind by a camera that looks along +x.
            if np.sin(signal.head.yaw_rad) < 0 and signal.head.x_m > x_m:
                assert label is None
                behind += 1
            elif label is not None:
                state = signal.plan.at(time_s)
                assert label == f"light_{state.colour if state.lit else 'off'}"
                states.add(label)
    assert behind
    assert len(states) >= 3


def test_the_truth_is_of_the_same_picture_at_any_sampling() -> None:
    drive, camera, T_cam_map = scene(*VIEWS[1])
    coarse, fine = seen(*VIEWS[1], 1)[1], seen(*VIEWS[1], 3)[1]
    ids = dict(zip(fine.ids.tolist(), range(len(fine)), strict=True))
    for k, identity in enumerate(coarse.ids.tolist()):
        if (coarse.boxes_px[k, 2:] - coarse.boxes_px[k, :2]).min() > 12:
            other = ids[identity]
            assert np.abs(coarse.boxes_px[k] - fine.boxes_px[other]).max() < 2.0
            assert abs(coarse.visible[k] - fine.visible[other]) < 0.06
            assert coarse.range_m[k] == pytest.approx(fine.range_m[other])
    x_m = float(T_cam_map.inverse().translation_m[0])
    mesh = street_mesh(drive.world, VIEWS[1][1], x_m)
    light = RenderConfig(noise_sd=0.0)
    alone = render_image(mesh, camera.pinhole(), T_cam_map, light)
    assert (alone == seen(*VIEWS[1])[0]).all()


def test_a_drive_carries_the_boxes_of_its_images(tmp_path: Path) -> None:
    config = DriveConfig(seed=4, seconds=0.2, cameras=("cam_front", "cam_rear"), beam_share=0.05)
    summary = generate_drive(config, tmp_path)
    images = pq.read_table(tmp_path / "truth" / "images_2d.parquet").to_pylist()
    rows = pq.read_table(tmp_path / "truth" / "boxes_2d.parquet").to_pylist()
    assert len(images) == summary.counts["/cam_front/image_raw/compressed"] + 2
    first = min(row["stamp_ns"] for row in images if row["camera"] == "cam_front")
    drive = Drive(config)
    assert first == drive.image_stamp_ns(drive.cameras[0], 0)
    truth = drive.picture(drive.cameras[0], 0)[1]
    of_first = [r for r in rows if r["stamp_ns"] == first and r["camera"] == "cam_front"]
    assert [row["track_id"] for row in of_first] == truth.ids.tolist()
    boxes = [[row[name] for name in ("x1_px", "y1_px", "x2_px", "y2_px")] for row in of_first]
    assert np.array(boxes) == pytest.approx(truth.boxes_px)
    assert [row["range_m"] for row in of_first] == pytest.approx(truth.range_m.tolist())
