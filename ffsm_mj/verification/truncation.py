"""Share of truncation in a failing check; it decreases with the fourth power of the step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from ffsm_mj.verification.check_result import LEAST_ORDER, TRUNCATION_CHECKS, Check, Truncation
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, RESIDUALS, CheckAccumulator, Tolerance

_AGREES = 0.5
"""A logged residual agrees with that of the states if they differ by less than this fraction of the tolerance."""

ENTRIES = tuple(dict.fromkeys((name, subsystem) for name, subsystem, _ in RESIDUALS))
"""Check and subsystem of each entry of the residuals of a step: a number or a vector."""


def has_question(checks: Iterable[Check], tolerance: Tolerance) -> bool:
    """Whether a check fails that may fail by truncation, so that an analysis has something to find.

    At tolerances below the default there is none: residuals there are rounding as much as truncation.
    """
    allowed = tolerance if isinstance(tolerance, Mapping) else dict.fromkeys(TRUNCATION_CHECKS, tolerance)
    return any(
        check.may_be_truncation and allowed.get(check.name, DEFAULT_TOLERANCE) >= DEFAULT_TOLERANCE for check in checks
    )


@dataclass(frozen=True)
class ExplainedChecks:
    """Results of all checks of a run, and why they fail.

    Attributes:
        checks: Results; those that fail and may do so by truncation with its share.
        obstacle: Why it is not known whether they fail by truncation; empty if it is, or if that is in question for none.
    """

    checks: tuple[Check, ...]
    obstacle: str = ""


@dataclass(frozen=True)
class Refined:
    """Checks of energy and momenta recomputed from logged states: at the step of the run, at half of it, without truncation.

    Attributes:
        step_s: Step of the run.
        states: Checks with the residuals at the step of the run.
        half: Checks with the residuals at half the step.
        without: Checks with the residuals extrapolated to zero step.
        bounds: Bound on the error of the latter by check and subsystem, in the unit of the check; those that were analysed.
        orders: Power of the step with which residuals of most steps fall; those of which enough steps show one.
    """

    step_s: float
    states: CheckAccumulator
    half: CheckAccumulator
    without: CheckAccumulator
    bounds: Mapping[tuple[str, str], float]
    orders: Mapping[tuple[str, str], float]


@dataclass(frozen=True)
class TruncationAnalysis:
    """Result of an analysis of the truncation.

    Attributes:
        refined: Checks recomputed with shorter steps; None without a verdict.
        obstacle: Why there is no verdict; empty if there is one.
    """

    refined: Refined | None
    obstacle: str = ""

    def leaves_open(self, checks: Iterable[Check]) -> bool:
        """Whether it is not known of a failing check that more than truncation is left of its residual, nor that none is."""
        if self.refined is None:
            return False
        bounds = self.refined.bounds
        left = {
            (unrefined.name, unrefined.subsystem): unrefined.residual
            for unrefined in self.refined.without.checks((), DEFAULT_TOLERANCE)
        }
        keys = {(check.name, check.subsystem): check.tolerance for check in checks if check.may_be_truncation}
        return any(abs(left[key] - allowed) < bounds[key] for key, allowed in keys.items() if key in bounds and key in left)

    def judged(self, checks: tuple[Check, ...], tolerance: Tolerance) -> tuple[Check, ...]:
        """The checks; those of which truncation is in question with its share."""
        if self.refined is None or not has_question(checks, tolerance):
            return checks
        refined = self.refined
        states, half, without = (
            {(check.name, check.subsystem): check for check in accumulator.checks((), tolerance)}
            for accumulator in (refined.states, refined.half, refined.without)
        )
        judged = []
        for check in checks:
            key = check.name, check.subsystem
            if not has_question((check,), tolerance) or key not in refined.bounds:
                judged.append(check)
                continue
            # If the logged residual disagrees with the states, the check fails for another reason than the step.
            agrees = abs(check.residual - states[key].residual) <= _AGREES * check.tolerance + 1e-6 * check.residual
            left, bound = without[key].residual, refined.bounds[key]
            # What falls more slowly than truncation does is no truncation, though halvings take it off as well.
            order = refined.orders.get(key)
            alone = agrees and left + bound <= without[key].tolerance and (order is None or order >= LEAST_ORDER)
            share = Truncation(refined.step_s, check.residual, half[key].residual, left, bound, order, alone)
            judged.append(replace(check, truncation=share))
        return tuple(judged)
