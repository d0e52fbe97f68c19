"""Distributions of dispersed parameters, and the entries of ``dispersions`` that use them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, PositiveFloat, WithJsonSchema, model_validator

from ffsm_mj.arrays import FloatArray
from ffsm_mj.config import StrictModel


def _scalar(value: Any) -> Any:
    if isinstance(value, bool | str) or (isinstance(value, int | float) and abs(value) < float("inf")):
        return value
    if isinstance(value, list | tuple) and value:
        return tuple(map(_number, value))
    raise ValueError("should be a finite number, a text, a flag or a list of numbers")


def _number(value: Any) -> Any:
    if isinstance(value, bool | str) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise ValueError("should be a finite number")
    return value


Number = Annotated[Any, AfterValidator(_number), WithJsonSchema({"type": "number"})]
"""A finite number; integers are preserved, because integer keys of a scenario accept nothing else."""
Scalar = Annotated[Any, AfterValidator(_scalar), WithJsonSchema({"type": ["number", "string", "boolean", "array"]})]
_LEAST_U, _MOST_U = 2.0**-54, 1.0 - 2.0**-53
"""Probabilities are clipped to this interval, in which every inverse is finite."""


class Normal(StrictModel):
    """A normal distribution."""

    mean: float | None = None
    """Mean; default: 1 for ``scale``, 0 for ``offset`` and angle."""
    sd: PositiveFloat
    """Standard deviation."""


class Truncated(Normal):
    """A normal distribution truncated at one or two bounds."""

    low: float | None = None
    """Lower bound."""
    high: float | None = None
    """Upper bound."""

    @model_validator(mode="after")
    def _bounded(self) -> Truncated:
        if self.low is None and self.high is None:
            raise ValueError("needs 'low', 'high' or both; without bounds, write 'normal'")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low must be below high, {self.low:g} is not below {self.high:g}")
        return self


class LogNormal(StrictModel):
    """A lognormal distribution."""

    median: PositiveFloat
    """Median."""
    sigma: PositiveFloat
    """Standard deviation of the natural logarithm."""


class Levels(StrictModel):
    """Equally spaced numbers, for a grid."""

    low: Number
    """First level."""
    high: Number
    """Last level."""
    levels: Annotated[int, Field(ge=2, le=100_000)]
    """Number of levels."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """The levels; integers if both ends and the spacing are integers."""
        span, steps = self.high - self.low, self.levels - 1
        if isinstance(span, int) and span % steps == 0:
            return tuple(self.low + i * (span // steps) for i in range(self.levels))
        with np.errstate(all="ignore"):  # numbers that are not finite are refused when the design is sampled
            return tuple(np.linspace(float(self.low), float(self.high), self.levels).tolist())


class Distribution(StrictModel):
    """One distribution; the key is its name."""

    beside: ClassVar[tuple[str, ...]] = ()
    """Keys of a subclass that may accompany the distribution."""

    uniform: tuple[float, float] | None = None
    """Uniform between two numbers."""
    normal: Normal | None = None
    """Normal, with mean and standard deviation."""
    truncated: Truncated | None = None
    """Normal between two bounds."""
    lognormal: LogNormal | None = None
    """Lognormal, with median and standard deviation of the logarithm."""
    choice: Annotated[tuple[Scalar, ...], Field(min_length=1)] | None = None
    """Equally likely values: numbers, texts, flags or lists of numbers; for a grid, the levels in this order."""
    values: Annotated[tuple[Number, ...], Field(min_length=1)] | None = None
    """Equally likely numbers, in ascending order; for a grid, the levels. Integers remain integers."""
    grid: Levels | None = None
    """Equally spaced levels; only for samples of kind ``grid``."""

    @model_validator(mode="after")
    def _validate_one(self) -> Distribution:
        names = [name for name in type(self).model_fields if name not in self.beside]
        stated = [name for name in names if getattr(self, name) is not None]
        if len(stated) != 1:
            raise ValueError(f"needs one of {', '.join(names)}; got {' and '.join(stated) or 'none'}")
        if self.uniform is not None and not self.uniform[0] < self.uniform[1]:
            raise ValueError(f"uniform needs a lower and a higher number, got {self.uniform[0]:g} and {self.uniform[1]:g}")
        if len({"number" if type(option) in (int, float) else type(option) for option in self.choice or ()}) > 1:
            raise ValueError(
                "the values of a choice must have one type (numbers, texts, flags or lists): they form a column of the table"
            )
        return self

    @property
    def levels(self) -> tuple[Any, ...] | None:
        """Values of a discrete distribution; None for a continuous one."""
        if self.choice is not None:
            return self.choice
        if self.values is not None:
            whole = all(isinstance(level, int) for level in self.values)
            return tuple(sorted(self.values if whole else map(float, self.values)))  # a column has one type
        return self.grid.numbers if self.grid is not None else None

    @property
    def is_numeric(self) -> bool:
        """Whether all samples are numbers."""
        return self.choice is None or not any(isinstance(option, bool | str | tuple) for option in self.choice)

    @property
    def is_of_lists(self) -> bool:
        """Whether samples are lists of numbers."""
        return self.choice is not None and isinstance(self.choice[0], tuple)

    @property
    def is_integer(self) -> bool:
        """Whether all samples are integers."""
        return self.levels is not None and all(type(level) is int for level in self.levels)

    @property
    def mean_missing(self) -> bool:
        """Whether the mean depends on the use of the distribution."""
        around = self.normal or self.truncated
        return around is not None and around.mean is None

    def quantiles(self, u: FloatArray, mean: float | None = None) -> list[Any]:
        """Inverse of the distribution function.

        Args:
            u: Probabilities, (n,); 0 and 1 are replaced by the nearest numbers inside.
            mean: Default mean of a normal distribution.

        Returns:
            n plain values: floats, or values of a discrete distribution.
        """
        u = np.clip(u, _LEAST_U, _MOST_U)
        levels = self.levels
        if levels is not None:
            return [levels[i] for i in np.floor(u * len(levels)).astype(int).tolist()]
        with np.errstate(all="ignore"):
            values = self._continuous(0.0 if mean is None else mean).ppf(u)
        cut = self.truncated
        return (np.clip(values, cut.low, cut.high) if cut is not None else values).tolist()  # type: ignore[no-any-return]

    def _continuous(self, mean: float) -> Any:
        """The distribution of SciPy."""
        from scipy import stats  # slow to import

        if self.uniform is not None:
            low, high = self.uniform
            return stats.uniform(low, high - low)
        if self.lognormal is not None:
            return stats.lognorm(self.lognormal.sigma, scale=self.lognormal.median)
        around = self.normal or self.truncated
        if around is None:
            raise ValueError("not a continuous distribution")
        centre = mean if around.mean is None else around.mean
        if self.truncated is None:
            return stats.norm(centre, around.sd)
        bounds = ((-np.inf, self.truncated.low), (np.inf, self.truncated.high))
        # Accurate in the tails, unlike a difference of two normal integrals.
        ends = (none if bound is None else (bound - centre) / around.sd for none, bound in bounds)
        return stats.truncnorm(*ends, loc=centre, scale=around.sd)


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
