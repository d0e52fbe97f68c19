"""Scripted policies of the shipped environments: functions of the observation that succeed, to compare others with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

Policy = Callable[[FloatArray], FloatArray]
"""Action for an observation."""

_HALF_BOX_M = 0.5
_FORCE_PER_SPEED_N_S_M = 10.0


def touch(observation: FloatArray) -> FloatArray:
    """``ffsm_mj/Touch-v0``: force of the tip in proportion to its velocity error, on the way to the face of the box.

    The tip approaches with half the gap per second, at most 0.2 m/s, and touches with 1 cm/s.
    """
    wanted = _planar_velocity(observation, fastest_m_s=0.2, slowest_m_s=0.01)
    return np.clip(_FORCE_PER_SPEED_N_S_M * (wanted - observation[2:4]) / 2.0, -1.0, 1.0)


def capture_planar(observation: FloatArray) -> FloatArray:
    """``ffsm_mj/CapturePlanar-v0``: velocity of the tip to the face of the box; the grasp is armed at once."""
    wanted = _planar_velocity(observation, fastest_m_s=0.2, slowest_m_s=0.03)
    return np.append(wanted / 0.3, 1.0)


def _planar_velocity(observation: FloatArray, fastest_m_s: float, slowest_m_s: float) -> FloatArray:
    """Velocity of the tip, m/s, (2,): along x to the face of the box, along y to 0.2 m above its centre."""
    x, y, box_x, box_y = observation[[0, 1, 4, 5]]
    gap = x - (box_x + _HALF_BOX_M)
    speed = np.clip(0.5 * gap, slowest_m_s, fastest_m_s)
    return np.array([-speed, np.clip(box_y + 0.2 - y, -fastest_m_s, fastest_m_s)])


def capture(observation: FloatArray) -> FloatArray:
    """``ffsm_mj/Capture-v0``: twist of the hand that follows the grapple and closes in on its position and attitude.

    Velocity v_g + 0.5 r and rate w_g + 0.5 phi in 1/s, with the distance r and the rotation vector phi from hand to grapple;
    the hand waits 0.15 m in front of the grapple until it points at it.
    """
    hand, frame = observation[0:3], observation[3:12].reshape(3, 3)
    grapple, to = observation[18:21], observation[21:30].reshape(3, 3)
    velocity, rate = observation[30:33], observation[33:36]
    turn = _rotation_vector(to @ frame.T)
    goal = grapple - (0.15 if float(np.linalg.norm(turn)) > 0.1 else 0.0) * to[:, 0]
    velocity = velocity + np.cross(rate, goal - grapple)
    linear = velocity + _limited(0.5 * (goal - hand), 0.05)
    return np.clip(np.concatenate((linear / 0.1, (rate + _limited(0.5 * turn, 0.1)) / 0.2)), -1.0, 1.0)


def _limited(vector: FloatArray, most: float) -> FloatArray:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)


def _rotation_vector(matrix: FloatArray) -> FloatArray:
    """Axis times angle of a rotation, rad, (3,)."""
    quaternion, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


BASELINES: Mapping[str, Policy] = {
    "ffsm_mj/Touch-v0": touch,
    "ffsm_mj/CapturePlanar-v0": capture_planar,
    "ffsm_mj/Capture-v0": capture,
}
"""Scripted policy of each shipped environment."""
