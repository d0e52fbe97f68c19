"""Limits of actuators: envelopes of effort over velocity, and the valves of on-off thrusters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.actuation.config import AnyActuator, IdealConfig, OnOffConfig, ReactionWheelConfig, TorqueSpeedConfig
from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.errors import Faults
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.inputs import controller_of
from ffsm_mj.model.system import System
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import SCHEDULED_S


@dataclass(frozen=True)
class Envelope:
    """Limits of each actuator, (nu,) each: low <= effort <= high, |effort + slope * velocity| <= stall.

    For a servo they are those of its setpoint.

    Attributes:
        low: Least effort that MJCF allows.
        high: Greatest effort that MJCF allows.
        stall: Greatest effort at rest; infinite without a limit.
        slope: Effort lost per actuator velocity.
        saturation: Joint speed beyond which efforts cannot accelerate it further; infinite without one.
        gear: Effort per ctrl.
        keeps: Whether it keeps its command where it is not powered: a servo.
    """

    low: FloatArray
    high: FloatArray
    stall: FloatArray
    slope: FloatArray
    saturation: FloatArray
    gear: FloatArray
    keeps: BoolArray

    def bounds(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest effort of each actuator, (nu,) each, at actuator velocities (nu,); wheels not saturated."""
        drag = velocity * self.slope
        return np.maximum(-self.stall - drag, self.low), np.minimum(self.stall - drag, self.high)


class Valve(Stateful):
    """Valve of an on-off thruster: a Schmitt trigger with a minimum on-time.

    Attributes:
        firing: Direction in which it fires, 1 or -1, or 0 while it is closed.
    """

    @dataclass
    class State:
        """Direction in which it fires, and since when, s."""

        firing: float
        lit_at_s: float

    def __init__(self, config: OnOffConfig) -> None:
        """Shut."""
        self._force, self._threshold, self._min_on_s = config.force_N, config.threshold_N, config.min_on_time_s
        self._release = config.threshold_N if config.release_N is None else config.release_N
        self.firing, self._lit_at_s = 0.0, 0.0

    def fire(self, wanted: float, lower: float, upper: float, time_s: float) -> float:
        """Update the valve and return its force.

        It opens above the threshold, and stays open above the release or for its minimum on-time.
        """
        size = abs(wanted)
        sign = math.copysign(1.0, wanted)
        stays = self.firing == sign and size >= self._release and size > 0.0
        locked = self.firing != 0.0 and time_s - self._lit_at_s < self._min_on_s - SCHEDULED_S
        firing = self.firing if stays or locked else sign if size > self._threshold else 0.0
        if not lower <= firing * self._force <= upper:
            firing = 0.0  # a one-sided thruster never fires backwards
        if firing not in (0.0, self.firing):
            self._lit_at_s = time_s
        self.firing = firing
        return firing * self._force

    def shut(self) -> float:
        """Close the valve for loss of power; return its force."""
        self.firing = 0.0
        return 0.0

    def stand(self, force: float, time_s: float) -> float:
        """Restore the state that a force implies, from a time on; return the force."""
        firing = math.copysign(1.0, force) if force else 0.0
        if firing not in (0.0, self.firing):
            self._lit_at_s = time_s
        self.firing = firing
        return firing * self._force


@dataclass
class _Actuator:
    """Limits of one actuator."""

    low: float
    high: float
    stall: float = math.inf
    slope: float = 0.0
    saturation: float = math.inf
    valve: Valve | None = None

    def configure(self, config: AnyActuator) -> None:
        """Set the limits from a scenario."""
        if isinstance(config, TorqueSpeedConfig):
            self.stall = config.stall_torque_N_m
            self.slope = config.stall_torque_N_m / config.no_load_speed_rad_s
        elif isinstance(config, ReactionWheelConfig):
            self.stall, self.saturation = config.max_torque_N_m, config.max_speed_rad_s
        elif isinstance(config, OnOffConfig):
            self.stall, self.valve = config.force_N, Valve(config)


def limits_of(system: System, configs: Mapping[str, AnyActuator]) -> tuple[Envelope, dict[int, Valve]]:
    """Limits of all actuators, and the valves of the on-off ones by index, in MuJoCo's order.

    Raises:
        ScenarioFaults: An unknown actuator, or a limit of motors for a servo.
    """
    gear, servos = _effort_per_ctrl(system.mj), servo_mask(system.mj)
    actuators = [_Actuator(*ends) for ends in zip(*_mjcf_range(system, gear).tolist(), strict=True)]
    with Faults() as faults:
        for name, config in configs.items():
            with faults.below("actuators", name):
                i = system.index("actuator", name)
                if servos[i] and not isinstance(config, IdealConfig):
                    message = (
                        f"{name} is a servo, and {config.kind} is a limit of motors; a servo has those of its model file, "
                        f"and '{system.names('actuator')[controller_of(system.mj, i)]}: {{kind: torque}}' makes it a motor"
                    )
                    faults.add(message, "actuators", name, "kind")
                actuators[i].configure(config)
    envelope = Envelope(
        low=np.array([one.low for one in actuators]),
        high=np.array([one.high for one in actuators]),
        stall=np.array([one.stall for one in actuators]),
        slope=np.array([one.slope for one in actuators]) / gear,
        saturation=np.array([one.saturation for one in actuators]),
        gear=gear,
        keeps=servos,
    )
    return envelope, {i: one.valve for i, one in enumerate(actuators) if one.valve is not None}


def _effort_per_ctrl(model: Any) -> FloatArray:
    """Gear times gain of each motor; that of a thruster its gain, as its gear is a wrench; 1 for setpoints."""
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    gear = model.actuator_gainprm[:, 0] * np.where(on_joint, model.actuator_gear[:, 0], 1.0)
    return np.where(servo_mask(model), 1.0, gear)


def _mjcf_range(system: System, gear: FloatArray) -> FloatArray:
    """Bounds on the effort, or on the setpoint of a servo, in the model files, (2, nu)."""
    model, bounds, servos = system.mj, system.effort_limits.T.copy(), servo_mask(system.mj)
    for i in range(model.nu):
        limits = []
        if model.actuator_ctrllimited[i]:
            limits.append(np.sort(model.actuator_ctrlrange[i] * gear[i]))
        if model.actuator_forcelimited[i] and not servos[i]:
            limits.append(np.sort(model.actuator_forcerange[i] * gear[i] / model.actuator_gainprm[i, 0]))
        for low, high in limits:
            bounds[0, i], bounds[1, i] = max(bounds[0, i], low), min(bounds[1, i], high)
    return bounds
