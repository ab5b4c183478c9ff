"""Where exactly edges run between samples: analytic anti-aliasing of the camera renderer.

A sample knows which face it hits, not how far the face reaches towards its neighbour; a
picture of such samples places an edge to half a sample only. Here each change of face is
traced to the edge that causes it (as in Persson 2011, "Geometric post-process
anti-aliasing"), which places it exactly.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.datasets.synthetic.render_kernels import Lighting, light_of, project_clipped

__all__ = ["settle_edges"]


@njit(cache=True)
def settle_edges(
    light: NDArray[np.float32],
    face_at: NDArray[np.int32],
    inverse_depth: NDArray[np.float32],
    vertices_cam: NDArray[np.float64],
    faces: NDArray[np.int32],
    grid: tuple[float, float, float, float],
    lighting: Lighting,
) -> None:
    """Share the light of each sample as edges divide its cell.

    Edges steeper than 45 deg are settled between samples of a row and the others between
    samples of a column, so that none counts twice.

    Args:
        light: (H, W, 3) linear light of what each sample hits; updated.
        face_at: (H, W) index of the face at each sample, -1 for none.
        inverse_depth: (H, W) 1/m.
        vertices_cam: (V, 3) in the optical frame, metres.
        faces: (F, 3) vertex indices.
        grid: fx, fy, cx, cy of the sample grid.
        lighting: What faces, sky and haze send out.
    """
    height, width = face_at.shape
    polygon = np.empty((4, 2))
    for row in range(height - 1):
        for column in range(width - 1):
            here = face_at[row, column]
            for axis in range(2):
                beside = (row, column + 1) if axis == 0 else (row + 1, column)
                there = face_at[beside]
                if here == there or _alike(here, there, lighting.faces):
                    continue
                line, start = (row, column) if axis == 0 else (column, row)
                reach = _reach(vertices_cam, faces, grid, (here, there), axis, line, start, polygon)
                a = light_of(here, inverse_depth[row, column], row, column, grid, lighting)
                b = light_of(there, inverse_depth[beside], beside[0], beside[1], grid, lighting)
                # Beyond its half-way mark a face takes from the next cell, before it, it gives.
                cell = (row, column) if reach < 0.5 else beside
                share = np.float32(0.5 - reach)
                for k in range(3):
                    light[cell[0], cell[1], k] += share * (b[k] - a[k])


@njit(cache=True)
def _alike(here: int, there: int, lights: NDArray[np.float32]) -> bool:
    if here < 0 or there < 0:
        return False
    a, b = lights[here], lights[there]
    return bool(a[0] == b[0] and a[1] == b[1] and a[2] == b[2])


@njit(cache=True)
def _reach(
    vertices_cam: NDArray[np.float64],
    faces: NDArray[np.int32],
    grid: tuple[float, float, float, float],
    pair: tuple[int, int],
    axis: int,
    line: int,
    start: int,
    polygon: NDArray[np.float64],
) -> float:
    """Return how far, 0..1, the first of two faces reaches from one sample to the next.

    It is 0.5, which changes nothing, where no edge of either runs between them: where faces
    pierce each other.
    """
    for face in pair:
        if face < 0:
            continue
        corners = project_clipped(vertices_cam, faces[face], grid, polygon)
        for corner in range(corners):
            following = (corner + 1) % corners
            along0, across0 = polygon[corner, axis], polygon[corner, 1 - axis]
            along1, across1 = polygon[following, axis], polygon[following, 1 - axis]
            rise, run = across1 - across0, along1 - along0
            if abs(rise) < abs(run) or (across0 <= line) == (across1 <= line):
                continue
            reach = along0 + (line - across0) * run / rise - start
            if 0.0 <= reach <= 1.0:
                return float(reach)
    return 0.5
