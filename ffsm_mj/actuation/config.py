"""Configuration of actuators in a scenario, by kind."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.model.magnetorquers import Axis


class _Delayed(StrictModel):
    delay_s: NonNegativeFloat | None = None
    """Time from a command to its effect, s; default: ``delay`` of the model file, or else ``actuation.delay_s``."""


class IdealConfig(_Delayed):
    """An actuator with the limits of its model file: ``ctrlrange``, ``forcerange`` and those of its joint."""

    kind: Literal["ideal"]


class TorqueConfig(_Delayed):
    """A servo of the model file as an ideal motor: it is commanded by its effort, within ``forcerange``, and has no law."""

    kind: Literal["torque"]


class TorqueSpeedConfig(_Delayed):
    """A motor on its torque-speed line, paper (34): |u + (stall / no_load) speed| <= stall, while powered."""

    kind: Literal["torque_speed"]
    stall_torque_N_m: PositiveFloat
    """Torque at rest, N m (N for a slide joint)."""
    no_load_speed_rad_s: PositiveFloat
    """Speed at zero torque, rad/s (m/s for a slide joint)."""


class ReactionWheelConfig(_Delayed):
    """Motor of a reaction wheel: a torque limit, and no torque that would accelerate it beyond its maximum speed."""

    kind: Literal["reaction_wheel"]
    max_torque_N_m: PositiveFloat
    """Maximum torque, N m."""
    max_speed_rad_s: PositiveFloat
    """Speed of the rotor relative to its bearing at which it saturates, rad/s."""


class OnOffConfig(_Delayed):
    """A thruster that is off or fully on, in the commanded direction (paper, section 4.4).

    With ``release_N`` below ``threshold_N`` it is a Schmitt trigger. A thruster whose ctrlrange starts at 0 pushes only.
    """

    kind: Literal["on_off"]
    force_N: PositiveFloat
    """Force while on, N."""
    threshold_N: Annotated[float, Field(ge=0.0)] = 0.0
    """The thruster fires when more than this is commanded, N."""
    release_N: Annotated[float, Field(ge=0.0)] | None = None
    """Once on, it stays on until less than this is commanded, N; default: the threshold."""
    min_on_time_s: Annotated[float, Field(ge=0.0)] = 0.0
    """Minimum on-time unless power is cut, s."""

    @model_validator(mode="after")
    def _release_below_threshold(self) -> OnOffConfig:
        if self.release_N is not None and self.release_N > self.threshold_N:
            raise ValueError(f"release_N must not exceed threshold_N ({self.threshold_N:g})")
        return self


class MagnetorquerConfig(_Delayed):
    """A magnetorquer, added at a site: its command is a dipole along an axis of the site, and its torque m x B."""

    kind: Literal["magnetorquer"]
    site: Name
    """Site of a moving body that it is at."""
    axis: Axis = "z"
    """Axis of the site along which a positive dipole points."""
    max_dipole_A_m2: PositiveFloat
    """Largest dipole, in either direction, A m^2."""


AnyActuator = IdealConfig | TorqueConfig | TorqueSpeedConfig | ReactionWheelConfig | OnOffConfig | MagnetorquerConfig
ACTUATOR_KINDS = ("ideal", "torque", "torque_speed", "reaction_wheel", "on_off", "magnetorquer")
ActuatorConfig = Annotated[AnyActuator, Field(discriminator="kind")]
