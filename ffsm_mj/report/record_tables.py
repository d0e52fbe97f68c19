"""Tables and lines of a text report: impacts, contacts and other records.

If there are more impacts or contacts than are to be shown, they are folded: a row per pair for its whole series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count
from typing import Any, TypeVar

from ffsm_mj.analysis.intervals import ContactInterval
from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line, plural
from ffsm_mj.invocation import command
from ffsm_mj.records.events import ImpactRecord, UnhandledContactRecord, impact_count
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.report.terminal import table

MOST_ROWS = 20
_LEAST_OF_KIND = 2
"""Records that are listed of each kind that every report lists."""
_Record = TypeVar("_Record", ImpactRecord, ContactInterval)
Column = tuple[str, Callable[[Any], str]]
"""Head of a column, with its unit on a second line, and the cell of a record or of a series."""


def _table(columns: Sequence[Column], rows: Iterable[Any], **options: Any) -> str:
    return table([head for head, _ in columns], ([cell(row) for _, cell in columns] for row in rows), **options)


def impact_table(impacts: Sequence[ImpactRecord], *, changes: bool = True, most: int = MOST_ROWS) -> str:
    """One row per contact of every impact; if there are many, their number, the first and the largest, and a row per rule.

    Args:
        impacts: Contacts of all impacts.
        changes: Add the changes of energy and momenta of the whole system.
        most: Largest number of rows; 0: no rows.
    """
    if not impacts:
        return "no impacts"
    if len(impacts) > most:
        lines = "\n".join([number_of_impacts(impacts), *_first_and_largest(impacts)])
        return f"{lines}\n{_folded(impacts, _SERIES_OF_IMPACTS, most, spare=_LESS_OF_IMPACTS)}" if most else lines
    rough, odd = any(record.mu for record in impacts), any(record.status != "ok" for record in impacts)
    shown = {"friction": rough, "changes": changes, "status": odd}
    return _table(
        [column for of, column in _IMPACTS if shown.get(of, True)],
        impacts,
        spare=_LESS_OF_CHANGES,
    )


def number_of_impacts(impacts: Sequence[ImpactRecord]) -> str:
    """How many impacts there are; contacts at one instant are one impact."""
    number = impact_count(impacts)
    several = f", with {plural(len(impacts), 'contact')}" if len(impacts) > number else ""
    return f"{plural(number, 'impact')}{several}"


def _first_and_largest(impacts: Sequence[ImpactRecord]) -> Iterator[str]:
    """A line for the first impact and one for that of the largest impulse; of several contacts, for the largest one."""
    first = max((record for record in impacts if record.event == impacts[0].event), key=lambda record: record.impulse_N_s)
    largest = max(impacts, key=lambda record: record.impulse_N_s)
    named = [("first and largest", first)] if largest is first else [("first", first), ("largest", largest)]
    for name, record in named:
        size = f"{record.impulse_N_s:.5g} N s at {record.approach_speed_m_s:.4g} m/s"
        yield f"  {name}: {record.time_s:.6f} s  {one_line(record.pair)}, {size}"


def _status(record: ImpactRecord) -> str:
    return record.status + (f", theta {record.theta:.6g}" if record.theta < 1.0 else "")


_IMPACTS: tuple[tuple[str, Column], ...] = (
    ("", ("impact", lambda record: str(record.event + 1))),
    ("", ("time\ns", lambda record: f"{record.time_s:.6f}")),
    ("", ("pair", lambda record: record.pair)),
    ("", ("e", lambda record: f"{record.restitution:g}")),
    ("friction", ("mu", lambda record: f"{record.mu:g}")),
    ("", ("approach\nm/s", lambda record: f"{record.approach_speed_m_s:z.6f}")),
    ("", ("impulse\nN s", lambda record: f"{record.impulse_N_s:z.6f}")),
    ("friction", ("friction\nN s", lambda record: f"{math.hypot(*record.tangential_impulse_N_s):.6f}")),
    ("changes", ("dT\nJ", lambda record: f"{record.energy_change_J:.1e}")),
    ("changes", ("|dP|\nN s", lambda record: f"{record.linear_momentum_change_N_s:.0e}")),
    ("changes", ("|dL|\nN m s", lambda record: f"{record.angular_momentum_change_N_m_s:.0e}")),
    ("status", ("status", _status)),
)
"""Columns of impacts, by what they are shown for."""
_SERIES_OF_IMPACTS: tuple[Column, ...] = (
    ("impacts", lambda series: str(len({record.event for record in series}))),
    ("rule", lambda series: series[0].rule),
    ("from\ns", lambda series: f"{series[0].time_s:.6f}"),
    ("to\ns", lambda series: f"{series[-1].time_s:.6f}"),
    ("e", lambda series: f"{series[0].restitution:g}"),
    ("fastest\nm/s", lambda series: f"{max(record.approach_speed_m_s for record in series):.6f}"),
    ("slowest\nm/s", lambda series: f"{max(0.0, min(record.approach_speed_m_s for record in series)):.2g}"),
    ("impulse\nN s", lambda series: f"{_sum(series, 'impulse_N_s'):.6f}"),
)
"""Columns of all impacts of a rule; ``impulse`` is the sum of the normal impulses."""
_LESS_OF_CHANGES = ("|dL|", "|dP|", "dT", "mu", "e", "approach")
_LESS_OF_IMPACTS = ("slowest", "e", "fastest")
_LESS_OF_CONTACTS = ("at", "pairs", "sliding", "slip", "friction", "to")
"""Columns that can be spared on a narrow terminal."""


def contact_table(contacts: Sequence[ContactInterval], *, most: int = MOST_ROWS) -> str:
    """One row per persistent contact, or per rule if there are many; empty without any."""
    if not contacts:
        return ""
    with_friction = any(contact.peak_friction_use > 0.0 for contact in contacts)
    if len(contacts) > most:
        columns = (*_SERIES_OF_CONTACTS, *(_SERIES_OF_SLIP if with_friction else ()))
        return _folded(contacts, columns, most, spare=_LESS_OF_CONTACTS)
    numbers = count(1)
    columns = (("contact", lambda _: str(next(numbers))), *_CONTACTS, *(_SLIP if with_friction else ()))
    return _table(columns, contacts, spare=_LESS_OF_CONTACTS)


def _end(contact: ContactInterval) -> str:
    return "end" if contact.end_s is None else f"{contact.end_s:.6f}"


def _sum(records: Iterable[Any], name: str) -> float:
    return math.fsum(getattr(record, name) for record in records)


_CONTACTS: tuple[Column, ...] = (
    ("from\ns", lambda contact: f"{contact.start_s:.6f}"),
    ("to\ns", _end),
    ("rule", lambda contact: contact.rule),
    ("pairs", lambda contact: str(len(contact.pairs))),
    ("impulse\nN s", lambda contact: f"{contact.impulse_N_s:.6f}"),
    ("peak\nN", lambda contact: f"{contact.peak_force_N:.6g}"),
    ("at\ns", lambda contact: f"{contact.peak_force_s:.6f}"),
)
_SLIP: tuple[Column, ...] = (
    ("friction\nuse", lambda contact: f"{contact.peak_friction_use:.4g}"),
    ("sliding\ns", lambda contact: f"{contact.sliding_s:.6f}"),
    ("slip\nm", lambda contact: f"{contact.slip_m:.6g}"),
)
_SERIES_OF_CONTACTS: tuple[Column, ...] = (
    ("contacts", lambda series: str(len(series))),
    ("rule", lambda series: series[0].rule),
    ("from\ns", lambda series: f"{series[0].start_s:.6f}"),
    ("to\ns", lambda series: _end(series[-1])),
    ("impulse\nN s", lambda series: f"{_sum(series, 'impulse_N_s'):.6f}"),
    ("peak\nN", lambda series: f"{max(contact.peak_force_N for contact in series):.6g}"),
)
"""Columns of all persistent contacts of a rule."""
_SERIES_OF_SLIP: tuple[Column, ...] = (
    ("friction\nuse", lambda series: f"{max(contact.peak_friction_use for contact in series):.4g}"),
    ("sliding\ns", lambda series: f"{_sum(series, 'sliding_s'):.6f}"),
    ("slip\nm", lambda series: f"{_sum(series, 'slip_m'):.6g}"),
)


def _folded(records: Sequence[_Record], columns: Sequence[Column], most: int, *, spare: Sequence[str]) -> str:
    """A row per contact rule, those with most records first."""
    by_rule: dict[str, list[_Record]] = {}
    for record in records:
        by_rule.setdefault(record.rule, []).append(record)
    series = sorted(by_rule.values(), key=lambda group: (-len(group), group[0].rule))
    return _table(columns, series[:most], spare=spare) + _and_more(series, most)


def _and_more(records: Sequence[Any], most: int) -> str:
    return f"\n  and {len(records) - most} more" if len(records) > most else ""


def unhandled_table(contacts: Sequence[UnhandledContactRecord], *, most: int = MOST_ROWS) -> str:
    """One row per unhandled contact, and a remedy; empty without any."""
    if not contacts:
        return ""
    head = ("unhandled contact", "and", "from\ns", "to\ns", "depth\nm")
    rows = (
        (*contact.geoms, f"{contact.start_s:.3f}", f"{contact.end_s:.3f}", f"{contact.max_depth_m:.2e}")
        for contact in contacts[:most]
    )
    remedy = "  these contacts had no forces: resolve them by a rule of contacts.rules, or list them in contacts.ignored"
    return f"{table(head, rows)}{_and_more(contacts, most)}\n{remedy}"


def record_lines(run: Run, *, most: int = MOST_ROWS, also: Sequence[str] = ()) -> str:
    """Lines for the records of contact models, by kind; impacts, phases and unhandled contacts have their own tables.

    Args:
        run: The run.
        most: Largest number of records of a kind; 0: all but the kinds that every report lists are counted.
        also: What else is counted.
    """
    kinds = [(kind, run.records.get(kind.plural, ())) for kind in run.log.kinds if not kind.in_every_run]
    kinds = [(kind, records) for kind, records in kinds if records]
    # Where there is room for one row only, kinds with several records are counted: the first one would say little.
    counted = [] if most > 1 else [one for one in kinds if not one[0].in_every_report and len(one[1]) > most]
    listed = [(kind, records) for kind, records in kinds if (kind, records) not in counted]
    listed.sort(key=lambda one: one[0].time(one[1][0]))
    lines = [line for kind, records in listed for line in _lines(run, kind, records, max(most, _LEAST_OF_KIND))]
    if counts := [*also, *(_of_kind(kind, len(records)) for kind, records in counted)]:
        lines.append(f"{', '.join(counts)} (listed by analyze)")
    return "\n".join(lines)


def _of_kind(kind: RecordKind, number: int) -> str:
    return f"{number} {(kind.name if number == 1 else kind.plural).replace('_', ' ')}"


def _lines(run: Run, kind: RecordKind, records: Sequence[Any], most: int) -> Iterator[str]:
    sentences = [f"{kind.time(record):.6f} s  {one_line(kind.sentence(record))}" for record in records[:most]]
    if len(records) == 1:
        yield from sentences
        return
    yield _of_kind(kind, len(records))
    yield from (f"  {sentence}" for sentence in sentences)
    if len(records) > most:
        yield f"  and {len(records) - most} more: {export_command(run, kind.plural)}"


def export_command(run: Run, name: str) -> str:
    """Command that writes a table of a run to a file."""
    place = [] if run.path is None else [run.path.parent if run.path.stem == "run" else run.path]
    return command("export", *place, "--csv", "--table", name)
