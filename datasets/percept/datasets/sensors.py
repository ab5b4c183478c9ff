"""Which LiDARs of a log to use, what they are called, and where they sit."""

from __future__ import annotations

from collections.abc import Mapping

from percept.core.errors import InputError, TopicNotFoundError
from percept.core.rig import LidarSensor, Rig
from percept.core.samples import PointCloud, TransformSample
from percept.core.transform_tree import TransformTree
from percept.datasets.recording import Recording, TopicInfo

__all__ = ["choose_lidars", "read_static_transforms"]

_BASE_FRAMES = ("base_link", "base_footprint", "vehicle", "ego_vehicle")


def read_static_transforms(recording: Recording) -> TransformTree:
    """Return the tree of all static transforms that the log carries."""
    tree = TransformTree()
    topics = [t.topic for t in recording.topics() if t.sample_type is TransformSample]
    static = [topic for topic in topics if topic.endswith("static")]
    for sample in recording.samples(topics=static) if static else ():
        if isinstance(sample, TransformSample):
            tree.add(sample.T_frame_child, sample.stamp_ns, static=True)
    return tree


def choose_lidars(
    recording: Recording, rig: Rig | None, wanted: Mapping[str, str]
) -> tuple[LidarSensor, ...]:
    """Return the LiDARs to use, in a stable order, each with its topic.

    What was asked for decides; else the LiDARs of the rig whose topics are in the log; else
    every topic with point clouds. The place of a sensor comes from the rig, and from the
    log's own `tf_static` where the rig is silent.

    Args:
        recording: The log.
        rig: The rig that was given, or None.
        wanted: Topic by sensor name, from the command line; may be empty.

    Raises:
        InputError: If the log, or a topic that was asked for, has no point clouds.
        TopicNotFoundError: If a topic is not in the log; names the candidates.
    """
    clouds = {t.topic: t for t in recording.topics() if t.sample_type is PointCloud}
    if not clouds:
        raise InputError(
            "no point clouds in the log",
            where=recording.paths[0],
            remedy=f"It has {_listed(recording.topics())}",
        )
    chosen = dict(wanted) or _topics_of_rig(rig, clouds) or _every_topic(clouds)
    every = {t.topic: t for t in recording.topics()}
    for topic in chosen.values():
        if topic not in every:
            raise TopicNotFoundError(
                f"no topic '{topic}'",
                where=recording.paths[0],
                remedy=f"Topics with point clouds: {_listed(tuple(clouds.values()))}",
            )
        if topic not in clouds:
            raise InputError(
                f"topic '{topic}' holds {every[topic].msgtype}, not point clouds",
                remedy=f"Topics with point clouds: {_listed(tuple(clouds.values()))}",
            )
    tree = read_static_transforms(recording)
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
    base_frames = (rig.base_frame,) if rig is not None else _BASE_FRAMES
    for base_frame in base_frames:
        if base_frame == frame and base_frame not in tree.frames():
            continue
        T_base_sensor = tree.lookup(base_frame, frame) if frame else None
        if T_base_sensor is not None:
            return LidarSensor(name, topic, frame, T_base_sensor)
    return LidarSensor(name, topic, frame, None)


def _frame_of(recording: Recording, topic: str) -> str:
    first = next(iter(recording.samples(topics=[topic])), None)
    return first.frame if first is not None else ""


def _listed(topics: tuple[TopicInfo, ...]) -> str:
    if not topics:
        return "no topics"
    names = [f"{t.topic} ({t.count} {t.msgtype.rpartition('/')[2]})" for t in topics]
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
