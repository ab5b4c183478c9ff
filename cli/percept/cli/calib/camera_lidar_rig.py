"""The rig around `percept calib camera-lidar`: who is calibrated, and the rig that comes out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from percept.calib.formats import read_intrinsics
from percept.cli.calib.camera_lidar_inputs import PairInputs
from percept.core.errors import UsageError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform

__all__ = ["SensorPair", "choose_sensors", "initial_transform", "updated_rig"]


@dataclass(frozen=True, slots=True, eq=False)
class SensorPair:
    """The two sensors.

    Attributes:
        camera: With its intrinsics.
        lidar: The LiDAR.
        notes: Where the intrinsics come from, if that was not asked for.
    """

    camera: CameraSensor
    lidar: LidarSensor
    notes: tuple[str, ...] = ()


def choose_sensors(
    inputs: PairInputs,
    rig: Rig | None,
    intrinsics: Path | None,
    camera: str | None,
    lidar: str | None,
) -> SensorPair:
    """Settle which camera and LiDAR are calibrated, and the camera's intrinsics.

    Args:
        inputs: The pairs.
        rig: Of `--initial`, or None.
        intrinsics: Of `--intrinsics`, or None.
        camera: Name that was given, or None.
        lidar: Name that was given, or None.

    Raises:
        PerceptError: If there are no intrinsics, or a name is none of the rig's.
    """
    cameras = {} if rig is None else rig.cameras()
    lidars = {} if rig is None else rig.lidars()
    camera_name = _name(cameras, camera, inputs.camera_topic, inputs.camera_frame, "camera")
    lidar_name = _name(lidars, lidar, inputs.lidar_topic, inputs.lidar_frame, "lidar")
    chosen, notes = _camera(inputs, cameras, intrinsics, camera, camera_name)
    known = cameras.get(camera_name)
    chosen = replace(
        chosen,
        name=camera_name,
        topic=inputs.camera_topic or chosen.topic if known is None else known.topic,
        frame=_frame(inputs, chosen, intrinsics, camera_name) if known is None else known.frame,
        T_base_sensor=None if known is None else known.T_base_sensor,
    )
    frame = inputs.lidar_frame or lidar_name
    own = LidarSensor(lidar_name, inputs.lidar_topic, frame, None)
    return SensorPair(chosen, lidars.get(lidar_name, own), notes)


def _frame(
    inputs: PairInputs, chosen: CameraSensor, intrinsics: Path | None, camera_name: str
) -> str:
    """Return the frame's name: the log's, the file's, or the sensor's where neither says one."""
    named_after_file = intrinsics is not None and chosen.frame == intrinsics.stem
    return inputs.camera_frame or (camera_name if named_after_file else chosen.frame)


def _name(
    known: dict[str, CameraSensor] | dict[str, LidarSensor],
    given: str | None,
    topic: str | None,
    frame: str | None,
    kind: str,
) -> str:
    """Return the sensor's name: as given, by its topic or frame, or the only one of the rig."""
    if given is not None or not known:
        if known and given not in known:
            raise UsageError(
                f"the rig has no {kind} '{given}'", remedy=f"Choose from {', '.join(known)}"
            )
        return given or kind
    fits = [n for n, s in known.items() if topic is not None and s.topic == topic]
    fits = fits or [n for n, s in known.items() if frame is not None and s.frame == frame]
    fits = fits or list(known)
    if len(fits) != 1:
        raise UsageError(
            f"the rig has {len(fits)} sensors of the kind '{kind}' ({', '.join(fits)})",
            remedy=f"Choose with --{kind}",
        )
    return fits[0]


def _camera(
    inputs: PairInputs,
    cameras: dict[str, CameraSensor],
    intrinsics: Path | None,
    given: str | None,
    name: str,
) -> tuple[CameraSensor, tuple[str, ...]]:
    if intrinsics is not None:
        return read_intrinsics(intrinsics, given), ()
    if name in cameras:
        return cameras[name], (f"intrinsics: those of '{name}' in the rig",)
    if inputs.log_intrinsics is not None:
        return inputs.log_intrinsics, ("intrinsics: those of the log's CameraInfo",)
    raise UsageError(
        "the camera's intrinsics are not known",
        remedy="Give --intrinsics; `percept calib camera` makes them",
    )


def initial_transform(rig: Rig | None, sensors: SensorPair) -> Transform | None:
    """Return `T_camera_lidar` of the rig that was given, or None."""
    T_base_camera, T_base_lidar = sensors.camera.T_base_sensor, sensors.lidar.T_base_sensor
    if rig is None or T_base_camera is None or T_base_lidar is None:
        return None
    return T_base_camera.inverse() @ T_base_lidar


def updated_rig(rig: Rig | None, sensors: SensorPair, T_camera_lidar: Transform) -> Rig:
    """Return the rig with the camera placed relative to the LiDAR, which stays.

    Without a place of the LiDAR in a rig, its frame is the base frame.

    Args:
        rig: The rig that was given, or None.
        sensors: The two sensors.
        T_camera_lidar: What was found.

    Raises:
        UsageError: If the rig has other places but none for the LiDAR.
    """
    camera, lidar = sensors.camera, sensors.lidar
    placed = {} if rig is None else dict(rig.sensors)
    T_base_lidar = lidar.T_base_sensor
    if T_base_lidar is None:
        if any(s.T_base_sensor is not None for s in placed.values()):
            raise UsageError(
                f"the rig says where other sensors sit, but not '{lidar.name}'",
                remedy="Place the LiDAR with `percept calib lidar`, or leave --initial out",
            )
        T_base_lidar = Transform.identity(lidar.frame, lidar.frame)
    placed[lidar.name] = replace(lidar, T_base_sensor=T_base_lidar)
    placed[camera.name] = replace(camera, T_base_sensor=T_base_lidar @ T_camera_lidar.inverse())
    return Rig(T_base_lidar.target, placed)
