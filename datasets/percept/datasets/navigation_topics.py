"""Which topics of a log tell of the vehicle's own motion, and where their sensors sit."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from itertools import islice

import numpy as np

from percept.core.errors import InputError, TopicNotFoundError, UsageError
from percept.core.navigation import NavigationTopics
from percept.core.rig import Rig
from percept.core.samples import (
    GnssFix,
    ImuSample,
    OdometrySample,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.core.transform import Transform
from percept.core.transform_tree import TransformTree
from percept.datasets.recording import Recording, TopicInfo
from percept.datasets.sensors import BASE_FRAMES, read_static_transforms

__all__ = ["choose_navigation"]

_KINDS: Mapping[str, type[Sample]] = {
    "gnss": GnssFix,
    "imu": ImuSample,
    "odometry": OdometrySample,
    "pose": PoseSample,
    "tf": TransformSample,
}
_FIRST_TRANSFORMS = 2000
_DEFAULT_BASE = "base_link"
_STILL = 1e-9


def choose_navigation(
    recording: Recording,
    rig: Rig | None,
    wanted: Mapping[str, str] | None = None,
    tree: TransformTree | None = None,
) -> NavigationTopics:
    """Return the topics that the vehicle's poses can come from.

    What was asked for decides; else of each kind the topic with the most messages. Places come
    from the log's static transforms; they lead to the base frame of the rig, or to the first
    usual name of a vehicle's frame that the log has.

    Args:
        recording: The log.
        rig: The rig that was given, or None.
        wanted: Topic by kind (`gnss`, `imu`, `odometry`, `pose`, `tf`); all kinds where it is
            None or empty. Kinds that are not asked for are left out.
        tree: The log's static transforms; read from it where None.

    Raises:
        UsageError: If a kind is none of these.
        TopicNotFoundError: If a topic is not in the log; names the candidates.
        InputError: If a topic holds something else.
    """
    notes: list[str] = []
    topics = _wanted_topics(recording, wanted) if wanted else _every_topic(recording, notes)
    tree = read_static_transforms(recording) if tree is None else tree
    moving = _first_transforms(recording, topics.get("tf"))
    frames = {
        kind: _followed_frame(recording, topic) for kind, topic in topics.items() if kind != "tf"
    }
    base = _base_frame(rig, tree, moving, frames.get("odometry", ""))
    edge, T_base_tf = _carrying_edge(tree, moving, base)
    if "tf" in topics and edge is None:
        notes.append(f"no moving transform of '{topics['tf']}' carries frame '{base}'")
    places = {
        kind: _place(tree, base, kind, topics[kind], frame, notes) for kind, frame in frames.items()
    }
    return NavigationTopics(
        base_frame=base,
        gnss=topics.get("gnss"),
        imu=topics.get("imu"),
        odometry=topics.get("odometry"),
        pose=topics.get("pose"),
        tf=topics.get("tf") if edge is not None else None,
        tf_edge=edge,
        T_base_gnss=places.get("gnss"),
        T_base_imu=places.get("imu"),
        T_base_odometry=places.get("odometry"),
        T_base_pose=places.get("pose"),
        T_base_tf=T_base_tf,
        notes=tuple(notes),
    )


def _wanted_topics(recording: Recording, wanted: Mapping[str, str]) -> dict[str, str]:
    every = {info.topic: info for info in recording.topics()}
    for kind, topic in wanted.items():
        if kind not in _KINDS:
            raise UsageError(
                f"'{kind}' is no kind of navigation", remedy=f"Choose from {', '.join(_KINDS)}"
            )
        usable = ", ".join(info.topic for info in _of_kind(every.values(), kind)) or "none"
        if topic not in every:
            raise TopicNotFoundError(
                f"no topic '{topic}'", where=recording.paths[0], remedy=f"For {kind}: {usable}"
            )
        if every[topic].sample_type is not _KINDS[kind]:
            raise InputError(
                f"topic '{topic}' holds {every[topic].msgtype}, which is no {kind}",
                remedy=f"For {kind}: {usable}",
            )
    return dict(wanted)


def _every_topic(recording: Recording, notes: list[str]) -> dict[str, str]:
    topics = {}
    for kind in _KINDS:
        found = _of_kind(recording.topics(), kind)
        if found:
            topics[kind] = found[0].topic
        if len(found) > 1:
            left = ", ".join(info.topic for info in found[1:])
            notes.append(f"of {kind}, '{found[0].topic}' has the most messages; left alone: {left}")
    return topics


def _of_kind(infos: Iterable[TopicInfo], kind: str) -> list[TopicInfo]:
    """Return the readable topics of a kind, the one with the most messages first."""
    found = [
        info
        for info in infos
        if info.sample_type is _KINDS[kind]
        and info.count > 0
        and info.undecodable is None
        and not info.topic.rstrip("/").endswith("static")
    ]
    return sorted(found, key=lambda info: (-info.count, info.topic))


def _first_transforms(recording: Recording, topic: str | None) -> list[TransformSample]:
    if topic is None:
        return []
    first = islice(recording.samples(topics=[topic]), _FIRST_TRANSFORMS)
    return [sample for sample in first if isinstance(sample, TransformSample)]


def _followed_frame(recording: Recording, topic: str) -> str:
    """Return the frame whose motion a topic tells: the child of a pose, else that of the sensor."""
    first = next(iter(recording.samples(topics=[topic])), None)
    if isinstance(first, PoseSample):
        return first.T_frame_child.source
    return first.frame if first is not None else ""


def _base_frame(
    rig: Rig | None, tree: TransformTree, moving: list[TransformSample], odometry_child: str
) -> str:
    if rig is not None:
        return rig.base_frame
    known = {*tree.frames(), *(sample.T_frame_child.source for sample in moving), odometry_child}
    usual = next((frame for frame in BASE_FRAMES if frame in known), None)
    return usual or odometry_child or _DEFAULT_BASE


def _carrying_edge(
    static: TransformTree, moving: list[TransformSample], base: str
) -> tuple[tuple[str, str] | None, Transform | None]:
    """Return the lowest moving edge above the base, and `T_base_child` of its child.

    Some logs repeat fixed transforms on the topic of the moving ones: an edge that does not
    move gives way to one above it that does.
    """
    tree, samples = copy.deepcopy(static), dict[str, list[Transform]]()
    for sample in moving:
        tree.add(sample.T_frame_child, sample.stamp_ns, static=False)
        samples.setdefault(sample.T_frame_child.source, []).append(sample.T_frame_child)
    above = _moving_above(tree, base)
    edges = [child for child in above if _moves(samples[child])] or above
    if not edges:
        return None, None
    parent = tree.parent(edges[0])
    return None if parent is None else (parent, edges[0]), tree.lookup(base, edges[0])


def _moving_above(tree: TransformTree, base: str) -> list[str]:
    """Return the children of the moving edges from the base to its root, the lowest first."""
    found, seen, child = [], set[str](), base
    while (parent := tree.parent(child)) is not None and child not in seen:
        if not tree.is_static(child):
            found.append(child)
        seen.add(child)
        child = parent
    return found


def _moves(transforms: list[Transform]) -> bool:
    first = transforms[0].matrix
    return any(np.abs(T.matrix - first).max() > _STILL for T in transforms)


def _place(
    tree: TransformTree, base: str, kind: str, topic: str, frame: str, notes: list[str]
) -> Transform | None:
    if not frame:
        notes.append(f"'{topic}' does not say which frame it follows: taken for '{base}'")
        return None
    T_base_frame = tree.lookup(base, frame)
    if T_base_frame is None:
        notes.append(
            f"no transform leads from '{base}' to frame '{frame}' of the {kind}: taken to be one"
        )
    return T_base_frame
