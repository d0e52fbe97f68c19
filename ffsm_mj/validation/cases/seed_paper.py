"""The seed paper: its four simulations, each number that it prints."""

from __future__ import annotations

from functools import partial

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.reproduction.cases import SCENARIOS, paper_case
from ffsm_mj.reproduction.measure import measure
from ffsm_mj.reproduction.printed import PRINTED, PrintedNumber
from ffsm_mj.validation.case import Number, Origin, ValidationCase, Values
from ffsm_mj.validation.scene import uninterrupted

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


_MOVES = "moves by as much with the step size or with the step at which the impact is declared; see below"


def _values(scenario: str) -> Values:
    prepared = prepare(scenario, paper_case(scenario).overrides)
    return measure(uninterrupted(prepared.run()), prepared.system)


def _number(printed: PrintedNumber) -> Number:
    why = "one unit of the last digit where the paper says approximately" if printed.kind == "approximate" else ""
    return Number(
        printed.key,
        f"{printed.quantity}, {printed.unit}",
        printed.text,
        printed.open,
        why,
        at_most=printed.kind == "below",
        known=printed.why or _MOVES,
    )


def _case(scenario: str) -> ValidationCase:
    numbers = [printed for printed in PRINTED if printed.scenario == scenario]
    return ValidationCase(
        f"paper-{scenario}",
        f"Seed paper: {_TITLES[scenario]}",
        Origin.PUBLISHED,
        _SOURCE.format(numbers[0].section),
        f"Scenario `{scenario}` as shipped, RK4 and control at 1 ms, e = 1.",
        tuple(_number(printed) for printed in numbers),
        partial(_values, scenario),
        "The paper declares the impact at the first control step with the tip within 1 mm of the face."
        " [Reproduction](reproduction.md) gives the reason for each number that differs; it adds to the"
        " tolerance how far the"
        " computed value moves with the step size.",
    )


CASES = tuple(_case(scenario) for scenario in SCENARIOS)
