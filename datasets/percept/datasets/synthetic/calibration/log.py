"""Writes a synthetic calibration: the log, the rig to start from, the board, and the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from percept.core.clock import NS_PER_MS, ns_from_seconds
from percept.core.rig import rig_as_yaml
from percept.core.transform import quat_xyzw_from_matrix
from percept.datasets.synthetic.calibration.board import BOARD, PLATE_SIZE_M
from percept.datasets.synthetic.calibration.capture import CalibrationConfig, Capture
from percept.datasets.synthetic.drive import START_NS, DriveSummary
from percept.datasets.synthetic.truth import write_poses

if TYPE_CHECKING:
    from percept.datasets.write import Compression, LogFormat

__all__ = ["BOARD_COLUMNS", "generate_calibration"]

_POSE_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")

BOARD_COLUMNS = pa.schema(
    [
        ("pose", pa.int64()),
        ("camera", pa.string()),
        ("place", pa.int64()),
        ("start_ns", pa.int64()),
        ("end_ns", pa.int64()),
        ("frame_id", pa.string()),
        *((name, pa.float64()) for name in _POSE_COLUMNS),
    ]
)
"""Columns of `truth/boards.parquet`, one row for each pose of the board."""

_LOG_NAMES = {"mcap": "calib.mcap", "rosbag1": "calib.bag", "rosbag2": "calib"}
_POSE_STEP_NS = 5 * NS_PER_MS


def generate_calibration(
    config: CalibrationConfig,
    out: Path,
    log_format: LogFormat = "mcap",
    progress: Callable[[float], None] | None = None,
) -> DriveSummary:
    """Write the log, the wrong `rig.yaml`, `board.yaml`, and `truth/`.

    Memory does not grow with the length of the log. Images are written as JPEG.

    Args:
        config: What to make.
        out: Folder, which is made where it does not exist.
        log_format: Format of the log: `calib.mcap`, `calib.bag`, or the folder `calib`.
        progress: Called with the share that is done, from 0 to 1.

    Raises:
        UsageError: If a setting is out of range.
    """
    from percept.datasets.write import LogWriter

    capture = Capture(config)
    truth = out / "truth"
    truth.mkdir(parents=True, exist_ok=True)
    (out / "rig.yaml").write_text(rig_as_yaml(capture.start_rig), encoding="utf-8")
    (truth / "rig.yaml").write_text(rig_as_yaml(capture.rig), encoding="utf-8")
    (out / "board.yaml").write_text(_board_as_yaml(), encoding="utf-8")
    _write_boards(capture, truth / "boards.parquet")
    until_ns = START_NS + capture.duration_ns + _POSE_STEP_NS
    stamps = np.arange(START_NS, until_ns, _POSE_STEP_NS, dtype=np.int64)
    write_poses(capture.motion.trajectory(stamps), truth / "poses.parquet")
    log = out / _LOG_NAMES[log_format]
    counts: Counter[str] = Counter()
    compression: Compression = "lz4" if log_format == "rosbag1" else "zstd"
    with LogWriter(log, log_format, images="jpeg", compression=compression) as writer:
        for sample in capture.samples():
            writer.write(sample)
            counts[sample.topic] += 1
            if progress is not None:
                progress(min((sample.log_time_ns - START_NS) / capture.duration_ns, 1.0))
    return DriveSummary(log, dict(counts))


def _board_as_yaml() -> str:
    width, height = PLATE_SIZE_M
    board = f"checkerboard:{BOARD.columns}x{BOARD.rows}:{BOARD.square_m:g}"
    text: str = yaml.safe_dump(
        {"board": board, "board_size": f"{width:g}x{height:g}"}, sort_keys=False
    )
    return text


def _write_boards(capture: Capture, path: Path) -> None:
    rows: list[dict[str, Any]] = []
    for number, hold in enumerate(capture.holds):
        T_map_board = hold.T_map_board
        turn = quat_xyzw_from_matrix(T_map_board.rotation)
        place = [*T_map_board.translation_m.tolist(), *turn.tolist()]
        rows.append(
            {
                "pose": number,
                "camera": hold.camera,
                "place": hold.place,
                "start_ns": START_NS + ns_from_seconds(hold.start_s),
                "end_ns": START_NS + ns_from_seconds(hold.end_s),
                "frame_id": "map",
                **dict(zip(_POSE_COLUMNS, place, strict=True)),
            }
        )
    pq.write_table(pa.Table.from_pylist(rows, schema=BOARD_COLUMNS), path, compression="zstd")
