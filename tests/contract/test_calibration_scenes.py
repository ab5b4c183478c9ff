"""Scenes for calibration out of real logs of all kinds, and what is said where there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import merge
from pathlib import Path

import numpy as np
import pytest

from percept.core.errors import InputError, InsufficientDataError, TopicNotFoundError
from percept.core.samples import CameraImage, OdometrySample, PointCloud, Sample, TransformSample
from percept.datasets import open_recording
from percept.datasets.stops.find import SceneConfig, find_stops
from percept.datasets.synthetic.calibration.capture import CalibrationConfig, Capture
from percept.datasets.synthetic.drive import START_NS, Drive, DriveConfig
from percept.datasets.write import LogFormat, LogWriter

TOP, LEFT = "/lidar_top/points", "/lidar_left/points"
IMAGES = "/camera/image"
_SUFFIX = {"rosbag1": ".bag", "rosbag2": "", "mcap": ".mcap"}


@pytest.fixture(scope="module")
def capture() -> Capture:
    return Capture(CalibrationConfig(seed=3, stops=2, poses=4, beam_share=0.3))


@pytest.fixture(scope="module")
def samples(capture: Capture) -> list[Sample]:
    """Clouds of two LiDARs, odometry, and images that are noise, every other one blurred."""
    without_images = Capture(capture.config.model_copy(update={"cameras": ()}))
    without_images.street = capture.street
    without_images.motion = capture.motion
    without_images.duration_ns = capture.duration_ns
    kept = [s for s in without_images.samples() if s.topic in (TOP, LEFT, "/odometry")]
    return list(merge(kept, _images(capture.duration_ns), key=lambda s: s.log_time_ns))


def _images(duration_ns: int) -> Iterator[Sample]:
    rng = np.random.default_rng(0)
    for number in range(duration_ns // 100_000_000):
        stamp_ns = START_NS + number * 100_000_000
        sharp = rng.integers(0, 255, (24, 32), dtype=np.uint8)
        pixels = sharp if number % 2 else np.full_like(sharp, 100)
        yield CameraImage(
            topic=IMAGES, stamp_ns=stamp_ns, log_time_ns=stamp_ns + 20_000_000, pixels=pixels,
            frame="camera", encoding="mono8",
        )  # fmt: skip


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def make(samples: list[Sample], log_format: LogFormat = "mcap") -> Path:
        path = tmp_path / f"log{_SUFFIX[log_format]}"
        with LogWriter(path, log_format) as writer:
            for sample in samples:
                writer.write(sample)
        return path

    return make


@pytest.mark.parametrize("log_format", ["mcap", "rosbag1", "rosbag2"])
def test_each_pose_is_a_stop_with_its_scans_and_its_sharpest_image(
    capture: Capture, samples: list[Sample], write: Write, log_format: LogFormat
) -> None:
    shares: list[float] = []
    with open_recording(write(samples, log_format)) as recording:
        stops = find_stops(recording, [TOP, LEFT], [IMAGES], progress=shares.append)
    held = [stop for stop in stops if stop.held_cells]
    assert len(held) == 4
    for stop, hold in zip(held, capture.holds, strict=True):
        assert hold.start_s <= (stop.start_ns - START_NS) / 1e9
        assert (stop.end_ns - START_NS) / 1e9 <= hold.end_s
        assert stop.place == hold.place
        image = stop.images[IMAGES]
        assert stop.start_ns <= image.stamp_ns <= stop.end_ns
        assert image.pixels.std() > 50
        assert stop.cloud_frames == {TOP: "lidar_top", LEFT: "lidar_left"}
        scans = [
            s
            for s in samples
            if isinstance(s, PointCloud)
            and s.topic == TOP
            and stop.start_ns <= s.stamp_ns <= stop.end_ns
        ]
        assert len(stop.clouds[TOP]) == sum(len(s) for s in scans)
        assert stop.clouds[TOP].dtype == np.float32
        assert not stop.note
        assert not stop.moving
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_without_cameras_a_place_is_one_scene(samples: list[Sample], write: Write) -> None:
    with open_recording(write(samples)) as recording:
        stops = find_stops(recording, [TOP, LEFT])
        few = find_stops(recording, [TOP, LEFT], config=SceneConfig(most_stops=1, most_scans=1))
    assert [stop.place for stop in stops] == [0, 1]
    assert len(few) == 1
    assert few[0].note == "1 more stops in the log were left out"
    assert len(few[0].clouds[TOP]) < len(stops[0].clouds[TOP])


def test_a_part_of_a_log_has_the_scenes_of_that_part(samples: list[Sample], write: Write) -> None:
    with open_recording(write(samples)) as recording:
        stops = find_stops(recording, [TOP], end_ns=START_NS + 3_000_000_000)
        later = find_stops(recording, [TOP], start_ns=START_NS + 5_500_000_000)
    assert len(stops) == len(later) == 1
    assert stops[0].end_ns < START_NS + 3_000_000_000 < later[0].start_ns


def test_a_camera_or_lidar_that_gave_nothing_is_named(samples: list[Sample], write: Write) -> None:
    late_ns = START_NS + 4_500_000_000
    kept = [s for s in samples if s.topic not in (IMAGES, LEFT) or s.stamp_ns > late_ns]
    with open_recording(write(kept)) as recording:
        stops = find_stops(recording, [TOP, LEFT], [IMAGES])
    first = next(stop for stop in stops if stop.held_cells)
    assert first.note == f"no scan of {LEFT}; no image of {IMAGES}"
    assert list(first.clouds) == [TOP]
    assert not first.images


@pytest.fixture(scope="module")
def moving() -> list[Sample]:
    """A drive that never stops."""
    drive = Drive(DriveConfig(seconds=2.5, beam_share=0.2, cameras=()))
    topics = (TOP, LEFT, "/odometry", "/tf_static")
    return [s for s in drive.samples() if s.topic in topics]


def test_a_moving_vehicle_gives_keyframes(moving: list[Sample], write: Write) -> None:
    with open_recording(write(moving)) as recording:
        stops = find_stops(recording, [TOP, LEFT])
    assert 2 <= len(stops) <= 5
    assert all(stop.moving and set(stop.clouds) == {TOP, LEFT} for stop in stops)
    assert [stop.place for stop in stops] == list(range(len(stops)))
    assert "moving at 9" in stops[0].note
    poses = {s.stamp_ns: s.T_frame_child for s in moving if isinstance(s, OdometrySample)}
    at = [poses[min(poses, key=lambda t: abs(t - s.start_ns))].translation_m[0] for s in stops]
    assert np.diff(at).min() > 4.5


def test_a_moving_vehicle_without_odometry_is_told_to_stop(
    moving: list[Sample], write: Write
) -> None:
    kept = [s for s in moving if not isinstance(s, OdometrySample)]
    with (
        open_recording(write(kept)) as recording,
        pytest.raises(InsufficientDataError, match=r"no stop found.*Stand still for 2 s"),
    ):
        find_stops(recording, [TOP, LEFT])


def test_a_moving_lidar_without_a_place_is_refused(moving: list[Sample], write: Write) -> None:
    kept = [s for s in moving if not isinstance(s, TransformSample)]
    with open_recording(write(kept)) as recording:
        with pytest.raises(InsufficientDataError, match="the place of /lidar_top/points"):
            find_stops(recording, [TOP])
        places = {
            s.frame: s.T_frame_child
            for s in moving
            if isinstance(s, TransformSample) and s.T_frame_child.source == "lidar_top"
        }
        stops = find_stops(recording, [TOP], T_base_sensor={TOP: places["base_link"]})
    assert stops[0].moving


def test_topics_are_checked(samples: list[Sample], write: Write) -> None:
    with open_recording(write(samples[:50])) as recording:
        with pytest.raises(TopicNotFoundError, match="no topic '/nowhere'"):
            find_stops(recording, ["/nowhere"])
        with pytest.raises(InputError, match="holds no point clouds"):
            find_stops(recording, [IMAGES])
        with pytest.raises(InputError, match="holds no images"):
            find_stops(recording, [TOP], [TOP])
        with pytest.raises(InputError, match="no topic with point clouds"):
            find_stops(recording, [])


def test_empty_scans_give_no_scene(write: Write) -> None:
    empty = PointCloud(
        topic=TOP, stamp_ns=START_NS, log_time_ns=START_NS, frame="lidar_top",
        points_xyz=np.zeros((0, 3), np.float32),
    )  # fmt: skip
    clouds: list[Sample] = [
        replace(empty, stamp_ns=START_NS + n * 10**8, log_time_ns=START_NS + n * 10**8)
        for n in range(20)
    ]
    with (
        open_recording(write(clouds)) as recording,
        pytest.raises(InsufficientDataError, match="all 20 scans are empty"),
    ):
        find_stops(recording, [TOP])
