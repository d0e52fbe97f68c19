"""Feedback on joints with a stated bandwidth: stiffness and damping from the reduced mass matrix.

With the words of :class:`~ffsm_mj.task_model.JointModel` M_c qdd + c_c = u, whatever else of the robot floats. The effort
u = -M_c (w^2 e + 2 zeta w ed) makes every joint obey edd + 2 zeta w ed + w^2 e = 0 near rest: the reaction of the base and
the coupling of the joints are in M_c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from pydantic import PositiveFloat, model_validator

from ffsm_mj.controller_protocol import (
    ControllerContext,
    Damping,
    Fault,
    Faults,
    FloatArray,
    ScenarioFaults,
    StrictModel,
    System,
)
from ffsm_mj.task_model import JointModel

_ONE_BANDWIDTH = "write 'bandwidth_rad_s' or 'bandwidth_Hz', one of the two"


class ServoConfig(StrictModel):
    """Bandwidth of the feedback on joints."""

    kind: str
    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: all that motors or servos drive, but those of the base and of other parts."""
    bandwidth_rad_s: PositiveFloat | None = None
    """Natural frequency w of the closed loop, rad/s."""
    bandwidth_Hz: PositiveFloat | None = None
    """The same in Hz; one of the two is needed, unless servos drive the joints."""
    damping_ratio: PositiveFloat = 1.0
    """Damping ratio zeta of the closed loop; 1 is critical."""

    @model_validator(mode="after")
    def _has_one_bandwidth(self) -> ServoConfig:
        if self.bandwidth_rad_s is not None and self.bandwidth_Hz is not None:
            raise ValueError(_ONE_BANDWIDTH)
        return self

    @property
    def has_bandwidth(self) -> bool:
        """Whether one is given; servos have gains of their own."""
        return self.bandwidth_rad_s is not None or self.bandwidth_Hz is not None

    def needs_bandwidth(self) -> bool:
        """Whether there is feedback, if motors drive the joints."""
        return True

    @property
    def bandwidth(self) -> tuple[str, float]:
        """Key and value as written."""
        if self.bandwidth_Hz is not None:
            return "bandwidth_Hz", self.bandwidth_Hz
        return "bandwidth_rad_s", float(self.bandwidth_rad_s or 0.0)

    @property
    def frequency_rad_s(self) -> float:
        """Natural frequency w, rad/s."""
        return self.bandwidth[1] * (2.0 * math.pi if self.bandwidth_Hz is not None else 1.0)


class JointServo:
    """Gains of some joints for a bandwidth.

    Attributes:
        model: Reduced dynamics of the joints.
        stiffness: w^2 in 1/s^2.
        damping: 2 zeta w in 1/s.
    """

    def __init__(self, config: ServoConfig, context: ControllerContext) -> None:
        """Resolve the joints.

        Raises:
            ScenarioFaults: An unknown joint, no bandwidth, or one that the control period cannot serve.
        """
        if config.needs_bandwidth() and not config.has_bandwidth:
            raise ScenarioFaults([Fault(_ONE_BANDWIDTH)])
        self.model = JointModel(context, config.joints)
        frequency = config.frequency_rad_s
        self.stiffness, self.damping = frequency**2, 2.0 * config.damping_ratio * frequency
        self._bandwidth, self._mj = config.bandwidth, context.system.mj
        self._scratch = mujoco.MjData(self._mj)
        _refuse_unstable(config, context.control_period_s)

    def reduced_mass(self, data: Any, positions: FloatArray) -> FloatArray:
        """M_c where the joints are at some positions, (n, n), and all else is where it is in ``data`` or follows them."""
        scratch = self._scratch
        scratch.qpos[:] = data.qpos
        scratch.qpos[self.model.joints.qpos] = positions
        self.model.close(scratch)
        self.model.update(scratch)
        return self.model.M_c

    def damping_at(self, data: Any) -> Damping:
        """The damping of the feedback, with the gains for the positions in ``data``."""
        joints, (key, value) = self.model.joints, self._bandwidth
        mass = self.reduced_mass(data, data.qpos[joints.qpos])
        return Damping(key, joints.dofs, np.full(len(joints.dofs), value), self.damping * mass)


def _refuse_unstable(config: ServoConfig, period_s: float) -> None:
    """Refuse a bandwidth at which the sampled loop is unstable.

    An effort held for a period dt takes (e, ed) to (e + dt ed + dt^2 a / 2, ed + dt a) with a = -w^2 e - 2 zeta w ed. With
    s = w dt the map has the trace 2 - s^2/2 - 2 zeta s and the determinant 1 - 2 zeta s + s^2/2, so that by Jury's criterion
    it is stable for s < 4 zeta and s < 1/zeta.

    Raises:
        ScenarioFaults: It is unstable.
    """
    most = min(4.0 * config.damping_ratio, 1.0 / config.damping_ratio) / period_s
    key, value = config.bandwidth
    if config.frequency_rad_s >= most:
        allowed = most * value / config.frequency_rad_s
        message = f"is unstable at the control period of {period_s:g} s: stable below {allowed:.4g}"
        raise ScenarioFaults([Fault(message, (key,))])


def refuse_positions(system: System, joints: Sequence[str], positions: Sequence[float], path: tuple[str | int, ...]) -> None:
    """Refuse positions of another number than the joints, and those beyond the ranges of limited joints.

    Args:
        system: The system.
        joints: Full names.
        positions: Position of each, rad or m.
        path: Keys of the list of positions.

    Raises:
        ScenarioFaults: The number is another one, or one or more are beyond.
    """
    if len(positions) != len(joints):
        message = f"{len(positions)} values for {len(joints)} joints; write one each: {', '.join(joints)}"
        raise ScenarioFaults([Fault(message, path)])
    with Faults() as faults:
        for i, (name, position) in enumerate(zip(joints, positions, strict=True)):
            low, high = joint_range(system, name)
            if not low <= position <= high:
                faults.add(f"{position:g} is beyond the range of {name}, [{low:g}, {high:g}]", *path, i)


def joint_range(system: System, name: str) -> tuple[float, float]:
    """Least and greatest position of a joint, rad or m; infinite where it is not limited."""
    joint = system.mj.joint(name)
    limited = bool(system.mj.jnt_limited[joint.id])
    low, high = system.mj.jnt_range[joint.id] if limited else (-math.inf, math.inf)
    return float(low), float(high)
