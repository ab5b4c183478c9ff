"""Where a log has scenes for calibration: stillness of vehicle and boards, and motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.samples import PointCloud
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.stops.motion import at_one_instant, keyframe_stamps, stands_still
from percept.datasets.stops.stillness import Frame, FrameMaker, StillSpan, still_spans
from percept.datasets.synthetic.calibration.capture import CalibrationConfig, Capture
from percept.datasets.synthetic.calibration.course import CalibrationStreet
from percept.datasets.synthetic.creatures import make_pedestrian
from percept.datasets.synthetic.drive import START_NS, Drive, DriveConfig
from percept.datasets.synthetic.ego import Motion
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.lidar import cloud_of_scan, scan_world
from percept.datasets.synthetic.world import World

_STEP_S = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Creeping(Motion):
    """A vehicle that rolls straight on."""

    speed_mps: float

    def _plane(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        return 40 + self.speed_mps * time_s, 0 * time_s, 0 * time_s


@dataclass(frozen=True, slots=True, eq=False)
class Walked(CalibrationStreet):
    """The street with one more person."""

    walker: Placed | None = None

    def objects(self, time_s: float, x_m: float, reach_m: float) -> tuple[Placed, ...]:
        placed = CalibrationStreet.objects(self, time_s, x_m, reach_m)
        return placed if self.walker is None else (*placed, self.walker)


@pytest.fixture(scope="module")
def capture() -> Capture:
    return Capture(CalibrationConfig(seed=3, stops=2, poses=6, beam_share=0.4))


def frames(
    capture: Capture,
    world: World,
    motion: Motion,
    seconds: float,
    step_s: float = _STEP_S,
    sensors: tuple[int, ...] = (0,),
) -> Iterator[Frame]:
    """Scans of some LiDARs as frames."""
    models = [capture.lidars[i] for i in sensors]
    maker = FrameMaker([f"/{model.name}/points" for model in models])
    for number in range(int(seconds / step_s)):
        for place, model in enumerate(models):
            stamp_ns = START_NS + int(5e7 + number * step_s * 1e9) + model.phase_ns
            rng = np.random.default_rng([place, number])
            scan = scan_world(model, world, motion, stamp_ns, 1.0, rng)
            frame = maker.add(cloud_of_scan(scan, model.name))
            if frame is not None:
                yield frame
    last = maker.rest()
    if last is not None:
        yield last


def seconds(span: StillSpan) -> tuple[float, float]:
    return (span.first_ns - START_NS) / 1e9, (span.last_ns - START_NS) / 1e9


@pytest.mark.parametrize("walker_y_m", [None, 5.0, 3.0])
def test_each_pose_of_a_board_is_a_span_of_its_own(
    capture: Capture, walker_y_m: float | None
) -> None:
    street = capture.street
    walker = None
    if walker_y_m is not None:
        person = make_pedestrian(np.random.default_rng(0))
        x_m = capture.motion.course.x_m[0] - 4
        walker = Placed(5, person, x_m, walker_y_m, 0.0, 0.0, 1.3)
    world = Walked(street.seed, street.profile, street.holds, walker)
    duration_s = capture.duration_ns / 1e9
    spans = list(still_spans(frames(capture, world, capture.motion, duration_s, sensors=(0, 1))))
    held = [span for span in spans if span.held_cells]
    found = set()
    for span in held:
        first_s, last_s = seconds(span)
        inside = [
            number
            for number, hold in enumerate(capture.holds)
            if hold.start_s <= first_s and last_s <= hold.end_s
        ]
        assert len(inside) == 1, seconds(span)
        assert span.place == capture.holds[inside[0]].place
        found.add(inside[0])
    assert len(held) == len(found) >= len(capture.holds) - 1
    assert {span.place for span in spans} == {0, 1}


def test_without_boards_a_place_is_one_span(capture: Capture) -> None:
    empty = CalibrationStreet(capture.street.seed, capture.street.profile)
    duration_s = capture.duration_ns / 1e9
    spans = list(still_spans(frames(capture, empty, capture.motion, duration_s)))
    course = capture.motion.course
    assert [span.held_cells for span in spans] == [0, 0]
    assert [span.place for span in spans] == [0, 1]
    for span, arrive_s, leave_s in zip(spans, course.arrive_s, course.leave_s, strict=True):
        first_s, last_s = seconds(span)
        assert arrive_s - 0.2 < first_s < arrive_s + 0.5
        assert leave_s - 0.5 < last_s < leave_s + 0.3


@pytest.mark.parametrize("speed_mps", [0.2, 1.0, 8.0])
def test_a_vehicle_that_moves_is_never_still(capture: Capture, speed_mps: float) -> None:
    empty = CalibrationStreet(capture.street.seed, capture.street.profile)
    motion = Creeping(capture.street.profile, START_NS, speed_mps)
    assert not list(still_spans(frames(capture, empty, motion, 3.0, 0.1)))


def test_a_span_of_a_creeping_vehicle_covers_little_way(capture: Capture) -> None:
    empty = CalibrationStreet(capture.street.seed, capture.street.profile)
    motion = Creeping(capture.street.profile, START_NS, 0.05)
    for span in still_spans(frames(capture, empty, motion, 4.0, 0.1)):
        first_s, last_s = seconds(span)
        assert (last_s - first_s) * 0.05 < 0.06


def test_odometry_overrules_the_scans(capture: Capture) -> None:
    empty = CalibrationStreet(capture.street.seed, capture.street.profile)

    def spans(speed_mps: float, odometry: Callable[[int], bool]) -> list[StillSpan]:
        motion = Creeping(capture.street.profile, START_NS, speed_mps)
        return list(still_spans(frames(capture, empty, motion, 2.0), odometry))

    assert spans(0.0, lambda _: True)
    assert not spans(0.0, lambda _: False)


def test_a_frame_takes_the_nearest_scans_in_time() -> None:
    maker = FrameMaker(["/a", "/b"])
    made = []
    for stamp_ms, topic, range_m in (
        (0, "/a", 5), (20, "/b", 6), (100, "/a", 5), (120, "/b", 7), (200, "/a", 5),
    ):  # fmt: skip
        cloud = PointCloud(
            topic=topic,
            stamp_ns=stamp_ms * 10**6,
            log_time_ns=(stamp_ms + 50) * 10**6,
            points_xyz=np.array([[range_m, 0, 0]], np.float32),
        )
        made.append(maker.add(cloud))
    made.append(maker.rest())
    found = [frame for frame in made if frame is not None]
    ranges = [(f.stamp_ns // 10**6, (f.ranges[f.ranges < 65535] * 0.004).tolist()) for f in found]
    assert ranges[0] == (0, pytest.approx([5, 6], abs=0.005))
    assert ranges[1] == (100, pytest.approx([5, 7], abs=0.005))
    assert ranges[2] == (200, pytest.approx([5], abs=0.005))  # 80 ms are too far apart


def test_points_of_a_moving_scan_come_to_one_instant() -> None:
    drive = Drive(DriveConfig(seconds=1.0, noise=0.0, beam_share=0.2, cameras=()))
    stamps_ns = START_NS + np.arange(0, 1_000_000_001, 20_000_000)
    motion = drive.ego.trajectory(stamps_ns)
    scan = drive.scan(1, 4)
    model = drive.lidars[1]
    cloud = cloud_of_scan(scan, model.name)
    instant_ns = scan.stamp_ns + 7_000_000

    def in_map(points: NDArray[np.float64], stamp_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        T_map_sensor = drive.ego.poses(drive.ego.seconds(stamp_ns)) @ model.T_base_sensor.matrix
        turned = np.einsum("nij,nj->ni", T_map_sensor[:, :3, :3], points)
        return np.asarray(turned + T_map_sensor[:, :3, 3])

    truth = in_map(scan.points_sensor, scan.stamp_ns + scan.offset_ns)
    at_once = at_one_instant(cloud, motion, model.T_base_sensor, instant_ns)
    found = in_map(at_once.astype(np.float64), np.full(len(cloud), instant_ns))
    assert np.linalg.norm(found - truth, axis=1).max() < 0.004
    raw = in_map(scan.points_sensor, np.full(len(cloud), instant_ns))
    assert np.linalg.norm(raw - truth, axis=1).max() > 0.3
    # A place that is turned wrong by 1 deg: what the documentation of the module states.
    turn = np.eye(4)
    turn[:3, :3] = rotation_from_rpy(0, 0, np.radians(1))
    wrong = Transform("base_link", model.name, model.T_base_sensor.matrix @ turn)
    doubtful = at_one_instant(cloud, motion, wrong, instant_ns)
    off = np.linalg.norm(doubtful - at_once, axis=1).max()
    assert 0.003 < off < 0.012


def test_a_cloud_without_times_is_moved_as_a_whole() -> None:
    drive = Drive(DriveConfig(seconds=1.0, noise=0.0, beam_share=0.1, cameras=()))
    motion = drive.ego.trajectory(START_NS + np.arange(0, 1_000_000_001, 20_000_000))
    cloud = replace(cloud_of_scan(drive.scan(0, 4), "lidar_top"), offset_ns=None)
    identity = Transform.identity("base_link", "lidar_top")
    moved = at_one_instant(cloud, motion, identity, cloud.stamp_ns + 50_000_000)
    shift = moved - cloud.points_xyz
    assert np.linalg.norm(shift, axis=1) == pytest.approx(0.45, abs=0.06)
    kept = at_one_instant(cloud, motion, identity, cloud.stamp_ns)
    assert np.abs(kept - cloud.points_xyz).max() < 1e-5


def test_keyframes_are_some_way_apart_and_spread() -> None:
    stamps_ns = np.arange(0, 20_000_000_001, 50_000_000)
    matrices = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    matrices[:, 0, 3] = 2.0 * stamps_ns / 1e9
    motion = Trajectory("odom", "base_link", stamps_ns, matrices)
    scans_ns = np.arange(0, 20_000_000_001, 100_000_000)
    chosen = keyframe_stamps(motion, scans_ns, 5.0, 10)
    assert len(chosen) == 8
    assert np.diff(chosen).min() >= 2.5e9
    few = keyframe_stamps(motion, scans_ns, 5.0, 3)
    assert len(few) == 3
    assert few[-1] - few[0] > 12e9
    assert not keyframe_stamps(motion, scans_ns + 10**12, 5.0, 3)


def test_odometry_tells_standing_from_rolling() -> None:
    stamps_ns = np.arange(0, 4_000_000_001, 20_000_000)
    matrices = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    matrices[:, 0, 3] = 0.3 * np.maximum(stamps_ns / 1e9 - 2, 0)
    motion = Trajectory("odom", "base_link", stamps_ns, matrices)
    assert stands_still(motion, 1_000_000_000)
    assert not stands_still(motion, 3_000_000_000)
