"""The plant side of actuation: what reaches the joints of what a controller asks for. No controller can bypass it.

Efforts are forces in N or torques in N m at the driven joint or site; MuJoCo's ``ctrl`` is the effort over gear and gain.
A command is decided once per control tick and held.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
from pydantic import Field, PositiveFloat

from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import ControllerError, Fault, ScenarioFaults
from ffsm_mj.model import FloatArray, System
from ffsm_mj.signals import Signal, identifier


class IdealConfig(StrictModel):
    """An actuator that delivers what is asked, within MJCF's own ctrlrange and forcerange."""

    kind: Literal["ideal"]


class TorqueSpeedConfig(StrictModel):
    """A motor on its torque-speed line, paper (34): |u + (stall / no_load) speed| <= stall, while powered."""

    kind: Literal["torque_speed"]
    stall_torque_N_m: PositiveFloat
    """Torque at rest, N m (N for a slide joint)."""
    no_load_speed_rad_s: PositiveFloat
    """Speed at zero torque, rad/s (m/s for a slide joint)."""


class OnOffConfig(StrictModel):
    """A thruster that is off or fully on, in the direction asked for (paper, section 4.4)."""

    kind: Literal["on_off"]
    force_N: PositiveFloat
    """Force while on, N."""
    threshold_N: Annotated[float, Field(ge=0.0)] = 0.0
    """It fires when more than this is asked for, N."""


ActuatorConfig = Annotated[IdealConfig | TorqueSpeedConfig | OnOffConfig, Field(discriminator="kind")]


class Actuation:
    """Limits of all actuators, as arrays.

    Attributes:
        names: Full names of the actuators in MuJoCo's order.
        signals: What is logged of them.
        applied: Efforts that act now, (nu,).
    """

    def __init__(self, system: System, configs: Mapping[str, IdealConfig | TorqueSpeedConfig | OnOffConfig]) -> None:
        """Resolve names and collect limits.

        Raises:
            ScenarioFaults: An unknown actuator, or one that MJCF does not define as a plain motor.
        """
        model = system.mj
        self.names = system.names("actuator")
        self._gear = _effort_per_ctrl(system)
        count = int(model.nu)
        self._stall, self._slope = np.full(count, np.inf), np.zeros(count)
        self._on_off = np.zeros(count, dtype=np.bool_)
        self._force, self._threshold = np.zeros(count), np.zeros(count)
        self._range = _mjcf_range(model, self._gear)
        faults = []
        for name, config in configs.items():
            try:
                self._limit(system.index("actuator", name), config)
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), ("actuators", name)))
        if faults:
            raise ScenarioFaults(faults)
        self.signals = _signals(system)
        self.applied, self.command = np.zeros(count), np.zeros(count)
        self.lower, self.upper = np.full(count, -np.inf), np.full(count, np.inf)
        self._last_command = Command.off(count)

    def _limit(self, index: int, config: IdealConfig | TorqueSpeedConfig | OnOffConfig) -> None:
        if isinstance(config, TorqueSpeedConfig):
            self._stall[index] = config.stall_torque_N_m
            self._slope[index] = config.stall_torque_N_m / config.no_load_speed_rad_s
        elif isinstance(config, OnOffConfig):
            self._on_off[index] = True
            self._force[index], self._threshold[index] = config.force_N, config.threshold_N
            self._stall[index] = config.force_N

    def apply(self, command: Command, data: Any) -> None:
        """Turn a command into ``data.ctrl`` and hold it.

        Raises:
            ControllerError: A powered effort is not finite.
        """
        if not np.all(np.isfinite(command.effort[command.powered])):
            bad = [name for name, effort in zip(self.names, command.effort, strict=True) if not np.isfinite(effort)]
            raise ControllerError(f"the controller commands an effort that is not finite for {', '.join(bad)}")
        speed = data.actuator_velocity / self._gear
        drag = self._slope * speed
        np.maximum(-self._stall - drag, self._range[0], out=self.lower)
        np.minimum(self._stall - drag, self._range[1], out=self.upper)
        np.copyto(self.command, np.where(command.powered, command.effort, 0.0))
        fired = np.where(np.abs(self.command) > self._threshold, np.sign(self.command) * self._force, 0.0)
        wanted = np.where(self._on_off, fired, self.command)
        np.copyto(self.applied, np.where(command.powered, np.clip(wanted, self.lower, self.upper), 0.0))
        data.ctrl[:] = self.applied / self._gear

    def fill(self, row: FloatArray) -> None:
        """Write commands, applied efforts and bounds into the actuator columns of a row, (4 nu,)."""
        row[0::4], row[1::4], row[2::4], row[3::4] = self.command, self.applied, self.lower, self.upper


def _effort_per_ctrl(system: System) -> FloatArray:
    """Gear times gain of each actuator.

    Raises:
        ScenarioFaults: An actuator is no plain motor (a servo, a muscle, activation dynamics).
    """
    model = system.mj
    gear = np.ones(model.nu)
    faults = []
    for i in range(model.nu):
        fixed_gain = model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
        no_bias = model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE
        if not (fixed_gain and no_bias and model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_NONE):
            message = f"actuator {model.actuator(i).name!r} is no plain <motor>: its force would not be the command"
            faults.append(Fault(message, ("robot", "mjcf")))
        on_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        gear[i] = model.actuator_gainprm[i, 0] * (model.actuator_gear[i, 0] if on_joint else 1.0)
    if faults:
        raise ScenarioFaults(faults)
    return gear


def _mjcf_range(model: Any, gear: FloatArray) -> FloatArray:
    """Bounds on the effort that MJCF states, (2, nu)."""
    bounds = np.array([np.full(model.nu, -np.inf), np.full(model.nu, np.inf)])
    for i in range(model.nu):
        limits = []
        if model.actuator_ctrllimited[i]:
            limits.append(np.sort(model.actuator_ctrlrange[i] * gear[i]))
        if model.actuator_forcelimited[i]:
            limits.append(np.sort(model.actuator_forcerange[i] * gear[i] / model.actuator_gainprm[i, 0]))
        for low, high in limits:
            bounds[0, i], bounds[1, i] = max(bounds[0, i], low), min(bounds[1, i], high)
    return bounds


def _signals(system: System) -> tuple[Signal, ...]:
    signals = []
    for i, name in enumerate(system.names("actuator")):
        unit, suffix = ("N m", "N_m") if _drives_rotation(system.mj, i) else ("N", "N")
        for what, meaning in (
            ("command", "asked for"),
            ("applied", "delivered"),
            ("lower", "least possible while powered"),
            ("upper", "greatest possible while powered"),
        ):
            signals.append(Signal("actuators", f"{identifier(name)}_{what}_{suffix}", unit, f"effort of {name}, {meaning}"))
    return tuple(signals)


def _drives_rotation(model: Any, i: int) -> bool:
    if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
        return not np.any(model.actuator_gear[i, :3])
    return bool(model.jnt_type[model.actuator_trnid[i, 0]] == mujoco.mjtJoint.mjJNT_HINGE)
