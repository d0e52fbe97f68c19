"""PD on the pose of the base by thrusters and wheels: to where a phase began, or to set points, in world or LVLH axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from ffsm_controllers.allocation import ThrusterAllocation, WheelAllocation, actuators_by_name
from ffsm_mj.controller_protocol import (
    Command,
    Fault,
    FloatArray,
    IntArray,
    LvlhAxes,
    MinimumJerk,
    Observation,
    ScenarioFaults,
    Stateful,
    System,
    cross,
)

Frame = Literal["world", "lvlh"]
_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


@dataclass(frozen=True)
class Stiffness:
    """Gains: N/m and N s/m for translation, N m/rad and N m s/rad for rotation."""

    kp: float
    kd: float


@dataclass(frozen=True)
class BaseTarget:
    """Where the base is to be, in the axes of its control.

    Attributes:
        position_m: Position; None: that at the start of the phase.
        waypoints: Times since the start of the phase in s, and positions, on a path of least jerk from where the base is.
        attitude: Quaternion from its axes to those of the control; None: that at the start of the phase.
    """

    position_m: tuple[float, float, float] | None = None
    waypoints: tuple[tuple[float, tuple[float, float, float]], ...] = ()
    attitude: tuple[float, float, float, float] | None = None


class BaseControl(Stateful):
    """A wrench on the base that is asked of thrusters and wheels: the force of the thrusters, the torque of the wheels.

    Where there are no wheels the thrusters turn the base too. Rates of the set point, of rotating axes among them, are fed
    forward; its accelerations and the tide are not, so that a constant force leaves an offset of force / kp.

    Attributes:
        error: Distance in m and angle in rad of the base from its set point, at the last tick.
    """

    @dataclass
    class State:
        """When the phase and the law began, s; pose and velocity at the latter, in the law's axes; the last errors."""

        start_s: float
        begin_s: float
        position: FloatArray
        velocity: FloatArray
        orientation: FloatArray
        error: tuple[float, float]

    def __init__(
        self,
        system: System,
        thrusters: Sequence[str],
        wheels: Sequence[str],
        translation: Stiffness | None,
        rotation: Stiffness | None,
        *,
        axes: LvlhAxes | None = None,
        target: BaseTarget = BaseTarget(),
    ) -> None:
        """Resolve the actuators.

        Args:
            system: The scene.
            thrusters: Names of actuators that push the base.
            wheels: Names of motors of reaction wheels, or of an ideal one on a base hinge.
            translation: Gains of the base's position; None: it is not controlled.
            rotation: Gains of its attitude; None: it is not controlled.
            axes: Axes of set points and errors; None: those of the world.
            target: The set points.

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
        self._axes, self._target = axes, target
        self._path: MinimumJerk | None = None
        self._start_s = self._begin_s = 0.0
        self._position, self._velocity = np.zeros(3), np.zeros(3)
        self._orientation = np.array([1.0, 0.0, 0.0, 0.0])
        self.error = (0.0, 0.0)

    @property
    def driven_actuators(self) -> IntArray:
        """Thrusters and wheels."""
        return np.concatenate((self.thrusters, self.wheels))

    def start(self, observation: Observation) -> None:
        """Take the base's pose as the reference where no other is stated, and lay the path."""
        data, axes, target = observation.data, self._axes, self._target
        self._start_s, self._begin_s = observation.phase_start_s, observation.time_s
        pose = data.xpos[self._root].copy(), self._rates(data)[3:].copy(), data.xquat[self._root].copy()
        if axes is not None:
            axes.update(observation.time_s)
            pose = axes.relative(*pose)
        self._position[:], self._velocity[:], self._orientation[:] = pose
        if target.position_m is not None:
            self._position[:] = target.position_m
        if target.attitude is not None:
            self._orientation[:] = target.attitude
            mujoco.mju_normalize4(self._orientation)
        self._lay()

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        super().set_state(state)
        self._lay()

    def _lay(self) -> None:
        """Lay the path from where the law began through the waypoints that are still to come."""
        ahead = [
            (time_s, place) for at_s, place in self._target.waypoints if (time_s := self._start_s + at_s) > self._begin_s
        ]
        if ahead:
            times, positions = zip(*ahead, strict=True)
            self._path = MinimumJerk([self._begin_s, *times], np.vstack((self._position, positions)), self._velocity)
        elif self._target.waypoints:
            self._position[:] = self._target.waypoints[-1][1]

    def control(self, observation: Observation, command: Command) -> None:
        """Drive wheels and thrusters."""
        data = observation.data
        force, torque = self._wrench(observation.time_s, data)
        if len(self.wheels):
            command.drive(self.wheels, self._by_wheels.efforts(data, torque))
            torque = np.zeros(3)
        if len(self.thrusters):
            command.drive(self.thrusters, self._by_thrusters.efforts(data, force, torque))

    def _rates(self, data: Any) -> FloatArray:
        """Angular velocity of the base, and velocity of the origin of its frame, world axes, (6,)."""
        mujoco.mj_objectVelocity(self._model, data, _BODY, self._root, self._twist, 0)
        return self._twist

    def _wrench(self, time_s: float, data: Any) -> tuple[FloatArray, FloatArray]:
        """PD force and torque on the base in world axes, at the base frame's origin."""
        turn, twist, axes = self._turn, self._rates(data), self._axes
        position, orientation, rate = self._position, self._orientation, np.zeros(3)
        if self._path is not None:
            position, rate, _ = self._path.at(time_s)
        if axes is not None:
            axes.update(time_s)
            twist[:3] -= axes.spin
            # Relative to the rotating axes where the base is, not where it is to be: an offset at rest has no rate.
            rate = axes.axes @ rate + cross(axes.spin, data.xpos[self._root])
            position, orientation = axes.axes @ position, axes.attitude(orientation)
        twist[3:] -= rate
        offset = data.xpos[self._root] - position
        mujoco.mju_subQuat(turn, data.xquat[self._root], orientation)
        mujoco.mju_rotVecQuat(turn, turn.copy(), orientation)
        self.error = math.sqrt(offset.dot(offset)), math.sqrt(turn.dot(turn))
        force = -self._translation.kp * offset - self._translation.kd * twist[3:]
        return force, -self._rotation.kp * turn - self._rotation.kd * twist[:3]
