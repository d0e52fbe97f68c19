"""A validation case: numbers of a source, how the engine computes them, and how the two compare."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

Values = Mapping[str, float]


class Verdict(StrEnum):
    """How a computed number compares with that of its source."""

    AGREES = "agrees"
    EXPLAINED = "differs, explained"
    DIFFERS = "differs"


_MANY = {Verdict.AGREES: "agree", Verdict.EXPLAINED: "differ for a stated reason", Verdict.DIFFERS: "differ without one"}


class Origin(StrEnum):
    """What a number is compared with."""

    PUBLISHED = "published"
    CLOSED_FORM = "closed form"


class Topic(StrEnum):
    """What a case is about, in the order of the page."""

    SEED_PAPER = "Seed paper"
    FREE_MOTION = "Free motion"
    IMPACTS = "Impacts"
    INTEGRATION = "What impacts ask of a time integrator"
    SEVERAL_CONTACTS = "Several contacts at one instant"
    FRICTION = "Sliding, rolling and sticking"
    GRIPS = "Grips by friction"
    GRASPS = "Captures and latches"


@dataclass(frozen=True)
class Number:
    """One number of a source.

    Attributes:
        key: Name of the computed value.
        quantity: What it is, with its unit behind the last comma.
        text: The number as it is printed; of a closed form, its value to the digits of the tolerance or better.
        tolerance: Largest difference that is agreement; left out: half a unit of the last printed digit.
        why: Where the tolerance comes from.
        at_most: The computed value is an error or a bound, which must not exceed the printed one.
        approximate: The source says "approximately": the tolerance is a whole unit of the last printed digit.
        source: Where it comes from, if not from the source of its case.
        known: Why the computed value differs by more than the tolerance; empty: it must not.
        spread: How far the computed value moves with what the source leaves open, as a step size; part of the tolerance.
    """

    key: str
    quantity: str
    text: str
    tolerance: float | None = None
    why: str = ""
    at_most: bool = False
    approximate: bool = False
    source: str = ""
    known: str = ""
    spread: float = 0.0

    @property
    def name(self) -> str:
        """The quantity without its unit."""
        return self.quantity.rpartition(", ")[0] or self.quantity

    @property
    def value(self) -> float:
        """The number."""
        return float(self.text)

    @property
    def decimals(self) -> int:
        """Printed digits behind the point."""
        mantissa, _, exponent = self.text.lower().partition("e")
        return len(mantissa.partition(".")[2]) - int(exponent or 0)

    @property
    def allowed(self) -> float:
        """Largest difference that is agreement, before the spread."""
        if self.at_most:
            return 0.0
        if self.tolerance is not None:
            return self.tolerance
        return float(10.0**-self.decimals * (1.0 if self.approximate else 0.5))


@dataclass(frozen=True)
class ComparedNumber:
    """One number of a source beside the computed one.

    Attributes:
        number: That of the source.
        ours: The computed value.
    """

    number: Number
    ours: float

    @property
    def difference(self) -> float:
        """Ours minus that of the source."""
        return self.ours - self.number.value

    @property
    def verdict(self) -> Verdict:
        """Whether ours is within the tolerance, or no greater than a bound; a value that is not finite never is."""
        if not math.isfinite(self.ours):
            return Verdict.DIFFERS
        away = self.difference if self.number.at_most else abs(self.difference)
        if away <= self.number.allowed + self.number.spread:
            return Verdict.AGREES
        return Verdict.EXPLAINED if self.number.known else Verdict.DIFFERS


def verdicts_in_words(numbers: Iterable[ComparedNumber]) -> str:
    """How many numbers there are, and how many have which verdict, as a sentence without its full stop."""
    verdicts = Counter(number.verdict for number in numbers)
    return f"{verdicts.total()} numbers: {', '.join(f'{verdicts[verdict]} {_MANY[verdict]}' for verdict in Verdict)}"


@dataclass(frozen=True)
class ValidationCase:
    """Numbers of one source beside ours.

    Attributes:
        name: Name on the command line.
        title: What it computes.
        topic: What it is about.
        origin: Whether the numbers are printed by the source or follow from its formula.
        source: Authors, year, title, and where in it.
        setting: Model, law and step, in a sentence or two.
        numbers: What is compared.
        compute: Makes the runs; returns the values by key.
        explanation: Why numbers differ, where any does, or what the comparison does not show.
        page: Page with the numbers, if not that of all cases.
    """

    name: str
    title: str
    topic: Topic
    origin: Origin
    source: str
    setting: str
    numbers: tuple[Number, ...]
    compute: Callable[[], Values] = field(repr=False)
    explanation: str = ""
    page: str = ""


@dataclass(frozen=True)
class ComparedCase:
    """A case with what the engine computed for it."""

    case: ValidationCase
    numbers: tuple[ComparedNumber, ...]

    @property
    def agreeing(self) -> int:
        """How many of its numbers agree."""
        return sum(number.verdict is Verdict.AGREES for number in self.numbers)

    @property
    def verdict(self) -> Verdict:
        """The worst of its numbers."""
        verdicts = {number.verdict for number in self.numbers}
        return next(verdict for verdict in reversed(Verdict) if verdict in verdicts)


def compared_case(case: ValidationCase, values: Values) -> ComparedCase:
    """Compare the numbers that a case computed with those of the source."""
    return ComparedCase(case, tuple(ComparedNumber(number, values[number.key]) for number in case.numbers))
