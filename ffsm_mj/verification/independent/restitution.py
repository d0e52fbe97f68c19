"""Restitution of impacts: that of the rule in the scenario, or 0 where the rest rule says so."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.verification.independent.finding import Finding, Worst
from ffsm_mj.verification.independent.geom_sides import GeomSides
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.pressing import Pressing, pressing
from ffsm_mj.verification.independent.scene import LoggedScene
from ffsm_mj.verification.independent.tolerances import RESTITUTION_USED

_NO_SPEED_M_S = 1e-9
"""Contacts that separate slower than this are at rest whatever the rule says: the rounding of gap rates is 1e-12 m/s."""
_UNSURE = 0.02
"""Share of the pressing acceleration within which it is open, computed from distances, whether a contact comes to rest."""


def restitution_used(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference of the coefficients of restitution in the records of impacts from those that the scenario states."""
    worst, sides = Worst(RESTITUTION_USED), GeomSides(scene.system)
    for _, event in groupby(scene.log.impact_records, key=lambda record: record.event):
        records = list(event)
        for record in records:
            expected = _stated(scene, sides, record)
            if expected is None:
                continue
            used = float(record.restitution_used)
            away = max(abs(record.restitution - expected), min(abs(used - expected), abs(used)))
            if used == 0.0 < expected:
                away = away if _may_rest(scene, rows, records, record) else max(away, expected)
            elif away == 0.0 and used > 0.0 and _must_rest(scene, rows, records, record):
                away = used
            worst.add(f"impact {record.event + 1}", away, 0.0, record.time_s, "")
    return worst.found


def _stated(scene: LoggedScene, sides: GeomSides, record: Any) -> float | None:
    """Coefficient of restitution that the scenario states for the contact or joint of a record; None if it names none."""
    if hasattr(record, "joint"):
        limits = scene.scenario.get("joint_limits") or {}
        named = {scene.system.limited(key)[0]: given for key, given in limits.items()}
        return float((named.get(record.joint) or {}).get("restitution", 0.0))
    contacts = scene.scenario.get("contacts") or {}
    default = float((contacts.get("default") or {}).get("restitution", 1.0))
    rules = contacts.get("rules")
    if rules is None:
        return default
    having = [rule for rule in rules if rule.get("name") == record.rule and sides.names(rule["between"], record.geoms)]
    if not having:
        # The record names a rule that does not have these geoms: no coefficient is right.
        return np.inf
    stated = having[-1].get("restitution")
    return default if stated is None else float(stated)


def _rest_rule(scene: LoggedScene) -> tuple[float, float]:
    """Flights shorter than the first, s, are omitted, and separations slower than the second, m/s."""
    given: Mapping[str, Any] = scene.scenario.get("impact") or {}
    interval_s = given.get("rest_interval_s")
    return float(scene.scenario["time_step_s"] if interval_s is None else interval_s), float(
        given.get("rest_speed_m_s") or 0.0
    )


def _may_rest(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> bool:
    """Whether a contact that came to rest did so by the rule, from what its record says of the flights that it omits.

    The first of these lasts 2 s / b and is s^2 / (2 b) high, where the contact separates at s and is pressed at b; together
    the flights last 1 / (1 - e) times the first.
    """
    interval_s, speed_m_s = _rest_rule(scene)
    at_limit = hasattr(record, "joint")
    gap = record.dropped_gap if at_limit else record.dropped_gap_m
    flight_s = record.dropped_flights_s * (1.0 - record.restitution)
    if flight_s <= 0.0 or gap <= 0.0:
        # It did not separate without the rule either. One contact alone separates by its restitution, in an impact with
        # friction as by the law; of several, each impulse may bring the others to rest, and with e = 1 there is no rule.
        alone = len(event) == 1 and not at_limit and record.mu == 0.0
        return bool(gap <= _NO_SPEED_M_S and not (alone and record.restitution * record.approach_speed_m_s > _NO_SPEED_M_S))
    speed = 4.0 * gap / flight_s
    if speed <= _NO_SPEED_M_S:
        return True
    if flight_s > interval_s * (1.0 + 1e-9) and speed > speed_m_s * (1.0 + 1e-9):
        return False
    found = _pressing(scene, rows, event, record)
    return found is None or speed < max(speed_m_s, 0.5 * interval_s * found.most) * (1.0 + 1e-9)


def _must_rest(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> bool:
    """Whether a contact that bounced would have come to rest by the rule; False where that is not known."""
    if record.restitution >= 1.0 or (found := _pressing(scene, rows, event, record)) is None or found.least <= 0.0:
        return False
    interval_s, speed_m_s = _rest_rule(scene)
    return bool(record.separation_speed_m_s < max(speed_m_s, 0.5 * interval_s * found.least) * (1.0 - 1e-9))


def _pressing(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> Pressing | None:
    """Bounds on the acceleration that presses a contact; None where it is not computed here.

    That of several contacts, of joint limits, with friction or with grasps depends on the forces at the others.
    """
    if len(event) > 1 or hasattr(record, "joint") or record.mu > 0.0 or scene.grasps:
        return None
    return pressing(scene, rows, record, _UNSURE)
