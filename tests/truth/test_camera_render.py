"""The camera renderer against `PinholeCamera.project`, which says where everything must be."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.core.cameras import PinholeCamera
from percept.core.errors import GeometryError
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.board_mesh import board_mesh
from percept.datasets.synthetic.mesh import Mesh, joined
from percept.datasets.synthetic.render import RenderConfig, render_image

_K = np.array([[420.0, 0, 318.7], [0, 421.0, 200.4], [0, 0, 1]])
_NO_LENS = np.zeros(5)
_LENS = np.array([-0.28, 0.08, 0.0012, -0.0007, -0.01])
_EXACT = RenderConfig(noise_sd=0, sun=0.0, ambient=1.0, gamma=1.0)
# A picture with gamma lets bright squares bloom, which moves what a corner finder sees.
# Optical frame of a camera at the map's origin that looks along x.
_FORWARD = Transform.from_quat_xyzw("cam", "map", (0, 0, 0), (0.5, -0.5, 0.5, 0.5))


def _camera(distortion: NDArray[np.float64] = _NO_LENS) -> PinholeCamera:
    return PinholeCamera((640, 400), _K, distortion)


def _rectangle(
    corners: Sequence[Sequence[float]], colour: float, *, layer: int = 0, emission: float = 0
) -> Mesh:
    return Mesh(
        np.array(corners, dtype=np.float64),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full((2, 3), colour, np.float32),
        np.full(2, emission, np.float32),
        np.full(2, layer, np.int32),
    )


def _wall(x: float, y0: float, y1: float, colour: float, *, layer: int = 0) -> Mesh:
    corners = [[x, y0, -9], [x, y1, -9], [x, y1, 9], [x, y0, 9]]
    return _rectangle(corners, colour, layer=layer)


def _linear(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    linear: NDArray[np.float64] = image[..., 1] / 255.0
    return linear


@pytest.mark.parametrize("distortion", [_NO_LENS, _LENS], ids=["pinhole", "distorted"])
@pytest.mark.parametrize(
    ("rpy_deg", "at_m"),
    [
        ((0, 0, 0), (-0.3, -0.2, 1.0)),
        ((35, -20, 10), (-0.35, -0.1, 1.2)),
        ((-15, 40, -25), (-0.6, -0.05, 1.1)),
        ((5, 10, 3), (0.15, 0.05, 1.0)),
    ],
)
def test_checkerboard_corners_lie_where_the_camera_projects_them(
    distortion: NDArray[np.float64],
    rpy_deg: tuple[float, float, float],
    at_m: tuple[float, float, float],
) -> None:
    board = Checkerboard(7, 5, 0.08)
    camera = PinholeCamera((1280, 800), np.diag([2.0, 2.0, 1.0]) @ _K, distortion)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*np.deg2rad(rpy_deg))
    matrix[:3, 3] = at_m
    T_cam_board = Transform("cam", "board", matrix)
    truth_px, seen = camera.project(T_cam_board.apply(board.corners_board()))
    assert seen.all()
    plate = board_mesh(board, (0.75, 0.6), _FORWARD.inverse() @ T_cam_board)
    image = render_image(plate, camera, _FORWARD, _EXACT)
    # A lens blurs a little, and corner finders count on it.
    grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), 1.0)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = np.ascontiguousarray(truth_px + np.array([1.0, -1.0]), dtype=np.float32).reshape(
        -1, 1, 2
    )
    found_px = cv2.cornerSubPix(grey, start, (5, 5), (-1, -1), stop)[:, 0]
    errors_px = np.linalg.norm(found_px - truth_px, axis=1)
    assert errors_px.max() < 0.1
    assert np.abs((found_px - truth_px).mean(axis=0)).max() < 0.015
    # The sector finder is itself off by 0.4 px on boards turned as far as the third.
    found, sector_px = cv2.findChessboardCornersSB(image, (7, 5), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    nearest = np.linalg.norm(sector_px.reshape(-1, 1, 2) - truth_px, axis=2).min(axis=1)
    assert np.median(nearest) < (0.06 if max(map(abs, rpy_deg)) < 40 else 0.2)


@pytest.mark.parametrize("distortion", [_NO_LENS, _LENS], ids=["pinhole", "distorted"])
def test_straight_edges_are_where_the_camera_projects_them(
    distortion: NDArray[np.float64],
) -> None:
    camera = _camera(distortion)
    slanted: list[list[float]] = [[10.0, -1.13, -9], [10, -9, -9], [10, -9, 9], [10, 1.71, 9]]
    scene = joined([_wall(10.1, -20, 20, 0.1), _rectangle(slanted, 0.9)])
    linear = _linear(render_image(scene, camera, _FORWARD, _EXACT))
    # The edge's column in each row from the light of the row: dark left of it, bright right.
    z = np.linspace(-8.9, 8.9, 4001)
    edge = np.column_stack([np.full_like(z, 10), -1.13 + (z + 9) / 18 * 2.84, z])
    edge_px, inside = camera.project(_FORWARD.apply(edge))
    edge_px = edge_px[inside][np.argsort(edge_px[inside, 1])]
    rows = np.arange(20, 380)
    truth = np.interp(rows, edge_px[:, 1], edge_px[:, 0])
    errors = []
    for row, column in zip(rows, truth, strict=True):
        window = linear[row, int(column) - 6 : int(column) + 8]
        dark, bright = window[:3].mean(), window[-3:].mean()
        covered = ((window - dark) / (bright - dark)).sum()
        errors.append(int(column) + 8 - 0.5 - covered - column)
    assert abs(np.mean(errors)) < 0.01
    # Two samples across a pixel place one row's edge to a quarter of a pixel.
    assert np.sqrt(np.mean(np.square(errors))) < 0.15


def test_nearer_faces_hide_farther_ones_in_any_order() -> None:
    near, far = _wall(5, -1, 1, 0.9), _wall(9, -20, 20, 0.1)
    images = [
        render_image(joined(m), _camera(), _FORWARD, _EXACT) for m in ([near, far], [far, near])
    ]
    np.testing.assert_array_equal(images[0], images[1])
    assert images[0][200, 319, 0] > 150
    assert images[0][200, 30, 0] < 30


def test_interpenetrating_walls_meet_where_their_depths_are_equal() -> None:
    slanted = _rectangle([[4, -8, -9], [12, 8, -9], [12, 8, 9], [4, -8, 9]], 0.9)
    linear = _linear(
        render_image(joined([_wall(8, -20, 20, 0.1), slanted]), _camera(), _FORWARD, _EXACT)
    )
    # They cross at y = 0; right of it (y < 0) the slanted one is nearer.
    middle = linear[200, 250:400]
    dark, bright = middle[:20].mean(), middle[-20:].mean()
    covered = ((middle - dark) / (bright - dark)).sum()
    assert 400 - 0.5 - covered == pytest.approx(_K[0, 2], abs=0.26)


def test_a_higher_layer_wins_on_one_plane_without_flicker() -> None:
    road = _rectangle([[-20, -9, -1.5], [90, -9, -1.5], [90, 9, -1.5], [-20, 9, -1.5]], 0.1)
    paint = _rectangle(
        [[2.0, -3, -1.5], [60, -3.1, -1.5], [60, 3.3, -1.5], [2, 3, -1.5]], 0.8, layer=1
    )
    alone = render_image(paint, _camera(), _FORWARD, _EXACT)
    images = [
        render_image(joined(m), _camera(), _FORWARD, _EXACT) for m in ([road, paint], [paint, road])
    ]
    np.testing.assert_array_equal(images[0], images[1])
    pixels, seen = _camera().project(_FORWARD.apply(np.array([[3.5, 0.0, -1.5], [55, 0, -1.5]])))
    assert seen.all()
    low, high = np.rint(pixels[:, 1]).astype(int)
    column = int(np.rint(pixels[0, 0]))
    np.testing.assert_array_equal(images[0][high:low, column], alone[high:low, column])


def test_faces_are_cut_at_the_camera_and_leave_no_seam() -> None:
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.linspace(-30, 60, 31), np.linspace(-40, 40, 31), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.4)])
    inner = (np.abs(x) < 59).ravel() & (np.abs(y) < 39).ravel()
    vertices[inner, :2] += rng.uniform(-0.8, 0.8, (inner.sum(), 2))
    corner = (np.arange(30)[:, None] * 31 + np.arange(30)).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + 31, corner + 32]),
            np.column_stack([corner, corner + 32, corner + 1]),
        ]
    ).astype(np.int32)
    count = len(faces)
    ground = Mesh(
        vertices, faces, np.full((count, 3), 0.5, np.float32), np.zeros(count, np.float32),
        np.zeros(count, np.int32),
    )  # fmt: skip
    image = render_image(ground, _camera(_LENS), _FORWARD, _EXACT)
    assert np.ptp(image[230:].reshape(-1, 3), axis=0).max() <= 1


def test_paint_is_seen_thirty_metres_ahead() -> None:
    road = _rectangle([[-20, -9, -1.5], [90, -9, -1.5], [90, 9, -1.5], [-20, 9, -1.5]], 0.09)
    line = _rectangle(
        [[3, 1.75, -1.5], [80, 1.75, -1.5], [80, 1.9, -1.5], [3, 1.9, -1.5]], 0.75, layer=1
    )
    image = render_image(
        joined([road, line]), _camera(_LENS), _FORWARD, RenderConfig(noise_sd=0, gamma=1)
    )
    pixels, _ = _camera(_LENS).project(_FORWARD.apply(np.array([[30.0, 1.825, -1.5]])))
    column, row = np.rint(pixels[0]).astype(int)
    strip = image[row, column - 12 : column + 13, 0].astype(int)
    assert strip.max() - np.median(strip) > 40
    # Its light along the road stays what its width says: no beat with the pixel grid.
    linear = _linear(image)
    widths, truths = [], []
    for metres in np.linspace(8, 28, 41):
        ends, _ = _camera(_LENS).project(
            _FORWARD.apply(np.array([[metres, 1.75, -1.5], [metres, 1.9, -1.5]]))
        )
        row, left = int(np.rint(ends[0, 1])), int(ends[1, 0])
        window = linear[row, left - 8 : left + 20]
        background = np.median(window)
        truths.append(abs(ends[0, 0] - ends[1, 0]))
        widths.append((window - background).sum())
    ratio = np.array(widths) / np.array(truths)
    assert np.std(ratio) < 0.15 * np.mean(ratio)


def test_light_comes_from_sun_sky_and_lamps() -> None:
    square: list[list[float]] = [[8.0, -4, -4], [8, 4, -4], [8, 4, 4], [8, -4, 4]]
    lit = RenderConfig(noise_sd=0, sun=0.6, ambient=0.2, sun_direction_map=(-1, 0, 0))
    away = lit.model_copy(update={"sun_direction_map": (1.0, 0.0, 0.0)})
    values = [
        int(
            render_image(_rectangle(square, 0.5, emission=e), _camera(), _FORWARD, config)[
                200, 319, 1
            ]
        )
        for e, config in ((0.0, lit), (0.0, away), (1.0, away))
    ]
    expected = [255 * (0.5 * light) ** (1 / 2.2) for light in (0.75, 0.15, 1.15)]
    assert values == pytest.approx(expected, abs=1.0)


def test_the_sky_is_blue_above_and_pale_at_the_horizon() -> None:
    empty = joined([])
    image = render_image(empty, _camera(), _FORWARD, RenderConfig(noise_sd=0)).astype(int)
    assert (np.diff(image[:195, 300, 2]) >= 0).all()
    assert image[0, 300, 0] - image[0, 300, 2] > image[195, 300, 0] - image[195, 300, 2] + 20


def test_haze_takes_a_share_that_grows_with_depth() -> None:
    config = _EXACT.model_copy(update={"fog_per_m": 0.02, "sky_horizon_rgb": (1.0, 1.0, 1.0)})
    levels = [
        _linear(render_image(_wall(x, -90, 90, 0.0), _camera(), _FORWARD, config))[200, 319]
        for x in (10.0, 40.0)
    ]
    assert levels == pytest.approx([1 - np.exp(-0.2), 1 - np.exp(-0.8)], abs=0.01)


def test_noise_is_seeded_and_of_the_size_asked_for() -> None:
    wall = _wall(9, -20, 20, 0.3)
    clean, first, again, other = (
        render_image(wall, _camera(), _FORWARD, _EXACT.model_copy(update=noise))
        for noise in (
            {}, {"noise_sd": 3.0, "seed": 1}, {"noise_sd": 3.0, "seed": 1},
            {"noise_sd": 3.0, "seed": 2},
        )
    )  # fmt: skip
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5
    difference = first.astype(float) - clean
    assert np.std(difference) == pytest.approx(3.0, abs=0.1)
    assert abs(np.mean(difference)) < 0.55  # the clean image is rounded too


def test_a_lens_without_inverse_is_refused() -> None:
    folding = PinholeCamera((640, 400), _K, np.array([-0.9, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(GeometryError, match="no inverse"):
        render_image(_wall(9, -1, 1, 0.5), folding, _FORWARD, _EXACT)


def test_a_mesh_with_a_vertex_that_is_nowhere_is_refused() -> None:
    wall = _wall(9, -1, 1, 0.5)
    wall.vertices[0, 0] = np.nan
    with pytest.raises(GeometryError, match="finite"):
        render_image(wall, _camera(), _FORWARD, _EXACT)


def test_a_pattern_larger_than_its_plate_is_refused() -> None:
    with pytest.raises(GeometryError, match="fit"):
        board_mesh(Checkerboard(7, 5, 0.1), (0.5, 0.5), Transform.identity("map", "board"))
