"""PD on the pose of the base towards that at the start of the phase, at rest, by thrusters and wheels.

A wrench on the base is asked of thrusters and wheels: the force of the thrusters, the torque of the wheels, or of the
thrusters too where there are none. Ideal world-aligned actuators, body-fixed one-way thrusters and wheels that store the
momentum are all allocated the same way; what an on-off thruster makes of its share is decided by the plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from ffsm_controllers.base_control import BaseControl, Stiffness
from ffsm_controllers.pd import Gain
from ffsm_mj.controller_protocol import Command, ControllerContext, IntArray, Observation, Signal, Stateful, StrictModel


class BaseGains(StrictModel):
    """PD gains of the base towards its pose at the start of the phase."""

    kp: Gain
    """N/m for translation, N m/rad for rotation; 0 only brings it to rest."""
    kd: Gain
    """N s/m for translation, N m s/rad for rotation."""


class BaseActuation(StrictModel):
    """Actuators and gains of the base."""

    kind: str
    thrusters: tuple[str, ...] = ()
    """Actuators that push the base: body-fixed at sites, or ideal ones on base joints."""
    wheels: tuple[str, ...] = ()
    """Motors of reaction wheels, or an ideal one on a base hinge; without any the thrusters turn the base too."""
    translation: BaseGains | None = None
    """Left out: the base's translation is not controlled. The paper: kp 50, kd 37.5."""
    rotation: BaseGains | None = None
    """Left out: the base's rotation is not controlled. The paper: kp 200, kd 150."""


class BasePdConfig(BaseActuation):
    """PD on the base through thrusters and wheels."""

    kind: Literal["base_pd"]


class BasePd(Stateful):
    """PD wrench on the base, allocated."""

    @dataclass
    class State:
        """State of the control of the base."""

        base: BaseControl.State

    Config: ClassVar[type[BaseActuation]] = BasePdConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "base_position_error_m", "m", "distance of the base from where the phase began"),
        Signal("controller", "base_rotation_error_rad", "rad", "angle of the base from where the phase began"),
    )

    def __init__(self, config: BaseActuation, context: ControllerContext) -> None:
        """Resolve the actuators.

        Raises:
            ScenarioFaults: An unknown name, or a demand that no actuator can serve.
        """
        self._base = BaseControl(
            context.system, config.thrusters, config.wheels, _stiffness(config.translation), _stiffness(config.rotation)
        )

    @property
    def driven_actuators(self) -> IntArray:
        """Thrusters and wheels."""
        return self._base.driven_actuators

    def start(self, observation: Observation) -> None:
        """Take the pose as the reference."""
        self._base.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Ask for the wrench."""
        self._base.control(observation, command)

    def telemetry(self) -> Sequence[float]:
        """Position and rotation error of the base at the last tick."""
        return self._base.error


def _stiffness(gains: BaseGains | None) -> Stiffness | None:
    return None if gains is None else Stiffness(gains.kp, gains.kd)
