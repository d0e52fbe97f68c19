"""Moves joints through waypoints on the path of least jerk, by computed torque on the reduced dynamics, or by servos.

u = M_c (qdd_d - 2 zeta w ed - w^2 e) + c_c: the error from the path obeys edd + 2 zeta w ed + w^2 e = 0, whatever base and
momentum do. Servos get the setpoints at which they exert no force on joints that are on the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ffsm_controllers.allocation import moments, unit_moments
from ffsm_controllers.endings import TIME_TOLERANCE_S
from ffsm_controllers.joint_errors import JointErrors
from ffsm_controllers.joint_law import JointLaw
from ffsm_controllers.joint_path.config import JointPathConfig
from ffsm_controllers.joint_path.limits import Bounds, PathLimits
from ffsm_controllers.joint_servo import joint_range, refuse_positions
from ffsm_controllers.pd import per_joint
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerError,
    ControllerReport,
    Fault,
    Faults,
    FloatArray,
    MinimumJerk,
    Observation,
    ScenarioFaults,
)

_EXCEEDS, _INSTEAD = "the path exceeds a limit", "allow it more time, or other waypoints"


class JointPath(JointLaw):
    """Joints through waypoints."""

    @dataclass
    class State:
        """When the path begins, positions and rates there, (2, n), and errors so far."""

        start_s: float
        begin: FloatArray
        errors: JointErrors.State

    Config = JointPathConfig
    after_others = True

    def __init__(self, config: JointPathConfig, context: ControllerContext) -> None:
        """Resolve the joints, and check what is known of the path before it begins.

        Raises:
            ScenarioFaults: An unknown joint, a waypoint beyond the joints' ranges or too soon for their speed, or a
                bandwidth that the control period cannot serve.
        """
        super().__init__(config, context)
        if self._setpoints is not None:
            _refuse_effort(config)
        names = self._joints.names
        bounds = _bounds(config, context, names)
        _refuse_waypoints(config, context, names, bounds.speed)
        self._waypoints = np.array([waypoint.positions for waypoint in config.waypoints])
        self._times = [waypoint.at_s for waypoint in config.waypoints]
        self._limits = PathLimits(context, self._joints, None if self._setpoints is not None else self._servo.model, bounds)
        self._mj, self._unit = context.system.mj, unit_moments(context.system.mj)
        self._start_s, self._begin, self._faults = 0.0, np.zeros((2, len(names))), list[str]()
        self._errors = JointErrors(context.system, names, "path", "largest distance of a joint from its path")
        self.telemetry_signals = self._errors.signals

    def start(self, observation: Observation) -> None:
        """Lay the path from here."""
        data, joints = observation.data, self._joints
        self._start_s = observation.time_s
        self._begin[:] = data.qpos[joints.qpos], data.qvel[joints.dofs]
        self._path = self._path_from(*self._begin)
        self._faults = self._limits.faults(self._path, data)

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Limits that the path from a state exceeds."""
        joints = self._joints
        if dependent := super().start_faults(data):
            return dependent
        faults = self._limits.faults(self._path_from(data.qpos[joints.qpos], data.qvel[joints.dofs]), data)
        return [Fault(f"{_EXCEEDS}: {fault}; {_INSTEAD}", ("waypoints",)) for fault in faults]

    def _path_from(self, positions: FloatArray, rates: FloatArray) -> MinimumJerk:
        return MinimumJerk([0.0, *self._times], np.vstack((positions, self._waypoints)), rates)

    def set_state(self, state: Any) -> None:
        """Go on along the path of a state, which keeps its limits."""
        super().set_state(state)
        self._path, self._faults = self._path_from(*self._begin), []

    def control(self, observation: Observation, command: Command) -> None:
        """Drive the joints along the path.

        Raises:
            ControllerError: The path exceeds a limit.
        """
        if self._faults:
            raise ControllerError(f"{_EXCEEDS} ({'; '.join(self._faults)}); {_INSTEAD}")
        data = observation.data
        positions, rates, accelerations = self._path.at(observation.time_s - self._start_s)
        error = data.qpos[self._joints.qpos] - positions
        self._errors.look(error)
        if self._setpoints is not None:
            command.set(self._joints.actuators, self._setpoints.at(data, positions, rates))
            return
        model, servo = self._servo.model, self._servo
        model.update(data)
        wanted = accelerations - servo.damping * (model.qd - rates) - servo.stiffness * error
        if command.others.any():
            pushed = moments(self._mj, data, self._unit).T.dot(command.others)
            wanted = wanted - model.accelerations(data, pushed)[model.joints.dofs]
        command.drive(model.joints.actuators, model.M_c.dot(wanted) + model.c_c)

    def is_finished(self, time_s: float) -> bool:
        """Whether the path has come to its last waypoint."""
        return time_s - self._start_s >= self._times[-1] - TIME_TOLERANCE_S

    def telemetry(self) -> Sequence[float]:
        """Largest distance from the path, of hinges in rad and of slides in m."""
        return self._errors.values

    def summary(self) -> ControllerReport:
        """Largest distances from the path."""
        return self._errors.report()


def _refuse_effort(config: JointPathConfig) -> None:
    """Refuse a bound on efforts where servos drive the joints.

    Raises:
        ScenarioFaults: There is one.
    """
    if config.max_effort is not None:
        message = "servos drive the joints, whose efforts are not predicted; leave it out"
        raise ScenarioFaults([Fault(message, ("max_effort",))])


def _bounds(config: JointPathConfig, context: ControllerContext, names: Sequence[str]) -> Bounds:
    """Limits of the joints; infinite where there are none.

    Raises:
        ScenarioFaults: Lists of another length than the joints.
    """
    low, high = np.array([joint_range(context.system, name) for name in names]).T

    def most(bound: tuple[float, ...] | float | None, key: str) -> FloatArray:
        return np.full(len(names), np.inf) if bound is None else per_joint(bound, len(names), key)

    return Bounds(low, high, most(config.max_speed, "max_speed"), most(config.max_effort, "max_effort"))


def _refuse_waypoints(config: JointPathConfig, context: ControllerContext, names: Sequence[str], speed: FloatArray) -> None:
    """Refuse waypoints of another length than the joints, beyond their ranges, or too soon after the one before.

    Raises:
        ScenarioFaults: There is one.
    """
    with Faults() as faults:
        for k, waypoint in enumerate(config.waypoints):
            with faults.below():
                refuse_positions(context.system, names, waypoint.positions, ("waypoints", k, "positions"))
    period_s, times = context.control_period_s, [0.0, *(waypoint.at_s for waypoint in config.waypoints)]
    with Faults() as faults:
        for k, length in enumerate(np.diff(times).tolist()):
            if length < period_s:
                message = f"comes {length:.4g} s after the one before, less than the control period of {period_s:g} s"
                faults.add(message, "waypoints", k, "at_s")
        for k, (one, other) in enumerate(pairwise(config.waypoints)):
            mean = np.abs(np.subtract(other.positions, one.positions)) / (other.at_s - one.at_s)
            for i in np.flatnonzero(mean > speed).tolist():
                needed = f"{names[i]} needs a mean speed of {mean[i]:.4g} from the waypoint before"
                faults.add(f"{needed}, max_speed is {speed[i]:g}", "waypoints", k + 1, "at_s")
