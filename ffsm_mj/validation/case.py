"""A validation case: where its numbers come from, the numbers as they stand there, and how the engine computes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

Values = Mapping[str, float]


class Origin(StrEnum):
    """What a number is compared with."""

    PUBLISHED = "published"
    CLOSED_FORM = "closed form"


class Verdict(StrEnum):
    """How a computed number stands to that of its source."""

    AGREES = "agrees"
    EXPLAINED = "differs, explained"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Number:
    """One number of a source.

    Attributes:
        key: Name of the computed value.
        quantity: What it is, with its unit.
        text: The number as it is printed; of a closed form, its value to the digits of the tolerance or better.
        tolerance: Largest difference that is agreement.
        why: Where the tolerance comes from; empty: half a unit of the last printed digit.
        at_most: The computed value is an error or a bound, which must not exceed the printed one.
        known: Why the computed value differs by more than the tolerance; empty: it must not.
    """

    key: str
    quantity: str
    text: str
    tolerance: float | None = None
    why: str = ""
    at_most: bool = False
    known: str = ""

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    @property
    def allowed(self) -> float:
        """Largest difference that is agreement."""
        if self.tolerance is not None:
            return self.tolerance
        mantissa, _, exponent = self.text.lower().partition("e")
        return float(0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


@dataclass(frozen=True)
class ValidationCase:
    """Numbers of one source beside ours.

    Attributes:
        name: Name on the command line.
        title: What it is about.
        origin: Whether the numbers are printed by the source or follow from its formula.
        source: Authors, year, title, and where in it.
        setting: Model, law and step, in a sentence or two.
        numbers: What is compared.
        compute: Makes the runs; returns the values by key.
        explanation: Why numbers differ, where any does, or what the comparison does not show.
    """

    name: str
    title: str
    origin: Origin
    source: str
    setting: str
    numbers: tuple[Number, ...]
    compute: Callable[[], Values] = field(repr=False)
    explanation: str = ""


@dataclass(frozen=True)
class ComparedNumber:
    """One number of a source beside the computed one."""

    number: Number
    ours: float

    @property
    def verdict(self) -> Verdict:
        """Whether ours is within the tolerance, or no greater than a bound."""
        away = self.ours - self.number.value
        if away <= 0.0 if self.number.at_most else abs(away) <= self.number.allowed:
            return Verdict.AGREES
        return Verdict.EXPLAINED if self.number.known else Verdict.DIFFERS


@dataclass(frozen=True)
class ComparedCase:
    """A case with what the engine computed for it."""

    case: ValidationCase
    numbers: tuple[ComparedNumber, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst of its numbers."""
        verdicts = {number.verdict for number in self.numbers}
        return next(verdict for verdict in reversed(Verdict) if verdict in verdicts)


def compare_case(case: ValidationCase) -> ComparedCase:
    """Compute a case and put its numbers beside those of the source."""
    values = case.compute()
    return ComparedCase(case, tuple(ComparedNumber(number, values[number.key]) for number in case.numbers))
