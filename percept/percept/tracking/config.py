"""Settings of the tracker."""

from __future__ import annotations

from math import hypot
from typing import Literal

from pydantic import Field

from percept.core.settings import Settings
from percept.tracking.image_match import ImageMatchConfig

__all__ = ["AssociationWeights", "ClassSettings", "Motion", "TrackerConfig"]

Motion = Literal["velocity", "turn"]


class ClassSettings(Settings):
    """How objects of one class move, how well they are measured, and how long they live.

    Attributes:
        motion: `velocity`, constant but for noise; or `turn`, on a circle: vehicles.
        elongated: Whether objects are longer than wide and move along their length, so that a box
            which says otherwise has its sides confused.
        velocity_walk_mps: Standard deviation by which the velocity along x and along y changes
            within one second.
        turn_walk_radps: The same of the turn rate; only for `turn`.
        height_walk_m: The same of the height of the centre.
        birth_speed_mps: Standard deviation of the velocity along x and along y of an object
            that was seen once.
        birth_turn_radps: The same of its turn rate; only for `turn`.
        position_sd_m: Standard deviation of a measured centre in x and in y, near the sensor.
        position_sd_per_m: What is added to it for each metre of range, as independent noise.
        height_sd_m: Standard deviation of the measured height of the centre.
        gate_m: A detection farther than this from the predicted centre is another object; each
            second that a track was not seen adds twice `birth_speed_mps` to it.
        keep_score: A detection with a lower confidence is not used at all.
        birth_score: A detection with a lower confidence can only continue a track.
        t_birth_s: A trial track becomes full when its last detection is this much younger than
            its first.
        t_expire_s: A full track ends when it has not been seen for longer than this.
        t_prune_s: A trial track ends when it has not been seen for longer than this.
    """

    motion: Motion = "velocity"
    elongated: bool = False
    velocity_walk_mps: float = Field(default=1.5, gt=0)
    turn_walk_radps: float = Field(default=0.2, gt=0)
    height_walk_m: float = Field(default=0.3, gt=0)
    birth_speed_mps: float = Field(default=5.0, gt=0)
    birth_turn_radps: float = Field(default=0.1, gt=0)
    position_sd_m: float = Field(default=0.25, gt=0)
    position_sd_per_m: float = Field(default=0.005, ge=0)
    height_sd_m: float = Field(default=0.2, gt=0)
    gate_m: float = Field(default=2.0, gt=0)
    keep_score: float = 0.1
    birth_score: float = 0.3
    t_birth_s: float = Field(default=0.09, ge=0)
    t_expire_s: float = Field(default=1.0, ge=0)
    t_prune_s: float = Field(default=0.25, ge=0)


class AssociationWeights(Settings):
    """Weights of equation (1), each of a term that is about 0 for the same object.

    Attributes:
        distance: Of the distance between the centres over the gate of the class, 0..1.
        size: Of the mean relative difference of length, width and height, 0..1.
        overlap: Of (1 - generalised 3D IoU) / 2, 0..1.
        label: Of the focal cost of the class, -(1 - p)^2 log p.
        miss: A pair that costs more than this is left apart.
        gate_sigma: A detection farther than so many standard deviations from the prediction,
            in x and y together, is another object.
    """

    distance: float = Field(default=1.0, ge=0)
    size: float = Field(default=0.5, ge=0)
    overlap: float = Field(default=1.0, ge=0)
    label: float = Field(default=0.3, ge=0)
    miss: float = Field(default=1.5, gt=0)
    gate_sigma: float = Field(default=3.3, gt=0)


_DEFAULT_CLASSES = {
    "car": ClassSettings(
        motion="turn", elongated=True, birth_speed_mps=10.0, gate_m=2.0
    ),
    "truck": ClassSettings(
        motion="turn", elongated=True, birth_speed_mps=10.0, gate_m=4.0, position_sd_m=0.4
    ),
    "cyclist": ClassSettings(elongated=True, gate_m=1.5),
    "pedestrian": ClassSettings(
        velocity_walk_mps=0.8, birth_speed_mps=1.5, gate_m=1.2, position_sd_m=0.15,
        t_expire_s=2.0,
    ),
    "deer": ClassSettings(elongated=True, velocity_walk_mps=3.0, gate_m=2.0),
    "barrel": ClassSettings(velocity_walk_mps=0.1, birth_speed_mps=0.5, gate_m=1.0),
    "barricade": ClassSettings(velocity_walk_mps=0.1, birth_speed_mps=0.5, gate_m=1.5),
    "cone": ClassSettings(velocity_walk_mps=0.1, birth_speed_mps=0.5, gate_m=0.8),
    "sign": ClassSettings(velocity_walk_mps=0.1, birth_speed_mps=0.5, gate_m=1.0),
    "unknown": ClassSettings(birth_speed_mps=3.0, gate_m=1.9),
}  # fmt: skip

_DEFAULT_CONFUSIONS = {
    "car": {"truck": 0.1},
    "truck": {"car": 0.1},
    "cyclist": {"pedestrian": 0.15},
    "pedestrian": {"cyclist": 0.1},
    "barrel": {"cone": 0.1, "barricade": 0.05},
    "barricade": {"barrel": 0.05, "sign": 0.05},
    "cone": {"barrel": 0.1},
    "sign": {"barricade": 0.05},
}


class TrackerConfig(Settings):
    """Settings of a `Tracker`.

    Attributes:
        rollback_window_s: A measurement that arrives late is put at its place in time when it is
            at most this much older than the newest one; otherwise it is dropped and counted.
        classes: Settings of each class that tracks can have. Naming one in a file replaces all.
        confusions: For a true class, the probability that a detector says another one.
        confusion_floor: Probability that a detector says any one class that is not named there.
        unknown_share: Probability that a detector says `unknown` of an object of whatever class.
        class_change_per_s: Rate at which the belief in a class fades, so that it can be revised.
        vehicle_walk_mps: Without poses, what the vehicle's own accelerations and turns add to the
            `velocity_walk_mps` of all classes.
        vehicle_expire_s: Without poses, the most that `t_expire_s` of a class can be: how the
            vehicle moves is not known for longer.
        weights: Weights and limits of the association in space.
        image: The same of the association in images.
        duplicate_overlap: Of two tracks whose boxes overlap by more than this (IoU from above)
            the less certain one ends, unless each had its own detection and both are full.
        size_gain: Share of a new detection in the size and yaw of an old track; a young track
            takes the mean.
    """

    rollback_window_s: float = Field(default=1.0, ge=0)
    classes: dict[str, ClassSettings] = Field(default=_DEFAULT_CLASSES, min_length=1)
    confusions: dict[str, dict[str, float]] = Field(default=_DEFAULT_CONFUSIONS)
    confusion_floor: float = Field(default=0.01, gt=0, lt=0.1)
    unknown_share: float = Field(default=0.2, ge=0, lt=1)
    class_change_per_s: float = Field(default=0.02, ge=0)
    vehicle_walk_mps: float = Field(default=1.0, ge=0)
    vehicle_expire_s: float = Field(default=1.0, ge=0)
    weights: AssociationWeights = AssociationWeights()
    image: ImageMatchConfig = ImageMatchConfig()
    duplicate_overlap: float = Field(default=0.4, gt=0, le=1)
    size_gain: float = Field(default=0.15, gt=0, le=1)

    def in_moving_frame(self) -> TrackerConfig:
        """Return the settings for detections in a frame that moves with the vehicle.

        What an object seems to do there is what it and the vehicle do.
        """
        classes = {
            name: one.model_copy(
                update={
                    "velocity_walk_mps": hypot(one.velocity_walk_mps, self.vehicle_walk_mps),
                    "t_expire_s": min(one.t_expire_s, self.vehicle_expire_s),
                }
            )
            for name, one in self.classes.items()
        }
        return self.model_copy(update={"classes": classes})
