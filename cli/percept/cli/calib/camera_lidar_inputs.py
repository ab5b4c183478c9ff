"""The pairs of `percept calib camera-lidar`: from files, or from the stops of a log."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.calib.formats.models import model_and_coefficients
from percept.cli.window import log_window_ns
from percept.core.errors import InputError, UsageError
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage, CameraInfo, PointCloud
from percept.datasets import open_recording, read_point_cloud
from percept.datasets.decoding.images import pixels_of_file_bytes
from percept.datasets.recording import Recording
from percept.datasets.stops.find import find_stops

__all__ = ["PairInputs", "Shot", "listed_pairs", "shots_from_bags", "shots_from_files"]


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An image and a cloud of one moment.

    Attributes:
        name: Of the pair.
        read_image: Returns the image, (H, W) or (H, W, 3) BGR.
        points: (N, 3) float32 in the LiDAR's frame, metres.
    """

    name: str
    read_image: Callable[[], Any]
    points: Any


@dataclass(frozen=True, slots=True, eq=False)
class PairInputs:
    """What there is to calibrate.

    Attributes:
        shots: The pairs, in the order given.
        files: What was read.
        camera_frame, lidar_frame: Frames of a log, or None.
        camera_topic, lidar_topic: Topics of a log, or None.
        log_intrinsics: Intrinsics that the log carries, or None.
        notes: What a user should know.
        dropped: What was left out, by reason.
    """

    shots: tuple[Shot, ...]
    files: tuple[Path, ...]
    camera_frame: str | None = None
    lidar_frame: str | None = None
    camera_topic: str | None = None
    lidar_topic: str | None = None
    log_intrinsics: CameraSensor | None = None
    notes: tuple[str, ...] = ()
    dropped: Counter[str] | None = None


def listed_pairs(entries: Sequence[str], table: Path | None) -> list[tuple[Path, Path]]:
    """Return image and cloud of each pair that the command line or a table names.

    Raises:
        UsageError: If an entry is not of its form, or the table has no such columns.
    """
    listed = []
    for entry in entries:
        image, equals, cloud = entry.partition("=")
        if not equals or not image or not cloud:
            raise UsageError(f"--pair '{entry}' is not of the form IMAGE=CLOUD")
        listed.append((Path(image), Path(cloud)))
    return listed + ([] if table is None else _of_table(table))


def _of_table(path: Path) -> list[tuple[Path, Path]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"cannot be read ({error})", where=path) from error
    if not rows or not {"image", "cloud"} <= set(rows[0]):
        raise UsageError(
            "has no rows with the columns image and cloud",
            where=path,
            remedy="Begin it with the line image,cloud",
        )
    if not all(row["image"] and row["cloud"] for row in rows):
        raise UsageError("has a row without an image or a cloud", where=path)
    return [(path.parent / row["image"], path.parent / row["cloud"]) for row in rows]


def shots_from_files(
    listed: Sequence[tuple[Path, Path]], progress: Callable[[float], None]
) -> PairInputs:
    """Read the clouds of pairs; the images are read when they are asked for.

    Raises:
        InputError: If a file is missing or a cloud cannot be read.
    """
    for path in (path for pair in listed for path in pair):
        if not path.is_file():
            raise InputError("no such file", where=path, remedy="Check the pair that names it")
    dropped: Counter[str] = Counter()
    shots = []
    for number, (image, cloud_path) in enumerate(listed):
        cloud = read_point_cloud(cloud_path, Counter())
        if cloud.dropped_nonfinite:
            dropped["points that are not finite"] += cloud.dropped_nonfinite
        shots.append(Shot(image.stem, _reader(image), cloud.points_xyz))
        progress((number + 1) / len(listed))
    files = tuple(dict.fromkeys(path for pair in listed for path in pair))
    return PairInputs(tuple(_unique(shots)), files, dropped=dropped)


def _unique(shots: Sequence[Shot]) -> list[Shot]:
    """Name shots whose images have one name by their place in the list too."""
    names = Counter(shot.name for shot in shots)
    return [
        shot
        if names[shot.name] == 1
        else Shot(f"{k + 1}:{shot.name}", shot.read_image, shot.points)
        for k, shot in enumerate(shots)
    ]


def _reader(path: Path) -> Callable[[], Any]:
    def read() -> Any:  # noqa: ANN401 - pixels; the command line knows no numpy
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read ({error.strerror})", where=path) from error
        return pixels_of_file_bytes(content, str(path))[0]

    return read


def shots_from_bags(
    bags: Sequence[Path],
    topics: tuple[str | None, str | None],
    window_s: tuple[float | None, float | None],
    progress: Callable[[float], None],
) -> PairInputs:
    """Take a pair from each span of a log in which everything stands still.

    Args:
        bags: The log.
        topics: Of the images and of the clouds; None takes the only one of the log.
        window_s: `--start` and `--end`.
        progress: Called with the share that is done.

    Raises:
        PerceptError: If the log cannot be used.
    """
    with open_recording(list(bags)) as recording:
        image_topic = _topic(recording, topics[0], CameraImage, "--image-topic", "images")
        cloud_topic = _topic(recording, topics[1], PointCloud, "--cloud-topic", "point clouds")
        start_ns, end_ns = log_window_ns(recording, *window_s)
        stops = find_stops(
            recording,
            [cloud_topic],
            [image_topic],
            start_ns=start_ns,
            end_ns=end_ns,
            progress=progress,
        )
        whole = [s for s in stops if cloud_topic in s.clouds and image_topic in s.images]
        if not whole:
            raise InputError(
                "no stop has both an image and a cloud",
                where=recording.paths[0],
                remedy="Hold the board still for 1 s in each pose",
            )
        dropped = Counter(recording.losses)
        if len(whole) < len(stops):
            dropped["stops without an image or a cloud"] = len(stops) - len(whole)
        first = whole[0].images[image_topic]
        return PairInputs(
            shots=tuple(
                Shot(
                    f"{(s.start_ns - whole[0].start_ns) / 1e9:.1f} s",
                    _held(s.images[image_topic]),
                    s.clouds[cloud_topic],
                )
                for s in whole
            ),
            files=recording.paths,
            camera_frame=first.frame or None,
            lidar_frame=whole[0].cloud_frames[cloud_topic],
            camera_topic=image_topic,
            lidar_topic=cloud_topic,
            log_intrinsics=_log_intrinsics(recording, first),
            notes=tuple(dict.fromkeys(s.note for s in whole if s.note)),
            dropped=dropped,
        )


def _held(image: CameraImage) -> Callable[[], Any]:
    return lambda: image.pixels


def _topic(recording: Recording, given: str | None, kind: type, flag: str, what: str) -> str:
    known = [t.topic for t in recording.topics() if issubclass(t.sample_type, kind)]
    if given is not None:
        return given
    if len(known) != 1:
        raise UsageError(
            f"the log has {len(known)} topics with {what}",
            where=recording.paths[0],
            remedy=f"Give {flag}" + (f", one of {', '.join(known)}" if known else ""),
        )
    return known[0]


def _log_intrinsics(recording: Recording, image: CameraImage) -> CameraSensor | None:
    """Return the intrinsics that the log has for the camera of an image, or None.

    They belong to it when they lie beside it (`/cam/camera_info` and `/cam/image_raw`), or have
    its frame.
    """
    infos = [t.topic for t in recording.topics() if issubclass(t.sample_type, CameraInfo)]
    for topic in sorted(infos, key=lambda t: -_shared(t, image.topic)):
        for sample in recording.samples(topics=[topic]):
            if not isinstance(sample, CameraInfo):
                continue
            beside = _shared(topic, image.topic) == len(topic.split("/")) - 1
            if beside or (sample.frame and sample.frame == image.frame):
                return _as_sensor(sample, image.topic, recording.paths[0])
            break
    return None


def _shared(topic: str, other: str) -> int:
    """Return how many leading parts two topics share."""
    pairs = zip(topic.split("/"), other.split("/"), strict=False)
    return next((k for k, (a, b) in enumerate(pairs) if a != b), len(topic.split("/")))


def _as_sensor(info: CameraInfo, topic: str, path: Path) -> CameraSensor:
    model, distortion = model_and_coefficients(info.model, info.distortion.tolist(), path)
    K = info.K
    return CameraSensor(
        name="camera",
        topic=topic,
        frame=info.frame or "camera",
        image_size=info.image_size,
        model=model,
        K=(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])),
        distortion=distortion,
        T_base_sensor=None,
    )
