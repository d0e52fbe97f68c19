"""Proportional-derivative control of joints towards a fixed configuration, at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    Damping,
    DrivenJoints,
    Fault,
    FloatArray,
    IntArray,
    Observation,
    ScenarioFaults,
    Signal,
    Stateful,
    StrictModel,
    driven_joints,
)

Gain = Annotated[float, Field(ge=0.0)]


def _is_unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(math.hypot(*quaternion) - 1.0) > 1e-3:
        raise ValueError(f"is no unit quaternion: its norm is {math.hypot(*quaternion):.4g}")
    return quaternion


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_is_unit)]
"""A rotation, w, x, y, z."""


class PdConfig(StrictModel):
    """u = -kp (q - q_ref) - kd qdot on each joint."""

    kind: Literal["pd"]
    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: every motor-driven joint of the robot but those of the base and of other parts."""
    kp: tuple[Gain, ...] | Gain
    """Proportional gain, N m/rad (N/m for slides): one for all joints or one each."""
    kd: tuple[Gain, ...] | Gain
    """Derivative gain, N m s/rad: one for all joints or one each."""
    target: tuple[float, ...] | Literal["hold"] = "hold"
    """Reference configuration in rad or m, or ``hold``: the configuration at the start of the phase."""


class Pd(Stateful):
    """Joint PD."""

    @dataclass
    class State:
        """Configuration to go to, rad or m, (n,)."""

        reference: FloatArray

    Config = PdConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = ()

    def __init__(self, config: PdConfig, context: ControllerContext) -> None:
        """Resolve joints and gains.

        Raises:
            ScenarioFaults: An unknown joint, or a list of another length than the joints.
        """
        self._joints: DrivenJoints = driven_joints(context.system, config.joints, reserved=context.reserved)
        count = len(self._joints.names)
        self._kp, self._kd = per_joint(config.kp, count, "kp"), per_joint(config.kd, count, "kd")
        self._fixed = None if config.target == "hold" else per_joint(config.target, count, "target")
        self._reference = np.zeros(count)

    def start(self, observation: Observation) -> None:
        """Take the reference."""
        self._reference[:] = observation.data.qpos[self._joints.qpos] if self._fixed is None else self._fixed

    def control(self, observation: Observation, command: Command) -> None:
        """Drive the joints towards the reference."""
        joints, data = self._joints, observation.data
        error = data.qpos[joints.qpos] - self._reference
        command.drive(joints.actuators, -self._kp * error - self._kd * data.qvel[joints.dofs])

    @property
    def driven_actuators(self) -> IntArray:
        """Motors of the joints."""
        return self._joints.actuators

    def damping_at(self, data: Any) -> Damping:  # noqa: ARG002
        """The gains, the same at any state."""
        return Damping("kd", self._joints.dofs, self._kd, np.diag(self._kd))

    def telemetry(self) -> Sequence[float]:
        """Nothing to report."""
        return ()


def per_joint(values: tuple[float, ...] | float, count: int, key: str) -> FloatArray:
    """One value per joint from one for all or a list.

    Raises:
        ScenarioFaults: The list has another length.
    """
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if len(array) not in (1, count):
        raise ScenarioFaults([Fault(f"{len(array)} values for {count} joints; write one, or one each", (key,))])
    return np.broadcast_to(array, count).copy()
