"""Text report of a finished run."""

from __future__ import annotations

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.records.metadata import changed_property_lines, gravity_line
from ffsm_mj.report.check_report import conservation_table, truncation_lines
from ffsm_mj.report.record_tables import contact_table, impact_table, record_lines, unhandled_table


def run_report(run: Run) -> str:
    """Outcome, impacts, tip and conservation of a finished run."""
    parts = [headline(run), _sub_steps(run), impact_table(run.impacts), *details(run)]
    checks = run.checks()
    if run.conservative or checks:
        parts.append(conservation_table(checks) + truncation_lines(checks))
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


def details(run: Run) -> list[str]:
    """What both the report of a run and that of its verification say between impacts and checks; parts may be empty."""
    return [
        contact_table(run.contacts),
        *record_lines(run),
        _models(run),
        _missed_phases(run),
        _notes_of_laws(run),
        _tip(run),
        unhandled_table(run.unhandled_contacts),
    ]


def _sub_steps(run: Run) -> str:
    """Number and size of sub-steps; empty if the scenario gives no ``accuracy``."""
    summary = run.summary(checks=False)
    if not summary["sub_steps"]:
        return ""
    cut = f"accuracy: {summary['steps']} steps divided into {summary['sub_steps']} sub-steps"
    return f"{cut}, smallest {summary['smallest_step_s']:.3g} s"


def _models(run: Run) -> str:
    """Compiled values of body and geom properties that the scenario sets; gravity."""
    metadata = run.log.header.metadata
    return "\n".join([*changed_property_lines(metadata), *filter(None, [gravity_line(metadata)])])


def what_is_missing(run: Run) -> str:
    """Damage or incompleteness of a log in one line; empty if the log is complete."""
    broken_off = "" if run.complete else "incomplete: the log breaks off before the end of the run"
    return "; ".join(part for part in (f"damaged: {run.damage}" if run.damage else "", broken_off) if part)


def _missed_phases(run: Run) -> str:
    """Phases of the scenario that the run did not reach; empty if it reached all."""
    reached = {phase.name for phase in run.phases}
    missed = [name for name in run.log.header.metadata.get("phases", "").split("\n") if name and name not in reached]
    lost = "" if not run.damage else ", or lost with the damage"
    return f"phases not reached{lost}: {', '.join(missed)}" if missed else ""


def _notes_of_laws(run: Run) -> str:
    """Notes in the reports of control laws; empty without any."""
    phases = run.summary(checks=False)["controller"]["phases"]
    notes = ((each, name, text) for each in phases for name, text in each["reports"].items())
    return "\n".join(
        one_line(f"phase {each['name']!r} ({each['kind']}): {text}")
        for each, name, text in notes
        if name == "note" or name.endswith("_note")
    )


def _tip(run: Run) -> str:
    """Errors of the tip in one line; empty without a task."""
    tip = run.summary(checks=False)["tip"]
    if tip is None:
        return ""
    target = ", ".join(f"{x:g}" for x in tip["target_m"])
    closest = f"smallest error {tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    last = f"final error {tip['final_error_m']:.5g} m at {tip['final_speed_m_s']:.4g} m/s"
    return f"tip to ({target}) m: {closest}, {last}"
