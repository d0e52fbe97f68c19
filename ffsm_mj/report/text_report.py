"""Text reports of a run for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.summary import failing_checks, truncation_data
from ffsm_mj.errors import one_line
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.facts import changed_property_lines, gravity_line
from ffsm_mj.report.json_text import json_text
from ffsm_mj.report.record_lines import record_lines
from ffsm_mj.report.text_table import table
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.checks import Check, Tolerance
from ffsm_mj.verification.replay_result import ReplayResult

_MOST_CONTACTS = 20
_STEP_HINT = (
    "\n  these checks fail by the truncation of the step alone: write 'accuracy: 1e-9' in the scenario, use a shorter"
    " time_step_s, or state an acceptable tolerance with 'ffsm analyze --tolerance'"
)


def run_report(run: Run) -> str:
    """Outcome, impacts, tip and conservation of a finished run."""
    parts = [
        headline(run),
        _sub_steps(run),
        impact_table(run.impacts),
        contact_table(run.contacts),
        *record_lines(run),
        _models(run),
    ]
    parts += [*_phase_lines(run), *_tip_lines(run), *_unhandled_lines(run)]
    checks = run.checks()
    if run.conservative or checks:
        parts.append(conservation_table(checks) + _truncation_lines(checks))
    if not run.conservative:
        parts.append("not conservative: " + one_line(run.why_not_conservative))
    return "\n\n".join(part for part in parts if part)


def headline(run: Run) -> str:
    """One line: scenario, outcome, times."""
    summary = run.summary(checks=False)
    line = one_line(f"{run.name}: {summary['outcome']}")
    if summary["message"]:
        line += one_line(f" ({summary['message']})")
    if run.complete:
        line += f"; {summary['duration_s']:g} s simulated"
        if summary["wall_s"]:  # zero if SOURCE_DATE_EPOCH is set
            line += f" in {summary['wall_s']:.1f} s ({summary['real_time_factor']:.1f} times real time)"
    else:
        line += f"; {summary['duration_s']:g} s logged"
    return line


def _sub_steps(run: Run) -> str:
    """Number and size of sub-steps; empty if the scenario gives no ``accuracy``."""
    summary = run.summary(checks=False)
    if not summary["sub_steps"]:
        return ""
    cut = f"accuracy: {summary['steps']} steps divided into {summary['sub_steps']} sub-steps"
    return f"{cut}, smallest {summary['smallest_step_s']:.3g} s"


def _models(run: Run) -> str:
    """Compiled values of body and geom properties that the scenario sets; gravity."""
    facts = run.log.header.facts
    return "\n".join([*changed_property_lines(facts), *filter(None, [gravity_line(facts)])])


def what_is_missing(run: Run) -> str:
    """Damage or incompleteness of a log in one line; empty if the log is complete."""
    broken_off = "" if run.complete else "incomplete: the log breaks off before the end of the run"
    return "; ".join(part for part in (f"damaged: {run.damage}" if run.damage else "", broken_off) if part)


def impact_table(impacts: Sequence[ImpactRecord], *, whole: bool = True) -> str:
    """One row per contact of every impact; dT, |dP| and |dL| are of the whole system; friction columns if any."""
    if not impacts:
        return "no impacts" if whole else "no impacts in the readable part"
    named = any(map(_has_own_name, impacts))
    rough, odd = any(record.mu for record in impacts), any(record.status != "ok" for record in impacts)
    head = (
        "impact",
        "time s",
        *(("pair",) if named else ()),
        "geom a",
        "geom b",
        "e",
        *(("mu",) if rough else ()),
        "approach m/s",
        "impulse N s",
        *(("friction N s",) if rough else ()),
        "dT J",
        "|dP| N s",
        "|dL| N m s",
        *(("status",) if odd else ()),
    )
    return table(
        head,
        (
            (
                str(record.event + 1),
                f"{record.time_s:.6f}",
                *((record.pair,) if named else ()),
                *record.geoms,
                f"{record.restitution:g}",
                *((f"{record.mu:g}",) if rough else ()),
                f"{record.approach_speed_m_s:.6f}",
                f"{record.impulse_N_s:.6f}",
                *((f"{math.hypot(*record.tangential_impulse_N_s):.6f}",) if rough else ()),
                f"{record.energy_change_J:.1e}",
                f"{record.linear_momentum_change_N_s:.1e}",
                f"{record.angular_momentum_change_N_m_s:.1e}",
                *((_status(record),) if odd else ()),
            )
            for record in impacts
        ),
    )


def _status(record: ImpactRecord) -> str:
    return record.status + (f", theta {record.theta:.6g}" if record.theta < 1.0 else "")


def contact_table(contacts: Sequence[ContactInterval]) -> str:
    """One row per persistent contact, for the first few; empty without any."""
    if not contacts:
        return ""
    named = any(map(_has_own_name, contacts))
    pair = ("pair",) if named else ()
    head = ("contact", "from s", "to s", *pair, "geom a", "geom b", "impulse N s", "peak N", "at s")
    rows = (
        (
            str(number),
            f"{contact.start_s:.6f}",
            "end" if contact.end_s is None else f"{contact.end_s:.6f}",
            *((contact.pair,) if named else ()),
            *contact.geoms,
            f"{contact.impulse_N_s:.6f}",
            f"{contact.peak_force_N:.6g}",
            f"{contact.peak_force_s:.6f}",
        )
        for number, contact in enumerate(contacts[:_MOST_CONTACTS], 1)
    )
    more = len(contacts) - _MOST_CONTACTS
    return table(head, rows) + (f"\n  and {more} more: ffsm export --csv --table contacts" if more > 0 else "")


def _has_own_name(record: ImpactRecord | ContactInterval) -> bool:
    """Whether the pair has a name other than that of its geoms, which have columns of their own."""
    a, b = ({name, name.rsplit("/", 1)[-1]} for name in record.geoms)
    return record.pair not in {f"{one}-{other}" for one in a for other in b}


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


def _truncation_lines(checks: Sequence[Check]) -> str:
    """Share of truncation in each residual that is too large, and a remedy; empty if there is none."""
    told = [
        f"\n  {check.name} of {check.subsystem}, {check.truncation.sentence(check.unit)}"
        for check in checks
        if check.truncation
    ]
    return "".join(told) + (_STEP_HINT if fail_by_truncation(checks) else "")


def _phase_lines(run: Run) -> list[str]:
    """Phases of the scenario that the run did not reach."""
    reached = {phase.name for phase in run.phases}
    missed = [name for name in run.log.header.facts.get("phases", "").split("\n") if name and name not in reached]
    lost = "" if not run.damage else ", or lost with the damage"
    return [f"phases not reached{lost}: {', '.join(missed)}"] if missed else []


def _tip_lines(run: Run) -> list[str]:
    tip = run.summary(checks=False)["tip"]
    if tip is None:
        return []
    target = ", ".join(f"{x:g}" for x in tip["target_m"])
    closest = f"smallest error {tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    last = f"final error {tip['final_error_m']:.5g} m at {tip['final_speed_m_s']:.4g} m/s"
    return [f"tip to ({target}) m: {closest}, {last}"]


def _unhandled_lines(run: Run) -> list[str]:
    if not run.unhandled_contacts:
        return []
    head = ("unhandled contact", "and", "from s", "to s", "depth m")
    rows = (
        (c.geoms[0], c.geoms[1], f"{c.start_s:.3f}", f"{c.end_s:.3f}", f"{c.max_depth_m:.2e}")
        for c in run.unhandled_contacts
    )
    return [
        table(head, rows) + "\n  these contacts had no forces: declare them in impact_pairs, or list them in ignored_pairs"
    ]


def verification(run: Run, again: ReplayResult, tolerance: Tolerance) -> str:
    """Output of ``ffsm analyze``: checks recomputed from the states in the log."""
    damage = damage_of(run, again)
    impacts = impact_table(run.impacts, whole=run.complete and not damage)
    parts = [headline(run) + (" - DAMAGED LOG, see the end" if damage else ""), impacts]
    parts += [contact_table(run.contacts), *record_lines(run), _models(run)]
    parts += [*_phase_lines(run), *_tip_lines(run), *_unhandled_lines(run)]
    checks = again.checks(tolerance)
    if run.conservative or checks:
        parts.append(conservation_table(checks))
    if not run.conservative:
        fault = one_line(run.why_not_conservative)
        parts.append(f"energy and momenta are not checked, the run is not conservative: {fault}")
    if checks:
        left = " in the readable part" if damage else ""
        parts.append(verdict(run, checks) + left + _truncation_lines(checks))
    parts.append(agreement(again))
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
    if again.agrees:
        of = f"{again.numbers} numbers of {again.samples} samples"
        return f"columns agree with states ({of}); the worst difference:\n  {_difference(worst[0])}"
    return "COLUMNS DO NOT AGREE WITH STATES:" + "".join(f"\n  {_difference(one)}" for one in worst if not one.passes)


def _difference(worst: Discrepancy) -> str:
    unit = f" {worst.unit}" if worst.unit else ""
    return f"{worst.size:.1e}{unit} in {one_line(worst.what)} at {worst.time_s:.3f} s (allowed {worst.allowed:.1e})"


def damage_of(run: Run, again: ReplayResult) -> str:
    """Damage of the log: unreadable bytes, and gaps in the times of its samples."""
    return run.damage if again.gaps in run.damage else "; ".join(part for part in (run.damage, again.gaps) if part)


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


def verification_data(run: Run, again: ReplayResult, tolerance: Tolerance) -> dict[str, Any]:
    """The content of :func:`verification` as plain data."""
    judged = again.checks(tolerance)
    checks = [
        {
            "check": check.name,
            "of": check.subsystem,
            "component": check.component,
            "residual": _finite(check.residual),
            "unit": check.unit,
            "time_s": check.time_s,
            "tolerance": check.tolerance,
            "passes": check.passes,
            "drift": _finite(check.drift),
            "fails_by_truncation": check.fails_by_truncation,
            "truncation": truncation_data(check.truncation),
        }
        for check in judged
    ]
    states = {
        "agree": again.agrees,
        "obstacle": again.obstacle,
        "samples": again.samples,
        "numbers": again.numbers,
        "worst": {
            name: {
                "in": worst.what,
                "difference": _finite(worst.size),
                "allowed": worst.allowed,
                "unit": worst.unit,
                "time_s": _finite(worst.time_s),
            }
            for name, worst in again.worst.items()
        },
    }
    damage = damage_of(run, again)
    told = {"complete": run.complete, "note": run.note, "damage": damage}
    return {
        "summary": run.summary(checks=False) | {"checks": failing_checks(judged)},
        "checks": checks,
        "states": states,
    } | told


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def as_json(data: Any) -> str:
    """Indented JSON."""
    return json_text(data)
