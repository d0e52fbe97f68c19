"""Allowed error of a step for a requested accuracy, so that a run passes its checks."""

from __future__ import annotations

from typing import Any

from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.step_error import StepError
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.actuators import has_servos
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.simulation.step_control import MOST_PARTS, StepControl
from ffsm_mj.tolerances import EPSILON, RESOLVED_STEP, STIFF_STEP
from ffsm_mj.verification.residuals import STRETCH_STEPS

_SHARE = 0.5
"""Of what a check allows, for the largest of a step's errors of energy, P and L of the robot, and of the objects, together.

Errors of many steps add up to less than their sum, so a run is well within what the checks allow.
"""

_OF_SERVOS = 1e-9
"""Accuracy of a run with servos whose steps do not resolve them: that of the checks."""
_ROUNDING = 20.0 * EPSILON
"""Relative error of a sub-step that is rounding: those of a transient are too short for the budget.

It is the sum of three, of energy, P and L, each a difference of sums of a dozen terms: 2.1e-15 is seen in a robot of 500 kg.
"""
_TRANSIENT_PARTS, _MOST_IMPLICIT_PARTS = 400.0, 1 << 16
"""Sub-steps of the time in which the fastest servo decays, while it does, and the largest number of a step."""


def step_control(
    scenario: ScenarioConfig, system: System, data: Any, balance: Balance, motion: Motion
) -> StepControl | None:
    """What cuts the steps of a run, or of its replay; None where the scenario asks for no accuracy, and no servo needs it.

    Servos that are too fast for explicit steps make those of the motion implicit.

    Args:
        scenario: What is asked for.
        system: Robot and objects.
        data: Their state.
        balance: Enters what the efforts do in a step.
        motion: Motion of the system.

    Raises:
        ScenarioFaults: Something in the models breaks conservation, by which the error of a step is measured.
    """
    accuracy, parts = scenario.accuracy, MOST_PARTS
    if has_servos(system.mj):
        mechanical, fastest = StiffActuators(system.mj, data, motion.response).fastest()
        of_step = scenario.time_step_s * mechanical
        if of_step > STIFF_STEP:  # activations are known functions of the time, or no part of Newton's matrix
            motion.make_implicit()
            parts = max(parts, min(_MOST_IMPLICIT_PARTS, round(_TRANSIENT_PARTS * of_step)))
        of_step = scenario.time_step_s * max(mechanical, fastest)
        # Where no balance can tell the error, steps are as long as the scenario says.
        if accuracy is None and of_step > RESOLVED_STEP and not system.faults:
            accuracy = _OF_SERVOS
    if accuracy is None:
        return None
    if system.faults:
        why = f"nothing is conserved that could tell the error of a step ({system.faults[0]}); leave accuracy out"
        raise ScenarioFaults([Fault(why, ("accuracy",))])
    # The checks judge the sum of the errors of so many steps, whatever their length.
    steps = float(STRETCH_STEPS)
    if scenario.accuracy is None:
        steps = min(steps, scenario.duration_s / scenario.time_step_s)
    budget = _SHARE * accuracy / steps
    least = _ROUNDING if motion.stiff is not None else 0.0
    return StepControl(budget, scenario.time_step_s, StepError(system, data, balance), parts, least)
