"""Tables and lines of a text report: impacts, contacts and other records.

If there are more impacts or contacts than are to be shown, they are folded: a row per pair for its whole series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any, TypeVar

from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.invocation import command
from ffsm_mj.records.events import ImpactRecord, UnhandledContactRecord
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.report.terminal import table

MOST_ROWS = 20
_Record = TypeVar("_Record", ImpactRecord, ContactInterval)


def impact_table(impacts: Sequence[ImpactRecord], *, changes: bool = True, most: int = MOST_ROWS) -> str:
    """One row per contact of every impact, or per rule if there are many.

    Args:
        impacts: Contacts of all impacts.
        changes: Add the changes of energy and momenta of the whole system.
        most: Largest number of rows.
    """
    if not impacts:
        return "no impacts"
    if len(impacts) > most:
        return _folded(impacts, _impact_series, _SERIES_OF_IMPACTS, most)
    rough, odd = any(record.mu for record in impacts), any(record.status != "ok" for record in impacts)
    head = (
        "impact",
        "time\ns",
        "pair",
        "e",
        *(("mu",) if rough else ()),
        "approach\nm/s",
        "impulse\nN s",
        *(("friction\nN s",) if rough else ()),
        *(("dT\nJ", "|dP|\nN s", "|dL|\nN m s") if changes else ()),
        *(("status",) if odd else ()),
    )
    rows = (_impact_row(record, rough=rough, changes=changes, odd=odd) for record in impacts)
    return table(head, rows, spare=("|dL|", "|dP|"))


def _impact_row(record: ImpactRecord, *, rough: bool, changes: bool, odd: bool) -> tuple[str, ...]:
    """Cells of an impact; ``rough``, ``changes`` and ``odd`` add those of friction, of the changes and of the status."""
    return (
        str(record.event + 1),
        f"{record.time_s:.6f}",
        record.pair,
        f"{record.restitution:g}",
        *((f"{record.mu:g}",) if rough else ()),
        f"{record.approach_speed_m_s:z.6f}",
        f"{record.impulse_N_s:z.6f}",
        *((f"{math.hypot(*record.tangential_impulse_N_s):.6f}",) if rough else ()),
        *(
            (
                f"{record.energy_change_J:.1e}",
                f"{record.linear_momentum_change_N_s:.0e}",
                f"{record.angular_momentum_change_N_m_s:.0e}",
            )
            if changes
            else ()
        ),
        *((_status(record),) if odd else ()),
    )


def _status(record: ImpactRecord) -> str:
    return record.status + (f", theta {record.theta:.6g}" if record.theta < 1.0 else "")


_SERIES_OF_IMPACTS = ("impacts", "rule", "from\ns", "to\ns", "e", "fastest\nm/s", "slowest\nm/s", "impulse\nN s")


def _impact_series(records: Sequence[ImpactRecord]) -> tuple[str, ...]:
    """Cells of all impacts of a rule; ``impulse`` is the sum of the normal impulses."""
    speeds = [record.approach_speed_m_s for record in records]
    return (
        str(len({record.event for record in records})),
        records[0].rule,
        f"{records[0].time_s:.6f}",
        f"{records[-1].time_s:.6f}",
        f"{records[0].restitution:g}",
        f"{max(speeds):.6f}",
        f"{max(0.0, min(speeds)):.2g}",
        f"{math.fsum(record.impulse_N_s for record in records):.6f}",
    )


def contact_table(contacts: Sequence[ContactInterval], *, most: int = MOST_ROWS) -> str:
    """One row per persistent contact, or per rule if there are many; empty without any."""
    if not contacts:
        return ""
    with_friction = any(contact.peak_friction_use > 0.0 for contact in contacts)
    if len(contacts) > most:
        if with_friction:
            return _folded(contacts, _slipping_series, (*_SERIES_OF_CONTACTS, *_SLIP_HEAD), most)
        return _folded(contacts, _contact_series, _SERIES_OF_CONTACTS, most)
    head = ("contact", "from\ns", "to\ns", "rule", "pairs", "impulse\nN s", "peak\nN", "at\ns")
    rows = (
        (
            str(number),
            f"{contact.start_s:.6f}",
            _end(contact),
            contact.rule,
            str(len(contact.pairs)),
            f"{contact.impulse_N_s:.6f}",
            f"{contact.peak_force_N:.6g}",
            f"{contact.peak_force_s:.6f}",
            *(_slip(contact) if with_friction else ()),
        )
        for number, contact in enumerate(contacts, 1)
    )
    return table((*head, *(_SLIP_HEAD if with_friction else ())), rows)


_SLIP_HEAD = ("friction\nuse", "sliding\ns", "slip\nm")


def _slip(contact: ContactInterval) -> tuple[str, ...]:
    """Cells of friction of one contact."""
    return f"{contact.peak_friction_use:.4g}", f"{contact.sliding_s:.6f}", f"{contact.slip_m:.6g}"


_SERIES_OF_CONTACTS = ("contacts", "rule", "from\ns", "to\ns", "impulse\nN s", "peak\nN")


def _contact_series(contacts: Sequence[ContactInterval]) -> tuple[str, ...]:
    """Cells of all persistent contacts of a rule."""
    return (
        str(len(contacts)),
        contacts[0].rule,
        f"{contacts[0].start_s:.6f}",
        _end(contacts[-1]),
        f"{math.fsum(contact.impulse_N_s for contact in contacts):.6f}",
        f"{max(contact.peak_force_N for contact in contacts):.6g}",
    )


def _slipping_series(contacts: Sequence[ContactInterval]) -> tuple[str, ...]:
    """The same, with friction."""
    return (
        *_contact_series(contacts),
        f"{max(contact.peak_friction_use for contact in contacts):.4g}",
        f"{math.fsum(contact.sliding_s for contact in contacts):.6f}",
        f"{math.fsum(contact.slip_m for contact in contacts):.6g}",
    )


def _end(contact: ContactInterval) -> str:
    return "end" if contact.end_s is None else f"{contact.end_s:.6f}"


def _folded(
    records: Sequence[_Record], cells: Callable[[Sequence[_Record]], tuple[str, ...]], head: Sequence[str], most: int
) -> str:
    """A row per contact rule, those with most records first."""
    rules = [
        list(group) for _, group in groupby(sorted(records, key=lambda record: record.rule), lambda record: record.rule)
    ]
    rules.sort(key=lambda group: -len(group))
    more = f"\n  and {len(rules) - most} more" if len(rules) > most else ""
    return table(head, map(cells, rules[:most])) + more


def unhandled_table(contacts: Sequence[UnhandledContactRecord], *, most: int = MOST_ROWS) -> str:
    """One row per unhandled contact, and a remedy; empty without any."""
    if not contacts:
        return ""
    head = ("unhandled contact", "and", "from s", "to s", "depth m")
    rows = (
        (each.geoms[0], each.geoms[1], f"{each.start_s:.3f}", f"{each.end_s:.3f}", f"{each.max_depth_m:.2e}")
        for each in contacts[:most]
    )
    more = f"\n  and {len(contacts) - most} more" if len(contacts) > most else ""
    remedy = "  these contacts had no forces: resolve them by a rule of contacts.rules, or list them in contacts.ignored"
    return f"{table(head, rows)}{more}\n{remedy}"


def record_lines(run: Run, *, most: int = MOST_ROWS) -> str:
    """Lines for the records of contact models, by kind; impacts, phases and unhandled contacts have their own tables."""
    kinds = [(kind, run.records.get(kind.plural, ())) for kind in run.log.kinds if not kind.in_every_run]
    # Where there is room for one row only, kinds with several records are counted: the first one would say little.
    counted = [(kind, records) for kind, records in kinds if most == 1 and len(records) > 1]
    listed = [(kind, records) for kind, records in kinds if records and (kind, records) not in counted]
    lines = [line for kind, records in listed for line in _lines(run, kind, records, most)]
    if counted:
        counts = ", ".join(f"{kind.plural.replace('_', ' ')}: {len(records)}" for kind, records in counted)
        lines.append(f"{counts} (listed by analyze)")
    return "\n".join(lines)


def _lines(run: Run, kind: RecordKind, records: Sequence[Any], most: int) -> Iterator[str]:
    yield f"{kind.plural.replace('_', ' ')}: {len(records)}"
    for record in records[:most]:
        yield f"  {kind.time(record):.6f} s  {one_line(kind.sentence(record))}"
    if len(records) > most:
        yield f"  and {len(records) - most} more: {export_command(run, kind.plural)}"


def export_command(run: Run, name: str) -> str:
    """Command that writes a table of a run to a file."""
    place = [] if run.path is None else [run.path.parent if run.path.stem == "run" else run.path]
    return command("export", *place, "--csv", "--table", name)
