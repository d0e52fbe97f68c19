"""PD on the pose of the base by thrusters and wheels: back to where a phase began, at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation, actuators_by_name
from ffsm_mj.controller_protocol import Command, Fault, FloatArray, IntArray, Observation, ScenarioFaults, Stateful, System

_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


@dataclass(frozen=True)
class Stiffness:
    """Gains: N/m and N s/m for translation, N m/rad and N m s/rad for rotation."""

    kp: float
    kd: float


class BaseControl(Stateful):
    """A wrench on the base that is asked of thrusters and wheels: the force of the thrusters, the torque of the wheels.

    Where there are no wheels the thrusters turn the base too.

    Attributes:
        error: Distance in m and angle in rad of the base from where the phase began, at the last tick.
    """

    @dataclass
    class State:
        """Where the phase began: position in m, (3,), and quaternion, (4,); and the errors at the last tick."""

        position: FloatArray
        orientation: FloatArray
        error: tuple[float, float]

    def __init__(
        self,
        system: System,
        thrusters: Sequence[str],
        wheels: Sequence[str],
        translation: Stiffness | None,
        rotation: Stiffness | None,
    ) -> None:
        """Resolve the actuators.

        Args:
            system: The scene.
            thrusters: Names of actuators that push the base.
            wheels: Names of motors of reaction wheels, or of an ideal one on a base hinge.
            translation: Gains of the base's position; None: it is not controlled.
            rotation: Gains of its attitude; None: it is not controlled.

        Raises:
            ScenarioFaults: An unknown name, or a demand that no actuator can serve.
        """
        if translation is not None and not thrusters:
            raise ScenarioFaults([Fault("needs 'thrusters' to act with", ("translation",))])
        if rotation is not None and not (thrusters or wheels):
            raise ScenarioFaults([Fault("needs 'wheels' or 'thrusters' to act with", ("rotation",))])
        self._model, self._root = system.mj, system.robot.root
        self._translation, self._rotation = translation or Stiffness(0.0, 0.0), rotation or Stiffness(0.0, 0.0)
        self.thrusters = actuators_by_name(system, thrusters, "thrusters")
        self.wheels = actuators_by_name(system, wheels, "wheels")
        self._by_thrusters = ThrusterAllocation(system, self.thrusters)
        self._by_wheels = WheelAllocation(system, self.wheels)
        self._twist, self._turn = np.empty(6), np.empty(3)
        self._position, self._orientation = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self.error = (0.0, 0.0)

    @property
    def driven_actuators(self) -> IntArray:
        """Thrusters and wheels."""
        return np.concatenate((self.thrusters, self.wheels))

    def start(self, observation: Observation) -> None:
        """Take the base's pose as the reference."""
        self._position[:] = observation.data.xpos[self._root]
        self._orientation[:] = observation.data.xquat[self._root]

    def control(self, observation: Observation, command: Command) -> None:
        """Drive wheels and thrusters."""
        data = observation.data
        force, torque = self._wrench(data)
        if len(self.wheels):
            command.drive(self.wheels, self._by_wheels.efforts(data, torque))
            torque = np.zeros(3)
        if len(self.thrusters):
            command.drive(self.thrusters, self._by_thrusters.efforts(data, force, torque))

    def _wrench(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """PD force and torque on the base in world axes, at the base frame's origin."""
        twist, turn = self._twist, self._turn
        mujoco.mj_objectVelocity(self._model, data, _BODY, self._root, twist, 0)
        offset = data.xpos[self._root] - self._position
        mujoco.mju_subQuat(turn, data.xquat[self._root], self._orientation)
        mujoco.mju_rotVecQuat(turn, turn.copy(), self._orientation)
        self.error = math.sqrt(offset.dot(offset)), math.sqrt(turn.dot(turn))
        force = -self._translation.kp * offset - self._translation.kd * twist[3:]
        return force, -self._rotation.kp * turn - self._rotation.kd * twist[:3]
