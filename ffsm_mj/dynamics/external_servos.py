"""Servos that act from outside, at a site without reference site or on a free joint: their impulse and work in a step.

Both are integrals over the stages of the step, as the force of a servo varies within it: of the wrench about the world
origin, and of its power p . ldot.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray

_SITE = int(mujoco.mjtTrn.mjTRN_SITE)


class ExternalServos:
    """Impulse and work of the servos that act from outside.

    Attributes:
        impulse: Impulse on each tree in the last step, (P, L about the world origin), (number of trees, 6).
    """

    def __init__(self, model: Any, data: Any, servos: IntArray, trees: IntArray, impulse: FloatArray) -> None:
        """Bind to the data of a motion.

        Args:
            model: MuJoCo model of the motion.
            data: Its data.
            servos: Ids of the servos, (n,).
            trees: Tree that each acts on, (n,).
            impulse: Receives the impulse, (number of trees, 6).
        """
        self._model, self._data, self.impulse = model, data, impulse
        self._servos = [*zip(servos.tolist(), trees.tolist(), strict=True)]
        self._sums = np.zeros((len(impulse), 7))

    def begin(self) -> None:
        """Begin a step."""
        self._sums.fill(0.0)

    def add(self, weight: float) -> None:
        """Add wrench and power at a stage, forces current, with its weight."""
        data = self._data
        for i, tree in self._servos:
            force = weight * float(data.actuator_force[i])
            self._sums[tree, :6] += force * self._wrench(i)
            self._sums[tree, 6] += force * float(data.actuator_velocity[i])

    def end(self, duration_s: float, work: FloatArray) -> None:
        """End a step, and add the work to that of each tree, J, (number of trees,)."""
        self.impulse[:] = duration_s * self._sums[:, :6]
        work += duration_s * self._sums[:, 6]

    def _wrench(self, servo: int) -> FloatArray:
        """Wrench about the world origin per unit of force, (6,)."""
        model, data, target = self._model, self._data, int(self._model.actuator_trnid[servo, 0])
        push, turn = model.actuator_gear[servo].reshape(2, 3)
        if model.actuator_trntype[servo] == _SITE:
            axes, place = data.site_xmat[target].reshape(3, 3), data.site_xpos[target]
            push = axes @ push
        else:  # a free joint: the force is in world axes, the torque in those of the body
            body = int(model.jnt_bodyid[target])
            axes, place = data.xmat[body].reshape(3, 3), data.xpos[body]
        return np.concatenate((push, axes @ turn + np.cross(place, push)))
