"""The files behind a view: one is opened, and parts are joined."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from percept.export.rrd_parts import cut_to_whole_messages
from percept.export.view.layout import view_layout

__all__ = ["merge_views", "rrd_recording"]

_APPLICATION = "percept"
_FLUSH_BYTES = 4 * 1024 * 1024


def rrd_recording(path: Path, run_id: str, blueprint: rrb.Blueprint) -> rr.RecordingStream:
    """Open a recording that goes to a file, with the layout in it and no wall-clock time."""
    recording = rr.RecordingStream(
        _APPLICATION,
        recording_id=run_id,
        send_properties=False,
        batcher_config=rr.ChunkBatcherConfig(
            flush_tick=timedelta(hours=1), flush_num_bytes=_FLUSH_BYTES
        ),
    )
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.save(path, default_blueprint=blueprint)
    return recording


def merge_views(
    parts: Sequence[Path], path: Path, *, run_id: str, blueprint: rrb.Blueprint | None = None
) -> int:
    """Join parts of one view into a file with a blueprint, with flat memory.

    Parts that a killed process left are cut back to their last whole message first.

    Args:
        parts: The parts in order of time.
        path: The file to write; it gets its name when it is whole.
        run_id: What tells the run from others.
        blueprint: The layout; that of a view without cameras where none is given.

    Returns:
        The number of parts that could not be read and are left out.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    recording = rrd_recording(unfinished, run_id, blueprint or view_layout())
    unreadable = 0
    for part in parts:
        cut_to_whole_messages(part)
        try:
            with warnings.catch_warnings():
                # The end of a part that was cut lacks a footer, which is why we are here.
                warnings.simplefilter("ignore", RerunWarning)
                recording.send_chunks(RrdReader(part).stream())
        except (RuntimeError, ValueError):
            unreadable += 1
    recording.disconnect()
    unfinished.replace(path)
    return unreadable
