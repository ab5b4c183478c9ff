"""Tables of what was really there: poses, objects, signals and paint."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.core.transform import quat_xyzw_from_matrix
from percept.datasets.synthetic.ego import EgoMotion
from percept.datasets.synthetic.lanelet_map import StreetMap
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.world import World

if TYPE_CHECKING:
    from percept.datasets.synthetic.visible import VisibleBoxes

__all__ = [
    "BOX_COLUMNS",
    "IMAGE_COLUMNS",
    "LIGHT_COLUMNS",
    "OBJECT_COLUMNS",
    "TRUTH_REACH_M",
    "TableStream",
    "box_rows",
    "light_rows",
    "object_rows",
    "write_markings",
    "write_poses",
]

TRUTH_REACH_M = 80.0
"""Objects and signals further away along the street than this have no rows."""

OBJECT_COLUMNS = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("track_id", pa.int64()),
        ("frame_id", pa.string()),
        *((name, pa.float64()) for name in ("x", "y", "z", "length", "width", "height")),
        *((name, pa.float64()) for name in ("yaw_rad", "vx", "vy")),
        ("label", pa.string()),
        ("label_probability", pa.float64()),
        ("state", pa.string()),
        ("points", pa.int64()),
    ]
)
LIGHT_COLUMNS = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("light_id", pa.int64()),
        ("state", pa.string()),
        ("flashing", pa.bool_()),
        ("probability", pa.float64()),
        ("cameras", pa.string()),
        ("lit", pa.bool_()),
        *((name, pa.float64()) for name in ("x", "y", "z", "yaw_rad")),
    ]
)
_EDGES = ("x1_px", "y1_px", "x2_px", "y2_px")
IMAGE_COLUMNS = pa.schema([("stamp_ns", pa.int64()), ("camera", pa.string())])
BOX_COLUMNS = pa.schema(
    [
        *IMAGE_COLUMNS,
        ("track_id", pa.int64()),
        ("label", pa.string()),
        *((name, pa.float64()) for name in (*_EDGES, "visible", "range_m")),
    ]
)
_ROWS_PER_GROUP = 4096


class TableStream:
    """Rows into a parquet file, a group at a time; a context manager.

    Args:
        path: The file to write.
        schema: Its columns.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._schema = schema
        self._writer = pq.ParquetWriter(path, schema, compression="zstd")
        self._rows: list[dict[str, Any]] = []

    def write(self, rows: Sequence[dict[str, Any]]) -> None:
        """Append rows, each with a value for every column."""
        self._rows.extend(rows)
        while len(self._rows) >= _ROWS_PER_GROUP:
            self._flush(_ROWS_PER_GROUP)

    def _flush(self, count: int) -> None:
        self._writer.write_table(pa.Table.from_pylist(self._rows[:count], self._schema))
        del self._rows[:count]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._rows and error is None:
            self._flush(len(self._rows))
        self._writer.close()


def object_rows(
    world: World, ego: EgoMotion, stamp_ns: int, points: dict[int, int]
) -> list[dict[str, Any]]:
    """Return one row for every detectable object near the vehicle at a stamp.

    Objects stand upright, so their boxes are exact extents. `points` counts the returns of
    all LiDARs by object.
    """
    time_s = float(ego.seconds(stamp_ns))
    x_m = float(ego.poses(np.array([time_s]))[0, 0, 3])
    rows = []
    for placed in world.objects(time_s, x_m, TRUTH_REACH_M):
        shape = placed.shape
        if shape.label not in DETECTABLE:
            continue
        x, y, z = (world.place(placed, time_s) @ np.append(shape.middle, 1.0))[:3].tolist()
        rows.append(
            {
                "stamp_ns": stamp_ns,
                "track_id": placed.object_id,
                "frame_id": "map",
                "x": x,
                "y": y,
                "z": z,
                "length": shape.length_m,
                "width": shape.width_m,
                "height": shape.height_m,
                "yaw_rad": float(np.arctan2(np.sin(placed.yaw_rad), np.cos(placed.yaw_rad))),
                "vx": placed.vx_mps,
                "vy": 0.0,
                "label": shape.label,
                "label_probability": 1.0,
                "state": "full",
                "points": points.get(placed.object_id, 0),
            }
        )
    return rows


def light_rows(
    world: World, ego: EgoMotion, stamp_ns: int, cameras: Sequence[CameraSensor]
) -> list[dict[str, Any]]:
    """Return one row for every signal head near the vehicle at a stamp.

    `state` is the colour that the signal shows, also while a flash is dark; `lit` tells
    whether the lamp shines right now. `cameras` names those in whose image the face lies and
    that look at it from before, joined by commas; what stands between is not considered.
    """
    time_s = float(ego.seconds(stamp_ns))
    T_map_base = ego.poses(np.array([time_s]))[0]
    rows = []
    for signal in world.signals(float(T_map_base[0, 3]), TRUTH_REACH_M):
        state = signal.plan.at(time_s)
        T_map_head = world.place(signal.head, time_s)
        face = (T_map_head @ np.append(signal.head.shape.middle, 1.0))[:3]
        seen = [c.name for c in cameras if _sees(c, T_map_base, T_map_head, face)]
        rows.append(
            {
                "stamp_ns": stamp_ns,
                "light_id": signal.head.object_id,
                "state": state.colour,
                "flashing": state.flashing,
                "probability": 1.0,
                "cameras": ",".join(seen),
                "lit": state.lit,
                "x": float(face[0]),
                "y": float(face[1]),
                "z": float(face[2]),
                "yaw_rad": signal.head.yaw_rad,
            }
        )
    return rows


def box_rows(camera: str, stamp_ns: int, seen: VisibleBoxes) -> list[dict[str, Any]]:
    """Return one row for every object that a camera sees at a stamp."""
    columns = zip(
        seen.ids.tolist(),
        seen.labels,
        seen.boxes_px.tolist(),
        seen.visible.tolist(),
        seen.range_m.tolist(),
        strict=True,
    )
    return [
        {
            "stamp_ns": stamp_ns,
            "camera": camera,
            "track_id": track_id,
            "label": label,
            **dict(zip(_EDGES, box, strict=True)),
            "visible": visible,
            "range_m": range_m,
        }
        for track_id, label, box, visible, range_m in columns
    ]


def _sees(
    camera: CameraSensor,
    T_map_base: NDArray[np.float64],
    T_map_head: NDArray[np.float64],
    face_map: NDArray[np.float64],
) -> bool:
    if camera.T_base_sensor is None:
        return False
    T_map_cam = T_map_base @ camera.T_base_sensor.matrix
    towards = face_map - T_map_cam[:3, 3]
    before = float(T_map_head[:3, 1] @ towards) < 0
    _, inside = camera.pinhole().project((T_map_cam[:3, :3].T @ towards)[None])
    return before and bool(inside[0])


def write_poses(trajectory: Trajectory, path: Path) -> None:
    """Write poses: `stamp_ns, frame_id, child_frame_id, x, y, z, qx, qy, qz, qw`."""
    quats = np.array([quat_xyzw_from_matrix(matrix[:3, :3]) for matrix in trajectory.matrices])
    count = len(trajectory)
    columns: dict[str, Any] = {
        "stamp_ns": trajectory.stamps_ns,
        "frame_id": [trajectory.target] * count,
        "child_frame_id": [trajectory.source] * count,
    }
    columns |= {name: trajectory.matrices[:, i, 3] for i, name in enumerate("xyz")}
    columns |= {name: quats[:, i] for i, name in enumerate(("qx", "qy", "qz", "qw"))}
    pq.write_table(pa.table(columns), path, compression="zstd")


def write_markings(street: StreetMap, path: Path) -> None:
    """Write paint as GeoJSON (RFC 7946): WGS 84 positions, the map frame in `points_m`."""
    features = []
    for identity, (nodes, tags) in street.ways.items():
        if tags["type"] not in ("line_thin", "stop_line"):
            continue
        points = [street.nodes[node] for node in nodes]
        places = [street.origin.geodetic(np.array(point)) for point in points]
        features.append(
            {
                "type": "Feature",
                "id": identity,
                "geometry": {
                    "type": "LineString",
                    "coordinates": [[round(lon, 11), round(lat, 11)] for lat, lon, _ in places],
                },
                "properties": {
                    "map_element_id": identity,
                    "kind": "stop_line" if tags["type"] == "stop_line" else "line",
                    "type": tags.get("subtype", "solid"),
                    "colour": tags.get("color", "white"),
                    "points_m": [list(point) for point in points],
                },
            }
        )
    collection = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(collection, indent=1) + "\n", encoding="utf-8")
