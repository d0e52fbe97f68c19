"""Distributions that a campaign draws from, each by its inverse: a number in (0, 1) in, a value out."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

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
"""An integer stays one: keys of a scenario that count take no other numbers."""
Scalar = Annotated[Any, AfterValidator(_scalar), WithJsonSchema({"type": ["number", "string", "boolean", "array"]})]
_LEAST_U, _MOST_U = 2.0**-54, 1.0 - 2.0**-53
"""Between these every inverse is finite."""


class Normal(StrictModel):
    """A normal distribution."""

    mean: float | None = None
    """Left out: 1 for a factor (``scale``), 0 for an ``offset`` and an angle."""
    sd: PositiveFloat
    """Standard deviation."""


class Truncated(Normal):
    """A normal distribution between two bounds, one of which may be left out."""

    low: float | None = None
    """Nothing below it is drawn."""
    high: float | None = None
    """Nothing above it is drawn."""

    @model_validator(mode="after")
    def _bounded(self) -> Truncated:
        if self.low is None and self.high is None:
            raise ValueError("needs 'low', 'high' or both; without bounds it is 'normal'")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low must be below high, {self.low:g} is not below {self.high:g}")
        return self


class LogNormal(StrictModel):
    """A lognormal distribution."""

    median: PositiveFloat
    """Half of the draws are below it."""
    sigma: PositiveFloat
    """Standard deviation of the natural logarithm."""


class Levels(StrictModel):
    """Equally spaced numbers, for a grid."""

    low: Number
    """The first."""
    high: Number
    """The last."""
    levels: Annotated[int, Field(ge=2, le=100_000)]
    """How many."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """The levels; integers where both ends and the distance between levels are."""
        span, steps = self.high - self.low, self.levels - 1
        if isinstance(span, int) and span % steps == 0:
            return tuple(self.low + i * (span // steps) for i in range(self.levels))
        with np.errstate(all="ignore"):  # what is not finite is refused once it is drawn
            return tuple(np.linspace(float(self.low), float(self.high), self.levels).tolist())


class Distribution(StrictModel):
    """One distribution, named by its key."""

    beside: ClassVar[tuple[str, ...]] = ()
    """Keys of a subclass that may stand beside what is drawn."""

    uniform: tuple[float, float] | None = None
    """From the first number to the second."""
    normal: Normal | None = None
    """Normal, by mean and standard deviation."""
    truncated: Truncated | None = None
    """Normal between two bounds."""
    lognormal: LogNormal | None = None
    """Lognormal, by median and the standard deviation of the logarithm."""
    choice: Annotated[tuple[Scalar, ...], Field(min_length=1)] | None = None
    """One of these, texts and lists of numbers too, all as likely; the levels of a grid in this order."""
    values: Annotated[tuple[Number, ...], Field(min_length=1)] | None = None
    """One of these numbers, all as likely, drawn in rising order; the levels of a grid. Integers stay integers."""
    grid: Levels | None = None
    """Equally spaced levels; only for samples of kind ``grid``."""

    @model_validator(mode="after")
    def _one_way(self) -> Distribution:
        ways = [name for name in type(self).model_fields if name not in self.beside]
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"needs one of {', '.join(ways)}; {' and '.join(given) + ' stand' if given else 'none stands'} here"
            )
        if self.uniform is not None and not self.uniform[0] < self.uniform[1]:
            raise ValueError(
                f"uniform goes from a lower to a higher number, not from {self.uniform[0]:g} to {self.uniform[1]:g}"
            )
        if len({"number" if type(each) in (int, float) else type(each) for each in self.choice or ()}) > 1:
            raise ValueError("a choice is of numbers, of texts, of flags or of lists: they are one column of the table")
        return self

    @property
    def levels(self) -> tuple[Any, ...] | None:
        """The values of a discrete distribution; None of a continuous one."""
        if self.choice is not None:
            return self.choice
        if self.values is not None:
            whole = all(isinstance(each, int) for each in self.values)
            return tuple(sorted(self.values if whole else map(float, self.values)))  # one column, of one type
        return self.grid.numbers if self.grid is not None else None

    @property
    def is_numeric(self) -> bool:
        """Whether only numbers are drawn."""
        return self.choice is None or not any(isinstance(each, bool | str | tuple) for each in self.choice)

    @property
    def is_of_lists(self) -> bool:
        """Whether lists of numbers are drawn."""
        return self.choice is not None and isinstance(self.choice[0], tuple)

    @property
    def is_integer(self) -> bool:
        """Whether only integers are drawn."""
        return self.levels is not None and all(type(each) is int for each in self.levels)

    @property
    def mean_missing(self) -> bool:
        """Whether only its use can tell around what it lies."""
        around = self.normal or self.truncated
        return around is not None and around.mean is None

    def quantiles(self, u: FloatArray, mean: float | None = None) -> list[Any]:
        """Values below which these shares lie.

        Args:
            u: Shares, (n,), 0 to 1; the ends are taken a rounding inside.
            mean: Mean of a normal distribution that states none.

        Returns:
            n plain values: floats, or of a choice its own.
        """
        u = np.clip(u, _LEAST_U, _MOST_U)
        levels = self.levels
        if levels is not None:
            return [levels[i] for i in np.floor(u * len(levels)).astype(int).tolist()]
        with np.errstate(all="ignore"):
            return self._continuous(u, 0.0 if mean is None else mean).tolist()  # type: ignore[no-any-return]

    def _continuous(self, u: FloatArray, mean: float) -> Any:
        from scipy.special import ndtri  # SciPy costs: for those who draw

        if self.uniform is not None:
            low, high = self.uniform
            return low + (high - low) * u
        if self.normal is not None:
            return (mean if self.normal.mean is None else self.normal.mean) + self.normal.sd * ndtri(u)
        if self.lognormal is not None:
            return self.lognormal.median * np.exp(self.lognormal.sigma * ndtri(u))
        if self.truncated is None:
            raise ValueError("no continuous distribution")
        return _truncated(self.truncated, u, mean)


def _truncated(given: Truncated, u: FloatArray, mean: float) -> Any:
    from scipy.stats import truncnorm  # exact in the tails, where a difference of two normal integrals is not

    centre = mean if given.mean is None else given.mean
    low = -np.inf if given.low is None else (given.low - centre) / given.sd
    high = np.inf if given.high is None else (given.high - centre) / given.sd
    drawn = truncnorm.ppf(u, low, high, loc=centre, scale=given.sd)
    return np.clip(drawn, given.low, given.high) if given.low is not None or given.high is not None else drawn
