"""The checks of a run as they would be with shorter steps from the same logged states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module

from ffsm_mj.analysis.truncation import Truncation
from ffsm_mj.analysis.verdicts import DEFAULT_TOLERANCE, STEP_LAWS, Audit, Law, Tolerance
from ffsm_mj.records.run_log import RunLog

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
    states: Audit
    half: Audit
    without: Audit

    def judged(self, laws: tuple[Law, ...], tolerance: Tolerance) -> tuple[Law, ...]:
        """The same checks; those of energy and momenta that fail say what of that is truncation."""
        states, half, without = (
            {(law.name, law.party): law for law in audit.laws((), tolerance)}
            for audit in (self.states, self.half, self.without)
        )
        judged = []
        for law in laws:
            key = law.name, law.party
            if law.holds or law.name not in STEP_LAWS or key not in without:
                judged.append(law)
                continue
            # A log that says otherwise than its states fails for another reason than its step.
            same = abs(law.residual - states[key].residual) <= _SAME * law.tolerance + 1e-6 * law.residual
            alone = same and without[key].holds
            found = Truncation(self.step_s, law.residual, half[key].residual, without[key].residual, alone)
            judged.append(replace(law, truncation=found))
        return tuple(judged)


def explained(laws: tuple[Law, ...], tolerance: Tolerance, refined: Callable[[], Refined | None]) -> tuple[Law, ...]:
    """Checks with what of those that fail is truncation; nothing is made again where none fails that it could explain.

    Tolerances below the default are not explained: what is left of a step there is rounding as much as truncation.

    Args:
        laws: The checks.
        tolerance: By which they were judged.
        refined: Makes the checks with shorter steps; None where the log does not allow it.
    """
    own = tolerance if isinstance(tolerance, Mapping) else dict.fromkeys(STEP_LAWS, tolerance)
    judged = [name for name in STEP_LAWS if own.get(name, DEFAULT_TOLERANCE) >= DEFAULT_TOLERANCE]
    if not any(law.name in judged and not law.holds and math.isfinite(law.residual) for law in laws):
        return laws
    found = refined()
    return found.judged(laws, tolerance) if found is not None else laws


def refined(log: RunLog) -> Refined | None:
    """The checks of a log with shorter steps; None where nothing can be replayed.

    The replay stands above this floor: it is bound when it is needed.
    """
    made: Refined | None = import_module("ffsm_mj.recount.truncation").refined(log)
    return made
