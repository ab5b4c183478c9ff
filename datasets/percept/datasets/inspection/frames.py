"""The frames of a log: the tree that tf draws, and what does not fit into it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from percept.core.samples import TransformSample
from percept.core.transform_tree import TransformTree
from percept.datasets.recording import Recording

__all__ = ["FrameReport", "read_frames", "report_frames"]


@dataclass(frozen=True, slots=True)
class FrameReport:
    """Frames of a log.

    Attributes:
        tree: The tree as text, one frame a line.
        roots: Frames without a parent; a sound tree has one.
        conflicts: Frames with two parents, and cycles.
        missing: Frames that sensors name and the tree lacks, with the topics that name them.
    """

    tree: str
    roots: tuple[str, ...]
    conflicts: tuple[str, ...]
    missing: dict[str, tuple[str, ...]]


def read_frames(
    recording: Recording, topics: list[str], start_ns: int | None, end_ns: int | None
) -> TransformTree:
    """Return the tree of all transforms of a log; memory is bounded by the number of frames."""
    # One sample an edge is enough: the tree is looked at, nothing is looked up by time.
    tree = TransformTree(history=1)
    stream = recording.samples(topics=topics, start_ns=start_ns, end_ns=end_ns) if topics else ()
    for sample in stream:
        if isinstance(sample, TransformSample):
            tree.add(sample.T_frame_child, sample.stamp_ns, static=sample.static)
    return tree


def report_frames(tree: TransformTree, frame_of_topic: Mapping[str, str]) -> FrameReport:
    """Compare the tree with the frames that the sensors name.

    Args:
        tree: The log's tree.
        frame_of_topic: Frame by topic of every sensor.
    """
    known = set(tree.frames())
    missing: dict[str, list[str]] = {}
    for topic, frame in frame_of_topic.items():
        if frame and frame not in known:
            missing.setdefault(frame, []).append(topic)
    return FrameReport(
        tree=tree.as_text(),
        roots=tree.roots(),
        conflicts=(*tree.conflicts, *_cycles(tree)),
        missing={frame: tuple(topics) for frame, topics in sorted(missing.items())},
    )


def _cycles(tree: TransformTree) -> list[str]:
    found: set[frozenset[str]] = set()
    for frame in tree.frames():
        path: list[str] = []
        current: str | None = frame
        while current is not None and current not in path:
            path.append(current)
            current = tree.parent(current)
        if current is not None:
            found.add(frozenset(path[path.index(current) :]))
    return [
        f"frames {', '.join(sorted(cycle))} form a cycle" for cycle in sorted(found, key=sorted)
    ]
