"""The checks of a run as they would be with shorter steps from the same logged states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, STEP_LAWS, Check, CheckAccumulator, Tolerance
from ffsm_mj.verification.truncation import Truncation

_SAME = 0.5
"""A residual in the log is that of its states when the two differ by less than this share of what is allowed."""


@dataclass(frozen=True)
class Refined:
    """Energy and momenta of a run from its states: as they are, at half the step, and without truncation.

    Attributes:
        step_s: Step of the run.
        states: By what the states say.
        half: With the residuals that steps of half the duration leave.
        without: With those that are left as steps become short.
    """

    step_s: float
    states: CheckAccumulator
    half: CheckAccumulator
    without: CheckAccumulator

    def judged(self, checks: tuple[Check, ...], tolerance: Tolerance) -> tuple[Check, ...]:
        """The same checks; those of energy and momenta that fail say what of that is truncation."""
        states, half, without = (
            {(check.name, check.subsystem): check for check in audit.checks((), tolerance)}
            for audit in (self.states, self.half, self.without)
        )
        judged = []
        for check in checks:
            key = check.name, check.subsystem
            if check.passes or check.name not in STEP_LAWS or key not in without:
                judged.append(check)
                continue
            # A log that says otherwise than its states fails for another reason than its step.
            same = abs(check.residual - states[key].residual) <= _SAME * check.tolerance + 1e-6 * check.residual
            alone = same and without[key].passes
            found = Truncation(self.step_s, check.residual, half[key].residual, without[key].residual, alone)
            judged.append(replace(check, truncation=found))
        return tuple(judged)


def explained(checks: tuple[Check, ...], tolerance: Tolerance, refined: Callable[[], Refined | None]) -> tuple[Check, ...]:
    """Checks with what of those that fail is truncation; nothing is made again where none fails that it could explain.

    Tolerances below the default are not explained: what is left of a step there is rounding as much as truncation.

    Args:
        checks: The checks.
        tolerance: By which they were judged.
        refined: Makes the checks with shorter steps; None where the log does not allow it.
    """
    own = tolerance if isinstance(tolerance, Mapping) else dict.fromkeys(STEP_LAWS, tolerance)
    judged = [name for name in STEP_LAWS if own.get(name, DEFAULT_TOLERANCE) >= DEFAULT_TOLERANCE]
    if not any(check.name in judged and not check.passes and math.isfinite(check.residual) for check in checks):
        return checks
    found = refined()
    return found.judged(checks, tolerance) if found is not None else checks


def refined(log: RunLog) -> Refined | None:
    """The checks of a log with shorter steps; None where nothing can be replayed.

    The replay stands above this floor: it is bound when it is needed.
    """
    made: Refined | None = import_module("ffsm_mj.replay.truncation").refined(log)
    return made
