"""When a phase has done its work: a quantity of the robot is below or above a bound, at once or for a while."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.endings import TIME_TOLERANCE_S, Trigger
from ffsm_mj.controller_protocol import (
    Controller,
    IntArray,
    Observation,
    ScenarioFaults,
    StackMomentum,
    Stateful,
    System,
    Task,
    driven_joints,
    unknown_name,
)

UNITS = {
    "base_rate": "rad/s",
    "base_speed": "m/s",
    "joint_rate": "rad/s",
    "tip_error": "m",
    "tip_speed": "m/s",
    "stack_momentum": "N m s",
}
"""Unit of each quantity: angular speed and speed of the base, the largest driven joint rate (of slides in m/s), distance of
the tip from the target of the task, and its speed; angular momentum of robot and grasped object without the wheels."""
_SENTENCE = re.compile(r"\s*(\w+)\s*(<|>)\s*(\S+)\s+(\S+(?: \S+)*?)(?:\s+for\s+(\S+)\s+s)?\s*")


@dataclass(frozen=True)
class StopCondition:
    """A quantity below or above a bound for some time.

    Attributes:
        quantity: A key of ``UNITS``.
        below: Whether it is to be below the bound.
        bound: The bound, in the unit of the quantity.
        for_s: Time for which it has been so, s; 0: at once.
    """

    quantity: str
    below: bool
    bound: float
    for_s: float

    @classmethod
    def parse(cls, text: str) -> StopCondition:
        """The condition in a text such as ``base_rate < 1e-3 rad/s for 2 s``.

        Raises:
            ValueError: The text is none; the message lists what is allowed.
        """
        match = _SENTENCE.fullmatch(text)
        if match is None:
            example = "e.g. base_rate < 1e-3 rad/s for 2 s"
            raise ValueError(f"{text!r} is no condition; write QUANTITY < NUMBER UNIT [for NUMBER s], or >, {example}")
        quantity, comparison, bound, unit, duration = match.groups()
        if quantity not in UNITS:
            raise ValueError(unknown_name("quantity", quantity, tuple(UNITS)))
        if unit != UNITS[quantity]:
            raise ValueError(f"{quantity} is in {UNITS[quantity]}, not in {unit!r}")
        for_s = 0.0 if duration is None else _number(duration)
        if for_s < 0.0:
            raise ValueError(f"a time of {for_s:g} s is negative")
        return cls(quantity, comparison == "<", _number(bound), for_s)

    def holds(self, value: float) -> bool:
        """Whether a value of the quantity is beyond the bound."""
        return value < self.bound if self.below else value > self.bound


def _number(text: str) -> float:
    """A finite number.

    Raises:
        ValueError: It is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is no finite number")
    return value


def _driven_dofs(system: System) -> IntArray:
    """Dofs of the motor-driven joints of the robot.

    Raises:
        ValueError: There is none.
    """
    try:
        return driven_joints(system, None).dofs
    except ScenarioFaults as error:
        raise ValueError(f"joint_rate: {error.faults[0].message}") from error


class StopMonitor(Stateful, Trigger):
    """Watches a quantity through a phase, at control ticks and impacts."""

    @dataclass
    class State:
        """Time since which the condition holds, s; None: it does not."""

        since_s: float | None

    def __init__(
        self,
        condition: StopCondition,
        system: System,
        task: Task | None,
        grasped: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Know the condition and whose quantity it is.

        Args:
            condition: The condition.
            system: The scene.
            task: The task of the tip.
            grasped: Object by the name of the grasp that holds it.

        Raises:
            ValueError: It is one of the tip, and there is no task, or of joints, and none is driven.
        """
        if task is None and condition.quantity.startswith("tip_"):
            raise ValueError(f"{condition.quantity} needs a 'task': the scenario has none")
        self._condition, self._model, self._task = condition, system.mj, task
        self._root, self._twist, self._grasped = system.robot.root, np.zeros(6), grasped
        self._stack = StackMomentum(system) if condition.quantity == "stack_momentum" else None
        self._dofs = _driven_dofs(system) if condition.quantity == "joint_rate" else np.zeros(0, dtype=np.intp)
        self._since_s: float | None = None

    def begin(self, observation: Observation) -> None:
        """The phase begins here."""
        self._since_s = None
        self._look(observation)

    def is_due(self, observation: Observation, start_s: float, law: Controller) -> bool:  # noqa: ARG002
        """Whether it ends the phase now: at a control tick."""
        self._look(observation)
        if self._since_s is None or not observation.at_tick:
            return False
        return observation.time_s - self._since_s >= self._condition.for_s - TIME_TOLERANCE_S

    def _look(self, observation: Observation) -> None:
        """Take note of whether the condition holds."""
        if not self._condition.holds(self._value(observation)):
            self._since_s = None
        elif self._since_s is None:
            self._since_s = observation.time_s

    def _value(self, observation: Observation) -> float:
        reader: Callable[[Observation], float] = getattr(self, f"_{self._condition.quantity}")
        return reader(observation)

    def _base_rate(self, observation: Observation) -> float:
        return math.hypot(*self._twist_of(observation.data, mujoco.mjtObj.mjOBJ_XBODY, self._root)[:3].tolist())

    def _base_speed(self, observation: Observation) -> float:
        return math.hypot(*self._twist_of(observation.data, mujoco.mjtObj.mjOBJ_XBODY, self._root)[3:].tolist())

    def _joint_rate(self, observation: Observation) -> float:
        return float(np.abs(observation.data.qvel[self._dofs]).max(initial=0.0))

    def _stack_momentum(self, observation: Observation) -> float:
        assert self._stack is not None
        trees = dict.fromkeys(self._grasped[name] for name in observation.grasps if name in self._grasped)
        return math.hypot(*self._stack.parts(observation.data, tuple(trees))[0].tolist())

    def _tip_error(self, observation: Observation) -> float:
        assert self._task is not None
        target, _ = self._task.target_at(observation.time_s, observation.data)
        return math.dist(observation.data.site_xpos[self._task.tip_site][list(self._task.axes)], target)

    def _tip_speed(self, observation: Observation) -> float:
        assert self._task is not None
        _, rates = self._task.target_at(observation.time_s, observation.data)
        twist = self._twist_of(observation.data, mujoco.mjtObj.mjOBJ_SITE, self._task.tip_site)
        return math.hypot(*(twist[3:][list(self._task.axes)] - rates).tolist())

    def _twist_of(self, data: Any, kind: mujoco.mjtObj, index: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Angular and linear velocity in world axes, (6,)."""
        mujoco.mj_objectVelocity(self._model, data, kind, index, self._twist, 0)
        return self._twist
