"""The plant side of actuation: what reaches the joints of what a controller asks for. No controller can bypass it.

Efforts are forces in N or torques in N m at the driven joint or site; MuJoCo's ``ctrl`` is the effort over gear and gain.
A command is decided once per control tick and held.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
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
ACTUATOR_KINDS = ("ideal", "torque_speed", "reaction_wheel", "on_off")
ActuatorConfig = Annotated[AnyActuator, Field(discriminator="kind")]


@dataclass
class _Limits:
    """What one actuator can do, and what its on-off valve remembers."""

    gear: float
    low: float
    high: float
    stall: float = math.inf
    slope: float = 0.0
    saturation: float = math.inf
    on_off: bool = False
    force: float = 0.0
    threshold: float = 0.0
    release: float = 0.0
    min_on_s: float = 0.0
    firing: float = 0.0
    lit_at_s: float = 0.0
    constant: bool = False
    least: float = -math.inf
    greatest: float = math.inf

    def configure(self, config: AnyActuator) -> None:
        """Take the limits of a scenario."""
        if isinstance(config, TorqueSpeedConfig):
            self.stall = config.stall_torque_N_m
            self.slope = config.stall_torque_N_m / config.no_load_speed_rad_s
        elif isinstance(config, ReactionWheelConfig):
            self.stall, self.saturation = config.max_torque_N_m, config.max_speed_rad_s
        elif isinstance(config, OnOffConfig):
            self.on_off = True
            self.force = self.stall = config.force_N
            self.threshold, self.min_on_s = config.threshold_N, config.min_on_time_s
            self.release = config.threshold_N if config.release_N is None else config.release_N

    def bounds(self, speed: float) -> tuple[float, float]:
        """Least and greatest effort while powered, at a speed."""
        drag = self.slope * speed
        lower = max(-self.stall - drag, self.low) if speed > -self.saturation else 0.0
        upper = min(self.stall - drag, self.high) if speed < self.saturation else 0.0
        return lower, upper

    def settle(self) -> None:
        """Note whether the bounds depend on the speed."""
        self.constant = self.slope == 0.0 and self.saturation == math.inf
        self.least, self.greatest = max(-self.stall, self.low), min(self.stall, self.high)

    def fire(self, wanted: float, lower: float, upper: float, time_s: float) -> float:
        """Force of the valve: kept on above the release and for its shortest time, lit above the threshold."""
        size = abs(wanted)
        sign = math.copysign(1.0, wanted)
        stays = self.firing == sign and size >= self.release and size > 0.0
        held = self.firing != 0.0 and time_s - self.lit_at_s < self.min_on_s - 1e-12
        firing = self.firing if stays or held else sign if size > self.threshold else 0.0
        if not lower <= firing * self.force <= upper:
            firing = 0.0  # one that only pushes never fires backwards
        if firing not in (0.0, self.firing):
            self.lit_at_s = time_s
        self.firing = firing
        return firing * self.force


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
        bounds = _mjcf_range(model, self._gear)
        self._limits = [_Limits(*values) for values in zip(self._gear.tolist(), *bounds.tolist(), strict=True)]
        faults = []
        for name, config in configs.items():
            try:
                self._limits[system.index("actuator", name)].configure(config)
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), ("actuators", name)))
        if faults:
            raise ScenarioFaults(faults)
        for limits in self._limits:
            limits.settle()
        # One row per actuator: command, applied, lower, upper.
        self._rest = [x for limits in self._limits for x in (0.0, 0.0, limits.least, limits.greatest)]
        self._flat = np.zeros(4 * len(self.names))
        self._data: Any = None
        self.applied = self._flat[1::4]
        self._counted = np.flatnonzero([limits.on_off for limits in self._limits])
        self._valves = [limits for limits in self._limits if limits.on_off]
        self._valves_open = False
        self.on_time_s, self.impulse_N_s = np.zeros(len(self.names)), np.zeros(len(self.names))
        self.signals = _signals(system, self._counted)

    def apply(self, command: Command, data: Any, time_s: float) -> None:
        """Turn a command into ``data.ctrl`` and hold it.

        In floats: for the few actuators of a robot that is several times faster than arrays.

        Raises:
            ControllerError: A powered effort is not finite.
        """
        if data is not self._data:
            self._data, self._velocity, self._ctrl = data, data.actuator_velocity, data.ctrl
        efforts, powered = command.effort.tolist(), command.powered.tolist()
        velocities, out = self._velocity.tolist(), self._rest.copy()
        for i, limits in enumerate(self._limits):
            on, lower, upper = powered[i], limits.least, limits.greatest
            if not limits.constant:
                lower, upper = out[4 * i + 2 : 4 * i + 4] = limits.bounds(velocities[i] / limits.gear)
            if on:
                out[4 * i], out[4 * i + 1] = self._delivered(i, efforts[i], lower, upper, time_s)
            elif limits.on_off:
                limits.firing = 0.0
        self._flat[:] = out
        self._valves_open = any(limits.firing for limits in self._valves) if self._valves else False
        np.divide(self.applied, self._gear, self._ctrl)

    def _delivered(self, i: int, wanted: float, lower: float, upper: float, time_s: float) -> tuple[float, float]:
        """What is asked of a powered actuator, and what it gives."""
        if not math.isfinite(wanted):
            raise ControllerError(f"the controller commands an effort that is not finite for {self.names[i]}")
        applied = self._limits[i].fire(wanted, lower, upper, time_s) if self._limits[i].on_off else wanted
        return wanted, min(max(applied, lower), upper)

    def elapse(self, duration_s: float) -> None:
        """Count on-times and impulses of the on-off actuators over a time with the efforts held."""
        if not self._valves_open:
            return
        counted = self._counted
        self.on_time_s[counted] += duration_s * (self.applied[counted] != 0.0)
        self.impulse_N_s[counted] += duration_s * np.abs(self.applied[counted])

    def fill(self, row: FloatArray) -> None:
        """Write commands, applied efforts, bounds, on-times and impulses into the actuator columns of a row."""
        efforts = self._flat.size
        row[:efforts] = self._flat
        if len(self._counted):
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
