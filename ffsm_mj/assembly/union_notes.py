"""Rigid bodies of several convex pieces, as ``ffsm check`` describes them: what welding has merged and moved, and missed."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ffsm_mj.assembly.contact_rules import Contacts, rigid_body_name
from ffsm_mj.contact.sides import Side
from ffsm_mj.contact.solid.welding import Step
from ffsm_mj.contact.union_pair import UnionPair
from ffsm_mj.errors import first_few
from ffsm_mj.model.system import System


def union_lines(contacts: Contacts, system: System) -> list[str]:
    """A heading and a line for each rigid body of several pieces that is in contact rules; none if there are none."""
    lines = []
    for side in _sides(contacts):
        report = side.solid.report if side.solid else None
        welded = f"; {report}" if report and report.merged else ""
        lines.append(f"    {rigid_body_name(system, side.body)}: {len(side.pieces)} pieces{welded}")
    return ["  unions of convex pieces", *lines] if lines else []


def union_notes(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on pieces of one body that are a little farther apart than what is welded."""
    steps = [(side, step) for side in _sides(contacts) if side.solid for step in side.solid.report.steps]
    if not steps:
        return
    steps.sort(key=lambda entry: -entry[1].height_m)
    enough = 10.0 ** math.ceil(math.log10(steps[0][1].height_m))
    which = first_few([_sentence(*entry, system) for entry in steps])
    yield f"{which}: contacts.weld_m is smaller, and {enough:.0e} would weld them"


def _sentence(side: Side, step: Step, system: System) -> str:
    one, other = (system.mj.geom(side.pieces[k].geom).name or f"geom {side.pieces[k].geom}" for k in step.pieces)
    which = f"{one} and {other}" if one != other else f"two pieces of {one}"
    return f"{'a crack or overlap' if step.crack else 'a step'} of {step.height_m:.1e} m between {which}"


def _sides(contacts: Contacts) -> list[Side]:
    """Rigid bodies of several pieces, each once."""
    sides = [side for pair in contacts.pairs if isinstance(pair, UnionPair) for side in pair.sides]
    return [side for side in dict.fromkeys(sides) if len(side.pieces) > 1]
