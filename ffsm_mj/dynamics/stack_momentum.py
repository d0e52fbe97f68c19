"""Angular momentum of a stack, robot and grasped objects, about its own centre of mass: in its wheels, and the rest.

About that centre it is the same in every inertial frame. The wheels have h = sum_i a_i I_i thetadot_i, with axis, axial
inertia and rate of each rotor relative to its bearing; the rest is what the stack has with its wheels locked. Where no
joint moves, the rest is zero exactly if nothing rotates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.model.system import System, rotors


class StackMomentum:
    """Angular momentum of the robot together with some objects.

    Attributes:
        wheels: Names of the joints of the rotors.
        dofs: Their addresses in ``qvel``, (n,).
    """

    def __init__(self, system: System) -> None:
        """Find the rotors."""
        self._model, self._root = system.mj, system.robot.root
        self._roots = {tree.name: tree.root for tree in system.objects}
        wheels = rotors(system)
        self.wheels = tuple(joint.name for joint in wheels)
        self.dofs = np.array([joint.dofs.start for joint in wheels], dtype=np.intp)
        self._axes = np.empty((3, self._model.nv))

    def wheel_columns(self, data: Any) -> FloatArray:
        """Angular momentum per rate of each wheel, a_i I_i in world axes, (3, n)."""
        mujoco.mj_angmomMat(self._model, data, self._axes, self._root)
        return np.asarray(self._axes[:, self.dofs])

    def total(self, data: Any, objects: Sequence[str] = ()) -> FloatArray:
        """Angular momentum of robot and objects about their common centre of mass, world axes, N m s, (3,).

        Args:
            data: State with current kinematics (``mj_forward``).
            objects: Names of objects with joints of their own that belong to the stack; an object that is grasped in the
                model is a part of the robot there.
        """
        model, momentum, mass, centre = self._model, np.zeros(6), 0.0, np.zeros(3)
        for root in (self._root, *(self._roots[name] for name in objects)):
            momentum += momentum_matrix(model, data, root) @ data.qvel
            mass += model.body_subtreemass[root]
            centre += model.body_subtreemass[root] * data.subtree_com[root]
        return momentum[3:] - cross(centre / mass, momentum[:3])

    def parts(self, data: Any, objects: Sequence[str] = ()) -> tuple[FloatArray, FloatArray]:
        """Angular momentum without the wheels, (3,), and h of each wheel, (n, 3); their sum is :meth:`total`."""
        h = self.wheel_columns(data).T * data.qvel[self.dofs][:, None]
        return self.total(data, objects) - h.sum(axis=0), h
