"""What formats in 3D cannot do without, said before anything is written."""

from __future__ import annotations

from percept.core.errors import InputError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import Keyframe, LabelledFrame, LabelledSet

__all__ = ["check_solid_needs", "placed_camera", "rectified_file"]

_GIVE_RIG = "give the rig with --rig"


def check_solid_needs(
    labelled: LabelledSet, name: str, *, poses: bool = False, suffix: str | None = None
) -> None:
    """Check that a set has what a format in 3D needs.

    Single keyframes may lack a scan or a pose: formats leave them out and say how many.

    Args:
        labelled: The set.
        name: Name of the format.
        poses: Whether it needs the places of the vehicle.
        suffix: Suffix that its images must have; None takes any.

    Raises:
        InputError: If there are no scans, or no poses; or if an image has no rectified file of
            that suffix, or its camera no lens or place. It names the command that makes it.
    """
    for keyframe, frame in labelled.frames():
        placed_camera(labelled, keyframe, frame)
        rectified_file(frame, name, suffix)
    if not any(keyframe.scan for keyframe in labelled.keyframes):
        raise InputError(
            f"{name} needs LiDAR scans, and no keyframe has one",
            where=labelled.name,
            remedy="Take a log with a LiDAR whose place is known: 'percept calib lidar' finds it; "
            + _GIVE_RIG,
        )
    if poses and not any(keyframe.T_world_base for keyframe in labelled.keyframes):
        raise InputError(
            f"{name} needs the places of the vehicle, and no keyframe has one",
            where=labelled.name,
            remedy="Let 'percept odometry' say what the log has to find them",
        )


def placed_camera(
    labelled: LabelledSet, keyframe: Keyframe, frame: LabelledFrame
) -> tuple[CameraSensor, Transform]:
    """Return the camera that took an image, and `T_base_camera`.

    Raises:
        InputError: If its lens or its place is not known; it names the command that finds it.
    """
    sensor = labelled.camera_of(keyframe, frame)
    if sensor is None:
        raise InputError(
            f"the lens of camera '{frame.camera}' is not known",
            where=labelled.drives[keyframe.drive].log,
            remedy=f"Run 'percept calib camera' and {_GIVE_RIG}",
        )
    if sensor.T_base_sensor is None:
        raise InputError(
            f"the place of camera '{frame.camera}' is not known",
            where=labelled.drives[keyframe.drive].log,
            remedy=f"Run 'percept calib camera-lidar' and {_GIVE_RIG}",
        )
    return sensor, sensor.T_base_sensor


def rectified_file(frame: LabelledFrame, name: str, suffix: str | None = None) -> str:
    """Return the file of an image without distortion.

    Args:
        frame: The image.
        name: Name of the format that needs it.
        suffix: Suffix that it must have; None takes any.

    Raises:
        InputError: If there is none, or it has another suffix.
    """
    file = frame.rectified_file
    if file is None or (suffix is not None and not file.endswith(suffix)):
        raise InputError(
            f"{name} needs it without distortion" + (f", as {suffix}" if suffix else ""),
            where=frame.file,
            remedy=f"Prepare the set again: percept dataset prepare --format {name}",
        )
    return file
