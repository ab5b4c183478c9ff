"""`metadata.yaml` of a rosbag2 folder, made anew from the files themselves."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from percept.datasets.formats.chunks import ChunkedSource
from percept.datasets.formats.mcap_log import McapLayout
from percept.datasets.formats.sqlite3_log import Sqlite3Source
from percept.datasets.messages import Connection, MessageSource
from percept.datasets.open import open_source

__all__ = ["write_metadata"]

_ROOT = "rosbag2_bagfile_information"
# Version 9 writes quality of service as a list with words, version 8 as a text with numbers.
_VERSION_WITH_TEXT, _VERSION_WITH_LIST = 8, 9


def write_metadata(original: Path, folder: Path, files: Sequence[Path]) -> None:
    """Write `metadata.yaml` for sound ROS 2 files; nothing for ROS 1 bags, which have none.

    What the original says of compression, distribution and custom data is kept.

    Args:
        original: Folder whose `metadata.yaml`, if it can be read, is taken over.
        folder: Folder to write to.
        files: The sound files in it, in order.
    """
    with contextlib.ExitStack() as stack:
        sources = [stack.enter_context(contextlib.closing(open_source(file))) for file in files]
        if all(source.format == "rosbag1" for source in sources):
            return
        known = _original(original)
        information = _information(sources) | {
            key: known[key]
            for key in ("custom_data", "ros_distro", "compression_format", "compression_mode")
            if key in known
        }
    if str(information["compression_mode"]).upper() == "FILE":
        information["compression_mode"] = information["compression_format"] = ""
    text = yaml.safe_dump({_ROOT: information}, sort_keys=False)
    (folder / "metadata.yaml").write_text(text)


def _original(folder: Path) -> dict[str, Any]:
    try:
        known = yaml.safe_load((folder / "metadata.yaml").read_text(errors="replace"))[_ROOT]
    except (OSError, yaml.YAMLError, KeyError, TypeError):
        return {}
    return known if isinstance(known, dict) else {}


def _information(sources: Sequence[MessageSource]) -> dict[str, Any]:
    quality = {c.topic: _parsed(text) for s in sources for c, text in _quality(s).items()}
    as_list = any(isinstance(p.get("history"), str) for ps in quality.values() for p in ps)
    starts = [s.start_ns for s in sources if s.start_ns is not None]
    ends = [s.end_ns for s in sources if s.end_ns is not None]
    return {
        "version": _VERSION_WITH_LIST if as_list else _VERSION_WITH_TEXT,
        "storage_identifier": sources[0].format,
        "relative_file_paths": [source.paths[0].name for source in sources],
        **_span(min(starts, default=None), max(ends, default=None)),
        "message_count": sum(sum(source.counts.values()) for source in sources),
        "topics_with_message_count": _topics(sources, quality, as_list=as_list),
        "compression_format": "",
        "compression_mode": "",
        "files": [
            {"path": source.paths[0].name}
            | _span(source.start_ns, source.end_ns)
            | {"message_count": sum(source.counts.values())}
            for source in sources
        ],
        "custom_data": None,
        "ros_distro": "",
    }


def _span(start_ns: int | None, end_ns: int | None) -> dict[str, dict[str, int]]:
    """Return start and duration as rosbag2 states them, also for a log without messages."""
    start = 2**63 - 1 if start_ns is None else start_ns
    return {
        "duration": {"nanoseconds": 0 if end_ns is None else end_ns - start},
        "starting_time": {"nanoseconds_since_epoch": start},
    }


def _topics(
    sources: Sequence[MessageSource], quality: dict[str, list[dict[str, Any]]], *, as_list: bool
) -> list[dict[str, Any]]:
    every: dict[str, Connection] = {c.topic: c for s in sources for c in s.connections}
    return [
        {
            "topic_metadata": {
                "name": topic,
                "type": every[topic].msgtype,
                "serialization_format": every[topic].encoding,
                "offered_qos_profiles": _stated(quality.get(topic, []), as_list=as_list),
                "type_description_hash": "",
            },
            "message_count": sum(source.counts.get(topic, 0) for source in sources),
        }
        for topic in sorted(every)
    ]


def _stated(profiles: list[dict[str, Any]], *, as_list: bool) -> str | list[dict[str, Any]]:
    if as_list:
        return profiles
    return yaml.safe_dump(profiles, sort_keys=False).strip() if profiles else ""


def _quality(source: MessageSource) -> dict[Connection, str]:
    """Return the quality of service of each connection as the file states it."""
    if isinstance(source, ChunkedSource) and isinstance(source.layout, McapLayout):
        channels = source.layout.definitions.channels
        return {
            connection: channels[key].metadata.get("offered_qos_profiles", "")
            for key, connection in source.index.connections.items()
        }
    if isinstance(source, Sqlite3Source):
        rows = [row for name, _, rows in source.tables() if name == "topics" for row in rows]
        return {
            source.by_id[key]: str(values[4])
            for key, values in rows
            if key in source.by_id and len(values) > 4
        }
    return {}


def _parsed(text: str) -> list[dict[str, Any]]:
    try:
        profiles = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return profiles if isinstance(profiles, list) else []
