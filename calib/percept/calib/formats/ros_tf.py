"""Static transforms for ROS: a ROS 2 launch file, commands for a shell, and plain YAML.

The three files say the same. The YAML has the fields of geometry_msgs/TransformStamped: the
transform maps points of `child_frame_id` into `frame_id`.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from percept.calib.formats.frames import rig_of_frames
from percept.calib.formats.placement import frame_edges
from percept.calib.formats.reading import number_list
from percept.calib.formats.wording import commented, rounded, transforms_in_words
from percept.core.errors import InputError
from percept.core.rig import Rig
from percept.core.transform import Transform, quat_xyzw_from_matrix

__all__ = ["FILES", "is_static_transforms", "static_transforms_rig", "write_static_transforms"]

FILES = ("static_transforms.launch.py", "static_transforms.sh", "static_transforms.yaml")
# The title keeps comments off the first two lines, where they could name an encoding.
_TITLE = '"""Static transforms of a sensor rig, for `ros2 launch`."""\n\n'
_LAUNCH = """\
from launch import LaunchDescription
from launch_ros.actions import Node

# x y z in metres, quaternion x y z w, parent frame, child frame
TRANSFORMS = [
{rows}]


def generate_launch_description():
    flags = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw", "--frame-id", "--child-frame-id")
    return LaunchDescription(
        [
            Node(
                package="tf2_ros",
                executable="static_transform_publisher",
                name=f"static_transform_publisher_{{number}}",
                arguments=[part for pair in zip(flags, values) for part in pair],
            )
            for number, values in enumerate(TRANSFORMS)
        ]
    )
"""


def write_static_transforms(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return the three files; cameras are optical frames.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If no sensor has a place, or one frame would have two.
    """
    transforms = [T_base_sensor for _, T_base_sensor in frame_edges(rig, notes)]
    told = commented([*about, *transforms_in_words(rig)])
    rows = "".join(f"    {tuple(_values(transform))!r},\n" for transform in transforms)
    return {
        FILES[0]: _TITLE + told + _LAUNCH.format(rows=rows),
        FILES[1]: told + _shell_lines(transforms),
        FILES[2]: told + _yaml(transforms),
    }


def _values(transform: Transform) -> list[str]:
    seven = rounded([*transform.translation_m, *quat_xyzw_from_matrix(transform.rotation)])
    return [*(f"{value:.9f}" for value in seven), transform.target, transform.source]


def _shell_lines(transforms: Sequence[Transform]) -> str:
    flags = ("x", "y", "z", "qx", "qy", "qz", "qw", "frame-id", "child-frame-id")
    lines = ["# ROS 2: each line is a publisher of its own"]
    ros1 = ["# ROS 1: the same"]
    for transform in transforms:
        values = [shlex.quote(value) for value in _values(transform)]
        pairs = " ".join(f"--{flag} {value}" for flag, value in zip(flags, values, strict=True))
        lines.append(f"ros2 run tf2_ros static_transform_publisher {pairs} &")
        ros1.append(f"# rosrun tf2_ros static_transform_publisher {' '.join(values)} &")
    text = "\n".join(lines)
    return f"{text}\nwait\n{commented(ros1, mark='')}"


def _yaml(transforms: Sequence[Transform]) -> str:
    entries = []
    for transform in transforms:
        translation = rounded(transform.translation_m)
        quat_xyzw = rounded(quat_xyzw_from_matrix(transform.rotation))
        entry = {
            "frame_id": transform.target,
            "child_frame_id": transform.source,
            "translation": dict(zip("xyz", translation, strict=True)),
            "rotation": dict(zip("xyzw", quat_xyzw, strict=True)),
        }
        entries.append(entry)
    content = {"static_transforms": entries}
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=140)
    return text


def is_static_transforms(values: Mapping[str, Any]) -> bool:
    """Return whether a file is this YAML."""
    return isinstance(values.get("static_transforms"), list)


def static_transforms_rig(values: Mapping[str, Any], path: Path, notes: Counter[str]) -> Rig:
    """Return the LiDARs of such a file; cameras are left out, for it has no intrinsics.

    Raises:
        InputError: If a transform is none, or the frames are no tree.
    """
    return rig_of_frames([_transform(e, path) for e in values["static_transforms"]], path, notes)


def _transform(entry: object, path: Path) -> Transform:
    if not isinstance(entry, Mapping):
        raise InputError("'static_transforms' holds something that is no transform", where=path)
    parts = []
    for part, axes in (("translation", "xyz"), ("rotation", "xyzw")):
        below = entry.get(part)
        below = below if isinstance(below, Mapping) else {}
        parts.append(number_list([below.get(axis) for axis in axes], len(axes), part, path))
    parent, child = str(entry.get("frame_id")), str(entry.get("child_frame_id"))
    if abs(sum(value * value for value in parts[1]) - 1) > 1e-3:
        raise InputError(f"the rotation of '{child}' is no unit quaternion", where=path)
    return Transform.from_quat_xyzw(parent, child, *parts)
