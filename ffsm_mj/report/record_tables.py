"""Tables and lines of a text report: impacts, contacts and other records."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import one_line
from ffsm_mj.invocation import command
from ffsm_mj.records.events import ImpactRecord, UnhandledContactRecord
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.report.text_table import table

_MOST_CONTACTS, _MOST_LINES = 20, 20


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
    return table(head, (_impact_row(record, named=named, rough=rough, odd=odd) for record in impacts))


def _impact_row(record: ImpactRecord, *, named: bool, rough: bool, odd: bool) -> tuple[str, ...]:
    """Cells of an impact; ``named``, ``rough`` and ``odd`` add those of the pair, of friction and of the status."""
    return (
        str(record.event + 1),
        f"{record.time_s:.6f}",
        *((record.pair,) if named else ()),
        *record.geoms,
        f"{record.restitution:g}",
        *((f"{record.mu:g}",) if rough else ()),
        f"{record.approach_speed_m_s:z.6f}",
        f"{record.impulse_N_s:z.6f}",
        *((f"{math.hypot(*record.tangential_impulse_N_s):.6f}",) if rough else ()),
        f"{record.energy_change_J:.1e}",
        f"{record.linear_momentum_change_N_s:.1e}",
        f"{record.angular_momentum_change_N_m_s:.1e}",
        *((_status(record),) if odd else ()),
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
    return table(head, rows) + (
        f"\n  and {more} more: {command('export', '--csv', '--table', 'contacts')}" if more > 0 else ""
    )


def _has_own_name(record: ImpactRecord | ContactInterval) -> bool:
    """Whether the pair has a name other than that of its geoms, which have columns of their own."""
    a, b = ({name, name.rsplit("/", 1)[-1]} for name in record.geoms)
    return record.pair not in {f"{one}-{other}" for one in a for other in b}


def unhandled_table(contacts: Sequence[UnhandledContactRecord]) -> str:
    """One row per unhandled contact, and a remedy; empty without any."""
    if not contacts:
        return ""
    head = ("unhandled contact", "and", "from s", "to s", "depth m")
    rows = (
        (each.geoms[0], each.geoms[1], f"{each.start_s:.3f}", f"{each.end_s:.3f}", f"{each.max_depth_m:.2e}")
        for each in contacts
    )
    return (
        table(head, rows) + "\n  these contacts had no forces: declare them in impact_pairs, or list them in ignored_pairs"
    )


def record_lines(run: Run) -> list[str]:
    """Lines for the records of contact models, by kind; impacts, phases and unhandled contacts have their own tables."""
    return ["\n".join(_lines(kind, run.records.get(kind.plural, ()))) for kind in run.log.kinds if not kind.in_every_run]


def _lines(kind: RecordKind, records: Sequence[Any]) -> Iterator[str]:
    yield f"{kind.plural.replace('_', ' ')}: {len(records) or 'none'}"
    for record in records[:_MOST_LINES]:
        yield f"  {kind.time(record):.6f} s  {one_line(kind.sentence(record))}"
    if len(records) > _MOST_LINES:
        yield f"  and {len(records) - _MOST_LINES} more: {command('export', '--csv', '--table', kind.plural)}"
