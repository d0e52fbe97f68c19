"""Efforts of thrusters for a change of the angular momentum of the stack, without net force where the layout allows it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.allocation import moments, nonnegative_shares, unit_moments
from ffsm_mj.controller_protocol import ConstrainedModel, EffortLimits, FloatArray, IntArray, System

_LEVER_M = 1e-2
"""Lever arm by which a net force counts beside a torque: small, so that without couples the torque is still obtained."""


class MomentumThrusters:
    """Thrusters of a robot as what changes the angular momentum about the centre of mass of its stack."""

    def __init__(self, system: System, thrusters: IntArray, limits: EffortLimits | None) -> None:
        """Bind to the actuators."""
        model = system.mj
        self._model, self._root, self.actuators = model, system.robot.root, thrusters
        one_way = model.actuator_ctrllimited[thrusters].astype(bool) & (model.actuator_ctrlrange[thrusters, 0] >= 0.0)
        self._both_ways = ~one_way
        self._unit, self._constrained = unit_moments(model), ConstrainedModel(model)
        low, high = limits.bounds(np.zeros(model.nu)) if limits is not None else np.tile([[-np.inf], [np.inf]], model.nu)
        self._low, self._high = low[thrusters], high[thrusters]
        self._angular, self._linear = np.empty((3, model.nv)), np.empty((3, model.nv))

    def efforts(self, data: Any, impulse: FloatArray, duration_s: float) -> FloatArray:
        """Efforts that give an angular impulse about the centre of mass in a time, or as much of it as limits allow.

        Args:
            data: The state, with a factorised mass matrix.
            impulse: Angular impulse in world axes, N m s, (3,).
            duration_s: Time for which the efforts are held, s.
        """
        model, root = self._model, self._root
        mujoco.mj_angmomMat(model, data, self._angular, root)
        mujoco.mj_jacSubtreeCom(model, data, self._linear, root)
        pushes = np.ascontiguousarray(moments(model, data, self._unit)[self.actuators])
        answers = np.empty_like(pushes)
        self._constrained.respond(data, pushes, answers)
        force = model.body_subtreemass[root] * self._linear @ answers.T
        columns = np.vstack((_LEVER_M * force, self._angular @ answers.T))
        signed = np.hstack((columns, -columns[:, self._both_ways]))
        shares = nonnegative_shares(signed, np.concatenate((np.zeros(3), impulse / duration_s)))
        count = len(self.actuators)
        efforts = np.array(shares[:count])
        efforts[self._both_ways] -= shares[count:]
        room = np.where(efforts > 0.0, self._high, -self._low)
        used = efforts != 0.0
        return np.asarray(efforts * min(1.0, float((room[used] / np.abs(efforts[used])).min(initial=1.0))))
