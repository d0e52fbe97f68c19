"""Checks of impacts, independent of the impact law: energy, and the speeds after an impact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from ffsm_mj.contact_models.impact.law import law_of_record
from ffsm_mj.contact_models.impact.records import LimitImpactRecord
from ffsm_mj.contact_models.impact.replayed_impact import along_row
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.friction_check import EnergyDeviation, FrictionCheck, worst_of_records

_Record = ImpactRecord | LimitImpactRecord


def impact_checks(
    impacts: Sequence[ImpactRecord | LimitImpactRecord], allowed: Mapping[str, float], friction: FrictionCheck | None
) -> list[Check]:
    """Results of the checks of impacts, with the worst residual of each; empty without impacts.

    Args:
        impacts: Records of the impacts of a run, in order: contacts and joints at their limits.
        allowed: Tolerances by check.
        friction: Checks impacts with friction by the models; None: they are checked by their records alone.
    """
    events = [list(contacts) for _, contacts in groupby(impacts, key=lambda record: record.event)]
    rough = [any(isinstance(c, ImpactRecord) and c.mu > 0.0 for c in event) for event in events]
    checks = _frictionless_checks([event for event, rubs in zip(events, rough, strict=True) if not rubs], allowed)
    if not any(rough):
        return checks
    judged = [_check_with_friction(event, friction, allowed) for event, rubs in zip(events, rough, strict=True) if rubs]
    energy = max((*checks[:1], *judged), key=lambda check: EnergyDeviation(check.residual, check.tolerance).excess)
    return [energy, *checks[1:]]


def _check_with_friction(event: Sequence[_Record], friction: FrictionCheck | None, allowed: Mapping[str, float]) -> Check:
    """Energy check of an impact with friction; the tolerance is relative to its kinetic energy."""
    worst = worst_of_records if friction is None else friction.worst
    miss, record = worst(event, allowed["impact energy"]), event[0]
    place = f"impact {record.event + 1}"
    return Check("impact energy", "total", place, miss.size, record.time_s, miss.allowed, "J", miss.size)


def _frictionless_checks(events: Sequence[Sequence[_Record]], allowed: Mapping[str, float]) -> list[Check]:
    """Checks of impacts without friction.

    The work of frictionless impulses is the sum of impulse (separation - approach) / 2, exactly; the energy balance takes
    its change from the record, so it is checked here, for any impact law. The law itself checks the speeds after the impact.
    """
    if not events:
        return []
    works = [sum(p * (after - before) / 2 for p, before, after in map(along_row, event)) for event in events]
    checks = [
        _worst_impact(
            "impact energy",
            "J",
            [(event[0], abs(event[0].energy_change_J - work)) for event, work in zip(events, works, strict=True)],
            max(event[0].energy_before_J["total"][0] for event in events),
            allowed,
        )
    ]
    judged = [(event, _restitution_residual(event)) for event in events]
    misses = [(event[0], miss) for event, miss in judged if miss is not None]
    if misses:
        scale = max(along_row(record)[1] for event, miss in judged if miss is not None for record in event)
        checks.append(_worst_impact("impact restitution", "m/s", misses, scale, allowed))
    return checks


def _restitution_residual(event: Sequence[_Record]) -> float | None:
    """Residual of the speeds after an impact against its law, m/s or rad/s; None if the law makes no statement."""
    if len(event) == 1 and isinstance(event[0], LimitImpactRecord):
        return abs(event[0].separation_rate - event[0].restitution_used * event[0].approach_rate)
    contacts = [record for record in event if isinstance(record, ImpactRecord)]
    # Contacts together with a joint limit are an impact of which the law is told only a part.
    return law_of_record(event[0].law).restitution_residual(contacts) if len(contacts) == len(event) else None


def _worst_impact(
    name: str, unit: str, found: list[tuple[_Record, float]], scale: float, allowed: Mapping[str, float]
) -> Check:
    record, residual = max(found, key=lambda pair: np.inf if np.isnan(pair[1]) else pair[1])
    limit = allowed[name] * (1.0 + scale)
    return Check(name, "total", f"impact {record.event + 1}", residual, record.time_s, limit, unit, residual)
