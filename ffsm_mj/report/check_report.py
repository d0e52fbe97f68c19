"""Checks of a run as text: a table, the share of truncation, and the result in one line."""

from __future__ import annotations

from collections.abc import Sequence

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import first_few, one_line, plural
from ffsm_mj.invocation import command
from ffsm_mj.log.scenario import scenario_data
from ffsm_mj.report.terminal import table
from ffsm_mj.verification.check_result import Check, all_by_truncation
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance
from ffsm_mj.verification.truncation import ExplainedChecks, has_question

_STEP_HINT = (
    "  these checks fail by the truncation of the step alone: {divide}use a shorter time_step_s,"
    " or state an acceptable tolerance"
)
_FINEST = 1e-9
"""Least accuracy that a scenario may ask for."""


def check_table(checks: Sequence[Check]) -> str:
    """One row per check, those that fail first: worst residual, component, time, tolerance and result."""
    if not checks:
        return "no samples: nothing to verify"
    rows = (
        (
            check.name,
            check.subsystem,
            f"{check.residual:.1e}",
            check.unit,
            check.component,
            f"{check.time_s:.3f}",
            f"{check.tolerance:.1e}",
            _result(check),
        )
        for check in sorted(checks, key=lambda check: check.passes)
    )
    return table(("check", "of", "worst", "unit", "in", "at s", "allowed", ""), rows, spare=("in", "at s"))


def _result(check: Check) -> str:
    return "passes" if check.passes else "truncation" if check.fails_by_truncation else "FAILED"


def truncation_lines(run: Run, checks: Sequence[Check]) -> list[str]:
    """Share of truncation in each residual that is too large, and a remedy; empty if there is none."""
    lines = [
        f"  {check.name} of {check.subsystem}, {check.truncation.sentence(check.unit)}"
        for check in checks
        if check.truncation
    ]
    return [*lines, *([step_hint(run)] if all_by_truncation(checks) else [])]


def no_verdict(explained: ExplainedChecks, tolerance: Tolerance) -> str:
    """Why it is not known whether checks fail by truncation, in one line; empty if it is."""
    if not any(check.fails_by_truncation is None for check in explained.checks):
        return ""
    why = explained.obstacle
    if not has_question(explained.checks, tolerance):
        why = f"tolerances below {DEFAULT_TOLERANCE:g} are not"
    return f"  truncation: not analysed{why and f' ({one_line(why)})'}"


def step_hint(run: Run) -> str:
    """What to do about checks that fail by truncation alone: what the scenario does not say already."""
    accuracy = scenario_data(run.log).get("accuracy") if run.log.header.scenario else None
    finest = accuracy is not None and accuracy <= _FINEST
    divide = "" if finest else "write 'accuracy: 1e-9' in the scenario, "
    return f"{_STEP_HINT.format(divide=divide)}: {command('analyze', '--tolerance', '1e-8')}"


def left_to_replay(run: Run) -> str:
    """The check that ``ffsm analyze`` has and ``ffsm run`` has not, as it needs a replay; empty without contact forces."""
    forces = run.digest.check_accumulator.has_contact_forces
    return "one more by replay (ffsm analyze): contact complementarity" if forces else ""


def verdict(run: Run, checks: Sequence[Check]) -> str:
    """One line: which checks failed, or that all passed."""
    broken = [f"{check.name} of {check.subsystem}" for check in checks if not (check.passes or check.fails_by_truncation)]
    short = [f"{check.name} of {check.subsystem}" for check in checks if check.fails_by_truncation]
    verdicts = [("FAILED", broken), ("checks fail by the truncation of the step alone", short)]
    words = "; ".join(f"{head}: {first_few(names)}" for head, names in verdicts if names) or f"all {len(checks)} checks pass"
    return f"{words} over {run.digest.end_s:g} s ({plural(run.digest.samples, 'sample')})"
