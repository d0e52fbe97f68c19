"""The paper behind this project: its four simulations, ``seed-paper`` on the command line, with a page of their own."""

from __future__ import annotations

from functools import partial

from ffsm_mj.validation.case import Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.cases.seed_paper.printed import PRINTED
from ffsm_mj.validation.cases.seed_paper.runs import SCENARIOS, paper_run, perform

GROUP = "seed-paper"
PAGE = "reproduction.md"
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


def _values(scenario: str) -> Values:
    return perform(paper_run(scenario)).values


def _case(scenario: str) -> ValidationCase:
    numbers = tuple(printed for printed in PRINTED if printed.scenario == scenario)
    return ValidationCase(
        f"paper-{scenario}",
        f"Seed paper: {_TITLES[scenario]}",
        Topic.SEED_PAPER,
        Origin.PUBLISHED,
        _SOURCE.format(numbers[0].section),
        f"Scenario `{scenario}` as shipped, RK4 and control at 1 ms, e = 1.",
        numbers,
        partial(_values, scenario),
        "The paper declares the impact at the first control step with the tip within 1 mm of the face."
        " A tolerance includes how far ours moves with the step size.",
        page=PAGE,
    )


CASES = tuple(_case(scenario) for scenario in SCENARIOS)
RUNS = {f"paper-{scenario}": paper_run(scenario) for scenario in SCENARIOS}
"""Runs of the cases by name."""
