"""What laws on joints share that have a bandwidth of their own where motors drive the joints, and setpoints for servos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ffsm_controllers.joint_servo import JointServo, ServoConfig
from ffsm_controllers.setpoints import Setpoints
from ffsm_mj.controller_protocol import ControllerContext, Damping, Fault, FloatArray, IntArray, Stateful


class JointLaw(Stateful):
    """Part of a law on joints: feedback with a stated bandwidth by motors, or setpoints of the servos that drive them."""

    def __init__(self, config: ServoConfig, context: ControllerContext) -> None:
        """Resolve the joints.

        Raises:
            ScenarioFaults: An unknown joint, joints that motors and servos drive, or a bandwidth that is missing, of no use,
                or beyond the control period's.
        """
        self._setpoints = Setpoints.of(config, context)
        if self._setpoints is not None:
            self._joints = self._setpoints.joints
        else:
            self._servo = JointServo(config, context)
            self._joints = self._servo.model.joints

    @property
    def driven_actuators(self) -> IntArray:
        """Motors or servos of the joints."""
        return self._joints.actuators

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Joints that depend on each other."""
        return self._servo.model.start_faults(data) if self._setpoints is None else ()

    def gains_at(self, data: Any, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stiffness and damping of the feedback where the joints are at some positions, (n, n) each."""
        mass = self._servo.reduced_mass(data, positions)
        return self._servo.stiffness * mass, self._servo.damping * mass

    def damping_at(self, data: Any) -> Damping | None:
        """That of the feedback; its gains are for the positions in ``data``. None: servos have it."""
        return self._servo.damping_at(data) if self._setpoints is None else None
