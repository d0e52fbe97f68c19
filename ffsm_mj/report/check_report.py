"""Checks of a run as text: a table, the share of truncation, and the result in one line."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.analysis.run import Run
from ffsm_mj.invocation import command
from ffsm_mj.report.text_table import table
from ffsm_mj.verification.checks import Check, Tolerance

_STEP_HINT = (
    "\n  these checks fail by the truncation of the step alone: write 'accuracy: 1e-9' in the scenario, use a shorter"
    " time_step_s, or state an acceptable tolerance with"
)


def conservation_table(checks: Sequence[Check]) -> str:
    """One row per check: worst residual, component, time, tolerance and result."""
    if not checks:
        return "no samples: nothing to verify"
    return table(
        ("check", "of", "worst residual", "unit", "in", "at s", "allowed", ""),
        (
            (
                check.name,
                check.subsystem,
                f"{check.residual:.1e}",
                check.unit,
                check.component,
                f"{check.time_s:.3f}",
                f"{check.tolerance:.1e}",
                "passes" if check.passes else "truncation" if check.fails_by_truncation else "FAILED",
            )
            for check in checks
        ),
        keys=2,
    )


def truncation_lines(checks: Sequence[Check]) -> str:
    """Share of truncation in each residual that is too large, and a remedy; empty if there is none."""
    shares = [
        f"\n  {check.name} of {check.subsystem}, {check.truncation.sentence(check.unit)}"
        for check in checks
        if check.truncation
    ]
    return "".join(shares) + (
        f"{_STEP_HINT} '{command('analyze', '--tolerance', '1e-8')}'" if fail_by_truncation(checks) else ""
    )


def verdict(run: Run, checks: Sequence[Check]) -> str:
    """One line: which checks failed, or that all passed."""
    broken = [f"{check.name} of {check.subsystem}" for check in checks if not (check.passes or check.fails_by_truncation)]
    short = [f"{check.name} of {check.subsystem}" for check in checks if check.fails_by_truncation]
    found = [("FAILED", broken), ("checks fail by the truncation of the step alone", short)]
    words = "; ".join(f"{head}: {', '.join(names)}" for head, names in found if names) or f"all {len(checks)} checks pass"
    return f"{words} over {run.digest.end_s:g} s ({run.digest.samples} samples)"


def any_check_failed(run: Run, tolerance: Tolerance) -> bool:
    """Whether any check of the run fails."""
    return not all(check.passes for check in run.checks(tolerance))


def fail_by_truncation(checks: Sequence[Check]) -> bool:
    """Whether checks fail, all of them by truncation of the step alone."""
    failing = [check for check in checks if not check.passes]
    return bool(failing) and all(check.fails_by_truncation for check in failing)
