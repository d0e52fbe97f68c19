"""The plant side of actuation: what reaches the joints of what a controller asks for. No controller can bypass it.

Efforts are forces in N or torques in N m at the driven joint or site; MuJoCo's ``ctrl`` is the effort over gear and gain.
A command is decided once per control tick and held.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
import numpy.typing as npt
from pydantic import Field, PositiveFloat, model_validator

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


class ReactionWheelConfig(StrictModel):
    """A wheel's motor: a torque limit, and no torque that would speed it up beyond its greatest speed."""

    kind: Literal["reaction_wheel"]
    max_torque_N_m: PositiveFloat
    """Greatest torque, N m."""
    max_speed_rad_s: PositiveFloat
    """Speed of the rotor against its bearing at which it is saturated, rad/s."""


class OnOffConfig(StrictModel):
    """A thruster that is off or fully on, in the direction asked for (paper, section 4.4).

    With ``release_N`` below ``threshold_N`` it is a Schmitt trigger. A thruster whose ctrlrange starts at 0 pushes only.
    """

    kind: Literal["on_off"]
    force_N: PositiveFloat
    """Force while on, N."""
    threshold_N: Annotated[float, Field(ge=0.0)] = 0.0
    """It fires when more than this is asked for, N."""
    release_N: Annotated[float, Field(ge=0.0)] | None = None
    """Once on, it stays on until less than this is asked for, N; left out: the threshold."""
    min_on_time_s: Annotated[float, Field(ge=0.0)] = 0.0
    """Once on, it stays on at least this long, unless power is cut, s."""

    @model_validator(mode="after")
    def _release_below_threshold(self) -> OnOffConfig:
        if self.release_N is not None and self.release_N > self.threshold_N:
            raise ValueError(f"release_N must not exceed threshold_N ({self.threshold_N:g})")
        return self


AnyActuator = IdealConfig | TorqueSpeedConfig | ReactionWheelConfig | OnOffConfig
ActuatorConfig = Annotated[AnyActuator, Field(discriminator="kind")]


class Actuation:
    """Limits of all actuators, as arrays.

    Attributes:
        names: Full names of the actuators in MuJoCo's order.
        signals: What is logged of them.
        applied: Efforts that act now, (nu,).
    """

    def __init__(self, system: System, configs: Mapping[str, AnyActuator]) -> None:
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
        self._force, self._threshold, self._release = np.zeros(count), np.zeros(count), np.zeros(count)
        self._min_on, self._saturation = np.zeros(count), np.full(count, np.inf)
        self._firing, self._lit_at = np.zeros(count), np.zeros(count)
        self._range = _mjcf_range(model, self._gear)
        faults = []
        for name, config in configs.items():
            try:
                self._limit(system.index("actuator", name), config)
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), ("actuators", name)))
        if faults:
            raise ScenarioFaults(faults)
        self._counted = np.flatnonzero(self._on_off)
        self.on_time_s, self.impulse_N_s = np.zeros(count), np.zeros(count)
        self.signals = _signals(system, self._counted)
        self.applied, self.command = np.zeros(count), np.zeros(count)
        self.lower, self.upper = np.full(count, -np.inf), np.full(count, np.inf)

    def _limit(self, index: int, config: AnyActuator) -> None:
        if isinstance(config, TorqueSpeedConfig):
            self._stall[index] = config.stall_torque_N_m
            self._slope[index] = config.stall_torque_N_m / config.no_load_speed_rad_s
        elif isinstance(config, ReactionWheelConfig):
            self._stall[index], self._saturation[index] = config.max_torque_N_m, config.max_speed_rad_s
        elif isinstance(config, OnOffConfig):
            self._on_off[index] = True
            self._force[index], self._threshold[index] = config.force_N, config.threshold_N
            self._release[index] = config.threshold_N if config.release_N is None else config.release_N
            self._min_on[index], self._stall[index] = config.min_on_time_s, config.force_N

    def apply(self, command: Command, data: Any, time_s: float) -> None:
        """Turn a command into ``data.ctrl`` and hold it.

        Raises:
            ControllerError: A powered effort is not finite.
        """
        if not np.all(np.isfinite(command.effort[command.powered])):
            bad = [name for name, effort in zip(self.names, command.effort, strict=True) if not np.isfinite(effort)]
            raise ControllerError(f"the controller commands an effort that is not finite for {', '.join(bad)}")
        self._bounds(data.actuator_velocity / self._gear)
        np.copyto(self.command, np.where(command.powered, command.effort, 0.0))
        wanted = self.command
        if len(self._counted):
            self._fire(command.powered, time_s)
            wanted = np.where(self._on_off, self._firing * self._force, self.command)
        np.copyto(self.applied, np.where(command.powered, np.clip(wanted, self.lower, self.upper), 0.0))
        data.ctrl[:] = self.applied / self._gear

    def _bounds(self, speed: FloatArray) -> None:
        """Least and greatest effort of powered actuators at these speeds."""
        drag = self._slope * speed
        np.maximum(-self._stall - drag, self._range[0], out=self.lower)
        np.minimum(self._stall - drag, self._range[1], out=self.upper)
        self.upper[speed >= self._saturation] = 0.0
        self.lower[speed <= -self._saturation] = 0.0

    def _fire(self, powered: npt.NDArray[np.bool_], time_s: float) -> None:
        """Decide which on-off actuators fire, and in which direction (+1, -1, 0)."""
        size, sign = np.abs(self.command), np.sign(self.command)
        lit = self._firing != 0.0
        stays = lit & (sign == self._firing) & (size >= self._release) & (size > 0.0)
        held = lit & (time_s - self._lit_at < self._min_on - 1e-12)
        firing = np.where(stays | held, self._firing, np.where(size > self._threshold, sign, 0.0))
        # One that only pushes never fires backwards.
        firing = np.where(powered & (firing * self._force <= self.upper) & (firing * self._force >= self.lower), firing, 0.0)
        self._lit_at[(firing != self._firing) & (firing != 0.0)] = time_s
        self._firing = firing

    def elapse(self, duration_s: float) -> None:
        """Count on-times and impulses of the on-off actuators over a time with the efforts held."""
        counted = self._counted
        self.on_time_s[counted] += duration_s * (self.applied[counted] != 0.0)
        self.impulse_N_s[counted] += duration_s * np.abs(self.applied[counted])

    def fill(self, row: FloatArray) -> None:
        """Write commands, applied efforts, bounds, on-times and impulses into the actuator columns of a row."""
        efforts = 4 * len(self.names)
        row[0:efforts:4], row[1:efforts:4] = self.command, self.applied
        row[2:efforts:4], row[3:efforts:4] = self.lower, self.upper
        row[efforts::2] = self.on_time_s[self._counted]
        row[efforts + 1 :: 2] = self.impulse_N_s[self._counted]


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


def _signals(system: System, counted: npt.NDArray[np.intp]) -> tuple[Signal, ...]:
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
    for name in (system.names("actuator")[i] for i in counted):
        field = identifier(name)
        signals.append(Signal("actuators", f"{field}_on_time_s", "s", f"time that {name} has been on"))
        signals.append(Signal("actuators", f"{field}_impulse_N_s", "N s", f"impulse that {name} has delivered, unsigned"))
    return tuple(signals)


def _drives_rotation(model: Any, i: int) -> bool:
    if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT:
        return not np.any(model.actuator_gear[i, :3])
    return bool(model.jnt_type[model.actuator_trnid[i, 0]] == mujoco.mjtJoint.mjJNT_HINGE)
