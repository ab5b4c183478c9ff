"""The graph of a rig: sensors are nodes, registrations of two of them are edges.

Motions are small and split into a rotation and a translation: an edge `T_a_b = (R, t)` with
the error `(w, v)` means `(Exp(w) R, t + v)`, both in the axes of a. Covariances are (6, 6),
rotation (rad) before translation (m).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.result import RigLoop
from percept.calib.limits import LidarLimits

__all__ = [
    "Adjustment",
    "PairEdge",
    "Placement",
    "adjust_poses",
    "closing_loops",
    "culprit",
    "maximum_spanning_tree",
    "place_along",
    "relative_motion",
    "rotation_vector",
]

_F64 = NDArray[np.float64]

_WEIGHING_RANGE_M = 10.0
_STEPS = 20
_CONVERGED = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class PairEdge:
    """A registration of two sensors.

    Attributes:
        target: Sensor whose frame the other one is placed in.
        source: The other sensor.
        T_target_source: (4, 4) float64.
        covariance: (6, 6) of its error, in the target's axes.
        overlap: Share of points, 0 to 1, that both see.
        trusted: Whether nothing speaks against it; such edges are taken before all others.
    """

    target: str
    source: str
    T_target_source: _F64
    covariance: _F64
    overlap: float
    trusted: bool = True

    @property
    def name(self) -> str:
        """The two sensors, for people."""
        return f"{self.target}-{self.source}"

    @property
    def weight(self) -> float:
        """Information times overlap: one over the variance of a point 10 m away, in 1/m2.

        Rotations and translations have different units; what both do to a point at a middle
        range has one.
        """
        turned = np.trace(self.covariance[:3, :3]) * 2 / 3 * _WEIGHING_RANGE_M**2
        moved = np.trace(self.covariance[3:, 3:])
        return float(self.overlap / max(turned + moved, 1e-12))

    def reversed(self) -> PairEdge:
        """Return the same registration with target and source exchanged."""
        R, t = self.T_target_source[:3, :3], self.T_target_source[:3, 3]
        jacobian = np.block([[-R.T, np.zeros((3, 3))], [-R.T @ _skew(t), -R.T]])
        covariance = jacobian @ self.covariance @ jacobian.T
        T_source_target = _rigid(R.T, -R.T @ t)
        return PairEdge(
            self.source, self.target, T_source_target, covariance, self.overlap, self.trusted
        )


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where a sensor is, along a chain of registrations.

    Attributes:
        T_root_sensor: (4, 4) float64.
        covariance: (6, 6) of its error, in the root's axes.
        path: Names from the root to the sensor.
        edges: The registrations of the path, as they were given.
    """

    T_root_sensor: _F64
    covariance: _F64
    path: tuple[str, ...]
    edges: tuple[PairEdge, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """Poses of all sensors that serve all registrations at once.

    Attributes:
        T_root_sensor: (4, 4) by sensor name, without the root.
        covariance: (6, 6) by sensor name, in the root's axes. Redundant registrations do not make
            it smaller, and those that disagree by more than their spread make it larger.
        surprise: Root of chi-square by the redundant numbers; 1 is what is expected.
    """

    T_root_sensor: dict[str, _F64]
    covariance: dict[str, _F64]
    surprise: float


def maximum_spanning_tree(edges: Sequence[PairEdge], root: str) -> list[PairEdge]:
    """Return the edges that join all they can, the weightiest first (Kruskal 1956).

    Edges that nothing speaks against come before all others, and among them those of the root:
    a sensor that it sees is placed by that, and by way of others only where it is not.
    """
    group = {name: name for edge in edges for name in (edge.target, edge.source)}

    def head(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    def rank(edge: PairEdge) -> tuple[bool, bool, float]:
        return not edge.trusted, root not in (edge.target, edge.source), -edge.weight

    tree = []
    for edge in sorted(edges, key=rank):
        target, source = head(edge.target), head(edge.source)
        if target != source:
            group[source] = target
            tree.append(edge)
    return tree


def place_along(tree: Sequence[PairEdge], root: str) -> dict[str, Placement]:
    """Return the placements of all sensors that a tree joins with the root, and of the root."""
    placed = {root: Placement(np.eye(4), np.zeros((6, 6)), (root,), ())}
    waiting = [root]
    while waiting:
        at = waiting.pop(0)
        for edge in tree:
            for step in (edge, edge.reversed()):
                if step.target == at and step.source not in placed:
                    placed[step.source] = _extended(placed[at], step, edge)
                    waiting.append(step.source)
    return placed


def _extended(placement: Placement, step: PairEdge, edge: PairEdge) -> Placement:
    pose, covariance = _composed(placement.T_root_sensor, placement.covariance, step)
    return Placement(pose, covariance, (*placement.path, step.source), (*placement.edges, edge))


def _composed(T_root_a: _F64, covariance: _F64, step: PairEdge) -> tuple[_F64, _F64]:
    """Return `T_root_b` and its covariance of `T_root_a` and a step `T_a_b`."""
    R, offset = T_root_a[:3, :3], T_root_a[:3, :3] @ step.T_target_source[:3, 3]
    before = np.block([[np.eye(3), np.zeros((3, 3))], [-_skew(offset), np.eye(3)]])
    after = np.kron(np.eye(2), R)
    joined = before @ covariance @ before.T + after @ step.covariance @ after.T
    return T_root_a @ step.T_target_source, joined


def closing_loops(
    edges: Sequence[PairEdge], root: str, limits: LidarLimits
) -> list[tuple[RigLoop, tuple[PairEdge, ...]]]:
    """Return the fundamental round trips of the graph with their closure errors.

    Each edge outside of the maximum spanning tree closes one: from where its two branches part,
    along one, over the edge, and back along the other.

    Args:
        edges: The registrations.
        root: Sensor at which paths begin where they can.
        limits: When an error is more than its spread.

    Returns:
        A pair of loop and its edges for every edge outside of the tree that the root reaches.
    """
    tree = maximum_spanning_tree(edges, root)
    placed = place_along(tree, root)
    loops = []
    for edge in (e for e in edges if e not in tree and e.target in placed):
        top = _parting(placed[edge.target].path, placed[edge.source].path)
        around = place_along(tree, top)
        there, back = around[edge.target], around[edge.source]
        chain = [*_steps(there), edge, *(s.reversed() for s in reversed(_steps(back)))]
        path = (*there.path, *reversed(back.path))
        loops.append((_loop(path, chain, limits), (*there.edges, edge, *back.edges)))
    return loops


def _parting(there: tuple[str, ...], back: tuple[str, ...]) -> str:
    """Return the last sensor that two paths from the root share."""
    return [a for a, b in zip(there, back, strict=False) if a == b][-1]


def _steps(placement: Placement) -> list[PairEdge]:
    """Return the edges of a placement, each turned into the direction of the path."""
    return [
        edge if edge.target == at else edge.reversed()
        for at, edge in zip(placement.path, placement.edges, strict=False)
    ]


def _loop(path: tuple[str, ...], chain: Sequence[PairEdge], limits: LidarLimits) -> RigLoop:
    pose, covariance = np.eye(4), np.zeros((6, 6))
    for step in chain:
        pose, covariance = _composed(pose, covariance, step)
    error = np.concatenate([rotation_vector(pose[:3, :3]), pose[:3, 3]])
    surprise = float(np.sqrt(error @ np.linalg.solve(_regular(covariance), error) / 6))
    rotation_deg = float(np.degrees(np.linalg.norm(error[:3])))
    translation_m = float(np.linalg.norm(error[3:]))
    small = rotation_deg <= limits.loop_floor_deg and translation_m <= limits.loop_floor_m
    gross = rotation_deg > limits.loop_gross_deg or translation_m > limits.loop_gross_m
    return RigLoop(
        path=path,
        translation_m=translation_m,
        rotation_deg=rotation_deg,
        sd_translation_m=float(np.sqrt(np.trace(covariance[3:, 3:]))),
        sd_rotation_deg=float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
        surprise=surprise,
        agrees=small or (surprise <= limits.loop_surprise and not gross),
    )


def culprit(edges: Sequence[PairEdge], root: str, limits: LidarLimits) -> PairEdge | None:
    """Return the one registration without which all round trips agree, if there is just one.

    It is named only where the others still check each other: of a single triangle that does not
    close, any of the three could be wrong.
    """
    reached = set(place_along(maximum_spanning_tree(edges, root), root))
    found = []
    for edge in edges:
        rest = [e for e in edges if e is not edge]
        joined = set(place_along(maximum_spanning_tree(rest, root), root)) == reached
        if joined and all(loop.agrees for loop, _ in closing_loops(rest, root, limits)):
            found.append(edge)
    return found[0] if len(found) == 1 else None


def adjust_poses(edges: Sequence[PairEdge], start: Mapping[str, _F64], root: str) -> Adjustment:
    """Adjust all poses to all registrations by Gauss-Newton on the pose graph.

    Minimises the sum of squared errors, each weighed by its inverse covariance, as in Grisetti
    et al., "A Tutorial on Graph-Based SLAM" (2010), eq. 3 to 16, with the root held.

    Args:
        edges: Registrations between sensors that `start` has.
        start: `T_root_sensor` (4, 4) of every sensor, the root's included.
        root: The sensor that stays.
    """
    names = [name for name in start if name != root]
    poses = {name: np.array(pose, dtype=np.float64) for name, pose in start.items()}
    weights = [_inverse(_regular(edge.covariance)) for edge in edges]
    H, chi2 = np.eye(6 * len(names)), 0.0
    for _ in range(_STEPS):
        H, b, chi2 = _normal_equations(edges, weights, poses, names)
        step = np.linalg.solve(H, -b).reshape(-1, 6)
        for name, (rotation, translation) in zip(names, step.reshape(-1, 2, 3), strict=True):
            moved = _rotation(rotation) @ poses[name][:3, :3]
            poses[name] = _rigid(moved, poses[name][:3, 3] + translation)
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            break
    redundant = 6 * (len(edges) - len(names))
    surprise = float(np.sqrt(chi2 / redundant)) if redundant else 1.0
    # Registrations that share a cloud share its error: they check each other, but many of them
    # know no more than it takes to place the sensors. On a complete graph this factor gives back
    # the spread of one registration. Errors that disagree by more than they claim are wider than
    # they claim (Birge 1932).
    shared = max(len(edges) / max(len(names), 1), 1.0)
    covariance = _inverse(H) * shared * max(surprise, 1.0) ** 2
    blocks = {
        name: covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] for i, name in enumerate(names)
    }
    return Adjustment({name: poses[name] for name in names}, blocks, surprise)


def _normal_equations(
    edges: Sequence[PairEdge], weights: Sequence[_F64], poses: Mapping[str, _F64], names: list[str]
) -> tuple[_F64, _F64, float]:
    size = 6 * len(names)
    H, b, chi2 = np.zeros((size, size)), np.zeros(size), 0.0
    for edge, weight in zip(edges, weights, strict=True):
        T_a, T_b = poses[edge.target], poses[edge.source]
        error = relative_motion(edge.T_target_source, np.linalg.inv(T_a) @ T_b)
        turn, arm = T_a[:3, :3].T, T_b[:3, 3] - T_a[:3, 3]
        at_source = np.kron(np.eye(2), turn)
        at_target = -at_source
        at_target[3:, :3] = turn @ _skew(arm)
        jacobian = np.zeros((6, size))
        for name, block in ((edge.target, at_target), (edge.source, at_source)):
            if name in names:
                jacobian[:, 6 * names.index(name) :][:, :6] += block
        H += jacobian.T @ weight @ jacobian
        b += jacobian.T @ weight @ error
        chi2 += float(error @ weight @ error)
    return H, b, chi2


def relative_motion(T_a_b: _F64, T_a_b_other: _F64) -> _F64:
    """Return (6,) the small motion (rad, m) in the axes of a from one pose to another."""
    turned = rotation_vector(T_a_b_other[:3, :3] @ T_a_b[:3, :3].T)
    return np.concatenate([turned, T_a_b_other[:3, 3] - T_a_b[:3, 3]])


def rotation_vector(rotation: _F64) -> _F64:
    """Return the rotation vector (3,) in rad of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_rotvec(), dtype=np.float64)


def _rotation(vector: _F64) -> _F64:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix(), dtype=np.float64)


def _rigid(rotation: _F64, translation_m: _F64) -> _F64:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation_m
    return matrix


def _inverse(matrix: _F64) -> _F64:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _skew(vector: _F64) -> _F64:
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])


def _regular(covariance: _F64) -> _F64:
    """Return a covariance that can be inverted: nothing is known better than 1e-6 rad and m."""
    return covariance + 1e-12 * np.eye(6)
