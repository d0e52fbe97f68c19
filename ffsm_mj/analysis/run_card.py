"""Short summary of a run: one or two lines for a terminal, a small table for a notebook.

It must be fast. Checks, contacts and tip come from the run's digest, which exists after a simulation; for a log it takes a
pass over the rows, which is made here only if they are few.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.summary import tip_summary
from ffsm_mj.errors import LogError, one_line
from ffsm_mj.log.mcap.stored_rows import KEPT_BYTES
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.verification.check_result import Check, worst_check

if TYPE_CHECKING:
    from ffsm_mj.analysis.run import Run

_SHOWN = 5
_LEFT = 'style="text-align:left"'


def card_text(run: Run) -> str:
    """One line, and a second one with the tip if there is a task."""
    hits = len({record.event for record in run.impacts})
    contacts = _known_contacts(run)
    counts = [_counted(hits, "impact"), *([_counted(len(contacts), "persistent contact")] if contacts else [])]
    line = f"<Run {run.name}: {'; '.join((_outcome(run), *counts, _checks(run)))}"
    tip = _tip(run)
    return "\n  ".join(map(one_line, [line, f"tip {tip}"] if tip else [line])) + ">"


def card_html(run: Run, checks: Sequence[Check] | None = None) -> str:
    """HTML table of outcome, impacts, contacts, checks and tip; text from the log is always escaped.

    Args:
        run: The run.
        checks: Results of all of its checks; None: those of ``run.checks()``, unless the log is long.
    """
    rows = {
        "outcome": [_outcome(run)],
        "impacts": _impacts(run.impacts),
        "contacts": _contacts(_known_contacts(run)),
        "checks": [_checks(run) if checks is None else _result(run, checks)],
        "tip": [_tip(run)],
    }
    body = "".join(
        f"<tr><th {_LEFT}>{head}</th><td {_LEFT}>{'<br>'.join(map(_escaped, lines))}</td></tr>"
        for head, lines in rows.items()
        if any(lines)
    )
    return f"<table><caption>{_escaped(run.name)}</caption>{body}</table>"


def _escaped(text: str) -> str:
    return html.escape(one_line(text))


def _counted(number: int, word: str) -> str:
    return f"{number or 'no'} {word}{'s' if number > 1 else ''}"


def _outcome(run: Run) -> str:
    ended = run.log.outcome
    if ended is None:
        return run.missing
    ending = f"{ended.outcome} after {ended.end_s:g} s" + (f" ({ended.message})" if ended.message else "")
    return "; ".join(part for part in (ending, run.missing) if part)


def _impacts(records: tuple[ImpactRecord, ...]) -> list[str]:
    if not records:
        return ["none"]
    lines = [f"{r.time_s:.6f} s: {r.geoms[0]} on {r.geoms[1]}, {r.impulse_N_s:.4g} N s" for r in records[:_SHOWN]]
    more = len(records) - len(lines)
    return [*lines, f"and {_counted(more, 'more contact')}"] if more else lines


def _known_contacts(run: Run) -> tuple[ContactInterval, ...]:
    return run.contacts if _quick(run) else ()


def _contacts(contacts: tuple[ContactInterval, ...]) -> list[str]:
    lines = []
    for each in contacts[:_SHOWN]:
        until = "to the end" if each.end_s is None else f"to {each.end_s:.6f} s"
        force = f"{each.impulse_N_s:.4g} N s, up to {each.peak_force_N:.4g} N"
        force += f", slip {each.slip_m:.4g} m" if each.slip_m else ""
        lines.append(f"{each.start_s:.6f} s {until}: {each.rule}, {force}")
    more = len(contacts) - len(lines)
    return [*lines, f"and {_counted(more, 'more contact')}"] if more else lines


def _quick(run: Run) -> bool:
    """Whether checks, contacts and tip are known, or quick to compute from few rows."""
    try:
        if run.digested or 8 * len(run.log.rows) * len(run.keys) <= KEPT_BYTES:
            with np.errstate(all="ignore"):  # a log may hold any double
                return run.digest is not None
    except (LogError, OSError):  # the file is gone; the summary of a run in memory must not fail
        return False
    return False


def _checks(run: Run) -> str:
    if not _quick(run):
        return "checks not evaluated yet: checks() reads the whole log"
    return _result(run, run.checks())


def _result(run: Run, checks: Sequence[Check]) -> str:
    lax = "" if run.conservative else "energy and momenta not checked, as the models are not conservative"
    if not checks:
        return lax or "no samples to check"
    return "; ".join(part for part in (worst_check(checks), lax) if part)


def _tip(run: Run) -> str:
    tip = tip_summary(run.digest.tip) if _quick(run) else None
    if tip is None:
        return ""
    best = f"{tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    return f"final error {tip['final_error_m']:.4g} m, smallest {best}"
