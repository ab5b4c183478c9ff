"""Which LiDARs of a log to use, what they are called, and where sensors sit."""

from __future__ import annotations

from collections.abc import Mapping

from percept.core.errors import InputError, TopicNotFoundError
from percept.core.rig import LidarSensor, Rig
from percept.core.samples import CameraImage, PointCloud, Sample, TransformSample
from percept.core.transform import Transform
from percept.core.transform_tree import TransformTree
from percept.datasets.recording import Recording, TopicInfo

__all__ = [
    "BASE_FRAMES",
    "check_topics",
    "choose_lidars",
    "place_in_base",
    "read_static_transforms",
    "split_topics",
    "topics_of",
]

BASE_FRAMES = ("base_link", "base_footprint", "vehicle", "ego_vehicle")
"""Usual names of the vehicle's own frame, the likeliest first."""

_KINDS: Mapping[type[Sample], str] = {PointCloud: "point clouds", CameraImage: "images"}


def read_static_transforms(recording: Recording) -> TransformTree:
    """Return the tree of all static transforms that the log carries."""
    tree = TransformTree()
    topics = [t.topic for t in recording.topics() if t.sample_type is TransformSample]
    static = [topic for topic in topics if topic.endswith("static")]
    for sample in recording.samples(topics=static) if static else ():
        if isinstance(sample, TransformSample):
            tree.add(sample.T_frame_child, sample.stamp_ns, static=True)
    return tree


def place_in_base(tree: TransformTree, rig: Rig | None, frame: str) -> Transform | None:
    """Return `T_base_frame` as the log's static transforms have it, or None.

    The base is that of the rig where there is one, else the first of the usual names that the
    tree connects with the frame.
    """
    for base_frame in (rig.base_frame,) if rig is not None else BASE_FRAMES:
        if base_frame == frame and base_frame not in tree.frames():
            continue
        T_base_frame = tree.lookup(base_frame, frame) if frame else None
        if T_base_frame is not None:
            return T_base_frame
    return None


def split_topics(
    recording: Recording, wanted: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Split topics that were asked for into those of LiDARs and those of cameras.

    Args:
        recording: The log.
        wanted: Topic by sensor name.

    Raises:
        TopicNotFoundError: If a topic is not in the log; names the candidates.
        InputError: If a topic has neither point clouds nor images.
    """
    every = {t.topic: t for t in recording.topics()}
    usable = tuple(t for t in every.values() if t.sample_type in _KINDS)
    _require(recording, wanted, usable, "point clouds or images")
    kinds = {name: every[topic].sample_type for name, topic in wanted.items()}
    lidars = {name: topic for name, topic in wanted.items() if kinds[name] is PointCloud}
    return lidars, {name: topic for name, topic in wanted.items() if name not in lidars}


def topics_of(recording: Recording, kind: type[Sample]) -> dict[str, TopicInfo]:
    """Return the topics of a log with point clouds, or with images, by name.

    Raises:
        InputError: If there is none; says what there is.
    """
    found = {t.topic: t for t in recording.topics() if t.sample_type is kind}
    if not found:
        raise InputError(
            f"no {_KINDS[kind]} in the log",
            where=recording.paths[0],
            remedy=f"It has {_listed(recording.topics())}",
        )
    return found


def check_topics(recording: Recording, wanted: Mapping[str, str], kind: type[Sample]) -> None:
    """Check that topics by sensor name are in the log and hold point clouds, or images.

    Raises:
        TopicNotFoundError: If a topic is not in the log; names the candidates.
        InputError: If it holds something else.
    """
    usable = tuple(t for t in recording.topics() if t.sample_type is kind)
    _require(recording, wanted, usable, _KINDS[kind])


def choose_lidars(
    recording: Recording,
    rig: Rig | None,
    wanted: Mapping[str, str],
    tree: TransformTree | None = None,
) -> tuple[LidarSensor, ...]:
    """Return the LiDARs to use, in a stable order, each with its topic.

    What was asked for decides; else the LiDARs of the rig whose topics are in the log; else
    every topic with point clouds. The place of a sensor comes from the rig, and from the
    log's own `tf_static` where the rig is silent.

    Args:
        recording: The log.
        rig: The rig that was given, or None.
        wanted: Topic by sensor name, from the command line; may be empty.
        tree: The log's static transforms; read from it where None.

    Raises:
        InputError: If the log, or a topic that was asked for, has no point clouds.
        TopicNotFoundError: If a topic is not in the log; names the candidates.
    """
    clouds = topics_of(recording, PointCloud)
    chosen = dict(wanted) or _topics_of_rig(rig, clouds) or _every_topic(clouds)
    check_topics(recording, chosen, PointCloud)
    tree = read_static_transforms(recording) if tree is None else tree
    return tuple(_placed(recording, name, topic, rig, tree) for name, topic in chosen.items())


def _topics_of_rig(rig: Rig | None, clouds: Mapping[str, TopicInfo]) -> dict[str, str]:
    lidars = rig.lidars().values() if rig is not None else ()
    return {s.name: s.topic for s in lidars if s.topic is not None and s.topic in clouds}


def _every_topic(clouds: Mapping[str, TopicInfo]) -> dict[str, str]:
    """Name every topic that has clouds after itself, without the words that all share."""
    return {
        topic.strip("/").replace("/", "_") or "lidar": topic
        for topic, info in clouds.items()
        if info.count > 0
    } or {topic.strip("/").replace("/", "_") or "lidar": topic for topic in clouds}


def _placed(
    recording: Recording, name: str, topic: str, rig: Rig | None, tree: TransformTree
) -> LidarSensor:
    known = rig.lidars().get(name) if rig is not None else None
    if known is not None and known.T_base_sensor is not None:
        return LidarSensor(name, topic, known.frame, known.T_base_sensor)
    frame = known.frame if known is not None else _frame_of(recording, topic)
    return LidarSensor(name, topic, frame, place_in_base(tree, rig, frame))


def _frame_of(recording: Recording, topic: str) -> str:
    first = next(iter(recording.samples(topics=[topic])), None)
    return first.frame if first is not None else ""


def _require(
    recording: Recording, wanted: Mapping[str, str], usable: tuple[TopicInfo, ...], what: str
) -> None:
    every = {t.topic: t for t in recording.topics()}
    names = {t.topic for t in usable}
    for topic in wanted.values():
        if topic not in every:
            raise TopicNotFoundError(
                f"no topic '{topic}'",
                where=recording.paths[0],
                remedy=f"Topics with {what}: {_listed(usable)}",
            )
        if topic not in names:
            raise InputError(
                f"topic '{topic}' holds {every[topic].msgtype}, not {what}",
                remedy=f"Topics with {what}: {_listed(usable)}",
            )


def _listed(topics: tuple[TopicInfo, ...]) -> str:
    if not topics:
        return "no topics"
    names = [f"{t.topic} ({t.count} {t.msgtype.rpartition('/')[2]})" for t in topics]
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
