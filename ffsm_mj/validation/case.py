"""A validation case: where its numbers come from, the numbers as they stand there, and how the engine computes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from ffsm_mj.comparison import ComparedNumber, Number, Verdict

Values = Mapping[str, float]


class Origin(StrEnum):
    """What a number is compared with."""

    PUBLISHED = "published"
    CLOSED_FORM = "closed form"


class Topic(StrEnum):
    """What a case is about, in the order of the page."""

    SEED_PAPER = "Seed paper"
    FREE_MOTION = "Free motion"
    IMPACTS = "Impacts"
    SEVERAL_CONTACTS = "Several contacts at one instant"
    FRICTION = "Sliding, rolling and sticking"
    GRIPS = "Grips by friction"
    CAPTURES = "Captures and latches"


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
    """Put the numbers that a case computed beside those of the source."""
    return ComparedCase(case, tuple(ComparedNumber(number, values[number.key]) for number in case.numbers))
