"""The sensors of a run as a rig file, so that `percept track` needs no log."""

from __future__ import annotations

from percept.cli.detect.plan import RunPlan
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform
from percept.datasets.cameras import CameraStream

__all__ = ["camera_sensor", "used_rig"]

_BASE = "base_link"


def used_rig(plan: RunPlan) -> Rig:
    """Return the sensors that a run uses, with the places and lenses that it uses them with.

    Cameras of unknown lens are left out: a rig file has no words for them. The base frame is
    that of the sensors' places, and `base_link` where no place is known.
    """
    lidars = plan.lidars.streams.sensors if plan.lidars is not None else ()
    streams = plan.cameras.cameras.values() if plan.cameras is not None else ()
    cameras = [sensor for stream in streams if (sensor := camera_sensor(stream)) is not None]
    sensors: list[LidarSensor | CameraSensor] = [*lidars, *cameras]
    base = next((s.T_base_sensor.target for s in sensors if s.T_base_sensor is not None), _BASE)
    return Rig(base, {s.name: s for s in sensors if _fits(s.T_base_sensor, base)})


def _fits(T_base_sensor: Transform | None, base: str) -> bool:
    return T_base_sensor is None or T_base_sensor.target == base


def camera_sensor(stream: CameraStream) -> CameraSensor | None:
    """Return a camera of a log as a rig has it; None where its lens is not known."""
    lens = stream.camera
    if lens is None:
        return None
    return CameraSensor(
        name=stream.name,
        topic=stream.topic,
        frame=stream.frame or stream.name,
        image_size=lens.image_size,
        model=lens.model,
        K=(float(lens.K[0, 0]), float(lens.K[1, 1]), float(lens.K[0, 2]), float(lens.K[1, 2])),
        distortion=tuple(float(value) for value in lens.distortion),
        T_base_sensor=stream.T_base_sensor,
    )
