"""Short summary of a run: one or two lines for a terminal, a small table for a notebook.

It must be fast. Checks, contacts and tip come from the digest of the rows, which exists after a simulation; for a log it
takes a pass over the rows, which :class:`ffsm_mj.analysis.run.Run` makes for a card only if they are few.
"""

from __future__ import annotations

import html
from collections.abc import Sequence

from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.digest import Digest
from ffsm_mj.analysis.summary import tip_summary
from ffsm_mj.errors import one_line
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.metadata import is_conservative
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check, worst_check

_SHOWN = 5
_LEFT = 'style="text-align:left"'


def card_text(log: RunLog, digest: Digest | None, checks: Sequence[Check]) -> str:
    """One line, and a second one with the tip if there is a task; see :func:`card_html`."""
    hits = len({record.event for record in log.impacts})
    contacts = digest.contacts.intervals() if digest is not None else ()
    counts = [_counted(hits, "impact"), *([_counted(len(contacts), "persistent contact")] if contacts else [])]
    line = f"<Run {log.header.scenario_name}: {'; '.join((_outcome(log), *counts, _checks(log, digest, checks)))}"
    tip = _tip(digest)
    return "\n  ".join(map(one_line, [line, f"tip {tip}"] if tip else [line])) + ">"


def card_html(log: RunLog, digest: Digest | None, checks: Sequence[Check]) -> str:
    """HTML table of outcome, impacts, contacts, checks and tip; text from the log is always escaped.

    Args:
        log: Log of the run.
        digest: Digest of its rows; None: it is not known, which the table says.
        checks: Results of its checks; empty without a digest.
    """
    rows = {
        "outcome": [_outcome(log)],
        "impacts": _impacts(log.impacts),
        "contacts": _contacts(digest.contacts.intervals() if digest is not None else ()),
        "checks": [_checks(log, digest, checks)],
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


def _counted(number: int, word: str) -> str:
    return f"{number or 'no'} {word}{'s' if number > 1 else ''}"


def _outcome(log: RunLog) -> str:
    ended = log.outcome
    if ended is None:
        return missing(log)
    ending = f"{ended.outcome} after {ended.end_s:g} s" + (f" ({ended.message})" if ended.message else "")
    return "; ".join(part for part in (ending, missing(log)) if part)


def _impacts(records: tuple[ImpactRecord, ...]) -> list[str]:
    if not records:
        return ["none"]
    lines = [f"{r.time_s:.6f} s: {r.geoms[0]} on {r.geoms[1]}, {r.impulse_N_s:.4g} N s" for r in records[:_SHOWN]]
    more = len(records) - len(lines)
    return [*lines, f"and {_counted(more, 'more contact')}"] if more else lines


def _contacts(contacts: tuple[ContactInterval, ...]) -> list[str]:
    lines = []
    for each in contacts[:_SHOWN]:
        until = "to the end" if each.end_s is None else f"to {each.end_s:.6f} s"
        force = f"{each.impulse_N_s:.4g} N s, up to {each.peak_force_N:.4g} N"
        force += f", slip {each.slip_m:.4g} m" if each.slip_m else ""
        lines.append(f"{each.start_s:.6f} s {until}: {each.rule}, {force}")
    more = len(contacts) - len(lines)
    return [*lines, f"and {_counted(more, 'more contact')}"] if more else lines


def _checks(log: RunLog, digest: Digest | None, checks: Sequence[Check]) -> str:
    if digest is None:
        return "checks not evaluated yet: checks() reads the whole log"
    conservative = is_conservative(log.header.metadata)
    lax = "" if conservative else "energy and momenta not checked, as the models are not conservative"
    if not checks:
        return lax or "no samples to check"
    return "; ".join(part for part in (worst_check(checks), lax) if part)


def _tip(digest: Digest | None) -> str:
    tip = tip_summary(digest.tip) if digest is not None else None
    if tip is None:
        return ""
    best = f"{tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s"
    return f"final error {tip['final_error_m']:.4g} m, smallest {best}"
