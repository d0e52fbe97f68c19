"""The seed paper: its four simulations, each number that it prints."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from ffsm_mj.assembly.prepare import prepare, uninterrupted
from ffsm_mj.reproduction.cases import SCENARIOS, paper_case
from ffsm_mj.reproduction.measure import measure
from ffsm_mj.reproduction.printed import PRINTED, PrintedNumber
from ffsm_mj.validation.case import Origin, Topic, ValidationCase, Values

_SOURCE = (
    "Nekoo, Sharf & Ollero 2024, Free-floating space manipulator impacting a floating object: Modeling and output SDRE"
    " controller design, Aerospace Science and Technology 108945, section {}"
)
_TITLES = {
    "baseline": "an arm hits a floating box",
    "no-actuation": "the arm is off after the impact",
    "free-flying": "thrusters hold the base in the pause",
    "slow-impact": "a slow impact",
}


_SPREADS = {
    ("baseline", "smallest_error"): 3e-4,
    ("baseline", "final_error"): 1e-2,
    ("baseline", "before_2"): 1e-4,
    ("baseline", "slope_3"): 1e-4,
    ("baseline", "after_1"): 1e-4,
    ("baseline", "after_4"): 2e-4,
    ("baseline", "after_5"): 2e-4,
    ("free-flying", "final_error_mm"): 0.1,
    ("slow-impact", "impulse"): 5e-4,
}
"""How far some of our values move over the step sizes of the study in docs/reproduction.md, which computes it."""


def _values(scenario: str) -> Values:
    prepared = prepare(scenario, paper_case(scenario).overrides)
    return measure(uninterrupted(prepared.run()), prepared.system)


def _number(printed: PrintedNumber) -> PrintedNumber:
    spread = _SPREADS.get((printed.scenario, printed.key))
    if spread is None:
        return printed
    why = f"half a unit of the last digit, and {spread:g} by which ours moves with the step size"
    return replace(printed, tolerance=printed.allowed + spread, why=why)


def _case(scenario: str) -> ValidationCase:
    numbers = [printed for printed in PRINTED if printed.scenario == scenario]
    return ValidationCase(
        f"paper-{scenario}",
        f"Seed paper: {_TITLES[scenario]}",
        Topic.SEED_PAPER,
        Origin.PUBLISHED,
        _SOURCE.format(numbers[0].section),
        f"Scenario `{scenario}` as shipped, RK4 and control at 1 ms, e = 1.",
        tuple(_number(printed) for printed in numbers),
        partial(_values, scenario),
        "The paper declares the impact at the first control step with the tip within 1 mm of the face."
        " [Reproduction](reproduction.md) has the study of step sizes.",
    )


CASES = tuple(_case(scenario) for scenario in SCENARIOS)
