"""Text report of a finished run, which fits a terminal of 24 lines and 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ffsm_mj.analysis.pacing import Pacing
from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line, plural
from ffsm_mj.records.metadata import changed_property_lines, gravity_line, logged_phase_graph
from ffsm_mj.report.check_report import check_table, left_to_replay, no_verdict, step_hint
from ffsm_mj.report.momentum_report import momentum_line
from ffsm_mj.report.record_tables import MOST_ROWS, contact_table, impact_table, record_lines, unhandled_table
from ffsm_mj.report.terminal import wrapped
from ffsm_mj.verification.check_result import all_by_truncation, worst_check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE
from ffsm_mj.verification.truncation import ExplainedChecks

MOST_LINES = 19
"""Of the 24 lines of a terminal; the others show the run folder, the next commands and the prompt."""
_LEAST_FAILURES = 4
_LAYOUTS = (*((most, False) for most in (8, 5, 3, 2, 1)), *((most, True) for most in (3, 2, 1, 0)))
"""Greatest number of rows of a part, and whether there are no empty lines between parts; tried in this order."""


def run_report(run: Run, explained: ExplainedChecks, notes: Sequence[str] = (), lines: int = MOST_LINES) -> str:
    """Report of a finished run for a terminal: outcome, checks that fail, impacts, contacts, tip, result of the checks.

    Args:
        run: The run.
        explained: All of its checks.
        notes: What ``ffsm check`` notes about the scenario; they are repeated under checks that fail.
        lines: Greatest number of lines; series of records are folded, then cut, then only counted, until it has as many.
    """
    for most, tight in _LAYOUTS:
        report = _report(run, explained, notes, most, tight=tight)
        if wrapped(report).count("\n") < lines:
            break
    return report


def _report(run: Run, explained: ExplainedChecks, notes: Sequence[str], most: int, *, tight: bool) -> str:
    """The report with at most so many rows in each of its parts."""
    failures = _failures(run, explained, notes, most)
    result = "" if failures else "; ".join(filter(None, [worst_check(explained.checks), left_to_replay(run)]))
    if not run.conservative:
        result = f"{result}{result and '; '}not conservative: {one_line(run.why_not_conservative)}"
    happened = _happened(run, most) if most else _happened_in_short(run)
    parts = [headline(run), failures, _sub_steps(run), *happened, result]
    shown = [part for part in parts if part]
    return "\n".join(shown) if tight else _stacked(shown)


def _failures(run: Run, explained: ExplainedChecks, notes: Sequence[str], most: int) -> str:
    """Checks that fail, with what is known about the cause; empty if all pass."""
    checks = explained.checks
    failing = sorted((check for check in checks if not check.passes), key=lambda check: check.fails_by_truncation is True)
    if not failing:
        return ""
    shown = max(most, _LEAST_FAILURES)
    lines = [check_table(failing[:shown])]
    if len(failing) > shown:
        lines.append(f"  and {len(failing) - shown} more")
    lines += [step_hint(run)] if all_by_truncation(checks) else []
    lines += filter(None, [no_verdict(explained, DEFAULT_TOLERANCE)])
    return "\n".join([*lines, *(f"  note: {note}" for note in notes[: max(most, 1)])])


def _happened(run: Run, most: int) -> list[str]:
    """Impacts, contacts and other records; that there were no impacts is worth a line only where nothing else happened."""
    parts = details(run, most)
    nothing = not (run.impacts or run.contacts or parts[1])
    return [impact_table(run.impacts, changes=False, most=most) if run.impacts or nothing else "", *parts]


def _happened_in_short(run: Run) -> list[str]:
    """What every report has, and how much there is of everything else, where there is no room for more."""
    impacts = impact_table(run.impacts, changes=False, most=0) if run.impacts else ""
    counts = [(len(run.contacts), "persistent contact"), (len(run.unhandled_contacts), "unhandled contact")]
    also = [plural(number, name) for number, name in counts if number]
    return [impacts, record_lines(run, most=0, also=also)]


def _stacked(parts: Iterable[str]) -> str:
    """Parts below each other, with an empty line before and after those of several lines."""
    text = ""
    for part in parts:
        apart = "\n" in part or "\n" in text.rpartition("\n\n")[2]
        text += part if not text else ("\n\n" if apart else "\n") + part
    return text


def headline(run: Run) -> str:
    """One line: scenario, outcome, times."""
    summary = run.summary()
    line = one_line(f"{run.name}: {summary['outcome']}")
    if summary["message"]:
        line += one_line(f" ({summary['message']})")
    since = f"{summary['start_s']:g} to " if "start_s" in summary else ""
    if run.complete:
        line += f"; {since}{summary['duration_s']:g} s simulated"
        if summary["wall_s"]:  # zero if SOURCE_DATE_EPOCH is set
            line += f" in {summary['wall_s']:.1f} s ({summary['real_time_factor']:.1f} times real time)"
    else:
        line += f"; {since}{summary['duration_s']:g} s logged"
    return line


def details(run: Run, most: int = MOST_ROWS) -> list[str]:
    """What the report of a run and that of its verification have between impacts and checks; parts may be empty.

    Args:
        run: The run.
        most: Largest number of rows in a part.
    """
    return [
        contact_table(run.contacts, most=most),
        record_lines(run, most=most),
        _models(run, most),
        _missed_phases(run),
        _notes_of_laws(run),
        _tip(run),
        _joint_friction(run),
        pacing.line() if (pacing := Pacing.of(run)) is not None else "",
        momentum_line(run),
        unhandled_table(run.unhandled_contacts, most=most),
    ]


def _joint_friction(run: Run) -> str:
    """Heat of dry friction of joints and tendons; empty without any."""
    column = "balance.total_joint_friction_heat_J"
    if column not in run.keys or not len(run.time):
        return ""
    return f"dry friction of joints and tendons: {run[column][-1]:.4g} J of heat"


def _sub_steps(run: Run) -> str:
    """Number and size of sub-steps; empty if the scenario gives no ``accuracy``."""
    summary = run.summary()
    if not summary["sub_steps"]:
        return ""
    cut = f"accuracy: {plural(summary['steps'], 'step')} divided into {plural(summary['sub_steps'], 'sub-step')}"
    return f"{cut}, smallest {summary['smallest_step_s']:.3g} s"


def _models(run: Run, most: int) -> str:
    """Compiled values of body and geom properties that the scenario sets; gravity."""
    metadata = run.log.header.metadata
    lines = [*changed_property_lines(metadata), *filter(None, [gravity_line(metadata)])]
    more = [f"and {len(lines) - most} more"] if len(lines) > most else []
    return "\n".join([*lines[:most], *more])


def _missed_phases(run: Run) -> str:
    """Phases that the run could reach and did not; empty if it reached all."""
    names, ways = logged_phase_graph(run.log.header.metadata)
    reached = {phase.name for phase in run.phases}
    first = run.phases[0].name if run.phases else ""
    begun = names.index(first) if first in names else 0
    # A run that goes on from a state began in a later phase. Where phases branch, a way may lead back to those before it.
    ahead = _ahead(begun, ways) if ways else range(begun, len(names))
    missed = [names[i] for i in ahead if names[i] and names[i] not in reached]
    lost = "" if not run.damage else ", or lost with the damage"
    return f"phases not reached{lost}: {', '.join(missed)}" if missed else ""


def _ahead(first: int, ways: list[tuple[int, str, int]]) -> list[int]:
    """Positions of the phases to which ways lead from a phase, itself included, in the order of the scenario."""
    there, left = {first}, [first]
    while left:
        start = left.pop()
        left += (more := {to for of, _, to in ways if of == start} - there)
        there |= more
    return sorted(there)


def _notes_of_laws(run: Run) -> str:
    """Notes in the reports of control laws; empty without any."""
    phases = run.summary()["controller"]["phases"]
    notes = ((one, name, text) for one in phases for name, text in one["reports"].items())
    lines = (
        one_line(f"phase {note['name']!r} ({note['kind']}): {text}")
        for note, name, text in notes
        if name.rpartition(": ")[2] == "note" or name.endswith("_note")
    )
    return "\n".join(dict.fromkeys(lines))  # a phase that was entered again reports once


def _tip(run: Run) -> str:
    """Errors of the tip in one line; empty without a task."""
    tip = run.summary()["tip"]
    if tip is None:
        return ""
    target = ", ".join(f"{x:g}" for x in tip["target_m"])
    closest = f"smallest error {tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    last = f"final error {tip['final_error_m']:.5g} m at {tip['final_speed_m_s']:.4g} m/s"
    return f"tip to ({target}) m: {closest}, {last}"
