"""Checks of a run recomputed with shorter steps from the same logged states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, TRUNCATION_CHECKS, CheckAccumulator, Tolerance
from ffsm_mj.verification.truncation import Truncation

_SAME = 0.5
"""A logged residual agrees with that of the states if they differ by less than this fraction of the tolerance."""


@dataclass(frozen=True)
class Refined:
    """Checks of energy and momenta recomputed from logged states: at the step of the run, at half of it, without truncation.

    Attributes:
        step_s: Step of the run.
        states: Checks with the residuals at the step of the run.
        half: Checks with the residuals at half the step.
        without: Checks with the residuals extrapolated to zero step.
    """

    step_s: float
    states: CheckAccumulator
    half: CheckAccumulator
    without: CheckAccumulator

    def judged(self, checks: tuple[Check, ...], tolerance: Tolerance) -> tuple[Check, ...]:
        """The checks; failing ones of energy and momenta with their share of truncation."""
        states, half, without = (
            {(check.name, check.subsystem): check for check in accumulator.checks((), tolerance)}
            for accumulator in (self.states, self.half, self.without)
        )
        judged = []
        for check in checks:
            key = check.name, check.subsystem
            if check.passes or check.name not in TRUNCATION_CHECKS or key not in without:
                judged.append(check)
                continue
            # If the logged residual disagrees with the states, the check fails for another reason than the step.
            same = abs(check.residual - states[key].residual) <= _SAME * check.tolerance + 1e-6 * check.residual
            alone = same and without[key].passes
            found = Truncation(self.step_s, check.residual, half[key].residual, without[key].residual, alone)
            judged.append(replace(check, truncation=found))
        return tuple(judged)


def explained(checks: tuple[Check, ...], tolerance: Tolerance, refined: Callable[[], Refined | None]) -> tuple[Check, ...]:
    """Checks with the share of truncation in failing ones; replays only if truncation could explain a failure.

    Failures at tolerances below the default are not explained: residuals there are rounding as much as truncation.

    Args:
        checks: The checks.
        tolerance: Tolerance of the checks.
        refined: Recomputes the checks with shorter steps; returns None if the log does not allow it.
    """
    own = tolerance if isinstance(tolerance, Mapping) else dict.fromkeys(TRUNCATION_CHECKS, tolerance)
    judged = [name for name in TRUNCATION_CHECKS if own.get(name, DEFAULT_TOLERANCE) >= DEFAULT_TOLERANCE]
    if not any(check.name in judged and not check.passes and math.isfinite(check.residual) for check in checks):
        return checks
    found = refined()
    return found.judged(checks, tolerance) if found is not None else checks


def refined(log: RunLog) -> Refined | None:
    """The checks of a log with shorter steps; None where nothing can be replayed.

    Replay is a higher layer than verification, so it is imported at run time.
    """
    made: Refined | None = import_module("ffsm_mj.replay.truncation").refined(log)
    return made
