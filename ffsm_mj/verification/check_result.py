"""Result of a check: its worst residual and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

TRUNCATION_CHECKS = ("energy", "linear momentum", "angular momentum", "heat of sliding")
"""Checks that may fail by the truncation of the step."""
LEAST_ORDER = 2.5
"""Least power of the step with which truncation falls: of order four, and three where a stiff force is integrated."""


@dataclass(frozen=True)
class Truncation:
    """The residual of a check at the step of the run and at shorter ones, from the same logged states.

    Attributes:
        step_s: Step of the run.
        residual: Residual at that step, in the unit of the check.
        half: The same at half the step.
        left: Residual without truncation.
        bound: Bound on the error of ``left``.
        order: Power of the step with which the residual of most steps falls; None if too few show one. That of the
            methods is four.
        alone: Whether truncation alone makes the check fail: without it, it passes.
    """

    step_s: float
    residual: float
    half: float
    left: float
    bound: float
    order: float | None
    alone: bool

    def sentence(self, unit: str) -> str:
        """Text such as ``truncation: 6e-09 J at 5 ms, 4e-10 J at 2.5 ms``."""
        step, half = f"{1e3 * self.step_s:g} ms", f"{0.5e3 * self.step_s:g} ms"
        head = "truncation" if self.alone else "not truncation alone"
        rest = "" if self.alone else f", {self.left:.1e} {unit} without, known to {self.bound:.1e} {unit}"
        if self.order is not None and self.order < LEAST_ORDER:
            rest = f"; it falls with the power {self.order:.1f} of the step, truncation with 4"
        return f"{head}: {self.residual:.1e} {unit} at {step}, {self.half:.1e} {unit} at {half}{rest}"


@dataclass(frozen=True)
class Check:
    """Result of one check over one run.

    Attributes:
        name: Name of the check.
        subsystem: ``total``, ``robot`` or ``objects``.
        component: Component of the worst residual, such as ``T``, ``P_x`` to ``L_z``, ``gap`` or ``impact 1``.
        residual: Largest magnitude of the residual in a window of the run.
        time_s: Time of the largest residual.
        tolerance: Allowed magnitude: the relative tolerance times (1 + scale).
        unit: Unit of both.
        drift: Largest magnitude since the first sample; equals ``residual`` in a run of one window.
        truncation: Share of truncation in a residual that is too large; None if it was not analysed or is unknown.
    """

    name: str
    subsystem: str
    component: str
    residual: float
    time_s: float
    tolerance: float
    unit: str
    drift: float
    truncation: Truncation | None = None

    @property
    def may_be_truncation(self) -> bool:
        """Whether it fails and the truncation of the step may be the reason."""
        return not self.passes and self.name in TRUNCATION_CHECKS and math.isfinite(self.residual)

    @property
    def fails_by_truncation(self) -> bool | None:
        """Whether it fails by the truncation of the step alone: it passes with a shorter step or ``accuracy``.

        None if the truncation was not analysed, so that there is no verdict.
        """
        if not self.may_be_truncation:
            return False
        return self.truncation.alone if self.truncation is not None else None

    @property
    def passes(self) -> bool:
        """Whether the residual is within the tolerance; a residual that is not a number fails."""
        return bool(self.residual <= self.tolerance)


def all_by_truncation(checks: Iterable[Check]) -> bool | None:
    """Whether checks fail, all of them by the truncation of the step alone; None if that is not known."""
    verdicts = {check.fails_by_truncation for check in checks if not check.passes}
    if not verdicts or False in verdicts:
        return False
    return None if None in verdicts else True


def worst_check(checks: Sequence[Check], noun: str = "checks") -> str:
    """How many checks pass, and the one that is closest to its tolerance or exceeds it most; empty without checks.

    Args:
        checks: Results of the checks.
        noun: What they are, where they are not all checks of a run.
    """
    if not checks:
        return ""
    worst = max(checks, key=lambda check: share_of(check.residual, check.tolerance))
    broken = [check for check in checks if not check.passes]
    alone = all_by_truncation(checks)
    fate = "fail by the truncation of the step alone" if alone else "FAILED"
    fate += " (truncation: not analysed)" if alone is None else ""
    result = f"{len(broken)} of {len(checks)} {noun} {fate}" if broken else f"all {len(checks)} {noun} pass"
    near = f"{worst.residual:.1e} {worst.unit} of {worst.tolerance:.1e} allowed"
    return f"{result}; worst: {worst.name} of {worst.subsystem}, {near}"


def share_of(size: float, allowed: float) -> float:
    """Size over what is allowed; infinite if it is not a number, and if anything is there where nothing is allowed."""
    if allowed <= 0.0:
        return math.inf if size else 0.0
    share = size / allowed
    return math.inf if math.isnan(share) else share
