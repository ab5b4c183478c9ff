"""URDF: a link for every frame, a fixed joint for every transform.

`<origin xyz rpy>` of a joint is `T_parent_child` with the rotation Rz(yaw) Ry(pitch) Rx(roll)
(http://wiki.ros.org/urdf/XML/joint). Cameras are optical frames. What kind of sensor sits on a
link stands in `<sensor>` elements, as the URDF proposal for sensors has them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path
from xml.parsers import expat

from percept.calib.formats.frames import rig_of_frames
from percept.calib.formats.placement import frame_edges
from percept.calib.formats.reading import number_list
from percept.calib.formats.wording import numbers, transforms_in_words, xml_comment
from percept.core.errors import ConfigError, InputError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform, rotation_from_rpy, rpy_from_rotation

__all__ = ["FILES", "urdf_rig", "write_urdf"]

FILES = ("rig.urdf",)
_ABOUT = "a camera's link is its optical frame; URDF has no place for its intrinsics"


def write_urdf(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return the file.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If no sensor has a place, one frame would have two, or a name has a letter
            that XML does not have.
    """
    robot = ET.Element("robot", name="rig")
    ET.SubElement(robot, "link", name=_xml_name(rig.base_frame))
    for sensor, T_base_sensor in frame_edges(rig, notes):
        _add_sensor(robot, sensor, T_base_sensor)
    ET.indent(robot)
    told = xml_comment([*about, _ABOUT, *transforms_in_words(rig)])
    body = ET.tostring(robot, encoding="unicode")
    return {FILES[0]: f'<?xml version="1.0"?>\n{told}{body}\n'}


def _add_sensor(
    robot: ET.Element, sensor: LidarSensor | CameraSensor, T_base_sensor: Transform
) -> None:
    parent, child = _xml_name(T_base_sensor.target), _xml_name(T_base_sensor.source)
    ET.SubElement(robot, "link", name=child)
    joint = ET.SubElement(robot, "joint", name=f"{parent}_to_{child}", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    xyz = numbers(T_base_sensor.translation_m)
    ET.SubElement(joint, "origin", xyz=xyz, rpy=numbers(rpy_from_rotation(T_base_sensor.rotation)))
    kind = "ray" if isinstance(sensor, LidarSensor) else "camera"
    element = ET.SubElement(robot, "sensor", name=_xml_name(sensor.name), type=kind)
    ET.SubElement(element, "parent", link=child)
    ET.SubElement(element, kind)


def _xml_name(name: str) -> str:
    if not name.isprintable():
        raise ConfigError(f"the name {name!r} has letters that XML does not have")
    return name


def urdf_rig(text: str, path: Path, notes: Counter[str]) -> Rig:
    """Return the LiDARs of a URDF; cameras are left out, for it has no intrinsics.

    Joints that move are left out with everything below them.

    Raises:
        InputError: If the file is no URDF, has a document type or entities, or has no LiDAR.
    """
    robot = _parsed(text, path)
    if robot.tag != "robot":
        raise InputError("is XML, but no URDF", where=path)
    transforms, moving = [], set()
    for joint in robot.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:  # a <joint> inside a <transmission>
            continue
        if joint.get("type") != "fixed":
            notes[f"joint {joint.get('name')} moves: left out"] += 1
            moving.add(str(child.get("link")))
            continue
        transforms.append(_transform(joint, parent, child, path))
    unmoved = _unmoved(transforms, moving)
    return rig_of_frames(unmoved, path, notes, _lidar_links(robot))


def _transform(joint: ET.Element, parent: ET.Element, child: ET.Element, path: Path) -> Transform:
    origin = joint.find("origin")
    what = f"origin of joint {joint.get('name')}"
    texts = {} if origin is None else dict(origin.attrib)
    xyz, rpy = (_three(texts.get(key, "0 0 0"), what, path) for key in ("xyz", "rpy"))
    matrix = Transform.identity("", "").matrix.copy()
    matrix[:3, :3], matrix[:3, 3] = rotation_from_rpy(*rpy), xyz
    return Transform(str(parent.get("link")), str(child.get("link")), matrix)


def _three(text: str, what: str, path: Path) -> list[float]:
    try:
        values = [float(part) for part in text.split()]
    except ValueError as error:
        raise InputError(f"'{what}' holds something that is no number", where=path) from error
    return number_list(values, 3, what, path)


def _lidar_links(robot: ET.Element) -> set[str] | None:
    """Return the links of LiDARs where the file says what kind its sensors are."""
    links = set()
    sensors = list(robot.iter("sensor"))
    for sensor in sensors:
        parent = sensor.find("parent")
        if parent is not None and sensor.find("ray") is not None:
            links.add(str(parent.get("link")))
    return links if links else None


def _unmoved(transforms: Sequence[Transform], moving: Collection[str]) -> list[Transform]:
    """Return the edges that do not hang on a moving joint."""
    above = {edge.source: edge.target for edge in transforms}

    def root(frame: str) -> str:
        for _ in above:
            frame = above.get(frame, frame)
        return frame

    return [edge for edge in transforms if root(edge.target) not in moving]


def _parsed(text: str, path: Path) -> ET.Element:
    """Parse XML without a document type, so that no entity can grow or reach out."""
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise InputError("has a document type, which a URDF needs not", where=path)

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    try:
        parser.Parse(text, True)  # noqa: FBT003 - expat takes it by position
        return builder.close()
    except (expat.ExpatError, AssertionError) as error:
        raise InputError(f"is not XML ({error})", where=path) from error
