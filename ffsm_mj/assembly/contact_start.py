"""Pairs of geoms as a run begins: none may overlap, and the speed of all must have a bound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ffsm_mj.assembly.contact_rules import Contacts
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.tolerances import CONTACT_GAP_M

_SHOWN = 5
"""Faults of one kind that are listed for one rule; of the others, only the number."""


def refuse_undetectable(system: System, data: Any, contacts: Contacts) -> None:
    """Refuse pairs that overlap initially, or whose speed is not bounded by the energy.

    Raises:
        ScenarioFaults: There is such a pair.
    """
    faults = []
    for found in (_unbounded(system, data, contacts), overlapping(system, data, contacts)):
        by_rule: dict[str, list[str]] = {}
        for pair, message in found:
            by_rule.setdefault(pair.rule, []).append(message)
        for rule, messages in by_rule.items():
            place = _place(contacts, rule)
            faults += [Fault(message, place) for message in messages[:_SHOWN]]
            if more := len(messages) - _SHOWN:
                faults += [Fault(f"and {more} more pairs of this rule", place)] if more > 0 else []
    if faults:
        raise ScenarioFaults(faults)


def _place(contacts: Contacts, rule: str) -> tuple[str | int, ...]:
    names = [each.name for each in contacts.rules]
    return ("contacts",) if contacts.is_default else ("contacts", "rules", names.index(rule))


def _unbounded(system: System, data: Any, contacts: Contacts) -> Iterator[tuple[ContactPair, str]]:
    speeds = speeds_per_root_energy(system.mj, data, [pair.ids for pair in contacts.pairs])
    for pair, speed in zip(contacts.pairs, speeds.tolist(), strict=True):
        if math.isinf(speed):
            message = f"a moment of inertia of {pair.geom_a} or {pair.geom_b} is less than rounding of the others"
            yield pair, f"{message}: no energy bounds how fast it spins"


def overlapping(system: System, data: Any, contacts: Contacts) -> Iterator[tuple[ContactPair, str]]:
    """Pairs that overlap at a state, kinematics current, each with a message."""
    for i in BroadPhase(system.mj, contacts.pairs).within(data, 0.0):
        pair = contacts.pairs[i]
        gap = pair.gap(system.mj, data, 1.0)
        if gap < -CONTACT_GAP_M:
            message = f"{pair.geom_a} and {pair.geom_b} overlap by {-gap:.6g} m at the start"
            yield pair, f"{message}; move one of them, or list them in contacts.ignored"
