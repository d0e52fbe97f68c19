"""What a scenario says of the captures that its phases may arm."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ConfigDict, Field, PositiveFloat, model_validator

from ffsm_mj.config import StrictModel

_Name = Annotated[str, Field(min_length=1)]


class WithinConfig(StrictModel):
    """Bounds on how the object's site is to the robot's: those that are stated must hold all at once."""

    position_m: PositiveFloat | None = None
    """Distance of the sites, m."""
    angle_rad: PositiveFloat | None = None
    """Angle between the frames of the sites, rad."""
    speed_m_s: PositiveFloat | None = None
    """Relative speed of the two bodies at the object's site, m/s."""
    rate_rad_s: PositiveFloat | None = None
    """Relative angular speed of the two bodies, rad/s."""

    @model_validator(mode="before")
    @classmethod
    def _states_one(cls, data: Any) -> Any:
        if isinstance(data, dict) and not any(value is not None for value in data.values()):
            raise ValueError("needs one bound at least: position_m, angle_rad, speed_m_s, rate_rad_s")
        return data

    @property
    def bounds(self) -> tuple[float | None, ...]:
        """The four in the order of :class:`ffsm_mj.contact_models.grasp.nearness.Nearness`; None where there is none."""
        return self.position_m, self.angle_rad, self.speed_m_s, self.rate_rad_s


class WhenConfig(StrictModel):
    """When an armed grasp closes: at the impact of a pair, or once the sites are near and slow; one of the two."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["touch"]}, {"required": ["within"]}]})

    touch: Annotated[tuple[_Name, ...], Field(min_length=1)] | None = None
    """Names of impact pairs: at the instant of an impact of one of them."""
    within: WithinConfig | None = None
    """At the first instant at which all of these bounds hold."""

    @model_validator(mode="after")
    def _one_of_two(self) -> WhenConfig:
        if (self.touch is None) == (self.within is None):
            raise ValueError("needs 'touch: [pair, ...]' or 'within: {position_m: ..., ...}', one of the two")
        return self


class CaptureConfig(StrictModel):
    """A grasp: a site of the robot takes hold of a site of a floating object, at the pose that they have then."""

    robot_site: _Name
    """Site of the robot; the body that it is on holds the object."""
    object_site: _Name
    """Site of a floating object, on its base; the impulse and the loads are told at it."""
    when: WhenConfig
    """When it closes while a phase arms it."""
