"""What `view.rrd` holds of cameras, read back by rerun's own reader and checker."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_images import make_image
from rerun.chunk import RrdReader

from percept.core.cameras import PinholeCamera
from percept.core.errors import GeometryError
from percept.core.transform import Transform
from percept.detection.result import ImageResult
from percept.export.palette import depth_colours
from percept.export.view import ViewCamera, ViewWriter
from percept.lidar.result import ScanResult

_K = np.array([[400.0, 0, 399.5], [0, 400.0, 224.5], [0, 0, 1]])
_CAMERA = PinholeCamera((800, 450), _K, np.zeros(5))
_T_base_front = Transform.from_quat_xyzw(
    "base_link", "front_optical", [1.5, 0, 1.2], [-0.5, 0.5, -0.5, 0.5]
)
_FRONT = ViewCamera(name="front", camera=_CAMERA, T_root_camera=_T_base_front)
_CLOUD_PX = np.array([[99.5, 49.5, 4.0], [199.5, 59.5, 60.0]])
_IN_3D = "/world/front_optical/front"


def _write(
    path: Path,
    images: list[ImageResult],
    cameras: tuple[ViewCamera, ...] = (_FRONT,),
    **settings: Any,
) -> None:
    with ViewWriter(
        path,
        run_id="r",
        frames_expected=0,
        cameras=cameras,
        models=("near", "far"),
        images_expected=len(images),
        **settings,
    ) as view:
        for image in images:
            view.add_image(image, _CLOUD_PX)


def _rows_by_entity(path: Path) -> Counter[str]:
    rows: Counter[str] = Counter()
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] += chunk.num_rows
    return rows


def _values(path: Path, entity: str) -> list[dict[str, Any]]:
    """Return what an entity has, row by row, in the order of time."""
    rows: list[dict[str, Any]] = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity:
            rows += chunk.to_record_batch().to_pylist()
    return sorted(rows, key=lambda row: row.get("image") or 0)


def _rrd(*arguments: object) -> int:
    """Run rerun's own checker."""
    code = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "rrd", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True).returncode


def test_holds_images_boxes_points_and_plots(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    _write(path, [make_image(0), make_image(1), make_image(2, camera="loose")])
    assert _rrd("verify", path) == 0
    rows = _rows_by_entity(path)
    for part in ("image", "cloud", "boxes/near", "boxes/far", "duplicates/far"):
        assert rows[f"{_IN_3D}/{part}"] == 2, part
        assert rows[f"/cameras/loose/{part}"] == 1, part  # not placed: no part of the 3D view
    assert rows[f"{_IN_3D}/duplicates/near"] == 0
    assert rows["/world/base_link/objects/front/near"] == 2
    assert rows["/plots/boxes/front/near"] == 1 + 2  # the name of the line and two values
    assert rows["/plots/milliseconds/front/decode"] == 1 + 2
    assert list(tmp_path.iterdir()) == [path]


def test_the_image_is_at_half_its_size_and_all_in_it_too(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    image = make_image(0)
    _write(path, [image])
    (row,) = _values(path, f"{_IN_3D}/image")
    jpeg = np.frombuffer(bytes(row["EncodedImage:blob"][0]), np.uint8)
    drawn = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
    assert drawn is not None
    assert drawn.shape == (225, 400, 3)
    assert np.abs(drawn[100, 100].astype(int) - (30, 60, 90)).max() <= 6
    (boxes,) = _values(path, f"{_IN_3D}/boxes/near")
    found = image.boxes["near"]
    middles = (found.boxes_px[:, :2] + found.boxes_px[:, 2:]) / 4
    assert np.allclose(boxes["Boxes2D:centers"], middles, atol=1e-3)
    away_m = image.positions["near"].range_m[0]
    assert boxes["Boxes2D:labels"][:2] == [
        f"car {found.confidences[0]:.2f} {away_m:.1f} m",
        f"pedestrian {found.confidences[1]:.2f}",
    ]
    (cloud,) = _values(path, f"{_IN_3D}/cloud")
    points = np.array(cloud["Points2D:positions"])
    assert np.allclose(points, [[50, 25], [100, 30]])
    (pinhole,) = _values(path, _IN_3D)
    matrix = np.array(pinhole["Pinhole:image_from_camera"][0]).reshape(3, 3).T
    assert np.allclose(matrix, np.array([[200, 0, 200], [0, 200, 112.5], [0, 0, 1]], dtype=float))
    assert pinhole["Pinhole:resolution"][0] == [400, 225]


def test_a_narrow_image_keeps_its_size(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    image = make_image(0, camera="small", size=(640, 360))
    _write(path, [image])
    (boxes,) = _values(path, "/cameras/small/boxes/near")
    half = (image.boxes["near"].boxes_px[:, 2:] - image.boxes["near"].boxes_px[:, :2]) / 2
    assert np.allclose(boxes["Boxes2D:half_sizes"], half, atol=1e-3)


def test_objects_stand_where_they_are(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    image = make_image(0, boxes=4)
    primary = {"near": np.array([True, True, True, False])}  # the last one is another's
    _write(path, [replace(image, primary=primary)])
    (objects,) = _values(path, "/world/base_link/objects/front/near")
    place = image.positions["near"]
    assert place.sources[3]
    assert np.allclose(objects["Points3D:positions"], place.points_m[[0, 2]], atol=1e-4)
    assert objects["Points3D:labels"] == [
        f"car {place.range_m[0]:.1f} m",
        f"deer {place.range_m[2]:.1f} m",
    ]


def test_what_a_model_did_not_look_at_is_wiped(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    images = [make_image(0), make_image(1, models=("near",)), make_image(2, failure="cut short")]
    _write(path, images)
    far = _values(path, f"{_IN_3D}/boxes/far")
    assert [row["image"] for row in far] == [0, 1]
    assert [row.get("Clear:is_recursive") for row in far] == [None, [False]]
    image = _values(path, f"{_IN_3D}/image")
    assert [row.get("Clear:is_recursive") for row in image] == [None, None, [False]]
    assert _rows_by_entity(path)["/plots/boxes/front/far"] == 1 + 1
    notes = [row["TextLog:text"][0] for row in _values(path, "/notes")]
    assert "front, image 2: cut short" in notes
    assert any("near orange, far light blue" in note for note in notes)


def test_a_failure_of_one_model_leaves_the_others(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    _write(path, [replace(make_image(0, models=("near",)), failure="far: no numbers")])
    rows = _rows_by_entity(path)
    assert rows[f"{_IN_3D}/boxes/near"] == rows[f"{_IN_3D}/image"] == 1


def test_images_are_thinned_to_the_budget(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"
    images = [make_image(i, camera=("front", "loose")[i % 2]) for i in range(12)]
    one = 400 * 225 // 4 + 4_000 * 12
    _write(path, images, budget_bytes=4 * one)
    rows = _rows_by_entity(path)
    assert rows[f"{_IN_3D}/image"] == rows["/cameras/loose/image"] == 2
    assert rows["/plots/boxes/front/near"] == 1 + 6
    notes = [row["TextLog:text"][0] for row in _values(path, "/notes")]
    assert any("draws one image in 3 of each camera" in note for note in notes)


def test_images_of_a_rare_model_are_drawn_where_images_are_thinned(tmp_path: Path) -> None:
    """Every sixth image has both models, and with a stride of four none of these had its turn."""
    path = tmp_path / "view.rrd"
    models = [("near", "far") if i % 6 == 3 else ("near",) for i in range(24)]
    images = [make_image(i, models=both) for i, both in enumerate(models)]
    _write(path, images, budget_bytes=6 * (400 * 225 // 4 + 4_000 * 12))
    rows = _rows_by_entity(path)
    assert rows[f"{_IN_3D}/image"] == 5 + 1
    drawn = [row["image"] for row in _values(path, f"{_IN_3D}/image")]
    assert len([i for i in drawn if i % 6 == 3]) == 1


def test_scans_and_images_share_a_view(
    make_scan: Callable[..., ScanResult], tmp_path: Path
) -> None:
    T_base_lidar = Transform.from_quat_xyzw("base_link", "lidar_top", [1, 0, 2], [0, 0, 0, 1])
    for name in ("a", "b"):
        with ViewWriter(
            tmp_path / f"{name}.rrd",
            run_id="r",
            T_root_frames=[T_base_lidar],
            cameras=[_FRONT],
            models=("near", "far"),
            images_expected=3,
        ) as view:
            for i in range(3):
                view.add(i, make_scan(i))
                view.add_image(make_image(i))
            text = view.close().as_text()
        assert "every frame of each sensor" in text
        assert "every image of each camera" in text
    assert _rrd("compare", tmp_path / "a.rrd", tmp_path / "b.rrd") == 0
    scan = _values(tmp_path / "a.rrd", "/world/lidar_top/top/boxes")[0]
    assert ("image" in scan, "frame" in scan) == (False, True)


def test_a_killed_session_is_resumed(tmp_path: Path) -> None:
    path = tmp_path / "view.rrd"

    def interrupted() -> None:
        with ViewWriter(path, run_id="r", cameras=[_FRONT], models=("near", "far")) as view:
            for i in range(70):
                view.add_image(make_image(i, size=(160, 90)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    part = tmp_path / ".view.rrd.parts" / "part-0000.rrd"
    whole = part.read_bytes()
    part.write_bytes(whole[: len(whole) * 99 // 100])
    _write(path, [make_image(i, size=(160, 90)) for i in range(64, 70)], resume=True)
    assert _rrd("verify", path) == 0
    assert _rows_by_entity(path)[f"{_IN_3D}/image"] >= 64 + 6
    assert list(tmp_path.iterdir()) == [path]


def test_cameras_and_lidars_need_one_root(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="one root"):
        ViewWriter(
            tmp_path / "v.rrd",
            run_id="r",
            T_root_frames=[Transform.identity("map", "lidar")],
            cameras=[_FRONT],
        )
    assert list(tmp_path.iterdir()) == []


def test_depth_is_bright_near_by() -> None:
    near, far, farther = depth_colours(np.array([2.0, 60.0, 200.0])).astype(int)
    assert near.sum() > far.sum()
    assert (far == farther).all()
