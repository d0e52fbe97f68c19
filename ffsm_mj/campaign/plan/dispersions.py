"""What a campaign disperses: an entry of ``dispersions``, and the scalars that are drawn for it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from ffsm_mj.campaign.plan.distributions import Distribution
from ffsm_mj.config import StrictModel

Axis = Literal["random"] | tuple[float, float, float]
_HEIGHT, _TURN = Distribution(uniform=(-1.0, 1.0)), Distribution(uniform=(0.0, 2.0 * math.pi))
"""Height and azimuth: together uniform on the sphere, by Archimedes."""


class Rotation(StrictModel):
    """A turn of an attitude, since the four numbers of a quaternion cannot be drawn one by one."""

    axis: Axis
    """Axis in the axes that the quaternion turns into, the world's; any length; or ``random``, uniform on the sphere."""
    angle: Distribution
    """Angle, rad."""

    @model_validator(mode="after")
    def _of_numbers(self) -> Rotation:
        _refuse_texts("angle", self.angle)
        _refuse_zero("axis", self.axis)
        return self


class Vector(StrictModel):
    """A vector as a direction times a magnitude."""

    direction: Axis
    """Direction in the vector's own axes, any length; or ``random``, uniform on the sphere."""
    magnitude: Distribution
    """Length, in the unit of the key."""

    @model_validator(mode="after")
    def _of_numbers(self) -> Vector:
        _refuse_texts("magnitude", self.magnitude)
        _refuse_zero("direction", self.direction)
        return self


class Spread(Distribution):
    """A distribution of a number or of a vector."""

    vector: Vector | None = None
    """Three numbers as a direction times a magnitude."""


class Dispersion(Spread):
    """What happens to a key: it takes what is drawn, or that is a factor (``scale``) or an ``offset`` of its value."""

    beside: ClassVar[tuple[str, ...]] = ("keys",)

    keys: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)] | None = None
    """Keys that one draw applies to; left out: the entry's own name is the key."""
    scale: Distribution | None = None
    """A factor on the value that the key has."""
    offset: Spread | None = None
    """Added to the value that the key has."""
    rotation: Rotation | None = None
    """A turn of a quaternion, or of the attitude of a free joint, from where it is."""

    @model_validator(mode="after")
    def _around_something(self) -> Dispersion:
        absolute = self.vector.magnitude if self.vector is not None else self
        if absolute.mean_missing:
            raise ValueError("needs a 'mean'; only a scale, an offset and an angle have one of their own")
        for key, part in (("scale", self.scale), ("offset", self.offset)):
            if part is not None:
                _refuse_texts(key, part)
        return self


@dataclass(frozen=True)
class SampledScalar:
    """A scalar that is drawn for each run.

    Attributes:
        entry: The entry of ``dispersions`` that it is drawn for.
        name: Its column in the table.
        distribution: What it is drawn from.
        mean: Mean of a normal distribution that states none.
    """

    entry: str
    name: str
    distribution: Distribution
    mean: float | None = None


Operation = Literal["value", "scale", "offset", "rotation", "vector", "vector_offset"]


def operation(dispersion: Dispersion) -> Operation:
    """What is done to the value of a key."""
    if dispersion.offset is not None:
        return "vector_offset" if dispersion.offset.vector is not None else "offset"
    if dispersion.scale is not None:
        return "scale"
    if dispersion.rotation is not None:
        return "rotation"
    return "vector" if dispersion.vector is not None else "value"


def axis_of(dispersion: Dispersion) -> Axis | None:
    """Axis of a rotation or direction of a vector; None of a number."""
    spread = dispersion.offset or dispersion
    if dispersion.rotation is not None:
        return dispersion.rotation.axis
    return spread.vector.direction if spread.vector is not None else None


def sampled_scalars(name: str, dispersion: Dispersion) -> Iterator[SampledScalar]:
    """Scalars that an entry of ``dispersions`` draws: one, or with a random axis or direction three."""
    how = operation(dispersion)
    if dispersion.offset is not None and dispersion.offset.vector is None:
        yield SampledScalar(name, f"{name}.offset", dispersion.offset, 0.0)
    elif dispersion.scale is not None:
        yield SampledScalar(name, f"{name}.scale", dispersion.scale, 1.0)
    elif dispersion.rotation is not None:
        yield SampledScalar(name, f"{name}.angle_rad", dispersion.rotation.angle, 0.0)
    elif vector := (dispersion.offset or dispersion).vector:
        yield SampledScalar(name, f"{name}.magnitude", vector.magnitude, 0.0)
    else:
        yield SampledScalar(name, name, dispersion)
    if axis_of(dispersion) == "random":
        what = "axis" if how == "rotation" else "direction"
        yield SampledScalar(name, f"{name}.{what}_z", _HEIGHT)
        yield SampledScalar(name, f"{name}.{what}_azimuth_rad", _TURN)


def _refuse_texts(key: str, drawn: Distribution) -> None:
    if not drawn.is_numeric:
        raise ValueError(f"{key}: a choice of numbers is needed; texts and flags can only be the value itself")


def _refuse_zero(key: str, axis: Axis) -> None:
    if axis != "random" and not any(axis):
        raise ValueError(f"{key} must not be zero")
