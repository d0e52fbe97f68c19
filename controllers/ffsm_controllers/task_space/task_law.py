"""What the laws on the task's output share: the task model at a tick, names of joints, errors, time near singularities."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.allocation import moments, unit_moments
from ffsm_controllers.task_space.config import AttitudeTarget, TaskLawConfig
from ffsm_controllers.task_space.damping import most_unstable, output_damping
from ffsm_controllers.task_space.joints import controllable_directions, joints_that_move
from ffsm_controllers.task_space.singularity import SingularityMonitor, damped_inverse
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    Damping,
    Fault,
    FloatArray,
    IntArray,
    Observation,
    ScenarioFaults,
    Signal,
    Stateful,
)
from ffsm_mj.task_model import TaskModel

_DISTANCE = Signal("controller", "task_error_m", "m", "distance of the tip from its target along the axes of the task")
_ANGLE = Signal("controller", "task_error_rad", "rad", "angle of the tip's frame from its target")
_SHARE = Signal(
    "controller",
    "task_share",
    "",
    "share of what is wanted that the damping near singularities leaves, in the direction where it is least",
)


class TaskLaw(Stateful):
    """Part of a law on the task's output: position of the tip along the axes of the task, and its attitude if asked for.

    Attributes:
        model: The task model, current in :meth:`effort`; it accounts for the efforts of other parts of the phase.
        turns: Whether the attitude is output too.
        positions: Number of rows of the output that are of the position.
        directions: Number of directions in which the output can be moved.
        after_others: Other parts command before it.
    """

    @dataclass
    class State:
        """Attitude to reach, (3, 3), what it reports of the last tick, and how near to singularities it came."""

        frame: FloatArray
        report: tuple[float, ...]
        least_share: float
        monitor: SingularityMonitor.State | None

    after_others = True

    def __init__(
        self, config: TaskLawConfig, context: ControllerContext, attitude: AttitudeTarget | None, *, inverts: bool
    ) -> None:
        """Resolve the joints.

        Args:
            config: Names of joints.
            context: What the law is made for.
            attitude: Attitude that the tip is to have; None: it is not controlled.
            inverts: The law inverts a matrix with :meth:`damped`, and reports its damping.

        Raises:
            ScenarioFaults: No task, an unknown joint, or fewer joints than components of the output.
        """
        system, self._context = context.system, context
        if context.task is None:
            raise ScenarioFaults([Fault(f"{config.kind} needs a 'task' with tip, axes and target", ("kind",))])
        self._mj, self._attitude, self.turns = system.mj, attitude, attitude is not None
        site = context.task.tip_site
        joints = config.joints if config.joints is not None else joints_that_move(context, system.mj.site(site).name)
        self.model = TaskModel(context, joints, (), attitude=attitude is not None)
        self._frame = self.model.target_frame
        self.positions = len(context.task.axes)
        rows = (*context.task.axes, *((3, 4, 5) if attitude is not None else ()))
        robot = range(system.robot.dofs.start, system.robot.dofs.stop)
        self.directions = controllable_directions(self._mj, site, list(robot), rows)
        directions = controllable_directions(self._mj, site, self.model.joints.dofs, rows)
        if directions < self.directions:
            message = (
                f"{len(self.model.joints.dofs)} joints ({', '.join(self.model.joints.names)}) control {directions} of the "
                f"{self.directions} components of the output"
            )
            raise ScenarioFaults([Fault(message, ("joints",))])
        self._unit, self._inverts = unit_moments(self._mj), inverts
        signals = (_DISTANCE, *((_ANGLE,) if attitude is not None else ()), *((_SHARE,) if inverts else ()))
        self.telemetry_signals: tuple[Signal, ...] = signals
        self._report: tuple[float, ...] = (math.nan,) * len(signals)
        self._least_share, self._share = 1.0, 1.0
        self._monitor: SingularityMonitor | None = None

    def watch(self, largest: float, describe: Callable[[float, float], str] | None = None) -> None:
        """Keep account of the time near singularities: where an inverse of :meth:`damped` is above a bound."""
        bounds = (self.directions, largest, self._context.control_period_s)
        self._monitor = SingularityMonitor(*bounds) if describe is None else SingularityMonitor(*bounds, describe)

    @property
    def driven_actuators(self) -> IntArray:
        """Motors of the joints."""
        return self.model.joints.actuators

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Joints that depend on each other."""
        return self.model.start_faults(data)

    def start(self, observation: Observation) -> None:
        """Take the reference."""
        if self._attitude is None:
            return
        frame = self._frame.reshape(9)
        if self._attitude.target is not None:
            quaternion = np.array(self._attitude.target)
            mujoco.mju_quat2Mat(frame, quaternion / np.linalg.norm(quaternion))
        else:
            frame[:] = observation.data.site_xmat[self.site]

    @property
    def site(self) -> int:
        """Id of the tip."""
        assert self._context.task is not None
        return self._context.task.tip_site

    def control(self, observation: Observation, command: Command) -> None:
        """Drive the joints."""
        model, data = self.model, observation.data
        others = command.others
        pushed = moments(self._mj, data, self._unit).T.dot(others) if others.any() else None
        self._observe(data, pushed)
        self._share = 1.0
        self._at_tick, self._time_s = observation.at_tick, observation.time_s
        command.drive(model.joints.actuators, self.effort(data))
        k = self.positions
        errors = math.hypot(*model.e[:k].tolist()), math.hypot(*model.e[k:].tolist())
        self._report = (*errors[: 2 if self.turns else 1], *((self._share,) if self._inverts else ()))
        self._least_share = min(self._least_share, self._share)

    def _observe(self, data: Any, pushed: FloatArray | None) -> None:
        """Bring the task model up to date."""
        self.model.update(data, pushed)

    def effort(self, data: Any) -> FloatArray:
        """Efforts of the joints, (n,), with ``model`` at the present state."""
        raise NotImplementedError

    def damped(self, matrix: FloatArray, largest: float) -> FloatArray:
        """Damped inverse of a symmetric matrix of the output, (p, p), with what it does to the report of this tick."""
        inverse, values = damped_inverse(matrix, largest)
        least = float(values[len(values) - self.directions]) * largest
        share = 1.0 if least >= 1.0 else max(least, 0.0) * (2.0 - max(least, 0.0))
        self._share = min(self._share, share)
        if self._monitor is not None and self._at_tick:
            self._monitor.look(self._time_s, values)
        return inverse

    def least_stable(self, pushes: FloatArray, gains: FloatArray, keys: Sequence[str], *others: Damping) -> Damping:
        """The damping that comes nearest to instability: of position, attitude, or of what the output does not feel.

        Args:
            pushes: Efforts per rate of each row of the output, before the gains, (n, p).
            gains: Gain of each row, (p,).
            keys: What the gains of position and attitude are called.
            others: Dampings of what the output does not feel.
        """
        k = self.positions
        rows = (slice(0, k), slice(k, None))[: 2 if self.turns else 1]
        parts = zip(keys, rows, strict=False)
        of_output = [output_damping(self.model, pushes * gains, key, gains[part][0], part) for key, part in parts]
        return most_unstable(self.model, [*of_output, *others])

    def telemetry(self) -> Sequence[float]:
        """Errors and least share at the last tick."""
        return self._report

    def summary(self) -> ControllerReport:
        """How near to a singularity it came."""
        if self._monitor is None:
            return {}
        return {"least_task_share": self._least_share, **self._monitor.report()}

    def weighted(self, position: float, attitude: float) -> FloatArray:
        """One number for the rows of the position, another one for those of the attitude, (p,)."""
        k = self.positions
        return np.array([position] * k + [attitude] * (self.model.site.size - k))
