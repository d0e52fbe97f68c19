"""Impulses that an event passes on through force and torque sensors."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.wrench import Wrench
from ffsm_mj.sensing.reader import apply_wrenches


class ImpulseReader:
    """Values of all sensors of a motion's model in an impact: those of force and torque sensors are impulses.

    Newton-Euler recursion is linear in accelerations and external forces where nothing moves and nothing weighs: with the
    jump of the velocities in place of accelerations, and impulses in place of forces, it gives the impulses between bodies.

    Attributes:
        motion: The motion.
    """

    def __init__(self, motion: Motion) -> None:
        """Bind to a motion."""
        self.motion, self._still = motion, mujoco.MjData(motion.model)

    def read(self, jump: FloatArray, wrenches: Sequence[Wrench]) -> FloatArray:
        """Values in the order of MuJoCo's own, N s and N m s.

        Args:
            jump: Change of the velocities of the logged system, (nv,).
            wrenches: Impulses on its bodies, N s.
        """
        motion, still = self.motion, self._still
        model = motion.model
        mujoco.mj_resetData(model, still)
        still.qpos[:] = motion.data.qpos
        gravity, flags = model.opt.gravity.copy(), model.opt.disableflags
        model.opt.gravity[:] = 0.0
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        try:
            mujoco.mj_fwdPosition(model, still)
            mujoco.mj_fwdVelocity(model, still)
            still.qacc[:] = motion.own_rates(jump)
            apply_wrenches(motion, still, wrenches)
            mujoco.mj_rnePostConstraint(model, still)
            mujoco.mj_sensorAcc(model, still)
            return np.array(still.sensordata)
        finally:
            model.opt.gravity[:], model.opt.disableflags = gravity, flags
