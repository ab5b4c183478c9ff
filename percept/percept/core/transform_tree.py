"""The tree of frames of a log (REP 105): latched static edges and time-stamped dynamic ones."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

from percept.core.errors import GeometryError
from percept.core.transform import Transform

__all__ = ["TransformTree"]


class TransformTree:
    """Frames and the transforms between them, as tf keeps them.

    A static edge holds for all time. A dynamic edge answers with its sample nearest in
    time; only the last `history` samples of an edge are kept, so memory does not grow
    with the length of a log.
    """

    def __init__(self, history: int = 1000) -> None:
        self._static: dict[str, Transform] = {}
        self._dynamic: dict[str, deque[tuple[int, Transform]]] = {}
        self._history = history
        self.conflicts: list[str] = []

    def add(self, T_parent_child: Transform, stamp_ns: int, *, static: bool) -> None:
        """Add one edge. A child that changes its parent is kept and noted in `conflicts`."""
        child, parent = T_parent_child.source, T_parent_child.target
        known = self.parent(child)
        if known is not None and known != parent:
            note = f"frame '{child}' has two parents: '{known}' and '{parent}'"
            if note not in self.conflicts:
                self.conflicts.append(note)
        if static:
            self._static[child] = T_parent_child
            return
        samples = self._dynamic.setdefault(child, deque(maxlen=self._history))
        samples.append((stamp_ns, T_parent_child))

    def frames(self) -> tuple[str, ...]:
        """Return the names of all frames, sorted."""
        children = {*self._static, *self._dynamic}
        parents = {p for c in children if (p := self.parent(c)) is not None}
        return tuple(sorted(children | parents))

    def parent(self, child: str) -> str | None:
        """Return the parent of a frame, or None for a root or an unknown frame."""
        if child in self._static:
            return self._static[child].target
        samples = self._dynamic.get(child)
        return samples[-1][1].target if samples else None

    def is_static(self, child: str) -> bool:
        """Return whether the edge above a frame is static."""
        return child in self._static

    def roots(self) -> tuple[str, ...]:
        """Return the frames that have no parent, sorted; a sound tree has one."""
        return tuple(f for f in self.frames() if self.parent(f) is None)

    def lookup(self, target: str, source: str, stamp_ns: int | None = None) -> Transform | None:
        """Return `T_target_source`, or None where the tree does not connect the two.

        Args:
            target: Frame to map into.
            source: Frame to map from.
            stamp_ns: Time for dynamic edges; the latest sample where it is None.

        Raises:
            GeometryError: If the edges form a cycle.
        """
        if target == source:
            return Transform.identity(target, source)
        up_source = self._chain(source, stamp_ns)
        up_target = self._chain(target, stamp_ns)
        shared = next((frame for frame in up_source if frame in up_target), None)
        if shared is None:
            return None
        return up_target[shared].inverse() @ up_source[shared]

    def _chain(self, frame: str, stamp_ns: int | None) -> dict[str, Transform]:
        """Return T_ancestor_frame for the frame itself and every ancestor, nearest first."""
        chain = {frame: Transform.identity(frame, frame)}
        current = chain[frame]
        while (edge := self._edge(current.target, stamp_ns)) is not None:
            current = edge @ current
            if current.target in chain:
                raise GeometryError(f"the frames above '{frame}' form a cycle")
            chain[current.target] = current
        return chain

    def _edge(self, child: str, stamp_ns: int | None) -> Transform | None:
        if child in self._static:
            return self._static[child]
        samples = self._dynamic.get(child)
        if not samples:
            return None
        if stamp_ns is None:
            return samples[-1][1]
        ordered = sorted(samples, key=lambda sample: sample[0])
        at = bisect_left([stamp for stamp, _ in ordered], stamp_ns)
        near = ordered[max(at - 1, 0) : at + 1]
        return min(near, key=lambda sample: abs(sample[0] - stamp_ns))[1]

    def as_text(self) -> str:
        """Draw the tree, one frame a line, children indented under their parents."""
        children: dict[str, list[str]] = {}
        for frame in self.frames():
            parent = self.parent(frame)
            if parent is not None:
                children.setdefault(parent, []).append(frame)
        lines: list[str] = []

        def draw(frame: str, prefix: str, branch: str, seen: frozenset[str]) -> None:
            kind = (
                ""
                if self.parent(frame) is None
                else (" (static)" if self.is_static(frame) else " (dynamic)")
            )
            lines.append(f"{prefix}{branch}{frame}{kind}")
            below = prefix + ({"├─ ": "│  ", "└─ ": "   "}.get(branch, ""))
            kids = [kid for kid in children.get(frame, []) if kid not in seen]
            for kid in kids:
                draw(kid, below, "└─ " if kid == kids[-1] else "├─ ", seen | {kid})

        for root in self.roots():
            draw(root, "", "", frozenset({root}))
        return "\n".join(lines)
