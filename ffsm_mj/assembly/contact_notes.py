"""Lines of text about the contacts of a scenario: its rules, what they leave out, and how well meshes are represented."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from ffsm_mj.assembly.contact_rules import ContactRule, Contacts
from ffsm_mj.contact.mesh_hull import hull_offset
from ffsm_mj.model.system import System

_SHOWN_M = 1e-4
"""Meshes whose convex hull is closer than this are not mentioned."""
_MOST_MESHES = 6


def rule_lines(contacts: Contacts) -> Iterator[str]:
    """One line per contact rule, with the number of pairs that it has."""
    if not contacts.rules:
        yield "contacts: none"
        return
    default = ": one rule for each pair of models (default)" if contacts.is_default else ""
    yield f"contacts{default}"
    for rule in contacts.rules:
        yield f"  {_sentence(rule, contacts)}"


def _sentence(rule: ContactRule, contacts: Contacts) -> str:
    friction = f", mu = {rule.mu:g}" if rule.mu else ""
    count = len(rule.geoms)
    pairs = [pair for pair in contacts.pairs if pair.rule == rule.name]
    which = f"{pairs[0]}" if count == 1 and pairs else f"{count} pairs"
    lost = rule.matched - count
    left = f" ({lost} more ignored or in later rules)" if lost else ""
    return f"{rule.name}: e = {rule.restitution:g}{friction}, {which}{left}"


def contact_notes(contacts: Contacts, system: System) -> Iterator[str]:
    """Notes on contacts that are reported instead of resolved, and on those that end the run."""
    yield from _filtered(contacts, system)
    yield from _left_out(contacts, system)
    reasons = Counter(contacts.unsupported.values())
    for reason, count in reasons.items():
        yield f"the run ends where {'one of ' * (count > 1)}{count} pair{'s' * (count > 1)} meets: {reason}"


def _filtered(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on models that pass through each other."""
    geoms = {model.name: np.isin(system.mj.geom_bodyid, model.bodies).any() for model in system.models}
    for pair in contacts.filtered:
        bare = " and ".join(f"{name!r}" for name in pair if not geoms[name])
        why = f"{bare} without geoms" if bare else "contype and conaffinity in their models exclude every pair of geoms"
        yield f"{pair[0]!r} and {pair[1]!r} cannot touch: {why}"


def _left_out(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on contacts that could occur and that no rule resolves, by pairs of models."""
    number = {body: i for i, model in enumerate(system.models) for body in model.bodies}
    counts = Counter(tuple(sorted(number[int(system.mj.geom_bodyid[geom])] for geom in pair)) for pair in contacts.left_out)
    names = [model.name for model in system.models]
    if counts:
        which = ", ".join(
            f"{names[a]} with {'itself' if a == b else names[b]} ({count})" for (a, b), count in sorted(counts.items())
        )
        yield f"overlaps of other pairs are reported, not resolved (contacts.rules, contacts.ignored): {which}"


def mesh_notes(contacts: Contacts, system: System) -> Iterator[str]:
    """Notes on meshes in contacts, which collide as their convex hulls; takes up to a second for a large mesh."""
    model = system.mj
    geoms = sorted({geom for pair in contacts.pairs for geom in pair.geom_ids})
    found = [(hull_offset(model, geom), system.mj.geom(geom).name) for geom in geoms]
    offsets = sorted(((offset, name) for offset, name in found if offset > _SHOWN_M), reverse=True)
    for offset, name in offsets[:_MOST_MESHES]:
        yield f"{name} collides as the convex hull of its mesh, up to {1e3 * offset:.3g} mm off its triangles"
    if len(offsets) > _MOST_MESHES:
        yield f"and {len(offsets) - _MOST_MESHES} more meshes collide as hulls that stand off by less"
