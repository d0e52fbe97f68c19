"""Printed against measured, over step sizes.

The tolerance is what the print leaves open plus how far our own value moves when the step size does. Nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ffsm_mj.comparison import ComparedNumber
from ffsm_mj.reproduction.cases import SCENARIOS, STEPS_S, THRESHOLD, Case, Result, paper_case
from ffsm_mj.reproduction.measure import Measures
from ffsm_mj.reproduction.printed import PRINTED, PrintedNumber


@dataclass(frozen=True)
class StudiedNumber(ComparedNumber):
    """One printed number beside ours at 1 ms, with the study of what the paper leaves open.

    Attributes:
        number: The printed number.
        threshold: Ours where the impact is declared as the paper does, if that run was made.

    ``spread`` is the largest minus the smallest value over the step sizes and over both ways of declaring the impact.
    """

    number: PrintedNumber
    threshold: float | None = None


def judge(results: Mapping[Case, Result]) -> tuple[StudiedNumber, ...]:
    """Every printed number beside ours, in the paper's order."""
    study = {name: [results[case].values for case in decided_cases(name)] for name in SCENARIOS}
    declared = results[THRESHOLD].values
    return tuple(_judge(printed, study[printed.scenario], declared) for printed in PRINTED)


def decided_cases(scenario: str) -> tuple[Case, ...]:
    """The step-size study in which the controller decides at every step, the paper's 1 ms first."""
    return tuple(paper_case(scenario, step, step) for step in STEPS_S)


def _judge(printed: PrintedNumber, study: Sequence[Measures], declared: Measures) -> StudiedNumber:
    values = [values[printed.key] for values in study]
    threshold = declared.get(printed.key) if printed.scenario == THRESHOLD.scenario else None
    every = values if threshold is None else [*values, threshold]
    return StudiedNumber(printed, values[0], max(every) - min(every), threshold)
