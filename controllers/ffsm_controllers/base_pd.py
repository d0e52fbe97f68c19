"""PD on the pose of the base towards that at the start of the phase, or set points, by thrusters and wheels.

A wrench on the base is asked of thrusters and wheels: the force of the thrusters, the torque of the wheels, or of the
thrusters too where there are none. Ideal world-aligned actuators, body-fixed one-way thrusters and wheels that store the
momentum are all allocated the same way; what an on-off thruster makes of its share is decided by the plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

from pydantic import PositiveFloat, model_validator

from ffsm_controllers.base_control import BaseControl, BaseTarget, Frame, Stiffness
from ffsm_controllers.pd import Gain, Quaternion
from ffsm_mj.controller_protocol import Command, ControllerContext, IntArray, Observation, Signal, Stateful, StrictModel

Vector = tuple[float, float, float]


class BaseGains(StrictModel):
    """PD gains of the base towards its set point."""

    kp: Gain
    """N/m for translation, N m/rad for rotation; 0 only brings it to rest."""
    kd: Gain
    """N s/m for translation, N m s/rad for rotation."""


class BaseWaypoint(StrictModel):
    """Where the base is to be at a time."""

    at_s: PositiveFloat
    """Time since the start of the phase, s."""
    position_m: Vector
    """Position of the origin of its frame in the axes of ``frame``, m."""


class TranslationGains(BaseGains):
    """PD gains and set points of the position of the base."""

    position_m: Vector | None = None
    """Position of the origin of its frame in the axes of ``frame``, m; left out: that at the start of the phase."""
    waypoints: tuple[BaseWaypoint, ...] = ()
    """Waypoints in the order of their times: a path of least jerk from where the base is to rest at the last one."""

    @model_validator(mode="after")
    def _is_consistent(self) -> TranslationGains:
        if self.position_m is not None and self.waypoints:
            raise ValueError("'position_m' is a set point at once, 'waypoints' are a path from where the base is: write one")
        times = [waypoint.at_s for waypoint in self.waypoints]
        for one, other in pairwise(times):
            if other <= one:
                raise ValueError(f"the times of waypoints must ascend; {other:g} s follows {one:g} s")
        return self


class RotationGains(BaseGains):
    """PD gains and set point of the attitude of the base."""

    attitude: Quaternion | None = None
    """Quaternion w, x, y, z that turns its axes into those of ``frame``; left out: that at the start of the phase."""


class BaseActuation(StrictModel):
    """Actuators, gains and set points of the base."""

    kind: str
    frame: Frame = "world"
    """Axes of set points and errors: ``world``, or with an orbit ``lvlh``, which turn: at rest is station-keeping."""
    thrusters: tuple[str, ...] = ()
    """Actuators that push the base: body-fixed at sites, or ideal ones on base joints."""
    wheels: tuple[str, ...] = ()
    """Motors of reaction wheels, or an ideal one on a base hinge; without any the thrusters turn the base too."""
    translation: TranslationGains | None = None
    """Left out: the base's translation is not controlled. The paper: kp 50, kd 37.5."""
    rotation: RotationGains | None = None
    """Left out: the base's rotation is not controlled. The paper: kp 200, kd 150."""

    @property
    def target(self) -> BaseTarget:
        """The set points."""
        position = self.translation.position_m if self.translation is not None else None
        waypoints = self.translation.waypoints if self.translation is not None else ()
        attitude = self.rotation.attitude if self.rotation is not None else None
        return BaseTarget(position, tuple((point.at_s, point.position_m) for point in waypoints), attitude)


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
        Signal("controller", "base_position_error_m", "m", "distance of the base from its set point"),
        Signal("controller", "base_rotation_error_rad", "rad", "angle of the base from its set point"),
    )

    def __init__(self, config: BaseActuation, context: ControllerContext) -> None:
        """Resolve the actuators.

        Raises:
            ScenarioFaults: An unknown name, a demand that no actuator can serve, or LVLH axes without an orbit.
        """
        self._base = BaseControl(
            context.system,
            config.thrusters,
            config.wheels,
            _stiffness(config.translation),
            _stiffness(config.rotation),
            axes=context.lvlh_axes(config.frame),
            target=config.target,
        )

    @property
    def driven_actuators(self) -> IntArray:
        """Thrusters and wheels."""
        return self._base.driven_actuators

    def start(self, observation: Observation) -> None:
        """Take the pose as the reference where no other is stated."""
        self._base.start(observation)

    def control(self, observation: Observation, command: Command) -> None:
        """Ask for the wrench."""
        self._base.control(observation, command)

    def telemetry(self) -> Sequence[float]:
        """Position and rotation error of the base at the last tick."""
        return self._base.error


def _stiffness(gains: BaseGains | None) -> Stiffness | None:
    return None if gains is None else Stiffness(gains.kp, gains.kd)
