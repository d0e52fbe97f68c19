"""Output of ``ffsm analyze``: the verification of a run from its log, as text and as plain data."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import summary
from ffsm_mj.analysis.summary import truncation_data
from ffsm_mj.errors import one_line, plural
from ffsm_mj.log.run_folder import SUMMARY
from ffsm_mj.report.check_report import check_table, no_verdict, truncation_lines, verdict
from ffsm_mj.report.impact_velocities import velocity_table
from ffsm_mj.report.momentum_report import momentum_table
from ffsm_mj.report.record_tables import MOST_ROWS, export_command, impact_table
from ffsm_mj.report.run_report import details, headline
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import Tolerance
from ffsm_mj.verification.model_checks import ReplayResult
from ffsm_mj.verification.truncation import ExplainedChecks

SENSITIVITY_KEY = "sensitivity"
"""Key of what ``ffsm run`` found for the ``uncertainties`` of a scenario, in ``summary.json``."""
_MOST_SENTENCES = 50


def verification(run: Run, again: ReplayResult, explained: ExplainedChecks, tolerance: Tolerance) -> str:
    """Output of ``ffsm analyze``: checks recomputed from the states in the log.

    Args:
        run: The run.
        again: Its replay.
        explained: All checks from the replay.
        tolerance: Their tolerance.
    """
    damage = damage_of(run, again)
    impacts = impact_table(run.impacts)
    if not run.impacts and (damage or not run.complete):
        impacts += " in the readable part"
    elif len(run.impacts) > MOST_ROWS:
        impacts += f"\n  every impact: {export_command(run, 'impacts')}"
    parts = [headline(run) + (" - DAMAGED LOG, see the end" if damage else ""), impacts, velocity_table(run)]
    parts += [*details(run), momentum_table(run)]
    checks = explained.checks
    if run.conservative or checks:
        parts.append(check_table(checks))
    if not run.conservative:
        fault = one_line(run.why_not_conservative)
        parts.append(f"energy and momenta are not checked, the run is not conservative: {fault}")
    if checks:
        left = " in the readable part" if damage else ""
        lines = [*truncation_lines(run, checks), *filter(None, [no_verdict(explained, tolerance)])]
        parts.append("\n".join([verdict(run, checks) + left, *lines]))
    parts.append(agreement(again))
    parts.append("\n".join(stated_sensitivity(run)))
    if not run.complete:
        parts.append("incomplete: the log breaks off before the end of the run")
    if run.note:
        parts.append(f"note: {run.note}")
    if damage:
        parts.append(f"damaged: {damage}")
    return "\n\n".join(part for part in parts if part)


def agreement(again: ReplayResult) -> str:
    """One line: whether the columns of the log agree with its states; one more line per difference if not."""
    if again.obstacle:
        why = f"nothing can be recomputed ({one_line(again.obstacle)})"
        return f"NOT VERIFIED: {why}; the checks use the logged balances"
    worst = sorted(again.worst.values(), key=lambda one: -one.excess)
    if not worst:
        return "NOT VERIFIED: nothing of the log could be replayed; see its damage below"
    if again.agrees:
        of = f"{plural(again.numbers, 'number')} of {plural(again.samples, 'sample')}"
        return f"columns agree with states ({of}); worst difference: {_difference(worst[0])}"
    return "COLUMNS DO NOT AGREE WITH STATES:" + "".join(f"\n  {_difference(one)}" for one in worst if not one.passes)


def _difference(worst: Discrepancy) -> str:
    unit = f" {worst.unit}" if worst.unit else ""
    return f"{worst.size:.1e}{unit} in {one_line(worst.what)} at {worst.time_s:.3f} s (allowed {worst.allowed:.1e})"


def damage_of(run: Run, again: ReplayResult) -> str:
    """Damage of the log: unreadable bytes, gaps in the times of its samples, and what cannot be verified for it."""
    gaps = "" if again.gaps in run.damage else again.gaps
    to_s = again.verified_to_s
    left = (
        "" if math.isinf(to_s) else f"not replayed from {to_s:.9g} s on, as lost events may have changed contacts or grasps"
    )
    if run.log.is_doubtful and (not math.isinf(to_s) or not again.numbers):
        left = "not replayed, as the models or settings in it may be damaged"
    return "; ".join(part for part in (run.damage, gaps, left) if part)


def verification_data(run: Run, again: ReplayResult, checks: Sequence[Check]) -> dict[str, Any]:
    """The content of :func:`verification` as plain data."""
    return {
        "summary": summary(run, checks),
        "checks": [_check_data(check) for check in checks],
        "states": {
            "agree": again.agrees,
            "obstacle": again.obstacle,
            "samples": again.samples,
            "numbers": again.numbers,
            "worst": {name: _difference_data(worst) for name, worst in again.worst.items()},
        },
        "sensitivity": stated_sensitivity(run),
        "complete": run.complete,
        "note": run.note,
        "damage": damage_of(run, again),
    }


def json_text(data: Any) -> str:
    """Indented JSON text of plain data."""
    return json.dumps(_finite(data), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _check_data(check: Check) -> dict[str, Any]:
    return {
        "check": check.name,
        "of": check.subsystem,
        "component": check.component,
        "residual": check.residual,
        "unit": check.unit,
        "time_s": check.time_s,
        "tolerance": check.tolerance,
        "passes": check.passes,
        "drift": check.drift,
        "fails_by_truncation": check.fails_by_truncation,
        "truncation": truncation_data(check.truncation),
    }


def _difference_data(worst: Discrepancy) -> dict[str, Any]:
    return {
        "in": worst.what,
        "difference": worst.size,
        "allowed": worst.allowed,
        "unit": worst.unit,
        "time_s": worst.time_s,
    }


def stated_sensitivity(run: Run) -> list[str]:
    """Sentences of ``summary.json`` beside the log of a run; none where there are none. They are not recomputed."""
    if run.path is None:
        return []
    try:
        summary: Any = json.loads((run.path.parent / SUMMARY).read_text(encoding="utf-8"))
        sentences = summary[SENSITIVITY_KEY]["sentences"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
    if not isinstance(sentences, list):
        return []
    return [one_line(sentence) for sentence in sentences[:_MOST_SENTENCES] if isinstance(sentence, str)]
