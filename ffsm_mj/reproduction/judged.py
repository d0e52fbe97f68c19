"""Printed against measured: difference, tolerance, verdict.

The tolerance is what the print leaves open plus how far our own value moves when the step size does. Nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from ffsm_mj.reproduction.cases import SCENARIOS, STEPS_S, THRESHOLD, Case, Result, paper_case
from ffsm_mj.reproduction.measure import Measures
from ffsm_mj.reproduction.printed import PRINTED, PrintedNumber


class Verdict(StrEnum):
    """How a printed number stands to ours."""

    AGREES = "agrees"
    CONSISTENT = "consistent"
    DIFFERS = "differs"


@dataclass(frozen=True)
class ComparedNumber:
    """One printed number beside ours.

    Attributes:
        printed: The number.
        ours: The exact run at 1 ms.
        threshold: The run with the impact declared as the paper does, where it was made.
        spread: Largest minus smallest value over the step sizes, and over both ways of declaring the impact.
    """

    printed: PrintedNumber
    ours: float
    threshold: float | None
    spread: float

    @property
    def difference(self) -> float:
        """Ours minus the paper's."""
        return self.ours - self.printed.value

    @property
    def tolerance(self) -> float:
        """What the print leaves open plus the spread."""
        return self.printed.open + self.spread

    @property
    def verdict(self) -> Verdict:
        """Within tolerance or not; ``consistent`` where the paper is approximate or gives a bound."""
        away = self.difference if self.printed.kind == "below" else abs(self.difference)
        if away > self.tolerance:
            return Verdict.DIFFERS
        return Verdict.CONSISTENT if self.printed.kind else Verdict.AGREES


def judge(results: Mapping[Case, Result]) -> tuple[ComparedNumber, ...]:
    """Every printed number beside ours, in the paper's order."""
    study = {name: [results[case].values for case in decided_cases(name)] for name in SCENARIOS}
    declared = results[THRESHOLD].values
    return tuple(_judge(printed, study[printed.scenario], declared) for printed in PRINTED)


def decided_cases(scenario: str) -> tuple[Case, ...]:
    """The step-size study in which the controller decides at every step, the paper's 1 ms first."""
    return tuple(paper_case(scenario, step, step) for step in STEPS_S)


def _judge(printed: PrintedNumber, study: Sequence[Measures], declared: Measures) -> ComparedNumber:
    values = [values[printed.key] for values in study]
    threshold = declared.get(printed.key) if printed.scenario == THRESHOLD.scenario else None
    every = values if threshold is None else [*values, threshold]
    return ComparedNumber(printed, values[0], threshold, max(every) - min(every))
