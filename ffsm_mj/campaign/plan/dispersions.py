"""Entries of ``dispersions``, and the scalars that are sampled for them."""

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
"""Height and azimuth of a uniform direction on the sphere (Archimedes)."""


class Rotation(StrictModel):
    """Rotation of an attitude; the four numbers of a quaternion cannot be sampled independently."""

    axis: Axis
    """Axis in the parent frame of the attitude, usually the world, of any length; or ``random``, uniform on the sphere."""
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
    """Direction in the axes of the vector, of any length; or ``random``, uniform on the sphere."""
    magnitude: Distribution
    """Magnitude in the unit of the key."""

    @model_validator(mode="after")
    def _of_numbers(self) -> Vector:
        _refuse_texts("magnitude", self.magnitude)
        _refuse_zero("direction", self.direction)
        return self


class Spread(Distribution):
    """A distribution of a number or of a vector."""

    vector: Vector | None = None
    """Vector of three numbers: a direction times a magnitude."""


class Dispersion(Spread):
    """Dispersion of a key: the sample replaces its value, multiplies it (``scale``) or is added to it (``offset``)."""

    beside: ClassVar[tuple[str, ...]] = ("keys",)

    keys: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)] | None = None
    """Keys that share one sample; default: the name of the entry is the key."""
    scale: Distribution | None = None
    """Factor on the value of the base scenario."""
    offset: Spread | None = None
    """Offset added to the value of the base scenario."""
    rotation: Rotation | None = None
    """Rotation of a quaternion, or of the attitude of a free joint, relative to the base scenario."""

    @model_validator(mode="after")
    def _around_something(self) -> Dispersion:
        absolute = self.vector.magnitude if self.vector is not None else self
        if absolute.mean_missing:
            raise ValueError("needs a 'mean'; only scale, offset and angle have a default")
        for key, part in (("scale", self.scale), ("offset", self.offset)):
            if part is not None:
                _refuse_texts(key, part)
        return self


@dataclass(frozen=True)
class SampledScalar:
    """A scalar that is sampled for each run.

    Attributes:
        entry: Its entry of ``dispersions``.
        name: Its column in the table.
        distribution: Its distribution.
        mean: Default mean of a normal distribution.
    """

    entry: str
    name: str
    distribution: Distribution
    mean: float | None = None


Operation = Literal["value", "scale", "offset", "rotation", "vector", "vector_offset"]


def operation(dispersion: Dispersion) -> Operation:
    """Operation of a dispersion on the value of its keys."""
    if dispersion.offset is not None:
        return "vector_offset" if dispersion.offset.vector is not None else "offset"
    if dispersion.scale is not None:
        return "scale"
    if dispersion.rotation is not None:
        return "rotation"
    return "vector" if dispersion.vector is not None else "value"


def axis_of(dispersion: Dispersion) -> Axis | None:
    """Axis of a rotation or direction of a vector; None for a number."""
    spread = dispersion.offset or dispersion
    if dispersion.rotation is not None:
        return dispersion.rotation.axis
    return spread.vector.direction if spread.vector is not None else None


def sampled_scalars(name: str, dispersion: Dispersion) -> Iterator[SampledScalar]:
    """Scalars of an entry of ``dispersions``: one, or three with a random axis or direction."""
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


def _refuse_texts(key: str, distribution: Distribution) -> None:
    if not distribution.is_numeric:
        raise ValueError(f"{key}: needs a choice of numbers; texts and flags can only replace a value")


def _refuse_zero(key: str, axis: Axis) -> None:
    if axis != "random" and not any(axis):
        raise ValueError(f"{key} must not be zero")
