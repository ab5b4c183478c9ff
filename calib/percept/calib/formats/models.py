"""Camera models by the names that other tools give them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from percept.core.errors import InputError, PerceptError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform

__all__ = ["brown_coefficients", "camera_sensor", "model_and_coefficients", "ros_model"]

_FISHEYE = {"equidistant", "fisheye", "kannala_brandt", "kannala_brandt4", "kb4"}
_BROWN = {"plumb_bob", "rational_polynomial", "radtan", "brown_conrady", "pinhole", "none", ""}
_ROS = {"pinhole": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
_RATIONAL_COUNT = 8


def ros_model(model: str) -> str:
    """Return the name that ROS has for percept's `pinhole`, `rational` or `fisheye`."""
    return _ROS[model]


def model_and_coefficients(
    name: str, coefficients: Sequence[float], path: Path
) -> tuple[str, tuple[float, ...]]:
    """Return percept's model and its coefficients for another tool's.

    Args:
        name: What the tool calls it, such as `plumb_bob`.
        coefficients: In OpenCV's order. Of twelve and more, those of thin prisms and tilt must be
            zero.
        path: The file.

    Raises:
        InputError: If percept has no such model.
    """
    values = tuple(float(value) for value in coefficients)
    if name.lower() in _FISHEYE:
        if len(values) > 4:
            raise InputError(f"a '{name}' camera has 4 coefficients, not {len(values)}", where=path)
        return "fisheye", values + (0.0,) * (4 - len(values))
    if name.lower() not in _BROWN:
        raise InputError(
            f"percept has no camera model '{name}'",
            where=path,
            remedy="Use plumb_bob, rational_polynomial or equidistant, or calibrate anew",
        )
    if any(values[_RATIONAL_COUNT:]):
        raise InputError("thin prism and tilt coefficients are not supported", where=path)
    values = values[:_RATIONAL_COUNT]
    if any(values[5:]):
        return "rational", values + (0.0,) * (_RATIONAL_COUNT - len(values))
    return "pinhole", (values + (0.0,) * 5)[:5]


def brown_coefficients(sensor: CameraSensor) -> tuple[float, float, float, float, float] | None:
    """Return k1, k2, p1, p2, k3 where a camera needs no more than these, or None."""
    values = (*sensor.distortion, *([0.0] * _RATIONAL_COUNT))
    if sensor.model == "fisheye" or any(values[5:_RATIONAL_COUNT]):
        return None
    return values[0], values[1], values[2], values[3], values[4]


def camera_sensor(
    name: str,
    size: tuple[int, int],
    K: tuple[float, float, float, float],
    model: tuple[str, tuple[float, ...]],
    path: Path,
    *,
    frame: str | None = None,
    topic: str | None = None,
    T_base_sensor: Transform | None = None,
) -> CameraSensor:
    """Return a camera that was read, after trying whether it makes one.

    Args:
        name: Name of the camera.
        size: (width, height) in pixels.
        K: fx, fy, cx, cy in pixels.
        model: percept's model and its coefficients.
        path: The file.
        frame: Its optical frame; None takes the name.
        topic: Its topic, if known.
        T_base_sensor: Where it sits, if known.

    Raises:
        InputError: If the numbers make no camera.
    """
    kind, distortion = model
    sensor = CameraSensor(name, topic, frame or name, size, kind, K, distortion, T_base_sensor)
    try:
        sensor.camera()
    except PerceptError as error:
        raise InputError(f"camera '{name}': {error.what}", where=path) from error
    return sensor
