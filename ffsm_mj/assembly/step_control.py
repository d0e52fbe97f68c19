"""Allowed error of a step for a requested accuracy, so that a run passes its checks."""

from __future__ import annotations

from typing import Any

from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.step_error import StepError
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.simulation.step_control import StepControl
from ffsm_mj.verification.residuals import STRETCH_STEPS

_SHARE = 0.5
"""Of what a check allows, for the largest of a step's errors of energy, P and L of the robot, and of the objects, together.

Errors of many steps add up to less than their sum, so a run is well within what the checks allow.
"""


def step_control(scenario: ScenarioConfig, system: System, data: Any, balance: Balance) -> StepControl | None:
    """What cuts the steps of a run, or of its replay; None where the scenario asks for no accuracy.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.
        balance: Enters what the efforts do in a step.

    Raises:
        ScenarioFaults: Something in the models breaks conservation, by which the error of a step is measured.
    """
    if scenario.accuracy is None:
        return None
    if system.faults:
        why = f"nothing is conserved that could tell the error of a step ({system.faults[0]}); leave accuracy out"
        raise ScenarioFaults([Fault(why, ("accuracy",))])
    # The checks judge the sum of the errors of so many steps, whatever their length.
    budget = _SHARE * scenario.accuracy / STRETCH_STEPS
    return StepControl(budget, scenario.time_step_s, StepError(system, data, balance))
