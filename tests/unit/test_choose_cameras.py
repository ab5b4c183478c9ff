"""Which cameras of a log are used, and what is known of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import InputError, TopicNotFoundError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.samples import CameraImage, CameraInfo, PointCloud, Sample, TransformSample
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets import open_recording
from percept.datasets.camera_topics import every_topic
from percept.datasets.cameras import CameraStream, choose_cameras
from percept.datasets.recording import Recording, TopicInfo
from percept.datasets.sensors import split_topics
from percept.datasets.write import LogWriter

_K = np.array([[300.0, 0, 159.5], [0, 301, 119.5], [0, 0, 1]])
_OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])

Log = Callable[..., Recording]


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    """Writes samples into a log and opens it."""
    opened: list[Recording] = []

    def make(*samples: Sample) -> Recording:
        path = tmp_path / "log.mcap"
        with LogWriter(path, "mcap") as writer:
            for sample in samples:
                writer.write(sample)
        opened.append(open_recording(path))
        return opened[-1]

    yield make
    for recording in opened:
        recording.close()


def _image(
    topic: str,
    size: tuple[int, int] = (320, 240),
    dtype: Any = np.uint8,
    frame: str = "cam",
    **fields: Any,
) -> CameraImage:
    shape: tuple[int, ...] = (size[1], size[0], 3) if dtype == np.uint8 else (size[1], size[0])
    pixels: NDArray[Any] = np.ones(shape, dtype)
    head: dict[str, Any] = {"stamp_ns": 10, "log_time_ns": 10, "frame": frame}
    return CameraImage(topic=topic, pixels=pixels, **(head | fields))


def _info(topic: str = "/cam/camera_info", **fields: Any) -> CameraInfo:
    values: dict[str, Any] = {
        "image_size": (320, 240),
        "model": "plumb_bob",
        "K": _K,
        "distortion": np.array([-0.1, 0.02, 0, 0, 0]),
    }
    return CameraInfo(topic=topic, stamp_ns=10, log_time_ns=10, frame="cam", **(values | fields))


def _placed(parent: str, child: str, rotation: NDArray[np.float64]) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = 1.0, 0.2, 1.5
    return Transform(parent, child, matrix)


def _static(T_parent_child: Transform) -> TransformSample:
    return TransformSample(
        topic="/tf_static",
        stamp_ns=1,
        log_time_ns=1,
        frame=T_parent_child.target,
        T_frame_child=T_parent_child,
        static=True,
    )


def _rig(**changes: Any) -> Rig:
    values: dict[str, Any] = {
        "name": "front",
        "topic": "/cam/image_raw",
        "frame": "cam",
        "image_size": (320, 240),
        "model": "pinhole",
        "K": (310.0, 310.0, 160.0, 120.0),
        "distortion": (),
        "T_base_sensor": _placed("base_link", "cam", _OPTICAL),
    }
    camera = CameraSensor(**(values | changes))
    return Rig("base_link", {camera.name: camera})


def _only(cameras: Sequence[CameraStream]) -> CameraStream:
    (camera,) = cameras
    return camera


def test_lens_and_place_come_from_the_log(log: Log) -> None:
    place = _placed("base_link", "cam", _OPTICAL)
    recording = log(_static(place), _info(), _image("/cam/image_raw"))
    camera = _only(choose_cameras(recording, None, {}))
    assert (camera.name, camera.topic, camera.frame) == ("cam", "/cam/image_raw", "cam")
    assert camera.image_size == (320, 240)
    assert camera.camera is not None
    assert camera.camera.model == "pinhole"
    np.testing.assert_array_equal(camera.camera.K, _K)
    np.testing.assert_array_equal(camera.camera.distortion, [-0.1, 0.02, 0, 0, 0])
    assert camera.T_base_sensor is not None
    np.testing.assert_allclose(camera.T_base_sensor.matrix, place.matrix, atol=1e-12)
    assert camera.notes == ()


def test_the_rig_wins_over_the_log(log: Log) -> None:
    other = _placed("base_link", "cam", _OPTICAL @ rotation_from_rpy(0, 0.1, 0))
    recording = log(_static(other), _info(), _image("/cam/image_raw"))
    rig = _rig()
    camera = _only(choose_cameras(recording, rig, {}))
    assert camera.name == "front"
    assert camera.camera is not None
    assert camera.camera.K[0, 0] == 310
    assert camera.T_base_sensor is rig.cameras()["front"].T_base_sensor


def test_a_rig_without_a_place_takes_that_of_the_log(log: Log) -> None:
    place = _placed("base_link", "cam", _OPTICAL)
    recording = log(_static(place), _image("/cam/image_raw"))
    camera = _only(choose_cameras(recording, _rig(T_base_sensor=None), {}))
    assert camera.T_base_sensor is not None
    np.testing.assert_allclose(camera.T_base_sensor.matrix, place.matrix, atol=1e-12)


def test_a_log_without_lens_and_place_says_so(log: Log) -> None:
    camera = _only(choose_cameras(log(_image("/cam/image_raw")), None, {}))
    assert camera.camera is None
    assert camera.T_base_sensor is None
    assert camera.notes == (
        "its intrinsics are not known: neither a rig nor the log has them",
        "its place is not known: no transform leads to frame 'cam'",
    )


def test_intrinsics_of_the_rig_are_scaled_to_images_of_the_same_shape(log: Log) -> None:
    camera = _only(choose_cameras(log(_image("/cam/image_raw", (160, 120))), _rig(), {}))
    assert camera.camera is not None
    assert camera.camera.image_size == (160, 120)
    # The outer edge of the image is at -0.5: half of it stays there.
    np.testing.assert_allclose(
        camera.camera.K, [[155.0, 0, 79.75], [0.0, 155, 59.75], [0.0, 0, 1]], atol=1e-12
    )
    assert camera.notes == (
        "the rig's intrinsics are for 320x240 images, these have 160x120: scaled",
    )


@pytest.mark.parametrize("from_rig", [True, False])
def test_intrinsics_for_another_shape_are_not_used(log: Log, *, from_rig: bool) -> None:
    recording = log(_info(), _image("/cam/image_raw", (320, 200)))
    camera = _only(choose_cameras(recording, _rig() if from_rig else None, {}))
    assert camera.camera is None
    assert "are for 320x240 images, these have 320x200" in camera.notes[0]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"K": np.zeros((3, 3))}, "not calibrated"),
        ({"K": _K * [[1, 1, 9], [1, 1, 1], [1, 1, 1]]}, "is outside the image"),
        ({"model": "omnidirectional"}, "no camera model 'omnidirectional'"),
        ({"distortion": np.full(14, 0.1)}, "thin prism"),
        ({"model": "equidistant", "distortion": np.full(8, 0.1)}, "has 4 coefficients"),
    ],
)
def test_intrinsics_of_the_log_that_cannot_be_right_are_not_used(
    log: Log, fields: dict[str, Any], reason: str
) -> None:
    camera = _only(choose_cameras(log(_info(**fields), _image("/cam/image_raw")), None, {}))
    assert camera.camera is None
    assert "its intrinsics are not known" in camera.notes[0]
    assert reason in camera.notes[0]


def test_a_size_of_nothing_in_camera_info_is_that_of_the_images(log: Log) -> None:
    recording = log(_info(image_size=(0, 0)), _image("/cam/image_raw"))
    camera = _only(choose_cameras(recording, None, {}))
    assert camera.camera is not None
    assert camera.camera.image_size == (320, 240)


@pytest.mark.parametrize("distorted", [True, False])
def test_rectified_images_do_not_have_the_lens_of_the_raw_ones(
    log: Log, *, distorted: bool
) -> None:
    distortion = np.array([-0.1, 0, 0, 0, 0]) * distorted
    recording = log(_info(distortion=distortion), _image("/cam/image_rect_color"))
    camera = _only(choose_cameras(recording, None, {}))
    assert (camera.camera is None) == distorted
    assert ("rectified" in camera.notes[0]) == distorted


def test_a_frame_that_looks_up_is_no_optical_frame(log: Log) -> None:
    """Drivers stamp images with the body frame, x ahead; then its place would be wrong."""
    body = _placed("base_link", "cam", np.eye(3))
    camera = _only(choose_cameras(log(_static(body), _image("/cam/image_raw")), None, {}))
    assert camera.T_base_sensor is None
    assert "no optical frame" in camera.notes[1]


def test_the_optical_frame_beside_a_body_frame_is_used(log: Log) -> None:
    body = _placed("base_link", "cam_link", np.eye(3))
    optical = Transform("cam_link", "cam_optical_frame", np.block([
        [_OPTICAL, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))],
    ]))  # fmt: skip
    recording = log(_static(body), _static(optical), _image("/c/image_raw", frame="cam_link"))
    camera = _only(choose_cameras(recording, None, {}))
    assert camera.frame == "cam_optical_frame"
    assert camera.T_base_sensor is not None
    np.testing.assert_allclose(camera.T_base_sensor.rotation, _OPTICAL, atol=1e-12)
    assert "'cam_optical_frame' is used" in camera.notes[1]


def test_cameras_are_named_after_their_topics(log: Log) -> None:
    topics = [
        "/left/image_raw",
        "/right/image_raw",
        "/right/image_rect",
        "/image_raw",
        "/a/b",
        "/a_b",
    ]
    named = {c.name: c.topic for c in choose_cameras(log(*map(_image, topics)), None, {})}
    assert named == {
        "left": "/left/image_raw",
        "right_image_raw": "/right/image_raw",
        "right_image_rect": "/right/image_rect",
        "image_raw": "/image_raw",
        "/a/b": "/a/b",
        "/a_b": "/a_b",
    }


def test_topics_without_images_are_no_cameras_unless_all_are() -> None:
    counts = {"/left/image_raw": 3, "/right/image_raw": 0}
    kind = "sensor_msgs/msg/Image"
    for scale, names in ((1, {"left"}), (0, {"left", "right"})):
        topics = {t: TopicInfo(t, kind, n * scale, CameraImage) for t, n in counts.items()}
        assert set(every_topic(topics)) == names


def test_a_camera_that_is_there_plain_and_compressed_is_looked_at_once(log: Log) -> None:
    recording = log(_image("/cam/image_raw"), _image("/cam/image_raw/compressed"))
    camera = _only(choose_cameras(recording, None, {}))
    assert (camera.name, camera.topic) == ("cam", "/cam/image_raw")
    assert "the same images are in /cam/image_raw/compressed, which is left alone" in camera.notes


def test_of_two_transports_the_one_with_more_images_is_taken(log: Log) -> None:
    more = [_image("/cam/image_raw/compressed", log_time_ns=10 + k) for k in range(2)]
    camera = _only(choose_cameras(log(_image("/cam/image_raw"), *more), None, {}))
    assert camera.topic == "/cam/image_raw/compressed"


def test_the_rig_knows_a_camera_in_whichever_transport_it_is(log: Log) -> None:
    recording = log(_image("/cam/image_raw/compressed"), _image("/rear/image_raw"))
    camera = _only(choose_cameras(recording, _rig(), {}))
    assert (camera.name, camera.topic) == ("front", "/cam/image_raw/compressed")
    assert camera.notes[-1] == (
        "the rig does not have the cameras of /rear/image_raw: they are left alone"
    )


def test_what_is_asked_for_decides(log: Log) -> None:
    recording = log(_image("/cam/image_raw"), _image("/rear/image_raw"))
    camera = _only(choose_cameras(recording, _rig(), {"back": "/rear/image_raw"}))
    assert (camera.name, camera.topic) == ("back", "/rear/image_raw")


@pytest.mark.parametrize(
    ("topic", "dtype", "frame"),
    [
        ("/cam/depth/image_raw", np.uint16, "cam"),
        ("/cam/depth/image_raw", np.float32, "cam"),
        ("/cam/aligned_depth_to_color/image_raw", np.uint16, "other"),
    ],
)
def test_depth_images_go_with_the_camera_whose_view_they_show(
    log: Log, topic: str, dtype: Any, frame: str
) -> None:
    depth = _image(topic, (160, 120), dtype, frame)
    camera = _only(choose_cameras(log(_image("/cam/color/image_raw"), depth), None, {}))
    assert (camera.name, camera.depth_topic) == ("cam_color", topic)


def test_of_several_depth_images_those_beside_the_camera_are_taken(log: Log) -> None:
    """A frame that two cameras share by mistake does not mix them up."""
    topics = ["/left/depth/image_raw", "/the_right_one/depth/image_raw"]
    depths = [_image(topic, dtype=np.uint16) for topic in topics]
    camera = _only(choose_cameras(log(_image("/left/color/image_raw"), *depths), None, {}))
    assert camera.depth_topic == "/left/depth/image_raw"


@pytest.mark.parametrize(("size", "frame"), [((320, 240), "depth"), ((320, 200), "cam")])
def test_depth_images_of_another_view_are_left_alone(
    log: Log, size: tuple[int, int], frame: str
) -> None:
    depth = _image("/cam/depth/image_raw", size, np.uint16, frame)
    camera = _only(choose_cameras(log(_image("/cam/color/image_raw"), depth), None, {}))
    assert camera.depth_topic is None
    assert camera.notes[-1] == (
        "the depth images in /cam/depth/image_raw do not show its view, and are left alone"
    )


def test_a_thermal_camera_of_16_bits_is_a_camera(log: Log) -> None:
    camera = _only(choose_cameras(log(_image("/thermal/image_raw", dtype=np.uint16)), None, {}))
    assert camera.name == "thermal"


def test_topics_that_cannot_be_cameras_are_refused(log: Log) -> None:
    depth = _image("/depth/image_raw", dtype=np.float32)
    cloud = PointCloud(
        topic="/points", stamp_ns=10, log_time_ns=10, points_xyz=np.zeros((1, 3), np.float32)
    )
    recording = log(depth, cloud, _image("/cam/image_raw"))
    with pytest.raises(
        TopicNotFoundError, match=r"no topic '/x'. Topics with images: /cam/image_raw"
    ):
        choose_cameras(recording, None, {"x": "/x"})
    with pytest.raises(InputError, match="'/points' holds sensor_msgs/msg/PointCloud2, not images"):
        choose_cameras(recording, None, {"x": "/points"})
    with pytest.raises(InputError, match="holds depth images"):
        choose_cameras(recording, None, {"x": "/depth/image_raw"})


def test_a_log_without_cameras_says_what_it_has(log: Log) -> None:
    recording = log(_info())
    with pytest.raises(InputError, match=r"no images in the log. It has /cam/camera_info"):
        choose_cameras(recording, None, {})


def test_topics_are_split_by_what_they_hold(log: Log) -> None:
    cloud = PointCloud(
        topic="/points", stamp_ns=10, log_time_ns=10, points_xyz=np.zeros((1, 3), np.float32)
    )
    recording = log(cloud, _image("/cam/image_raw"), _info())
    wanted = {"front": "/cam/image_raw", "top": "/points"}
    assert split_topics(recording, wanted) == ({"top": "/points"}, {"front": "/cam/image_raw"})
    with pytest.raises(TopicNotFoundError, match="Topics with point clouds or images"):
        split_topics(recording, {"top": "/x"})
    with pytest.raises(InputError, match="CameraInfo, not point clouds or images"):
        split_topics(recording, {"top": "/cam/camera_info"})


def test_where_the_clouds_of_a_lidar_are_for_a_camera(log: Log) -> None:
    """Through the base where both have a place in it; else through the log's own frames."""
    T_base_camera = _placed("base_link", "cam", _OPTICAL)
    T_lidar_camera = _placed("velodyne", "cam", _OPTICAL @ rotation_from_rpy(0, 0.2, 0))
    placed = LidarSensor("top", "/points", "velodyne", _placed("base_link", "velodyne", np.eye(3)))
    loose = LidarSensor("top", "/points", "velodyne", None)
    recording = log(_static(T_lidar_camera), _image("/cam/image_raw"))
    through_frames = _only(choose_cameras(recording, None, {}))
    through_base = _only(choose_cameras(recording, _rig(), {}))

    def matrix(camera: CameraStream, lidar: LidarSensor) -> NDArray[np.float64]:
        place = camera.place_of(lidar)
        assert place is not None
        return place.matrix

    expected = T_lidar_camera.inverse()
    np.testing.assert_allclose(matrix(through_base, placed), T_base_camera.inverse().matrix)
    np.testing.assert_allclose(matrix(through_frames, loose), expected.matrix, atol=1e-12)
    assert placed.T_base_sensor is not None
    from_base = expected @ placed.T_base_sensor.inverse()
    np.testing.assert_allclose(matrix(through_frames, placed), from_base.matrix, atol=1e-12)
    elsewhere = LidarSensor("x", "/x", "x", None)
    assert through_frames.place_of(elsewhere) is None


def test_a_camera_in_its_body_frame_has_no_place_beside_a_lidar(log: Log) -> None:
    T_lidar_body = _placed("velodyne", "cam", np.eye(3))
    camera = _only(choose_cameras(log(_static(T_lidar_body), _image("/cam/image_raw")), None, {}))
    assert camera.place_of(LidarSensor("top", "/points", "velodyne", None)) is None


def test_a_camera_of_which_no_image_can_be_read_is_named_all_the_same(tmp_path: Path) -> None:
    for number in range(2):
        (tmp_path / "cam").mkdir(exist_ok=True)
        (tmp_path / "cam" / f"{number:06}.png").write_bytes(b"no picture")
    with open_recording(tmp_path) as recording:
        camera = _only(choose_cameras(recording, None, {}))
        assert recording.losses.total() == 2
    assert camera.image_size is None
    assert camera.camera is None
    assert camera.notes[0] == "none of its first 20 images can be read"
