"""Accelerations that the arm is to have: held, on a path of least jerk, or in its reaction null space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_controllers.detumble.config import DetumbleArm
from ffsm_mj.controller_protocol import DrivenJoints, FloatArray, MinimumJerk, Stateful

_RANK = 1e-8


class ArmMotion(Stateful):
    """Reference of the arm's joints, tracked with critical damping: qdd = qdd_d - 2 w ed - w^2 e."""

    @dataclass
    class State:
        """When the phase began, and positions and rates of the joints there, (2, n)."""

        start_s: float
        begin: FloatArray

    def __init__(self, config: DetumbleArm, joints: DrivenJoints, part: slice) -> None:
        """Bind to the joints.

        Args:
            config: The section ``arm``.
            joints: All driven joints.
            part: Those of the arm among them.
        """
        self._config, self._w = config, config.bandwidth_rad_s
        self._qpos, self._dofs = joints.qpos[part], joints.dofs[part]
        self._start_s, self._begin = 0.0, np.zeros((2, len(self._dofs)))
        self._path: MinimumJerk | None = None

    @property
    def null_space(self) -> bool:
        """Whether it moves in its reaction null space."""
        return self._config.null_space and len(self._dofs) > 0

    def start(self, time_s: float, data: Any) -> None:
        """Take the reference, or lay the path, from a state."""
        self._start_s, self._begin[:] = time_s, (data.qpos[self._qpos], data.qvel[self._dofs])
        self._lay()

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self._lay()

    def _lay(self) -> None:
        """Lay the path, if there is one, from where the phase began."""
        (at, rates), config = self._begin, self._config
        if config.positions is not None and config.over_s is not None:
            self._path = MinimumJerk([0.0, config.over_s], np.vstack((at, config.positions)), rates)

    def has_arrived(self, time_s: float) -> bool:
        """Whether its reference is at rest."""
        return time_s - self._start_s >= (self._config.over_s or 0.0)

    def accelerations(self, time_s: float, data: Any, W: FloatArray | None) -> FloatArray:
        """Accelerations of the joints, (n,).

        Args:
            time_s: Time, s.
            data: The state.
            W: Angular velocity of the base per rate of each joint, wheels locked in their bearings, without momentum,
                (3, n); for motion in the null space alone, where it is the rate N (qd_d - w e), N = 1 - W^+ W, that is
                tracked.
        """
        position, rate, acceleration = self._reference(time_s)
        at, moving = data.qpos[self._qpos], data.qvel[self._dofs]
        if W is not None:
            asked = rate - self._w * (at - position)
            asked = asked - np.linalg.pinv(W, rcond=_RANK) @ (W @ asked)
            return np.asarray(-2.0 * self._w * (moving - asked))
        return np.asarray(acceleration - 2.0 * self._w * (moving - rate) - self._w**2 * (at - position))

    def _reference(self, time_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        if self._path is not None:
            return self._path.at(time_s - self._start_s)
        nothing = np.zeros(len(self._dofs))
        return self._begin[0], nothing, nothing
