"""Configuration of a scenario as an environment for learning: actions, observations, reward, and the ends of an episode."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field, PositiveFloat, PositiveInt, field_validator, model_validator

from ffsm_mj.conditions import conditions
from ffsm_mj.config import Name, StrictModel

LARGEST = 1e6
"""Default bound of an observation."""


class EffortAction(StrictModel):
    """Efforts of actuators, one number each: 1 commands the greatest effort, -1 its negative."""

    kind: Literal["effort"]
    actuators: Annotated[tuple[Name, ...], Field(min_length=1)]
    """Actuators; the control laws of the phases command the others."""
    max_effort: tuple[PositiveFloat, ...] | PositiveFloat | None = None
    """Effort of the number 1, N or N m, one for all or one each; default: the limit of each actuator at rest."""


class _TipAction(StrictModel):
    """Motion or wrench of a site of the robot, by the efforts of joints; the base floats."""

    site: Name | None = None
    """Site of the robot; default: the tip of the task."""
    axes: Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1, max_length=3)] = ("x", "y", "z")
    """World axes of the translation, one number each."""
    rotation: bool = False
    """Whether three further numbers are of the rotation, about the world axes."""
    joints: tuple[Name, ...] | None = None
    """Joints to drive; default: all motor-driven joints of the robot other than those of the base."""
    damping_N_m_s_rad: Annotated[float, Field(ge=0.0)] = 0.0
    """Damping of the joints: with a velocity only of their motions that leave the site at rest, N m s/rad."""


class TipVelocityAction(_TipAction):
    """Velocity of a site: its acceleration is ``gain_1_s`` times the difference to the velocity that is asked for."""

    kind: Literal["tip_velocity"]
    max_speed_m_s: PositiveFloat
    """Velocity of the number 1 along an axis, m/s."""
    max_rate_rad_s: PositiveFloat | None = None
    """With ``rotation``: angular velocity of the number 1 about an axis, rad/s."""
    gain_1_s: PositiveFloat = 5.0
    """Acceleration per difference of velocity, 1/s."""
    singular_mass_kg: PositiveFloat = 1000.0
    """Effective inertia of the site, kg or kg m^2, above which a direction is near a singularity and torques fade out."""

    @model_validator(mode="after")
    def _has_a_rate(self) -> TipVelocityAction:
        if self.rotation != (self.max_rate_rad_s is not None):
            raise ValueError("'rotation: true' and 'max_rate_rad_s' go together")
        return self


class TipWrenchAction(_TipAction):
    """Force and torque that the joints exert at a site: efforts are the transposed generalised Jacobian times the wrench."""

    kind: Literal["tip_wrench"]
    max_force_N: PositiveFloat
    """Force of the number 1 along an axis, N."""
    max_torque_N_m: PositiveFloat | None = None
    """With ``rotation``: torque of the number 1 about an axis, N m."""

    @model_validator(mode="after")
    def _has_a_torque(self) -> TipWrenchAction:
        if self.rotation != (self.max_torque_N_m is not None):
            raise ValueError("'rotation: true' and 'max_torque_N_m' go together")
        return self


class RequestAction(StrictModel):
    """A request to a contact model, one number: it is sent at each control tick of a step whose number is above 0."""

    kind: Literal["request"]
    request: Name
    """``GRASP.arm``, ``GRASP.disarm`` or ``GRASP.release``, or a request that a contact model of a plug-in handles."""


ActionConfig = Annotated[
    EffortAction | TipVelocityAction | TipWrenchAction | RequestAction,
    Field(discriminator="kind"),
]
ACTION_KINDS: tuple[str, ...] = tuple(
    get_args(cls.model_fields["kind"].annotation)[0]
    for cls in (EffortAction, TipVelocityAction, TipWrenchAction, RequestAction)
)


class ObservationConfig(StrictModel):
    """A value to observe, with its bounds in the observation space."""

    of: Name
    """Column of the log or path of the observation."""
    low: float = -LARGEST
    """Least value."""
    high: float = LARGEST
    """Greatest value."""
    before: float | None = None
    """Of ``measured.SENSOR``: each number before the first sample has arrived; without it, that is an error."""

    @model_validator(mode="after")
    def _is_ordered(self) -> ObservationConfig:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be less than high ({self.high:g})")
        return self


class RewardConfig(StrictModel):
    """A reward function with arguments."""

    function: Name
    """Name of a reward function: one that ffsm-mj ships, or an entry point of the group ``ffsm_mj.rewards``."""
    arguments: dict[Name, float | str | bool] = {}
    """Further arguments of the function, by name."""


class EnvConfig(StrictModel):
    """A scenario as a Gymnasium environment; see docs/gymnasium.md. A run without Gymnasium ignores it."""

    actions: Annotated[tuple[ActionConfig, ...], Field(min_length=1)]
    """Parts of the action vector in their order, every number from -1 to 1."""
    observations: Annotated[tuple[Name | ObservationConfig, ...], Field(min_length=1)]
    """Parts of the observation vector in their order: columns of the log and paths of the observation."""
    ticks_per_step: PositiveInt = 1
    """Control ticks of one step of the environment."""
    reward: Name | RewardConfig = "sparse"
    """Reward function: ``sparse``, ``least_impulse``, ``nearer``, or an entry point of the group ``ffsm_mj.rewards``."""
    success: str | None = None
    """Condition that ends an episode with success, evaluated at every control tick: ``grasps.count == 1 and ...``."""
    failure: str | None = None
    """Condition that ends an episode with failure."""
    forbidden_contacts: tuple[Name, ...] = ()
    """Contact rules and pairs whose first contact ends an episode with failure; ``unhandled``: overlaps of geoms that no
    contact model handles."""
    bounds: dict[Name, tuple[float, float]] = {}
    """Least and greatest value by column or path; an episode ends with failure where a value leaves them."""
    design: Name | None = None
    """Campaign whose design gives the resets: a file, relative to the scenario file, or the name of a shipped campaign."""

    @field_validator("success", "failure")
    @classmethod
    def _validate_conditions(cls, value: str | None) -> str | None:
        if value is not None:
            conditions(value)
        return value

    @field_validator("bounds")
    @classmethod
    def _validate_bounds(cls, value: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        for name, (low, high) in value.items():
            if not low < high:
                raise ValueError(f"{name}: the least value ({low:g}) must be less than the greatest ({high:g})")
        return value
