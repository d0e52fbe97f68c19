"""Holds joints where they are, or at given positions, with a stated bandwidth, or by the servos that drive them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ffsm_controllers.joint_errors import JointErrors
from ffsm_controllers.joint_law import JointLaw
from ffsm_controllers.joint_servo import ServoConfig, refuse_positions
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    FloatArray,
    Observation,
)


class HoldConfig(ServoConfig):
    """u = -M_c (w^2 e + 2 zeta w ed) with the reduced mass matrix M_c at the held positions, constant through the phase.

    Servos get the setpoints of these positions.
    """

    kind: Literal["hold"]
    positions: tuple[float, ...] | None = None
    """Position of each joint, rad or m; left out: those at the start of the phase."""


class Hold(JointLaw):
    """Joint PD whose constant gains give a stated bandwidth where it holds.

    Stiffness and damping are symmetric and positive, so that energy and stiffness bound the motion whatever its size.
    """

    @dataclass
    class State:
        """Where the joints are held, rad or m, (n,), the gains there, (n, n), and errors so far."""

        reference: FloatArray
        stiffness: FloatArray
        damping: FloatArray
        errors: JointErrors.State

    Config = HoldConfig

    def __init__(self, config: HoldConfig, context: ControllerContext) -> None:
        """Resolve the joints.

        Raises:
            ScenarioFaults: An unknown joint, positions that do not fit them, or a bandwidth beyond the control period's.
        """
        super().__init__(config, context)
        system, names = context.system, self._joints.names
        self._fixed: FloatArray | None = None
        if config.positions is not None:
            refuse_positions(system, names, config.positions, ("positions",))
            if self._setpoints is not None:
                self._setpoints.refuse_outside_range(config.positions, ("positions",))
            self._fixed = np.array(config.positions)
        n = len(names)
        self._reference, self._stiffness, self._damping = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
        self._errors = JointErrors(system, names, "hold", "largest distance of a joint from where it is held")
        self.telemetry_signals = self._errors.signals

    def start(self, observation: Observation) -> None:
        """Take the reference, and the gains there."""
        data = observation.data
        self._reference[:] = data.qpos[self._joints.qpos] if self._fixed is None else self._fixed
        if self._setpoints is None:
            self._stiffness[:], self._damping[:] = self.gains_at(data, self._reference)

    def control(self, observation: Observation, command: Command) -> None:
        """Drive the joints towards the reference."""
        data, joints = observation.data, self._joints
        error = data.qpos[joints.qpos] - self._reference
        if self._setpoints is not None:
            command.set(joints.actuators, self._setpoints.at(data, self._reference))
        else:
            effort = -self._stiffness.dot(error) - self._damping.dot(data.qvel[joints.dofs])
            command.drive(joints.actuators, effort)
        self._errors.look(error)

    def telemetry(self) -> Sequence[float]:
        """Largest distance from the reference, of hinges in rad and of slides in m."""
        return self._errors.values

    def summary(self) -> ControllerReport:
        """Largest distances from the reference."""
        return self._errors.report()
