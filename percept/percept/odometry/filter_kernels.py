"""Compiled error-state Kalman filter and smoother over GNSS and IMU.

After J. Sola, "Quaternion kinematics for the error-state Kalman filter", 2017 (arXiv 1711.02508),
with errors of the attitude in the IMU's frame (section 6). A nominal state is a row of 21 numbers:
place and velocity of the IMU in the inertial frame, its attitude R (9, row by row), and the biases
of accelerometers and gyroscopes. An error state has 15: place, velocity, attitude, and both biases.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["ERRORS", "STATE", "Drive", "run_forward", "smooth_backward", "turned_since_start"]

ERRORS, STATE = 15, 21

_F = NDArray[np.float64]
_I = NDArray[np.int64]
_Function = TypeVar("_Function", bound=Callable[..., object])

# A standing car shakes; in one second its mean speed and mean turn rate are this close to zero.
_STILL_VAR_MPS2, _STILL_VAR_RADPS2 = 0.05**2, 2e-4**2
# Where the sideways speed is zero lies somewhere along the car: at most so far from the base.
_LEVER_M = 1.5
_FEWEST_REFUSED = 3
_ACCEPTED, _REFUSED, _RECOVERED = 1, 2, 3


def _compiled(function: _Function) -> _Function:
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))


class Drive(NamedTuple):
    """Readings on one time line, as the kernels read them.

    Attributes:
        times_s: (T,) of IMU readings, and of fixes between them.
        gyro: (T, 3) angular velocity, rad/s, interpolated at fixes.
        force: (T, 3) specific force, m/s^2.
        nodes: (M,) places on the time line at which there is a state.
        gyro_psd: (M,) white noise of the gyroscopes up to each node, rad^2/s.
        force_psd: (M,) the same of the accelerometers, m^2/s^3.
        fix_of_node: (M,) the fix at each node, or -1.
        fixes: (F, 3) antenna in the inertial frame, metres.
        covariances: (F, 3, 3) of the fixes.
        quiet: (M,) whether the IMU is quiet.
        attitudes: (M, 3, 3) the IMU's own orientation; NaN where it tells none.
        antenna: (3,) antenna in the IMU's frame, metres.
        base: (3,) the vehicle's frame in that of the IMU, metres.
        sideways: (3,) axis to the left of the vehicle in the IMU's frame.
        gravity: m/s^2.
        walks: Growth of the variances of gyroscope and accelerometer biases.
        gate: Largest squared Mahalanobis distance of a fix.
        recover_s: Time of refusals after which the position is let go.
        still_speed: Largest speed of a vehicle that stands, m/s.
        lateral_var: Of the sideways speed over one second; 0 does not use it.
        orientation_var: Of the IMU's own orientation over one second; 0 does not use it.
    """

    times_s: _F
    gyro: _F
    force: _F
    nodes: _I
    gyro_psd: _F
    force_psd: _F
    fix_of_node: _I
    fixes: _F
    covariances: _F
    quiet: NDArray[np.bool_]
    attitudes: _F
    antenna: _F
    base: _F
    sideways: _F
    gravity: float
    walks: tuple[float, float]
    gate: float
    recover_s: float
    still_speed: float
    lateral_var: float
    orientation_var: float


@_compiled
def _skew(a: _F) -> _F:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@_compiled
def _exp(turn: _F) -> _F:
    """Return the rotation of a rotation vector (Sola eq. 78)."""
    angle = math.sqrt(turn @ turn)
    W = _skew(turn)
    if angle < 1e-8:
        return np.eye(3) + W
    s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    return np.eye(3) + s * W + c * (W @ W)


@_compiled
def _log(R: _F) -> _F:
    """Return the rotation vector of a rotation that is less than half a turn (Sola eq. 79)."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
    sine = math.sqrt(axis @ axis)
    angle = math.atan2(sine, (R[0, 0] + R[1, 1] + R[2, 2] - 1.0) / 2.0)
    return axis * (angle / sine if sine > 1e-9 else 1.0)


@_compiled
def _attitude(x: _F) -> _F:
    return x[6:15].copy().reshape(3, 3)


@_compiled
def _set_attitude(x: _F, R: _F) -> None:
    """Store a rotation, one Newton step nearer to an exact one."""
    exact = R @ (3.0 * np.eye(3) - R.T.copy() @ R) / 2.0
    x[6:15] = exact.reshape(9)


@_compiled
def turned_since_start(d: Drive, bias: _F) -> _F:
    """Return (T, 3, 3) the IMU's attitude in its own first frame, by the gyroscopes alone."""
    turned = np.empty((len(d.times_s), 3, 3))
    turned[0] = np.eye(3)
    for i in range(len(d.times_s) - 1):
        rate = (d.gyro[i] + d.gyro[i + 1]) / 2.0 - bias
        turned[i + 1] = turned[i] @ _exp(rate * (d.times_s[i + 1] - d.times_s[i]))
    return turned


@_compiled
def _predict(d: Drive, k: int, x: _F, P: _F) -> tuple[_F, _F, _F]:
    """Return state, covariance and transition (15, 15) at node k from those at the node before.

    The readings between are added up in the frame of the first (preintegration), with the
    attitude at the middle of each interval.
    """
    turn, dv, dp = np.eye(3), np.zeros(3), np.zeros(3)
    for i in range(d.nodes[k - 1], d.nodes[k]):
        dt = d.times_s[i + 1] - d.times_s[i]
        rate = (d.gyro[i] + d.gyro[i + 1]) / 2.0 - x[18:21]
        force = (d.force[i] + d.force[i + 1]) / 2.0 - x[15:18]
        half = _exp(rate * (dt / 2.0))
        middle = turn @ half
        push = middle @ force
        dp += dv * dt + push * (dt * dt / 2.0)
        dv += push * dt
        turn = middle @ half
    T = d.times_s[d.nodes[k]] - d.times_s[d.nodes[k - 1]]
    R = _attitude(x)
    F = np.eye(ERRORS)
    F[0:3, 3:6] = T * np.eye(3)
    F[0:3, 6:9] = -R @ _skew(dp)
    F[0:3, 9:12] = -R * (T * T / 2.0)
    F[3:6, 6:9] = -R @ _skew(dv)
    F[3:6, 9:12] = -R * T
    F[6:9, 6:9] = turn.T
    F[6:9, 12:15] = -T * np.eye(3)
    after = x.copy()
    after[0:3] = x[0:3] + x[3:6] * T + R @ dp
    after[3:6] = x[3:6] + R @ dv
    after[2] -= d.gravity * T * T / 2.0
    after[5] -= d.gravity * T
    _set_attitude(after, R @ turn)
    Q = F @ P @ F.T.copy()
    for n in range(3):
        Q[n, n] += d.force_psd[k] * T**3 / 3.0
        Q[n, n + 3] += d.force_psd[k] * T**2 / 2.0
        Q[n + 3, n] += d.force_psd[k] * T**2 / 2.0
        Q[n + 3, n + 3] += d.force_psd[k] * T
        Q[n + 6, n + 6] += d.gyro_psd[k] * T
        Q[n + 9, n + 9] += d.walks[1] * T
        Q[n + 12, n + 12] += d.walks[0] * T
    return after, (Q + Q.T) / 2.0, F


@_compiled
def _update(x: _F, P: _F, residual: _F, H: _F, noise: _F) -> tuple[_F, _F]:
    """Return state and covariance after a measurement, in Joseph's form."""
    K = P @ H.T.copy() @ np.linalg.inv(H @ P @ H.T.copy() + noise)
    error = K @ residual
    keep = np.eye(ERRORS) - K @ H
    P_new = keep @ P @ keep.T.copy() + K @ noise @ K.T.copy()
    # The error is now taken about the new attitude (Sola eq. 287).
    G = np.eye(ERRORS)
    G[6:9, 6:9] -= _skew(error[6:9]) / 2.0
    P_new = G @ P_new @ G.T.copy()
    return _moved(x, error), (P_new + P_new.T) / 2.0


@_compiled
def _moved(x: _F, error: _F) -> _F:
    """Return a nominal state with an error state added (Sola eq. 283)."""
    new = x.copy()
    new[0:6] += error[0:6]
    _set_attitude(new, _attitude(x) @ _exp(error[6:9]))
    new[15:21] += error[9:15]
    return new


@_compiled
def _use_fix(
    d: Drive, f: int, time_s: float, x: _F, P: _F, memory: _F, fate: _F
) -> tuple[_F, _F, _F]:
    """Return state, covariance and predicted covariance after a fix, unless it is refused.

    `fate` (4,) gets what became of the fix, its squared Mahalanobis distance, the same with the
    logarithm of the determinant (twice its negative log-likelihood), and its distance in metres.
    """
    R = _attitude(x)
    H = np.zeros((3, ERRORS))
    H[:, 0:3] = np.eye(3)
    H[:, 6:9] = -R @ _skew(d.antenna)
    residual = d.fixes[f] - x[0:3] - R @ d.antenna
    S = H @ P @ H.T.copy() + d.covariances[f]
    distance = residual @ np.linalg.inv(S) @ residual
    fate[1], fate[2] = distance, distance + math.log(np.linalg.det(S))
    fate[3] = math.sqrt(residual @ residual)
    if distance <= d.gate:
        memory[:] = 0.0
        fate[0] = _ACCEPTED
        x, P_new = _update(x, P, residual, H, d.covariances[f])
        return x, P_new, P
    if memory[0] == 0.0:
        memory[1] = time_s
    memory[0] += 1.0
    if memory[0] < _FEWEST_REFUSED or time_s - memory[1] < d.recover_s:
        fate[0] = _REFUSED
        return x, P, P
    memory[:] = 0.0
    fate[0] = _RECOVERED
    P = P.copy()
    for n in range(3):
        P[n, n] += fate[3] ** 2
        P[n + 3, n + 3] += (fate[3] / d.recover_s) ** 2
    x, P_new = _update(x, P, residual, H, d.covariances[f])
    return x, P_new, P


@_compiled
def _use_stillness(d: Drive, k: int, T: float, x: _F, P: _F) -> tuple[_F, _F]:
    """Use that a standing vehicle neither moves nor turns: v = 0, and the gyroscopes read bias."""
    H = np.zeros((6, ERRORS))
    H[0:3, 3:6] = np.eye(3)
    H[3:6, 12:15] = np.eye(3)
    residual = np.concatenate((-x[3:6], d.gyro[d.nodes[k]] - x[18:21]))
    noise = np.zeros((6, 6))
    for n in range(3):
        noise[n, n] = _STILL_VAR_MPS2 / T
        noise[n + 3, n + 3] = (d.gyro_psd[k] + _STILL_VAR_RADPS2) / T
    S = H @ P @ H.T.copy() + noise
    speed = residual[0:3]
    if speed @ np.linalg.inv(S[0:3, 0:3].copy()) @ speed > d.gate:
        return x, P
    return _update(x, P, residual, H, noise)


@_compiled
def _use_no_slip(d: Drive, k: int, T: float, x: _F, P: _F) -> tuple[_F, _F]:
    """Use that the vehicle does not move sideways; less so where it turns."""
    R = _attitude(x)
    rate = d.gyro[d.nodes[k]] - x[18:21]
    v_imu = R.T.copy() @ x[3:6]
    h = np.zeros(ERRORS)
    h[3:6] = R @ d.sideways
    h[6:9] = -(_skew(v_imu) @ d.sideways)
    residual = -(d.sideways @ (v_imu + _skew(rate) @ d.base))
    spread = d.lateral_var + (_LEVER_M**2) * (rate @ rate)
    Ph = P @ h
    if residual**2 > d.gate * (h @ Ph + spread):
        return x, P
    S = h @ Ph + spread / T
    P_new = P - np.outer(Ph, Ph) / S
    return _moved(x, Ph * (residual / S)), (P_new + P_new.T) / 2.0


@_compiled
def _use_orientation(d: Drive, k: int, T: float, x: _F, P: _F) -> tuple[_F, _F]:
    residual = _log(_attitude(x).T.copy() @ d.attitudes[k])
    H = np.zeros((3, ERRORS))
    H[:, 6:9] = np.eye(3)
    return _update(x, P, residual, H, np.eye(3) * (d.orientation_var / T))


@_compiled
def run_forward(
    d: Drive, first: int, x: _F, P: _F, memory: _F, fates: _F, states: _F, store: _F
) -> None:
    """Filter from the state at a node over as many nodes as there is room for.

    Args:
        d: The drive.
        first: The node that x and P hold for.
        x: (21,) state.
        P: (15, 15) covariance.
        memory: (2,) fixes refused in a row, and when that began; is changed.
        fates: (F, 4) is filled: what became of each fix (0 not met, 1 used, 2 refused, 3 used
            after the position was let go), its squared Mahalanobis distance, twice its negative
            log-likelihood, and its distance in metres.
        states: (2, n, 21) is filled: states predicted and filtered at n nodes from `first` on.
        store: (3, n, 15, 15) is filled: covariances predicted and filtered, and transitions.
    """
    states[:, 0] = x
    store[0, 0], store[1, 0], store[2, 0] = P, P, np.eye(ERRORS)
    for n in range(1, states.shape[1]):
        k = first + n
        x, P, F = _predict(d, k, x, P)
        states[0, n], store[0, n], store[2, n] = x, P, F
        T = d.times_s[d.nodes[k]] - d.times_s[d.nodes[k - 1]]
        if d.fix_of_node[k] >= 0:
            f = d.fix_of_node[k]
            x, P, P_open = _use_fix(d, f, d.times_s[d.nodes[k]], x, P, memory, fates[f])
            store[0, n] = P_open
        if d.quiet[k] and math.sqrt(x[3:6] @ x[3:6]) <= d.still_speed:
            x, P = _use_stillness(d, k, T, x, P)
        if d.lateral_var > 0.0:
            x, P = _use_no_slip(d, k, T, x, P)
        if d.orientation_var > 0.0 and not math.isnan(d.attitudes[k, 0, 0]):
            x, P = _use_orientation(d, k, T, x, P)
        states[1, n], store[1, n] = x, P


@_compiled
def smooth_backward(states: _F, store: _F) -> None:
    """Replace filtered states and covariances by smoothed ones (Rauch, Tung, Striebel 1965).

    The last of them is taken as smoothed already. Differences of states are error states.

    Args:
        states: (2, n, 21) predicted and filtered; the second part is changed.
        store: (3, n, 15, 15) predicted, filtered, transitions; the second part is changed.
    """
    for n in range(states.shape[1] - 2, -1, -1):
        P, F = store[1, n].copy(), store[2, n + 1].copy()
        C = np.linalg.solve(store[0, n + 1].copy(), F @ P).T.copy()
        predicted, smoothed = states[0, n + 1], states[1, n + 1]
        error = np.zeros(ERRORS)
        error[0:6] = smoothed[0:6] - predicted[0:6]
        error[6:9] = _log(_attitude(predicted).T.copy() @ _attitude(smoothed))
        error[9:15] = smoothed[15:21] - predicted[15:21]
        states[1, n] = _moved(states[1, n], C @ error)
        spread = P + C @ (store[1, n + 1] - store[0, n + 1]) @ C.T.copy()
        store[1, n] = (spread + spread.T) / 2.0
