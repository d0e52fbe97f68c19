"""State transfer from the motion with a grasped object to the logged system, (17).

Coordinates and rates of shared joints are copied; those of the object's base joints follow from its pose and twist as part
of the link.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray, numbers
from ffsm_mj.compiled import fastest
from ffsm_mj.contact_models.grasp.base_joints import BaseJointSolver

_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)

Shared = tuple[IntArray, IntArray]
"""Indices in ``qpos`` or ``qvel`` of joints that both systems have: in the logged system, and in the other."""


class StateTransfer:
    """Transfers the state of a motion with a grasped object to the data of the logged system."""

    def __init__(
        self,
        logged: tuple[Any, Any, FloatArray],
        moving: tuple[Any, Any, int],
        shared: tuple[Shared, Shared],
        placing: BaseJointSolver,
    ) -> None:
        """Bind to both systems.

        Args:
            logged: Model and data of the logged system, and the array for its M qdot, (nv,).
            moving: Model and data of the motion, and the id of the object's base in it.
            shared: Indices of shared coordinates, and of shared rates.
            placing: Solver for the object's base joints.
        """
        self._model, self._data, self._momentum = logged
        self._moving, self._state, self._root = moving
        self._placing, self._twist, self._rates = placing, np.empty(6), self._data.qvel
        self._position, self._quaternion = self._state.xpos[self._root], self._state.xquat[self._root]
        of_both = (self._data.qpos, self._state.qpos), (self._data.qvel, self._state.qvel)
        self._copies = [
            (numbers(own[ours]), numbers(other[theirs]))
            for (own, other), places in zip(of_both, shared, strict=True)
            for ours, theirs in _stretches(*places)
        ]

    @classmethod
    def of(
        cls, logged: tuple[Any, Any, FloatArray], moving: tuple[Any, Any, int], shared: Any, placing: BaseJointSolver
    ) -> StateTransfer:
        """The compiled twin if it is installed and the base joints have a closed form; else this class."""
        kind = fastest(cls) if placing.free or placing.reading is not None else cls
        return kind(logged, moving, shared, placing)

    def state(self) -> None:
        """Transfer positions and velocities, and update what depends on them."""
        for own, other in self._copies:
            own[:] = other
        self._data.time = self._state.time
        self._placing.pose(self._position, self._quaternion)
        mujoco.mj_fwdPosition(self._model, self._data)
        mujoco.mj_objectVelocity(self._moving, self._state, _BODY, self._root, self._twist, 0)
        self._placing.rates(self._twist)
        mujoco.mj_fwdVelocity(self._model, self._data)

    def step(self) -> None:
        """The same, and update M qdot and the actuator forces under the efforts in the system's data."""
        self.state()
        mujoco.mj_mulM(self._model, self._data, self._momentum, self._rates)
        mujoco.mj_fwdActuation(self._model, self._data)


def _stretches(ours: IntArray, theirs: IntArray) -> list[tuple[slice, slice]]:
    """Runs of indices that are consecutive in both systems, as slices: slice copies are faster."""
    edges = np.flatnonzero((np.diff(ours) != 1) | (np.diff(theirs) != 1)) + 1
    both = (np.split(places, edges) for places in (ours, theirs))
    return [
        (slice(int(a[0]), int(a[-1]) + 1), slice(int(b[0]), int(b[-1]) + 1)) for a, b in zip(*both, strict=True) if len(a)
    ]
