"""Summaries of a run: ``summary.json`` for scripts, one or two lines for a terminal, a small table for a notebook."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ffsm_mj.analysis.digest import Digest, TipDigest
from ffsm_mj.analysis.intervals import ContactInterval, GraspInterval
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GRASP
from ffsm_mj.errors import one_line, plural
from ffsm_mj.records.events import ImpactRecord, impact_count
from ffsm_mj.records.kinds import all_fields
from ffsm_mj.records.metadata import is_conservative, logged_models, logged_start_s, logged_task
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check, Truncation, all_by_truncation, worst_check
from ffsm_mj.verification.checks import CheckAccumulator

SCHEMA_VERSION = 3
"""Version of the schema; it is raised when a key goes or changes its meaning, not when one is added."""
_NOT_ANALYSED = "not analysed"


def tip_error(log: RunLog) -> FloatArray:
    """Distance of the tip from its target along the task's axes at every tick, m.

    Raises:
        ValueError: The scenario has no task.
    """
    task = logged_task(log.header.metadata)
    if task is None:
        raise ValueError("the scenario has no task, so there is no tip error")
    return np.asarray(np.linalg.norm(task.errors_m(log.header.layout, log.column), axis=1))


def summarise(log: RunLog, digest: Digest) -> dict[str, Any]:
    """Content of ``summary.json``, except ``checks``, ``effort`` and ``base_rotation``."""
    outcome = log.outcome
    wall = outcome.wall_s if outcome else 0.0
    end = outcome.end_s if outcome else digest.end_s
    start = logged_start_s(log.header.metadata)
    return {
        "schema_version": SCHEMA_VERSION,
        "scenario": log.header.scenario_name,
        "outcome": outcome.outcome if outcome else "incomplete",
        "message": outcome.message if outcome else "the log breaks off before the end of the run",
        **({"start_s": start} if start else {}),
        "duration_s": end,
        "steps": outcome.steps if outcome else 0,
        "sub_steps": outcome.sub_steps if outcome else 0,
        "smallest_step_s": outcome.smallest_step_s if outcome else 0.0,
        "wall_s": wall,
        "real_time_factor": (end - start) / wall if wall else 0.0,
        "law_wall_s_per_tick": outcome.law_wall_s / outcome.controller_ticks
        if outcome and outcome.controller_ticks
        else 0.0,
        "conservative": is_conservative(log.header.metadata),
        **_records(log, digest, end),
        "tip": tip_summary(digest.tip),
        "controller": {
            "ticks": outcome.controller_ticks if outcome else 0,
            "phases": [
                {"name": p.name, "kind": p.controller, "reports": dict(outcome.reports.get(p.name, {})) if outcome else {}}
                for p in log.phases
            ],
        },
        "conservation": _conservation(digest.check_accumulator),
        **logged_models(log.header.metadata),
        "versions": dict(outcome.versions) if outcome else {},
    }


def _records(log: RunLog, digest: Digest, end_s: float) -> dict[str, list[dict[str, Any]]]:
    """Lists of records by kind, contacts and grasps; a phase ends at the start of the next one."""
    contacts = {"contacts": [all_fields(contact) for contact in digest.contacts.intervals()]}
    lists = {
        kind.plural: [kind.summary(record) for record in log.records.get(kind.plural, ())]
        for kind in log.kinds
        if kind.summarised
    }
    ends = [phase.start_s for phase in log.phases[1:]] + [end_s] * bool(log.phases)
    for phase, end in zip(lists.get("phases", ()), ends, strict=True):
        phase["end_s"] = end
    grasps = [all_fields(grasp) for grasp in digest.grasps.intervals()]
    declared = {"grasps": grasps} if GRASP.name in log.header.kinds else {}
    return {"impacts": lists.pop("impacts"), **contacts, **declared, **lists}


def tip_summary(tip: TipDigest | None) -> dict[str, Any] | None:
    """Summary of the tip error; None without a task, or if an error was not finite."""
    if tip is None or not tip.finite or math.isinf(tip.best_m):
        return None
    return {
        "target_m": tip.task.target_m.tolist(),
        "min_error_m": tip.best_m,
        "min_error_time_s": tip.best_s,
        "final_error_m": tip.last_m,
        "final_speed_m_s": tip.last_m_s,
    }


def failing_checks(checks: Sequence[Check]) -> dict[str, Any]:
    """Whether all checks pass; else the failing ones, each with its share of truncation.

    A failure of which truncation may be the reason has ``truncation: not analysed`` until that is known.
    """
    failing = [
        {
            "check": check.name,
            "of": check.subsystem,
            "residual": check.residual if math.isfinite(check.residual) else None,
            "allowed": check.tolerance,
            "unit": check.unit,
            "fails_by_truncation": check.fails_by_truncation,
            "truncation": _NOT_ANALYSED if check.fails_by_truncation is None else truncation_data(check.truncation),
        }
        for check in checks
        if not check.passes
    ]
    return {"passed": not failing, "fail_by_truncation": all_by_truncation(checks), "failing": failing}


def truncation_data(truncation: Truncation | None) -> dict[str, Any] | None:
    """Truncation as plain data."""
    return None if truncation is None else {key: _finite(value) for key, value in asdict(truncation).items()}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _conservation(accumulator: CheckAccumulator) -> dict[str, float | None] | None:
    """Worst residuals since the first row, None for one that is not finite; None if conservation is not checked."""
    judged = accumulator.checks(())
    names = {
        "energy": "energy_residual_J",
        "linear momentum": "linear_momentum_residual_N_s",
        "angular momentum": "angular_momentum_residual_N_m_s",
    }
    residuals: dict[str, float | None] = {}
    for name, key in names.items():
        checks = [check for check in judged if check.name == name]
        if not checks:
            return None
        finite = all(math.isfinite(check.residual) and math.isfinite(check.drift) for check in checks)
        residuals[key] = max(check.drift for check in checks) if finite else None
    return residuals


_SHOWN = 5
_PART = "checks of rows and records"
"""Those of ``run.checks()``, which a representation shows; ``ffsm run`` counts those that need the models too."""
_LEFT = 'style="text-align:left"'


def card_text(log: RunLog, digest: Digest | None, checks: Sequence[Check]) -> str:
    """One line, and a second one with the tip if there is a task; see :func:`card_html`.

    It must be fast. Checks, contacts and tip come from the digest of the rows, which exists after a simulation; for a log it
    takes a pass over the rows, which :class:`ffsm_mj.analysis.run.Run` makes for a card only if they are few.
    """
    hits = impact_count(log.impacts)
    contacts = digest.contacts.intervals() if digest is not None else ()
    counts = [plural(hits, "impact") if hits else "no impact"]
    counts += [plural(len(contacts), "persistent contact")] if contacts else []
    line = f"<Run {log.header.scenario_name}: {'; '.join((_outcome(log), *counts, _checks(log, digest, checks, _PART)))}"
    tip = _tip(digest)
    return "\n  ".join(map(one_line, [line, f"tip {tip}"] if tip else [line])) + ">"


def card_html(log: RunLog, digest: Digest | None, checks: Sequence[Check], noun: str = _PART) -> str:
    """HTML table of outcome, impacts, contacts, grasps, checks and tip; text from the log is always escaped.

    Args:
        log: Log of the run.
        digest: Digest of its rows; None: it is not known, which the table says.
        checks: Results of its checks; empty without a digest.
        noun: What they are.
    """
    rows = {
        "outcome": [_outcome(log)],
        "impacts": _impacts(log.impacts),
        "contacts": _contacts(digest.contacts.intervals() if digest is not None else ()),
        "grasps": _grasps(digest.grasps.intervals() if digest is not None else ()),
        "checks": [_checks(log, digest, checks, noun)],
        "tip": [_tip(digest)],
    }
    body = "".join(
        f"<tr><th {_LEFT}>{head}</th><td {_LEFT}>{'<br>'.join(map(_escaped, lines))}</td></tr>"
        for head, lines in rows.items()
        if any(lines)
    )
    return f"<table><caption>{_escaped(log.header.scenario_name)}</caption>{body}</table>"


def missing(log: RunLog) -> str:
    """Damage or incompleteness of a log in one line; empty if it is complete."""
    broken_off = "" if log.outcome is not None else "incomplete: the log breaks off before the end of the run"
    return "; ".join(part for part in (f"damaged: {log.damage}" if log.damage else "", broken_off) if part)


def _escaped(text: str) -> str:
    return html.escape(one_line(text))


def _outcome(log: RunLog) -> str:
    ended = log.outcome
    if ended is None:
        return missing(log)
    ending = f"{ended.outcome} after {ended.end_s:g} s" + (f" ({ended.message})" if ended.message else "")
    return "; ".join(part for part in (ending, missing(log)) if part)


def _impacts(records: tuple[ImpactRecord, ...]) -> list[str]:
    lines = [f"{r.time_s:.6f} s: {r.geoms[0]} on {r.geoms[1]}, {r.impulse_N_s:.4g} N s" for r in records[:_SHOWN]]
    return [*lines, *_more(records, "contact")]


def _contacts(contacts: tuple[ContactInterval, ...]) -> list[str]:
    lines = []
    for one in contacts[:_SHOWN]:
        until = "to the end" if one.end_s is None else f"to {one.end_s:.6f} s"
        force = f"{one.impulse_N_s:.4g} N s, up to {one.peak_force_N:.4g} N"
        force += f", slip {one.slip_m:.4g} m" if one.slip_m else ""
        lines.append(f"{one.start_s:.6f} s {until}: {one.rule}, {force}")
    return [*lines, *_more(contacts, "contact")]


def _grasps(grasps: tuple[GraspInterval, ...]) -> list[str]:
    lines = []
    for one in grasps[:_SHOWN]:
        until = "to the end" if one.release_s is None else f"to {one.release_s:.6f} s"
        lines.append(f"{one.time_s:.6f} s {until}: {one.grasp}, {math.hypot(*one.impulse):.4g} N s at closing")
    return [*lines, *_more(grasps, "grasp")]


def _more(shown: Sequence[Any], word: str) -> list[str]:
    more = len(shown) - _SHOWN
    return [f"and {plural(more, f'more {word}')}"] if more > 0 else []


def _checks(log: RunLog, digest: Digest | None, checks: Sequence[Check], noun: str) -> str:
    if digest is None:
        return "checks not evaluated yet: checks() reads the whole log"
    conservative = is_conservative(log.header.metadata)
    lax = "" if conservative else "energy and momenta not checked, as the models are not conservative"
    if not checks:
        return lax or "no samples to check"
    return "; ".join(part for part in (worst_check(checks, noun), lax) if part)


def _tip(digest: Digest | None) -> str:
    tip = tip_summary(digest.tip) if digest is not None else None
    if tip is None:
        return ""
    best = f"{tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    return f"final error {tip['final_error_m']:.4g} m, smallest {best}"
