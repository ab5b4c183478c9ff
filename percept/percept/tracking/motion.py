"""How objects move between two moments: with constant velocity, or on a circle.

Both are one model. Its state is x, y, z, vx, vy and the turn rate w, in a frame that does not
move; an object of the motion `velocity` is one whose turn rate is known to be zero, and its
state ends before w. Velocities are Cartesian since a course has no meaning at standstill, which
is how most objects begin and many stay. Equations and their Jacobian: Bar-Shalom, Li,
Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), section 11.7.

The noise is white acceleration of continuous time: two short predictions spread a constant
velocity exactly as one long prediction does, so that the rate of the sensors does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.tracking.config import ClassSettings, Motion

__all__ = ["STATE_SIZE", "MotionModel", "motion_model", "predict_turns"]

_F64 = NDArray[np.float64]

STATE_SIZE = 6
"""Numbers of a whole state: x, y, z, vx, vy, turn rate."""

_SIZES: dict[str, int] = {"velocity": 5, "turn": STATE_SIZE}


@dataclass(frozen=True, slots=True)
class MotionModel:
    """The motion of one class of objects.

    Attributes:
        name: `velocity` or `turn`.
        size: D, how many numbers a state has: x, y, z in metres, vx, vy in m/s, and for `turn`
            the turn rate in rad/s, counter-clockwise.
        velocity_walk_mps: Standard deviation by which vx and vy change within one second.
        height_walk_m: The same of z.
        turn_walk_radps: The same of the turn rate; 0 for `velocity`.
    """

    name: Motion
    size: int
    velocity_walk_mps: float
    height_walk_m: float
    turn_walk_radps: float

    def predict(
        self, states: _F64, covariances: _F64, dt_s: NDArray[np.floating]
    ) -> tuple[_F64, _F64, _F64]:
        """Return the states, covariances and Jacobians after a time.

        Args:
            states: (N, D).
            covariances: (N, D, D).
            dt_s: (N,) seconds, not negative; 0 changes nothing.

        Returns:
            (N, D) means, (N, D, D) covariances with the noise of the motion added, and (N, D, D)
            Jacobians of the new state by the old one.
        """
        count, size = len(states), self.size
        whole = np.zeros((count, STATE_SIZE))
        spread = np.zeros((count, STATE_SIZE, STATE_SIZE))
        whole[:, :size] = states
        spread[:, :size, :size] = covariances
        walks = np.tile(
            [self.velocity_walk_mps, self.height_walk_m, self.turn_walk_radps], (count, 1)
        )
        whole, spread, jacobians = predict_turns(whole, spread, np.asarray(dt_s, float), walks)
        return whole[:, :size], spread[:, :size, :size], jacobians[:, :size, :size]

    def difference(self, states: _F64, others: _F64) -> _F64:
        """Return `states` minus `others` (N, D); no number of a state is an angle that wraps."""
        return states - others

    def velocity(self, states: _F64) -> _F64:
        """Return (N, 2) velocities over the ground in m/s of states (N, D)."""
        return states[:, 3:5]

    def velocity_covariance(self, _states: _F64, covariances: _F64) -> _F64:
        """Return (N, 2, 2) covariances of the velocities, in (m/s)^2."""
        return covariances[:, 3:5, 3:5]


def motion_model(name: str, settings: ClassSettings) -> MotionModel:
    """Return the model `velocity` or `turn` with the noise of a class."""
    turn_walk = settings.turn_walk_radps if name == "turn" else 0.0
    motion: Motion = "turn" if name == "turn" else "velocity"
    return MotionModel(
        motion, _SIZES[motion], settings.velocity_walk_mps, settings.height_walk_m, turn_walk
    )


def predict_turns(
    states: _F64, covariances: _F64, dt_s: _F64, walks: _F64
) -> tuple[_F64, _F64, _F64]:
    """Predict whole states, each with its own noise.

    Args:
        states: (N, 6).
        covariances: (N, 6, 6); the row and column of the turn rate are zero for objects that do
            not turn.
        dt_s: (N,) seconds.
        walks: (N, 3) spread of velocity, height and turn rate after one second.

    Returns:
        (N, 6), (N, 6, 6) and the Jacobians (N, 6, 6).
    """
    from percept.tracking.motion_kernels import fill_predictions

    moved = np.empty((len(states), STATE_SIZE))
    spreads, jacobians = np.empty((2, len(states), STATE_SIZE, STATE_SIZE))
    fill_predictions(
        np.ascontiguousarray(states), np.ascontiguousarray(covariances), dt_s, walks,
        moved, spreads, jacobians,
    )  # fmt: skip
    return moved, spreads, jacobians
