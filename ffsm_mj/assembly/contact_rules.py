"""Contact rules of a scenario, resolved to pairs of geoms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ffsm_mj.assembly.geom_selection import SELF, GeomSelection, GeomSelector, geom_names, short_names
from ffsm_mj.contact.pairs import ContactPair, shape_fault
from ffsm_mj.contact.watch import Matrix, collidable
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.scenario.contacts import ContactRuleConfig, ContactsConfig

_RULES, _IGNORED = ("contacts", "rules"), ("contacts", "ignored")


@dataclass(frozen=True)
class ContactRule:
    """A rule with the pairs that it has.

    Attributes:
        name: Name of the rule.
        between: Its two sides as written.
        restitution: Coefficient of restitution.
        mu: Coefficient of friction.
        matched: Number of pairs that its sides name.
        ignored: Number of these that are ignored.
        geoms: Ids of the geoms a and b of its pairs: those that no later rule and no ignored contact takes.
    """

    name: str
    between: tuple[str, ...]
    restitution: float
    mu: float
    matched: int
    ignored: int
    geoms: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Contacts:
    """The contacts of a scenario.

    Attributes:
        rules: Its rules, or those of the default, in order.
        pairs: Pairs that contact models resolve, rule by rule.
        unsupported: Pairs of a rule that cannot be resolved because of the shape of a geom, with the reason: the run ends
            where one of them meets.
        ignored: Geom ids of ignored pairs.
        left_out: Geom ids of pairs that could collide and that no rule has: overlaps are reported.
        is_default: Whether the scenario states no rules.
        filtered: Names of two models of which no geoms can meet, by their filters or for want of geoms.
    """

    rules: tuple[ContactRule, ...]
    pairs: tuple[ContactPair, ...]
    unsupported: dict[frozenset[int], str]
    ignored: frozenset[frozenset[int]]
    left_out: frozenset[frozenset[int]]
    is_default: bool
    filtered: tuple[tuple[str, str], ...]


def resolve_contacts(config: ContactsConfig, system: System) -> Contacts:
    """Resolve the contact rules of a scenario.

    Raises:
        ScenarioFaults: An unknown name, a rule without pairs, or a pair of geoms that cannot meet or has no exact distance.
    """
    selector, can = GeomSelector(system), collidable(system.mj)
    can &= (selector.part[:, None] >= 0) & (selector.part[None, :] >= 0)
    is_default = config.rules is None
    stated = _default_rules(config, system, selector, can) if is_default else _stated_rules(config, selector, can)
    ignored = _ignored(config, selector)
    rules = _winners(stated, ignored)
    if is_default:
        rules = tuple(rule for rule in rules if rule.geoms)
    else:
        _refuse_without_pairs(rules)
    pairs, unsupported = _pairs(rules, system)
    _refuse_same_names(rules, pairs)
    filtered, behind_filters = _filtered(system, selector, can, pairs, ignored)
    for rule in rules:
        a, b = np.array(rule.geoms, dtype=np.intp).reshape(-1, 2).T
        can[a, b] = can[b, a] = False
    left_out = frozenset(frozenset(pair) for pair in np.argwhere(np.triu((can | behind_filters) & ~ignored)).tolist())
    ignored_ids = frozenset(frozenset(pair) for pair in np.argwhere(np.triu(ignored, 1)).tolist())
    return Contacts(rules, pairs, unsupported, ignored_ids, left_out, is_default, filtered)


def _filtered(
    system: System, selector: GeomSelector, can: Matrix, pairs: Sequence[ContactPair], ignored: Matrix
) -> tuple[tuple[tuple[str, str], ...], Matrix]:
    """Two models each that the filters of their files keep from meeting at all, and the pairs of their geoms.

    A satellite whose file switches the contacts of its own parts off would otherwise fly through another one unseen.
    """
    ruled = [{int(selector.part[geom]) for geom in pair.geom_ids} for pair in pairs]
    found, behind = [], np.zeros_like(can)
    for (i, a), (k, b) in combinations(enumerate(system.models), 2):
        between = np.ix_(selector.part == i, selector.part == k)
        if (a in system.fixed and b in system.fixed) or can[between].any() or {i, k} in ruled:
            continue
        if ignored[between].size == 0 or not ignored[between].all():
            found.append((a.name, b.name))
            behind[between] = True
    return tuple(found), behind | behind.T


@dataclass(frozen=True)
class _Stated:
    """A rule with all pairs that its sides name: a of the first side, b of the second, (ngeom, ngeom)."""

    config: ContactRuleConfig
    restitution: float
    mu: float
    pairs: Matrix


def _default_rules(config: ContactsConfig, system: System, selector: GeomSelector, can: Matrix) -> list[_Stated]:
    """A rule for each two models."""
    rules = [ContactRuleConfig(between=(a.name, b.name)) for a, b in combinations(system.models, 2)]
    return [_stated(rule, config, selector, can) for rule in rules]


def _stated_rules(config: ContactsConfig, selector: GeomSelector, can: Matrix) -> list[_Stated]:
    """The rules as stated.

    Raises:
        ScenarioFaults: An unknown name, or a rule that names no pair.
    """
    found, faults = [], []
    for i, rule in enumerate(config.rules or ()):
        try:
            each = _stated(rule, config, selector, can)
            if not each.pairs.any():
                faults.append(Fault(_no_pair(rule.between, selector, can), (*_RULES, i, "between")))
            found.append(each)
        except ScenarioFaults as error:
            faults += [Fault(fault.message, (*_RULES, i, *fault.path)) for fault in error.faults]
    if faults:
        raise ScenarioFaults(faults)
    return found


def _stated(rule: ContactRuleConfig, config: ContactsConfig, selector: GeomSelector, can: Matrix) -> _Stated:
    sides = _sides(rule.between, selector)
    # Two geoms by name are a pair whatever the filters say, as a <pair> of an MJCF is.
    pairs = _named(sides, selector) if all(side.is_geom for side in sides) else _named(sides, selector) & can
    return _Stated(rule, config.restitution_of(rule), config.mu_of(rule), pairs)


def _sides(names: Sequence[str], selector: GeomSelector) -> tuple[GeomSelection, GeomSelection]:
    """Geoms of the two sides of a rule.

    Raises:
        ScenarioFaults: An unknown name.
    """
    found: list[GeomSelection | None] = []
    faults = []
    for k, name in enumerate(names):
        try:
            found.append(None if name == SELF else selector.side(name))
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("between", k)))
    if not faults and not any(found):
        faults.append(Fault("'self' needs a model on the other side, such as [robot, self]", ("between",)))
    if faults:
        raise ScenarioFaults(faults)
    one, other = found
    given = one or other
    assert given is not None
    return one or selector.same_parts(given), other or selector.same_parts(given)


def _named(sides: tuple[GeomSelection, GeomSelection], selector: GeomSelector) -> Matrix:
    """Pairs of two sides, a of the first and b of the second; each pair once."""
    first, second = sides
    pairs = first.geoms[:, None] & second.geoms[None, :]
    if first.is_all or second.is_all:
        pairs &= selector.part[:, None] != selector.part[None, :]
    np.fill_diagonal(pairs, val=False)
    if not (first.is_geom and second.is_geom):
        # The robot is side a of its contacts with objects, so that normals and impulses point from the robot to the object.
        robot = selector.part == 0
        swap = pairs & ~robot[:, None] & robot[None, :]
        pairs = (pairs & ~swap) | swap.T
    twice = pairs & pairs.T
    return np.asarray(pairs & ~np.tril(twice))


def _no_pair(between: Sequence[str], selector: GeomSelector, can: Matrix) -> str:
    """Why two sides name no pair that can collide."""
    sides = _sides(between, selector)
    if sides[0].is_geom and sides[1].is_geom:
        return "names one geom twice"
    for name, side in zip(between, sides, strict=True):
        if not side.geoms.any():
            return f"{name!r} has no geom"
        if not can[side.geoms].any():
            return f"no geom of {name!r} can collide with anything: see contype and conaffinity in its model"
    if len({*selector.part[sides[0].geoms], *selector.part[sides[1].geoms]}) == 1:
        return "names no two geoms that can collide: MuJoCo's filters exclude those of one body or of joined bodies"
    return "names no two geoms that can collide: see contype, conaffinity and exclude in their models"


def _ignored(config: ContactsConfig, selector: GeomSelector) -> Matrix:
    """Ignored pairs, symmetric.

    Raises:
        ScenarioFaults: An unknown name.
    """
    ignored = np.zeros((len(selector.part),) * 2, dtype=bool)
    faults = []
    for i, each in enumerate(config.ignored):
        try:
            first, second = _sides(each.between, selector)
        except ScenarioFaults as error:
            faults += [Fault(fault.message, (*_IGNORED, i, *fault.path)) for fault in error.faults]
            continue
        pairs = first.geoms[:, None] & second.geoms[None, :]
        if first.is_all or second.is_all:
            pairs &= selector.part[:, None] != selector.part[None, :]
        ignored |= pairs | pairs.T
    if faults:
        raise ScenarioFaults(faults)
    return ignored


def _winners(stated: Sequence[_Stated], ignored: Matrix) -> tuple[ContactRule, ...]:
    """The rules with the pairs that no later rule has."""
    taken, rules = ignored.copy(), []
    for each in reversed(stated):
        left = each.pairs & ~taken
        taken |= left | left.T
        geoms = tuple((a, b) for a, b in np.argwhere(left).tolist())
        rule, matched, lost = each.config, int(each.pairs.sum()), int((each.pairs & ignored).sum())
        rules.append(ContactRule(rule.name, rule.between, each.restitution, each.mu, matched, lost, geoms))
    return tuple(reversed(rules))


def _refuse_without_pairs(rules: Sequence[ContactRule]) -> None:
    """Refuse rules that lose all their pairs: they have no effect.

    Raises:
        ScenarioFaults: There is one.
    """
    faults = []
    for i, rule in enumerate(rules):
        if not rule.geoms:
            takers = ["contacts.ignored"] * (rule.ignored > 0) + ["later rules, which win"] * (rule.ignored < rule.matched)
            message = f"has no effect: every pair that it names is in {' or '.join(takers)}"
            faults.append(Fault(message, (*_RULES, i)))
    if faults:
        raise ScenarioFaults(faults)


def _pairs(rules: Sequence[ContactRule], system: System) -> tuple[tuple[ContactPair, ...], dict[frozenset[int], str]]:
    """Pairs of all rules, and those that the shape of a geom rules out.

    Raises:
        ScenarioFaults: A pair that a rule names by its two geoms cannot meet, or has no exact distance.
    """
    names = short_names(geom_names(system))
    pairs: list[ContactPair] = []
    unsupported: dict[frozenset[int], str] = {}
    faults = []
    for i, rule in enumerate(rules):
        for a, b in rule.geoms:
            fault = shape_fault(system, a) or shape_fault(system, b)
            if fault and rule.matched > 1:
                unsupported[frozenset((a, b))] = fault
                continue
            name = rule.name if rule.matched == 1 else f"{names[a]}-{names[b]}"
            try:
                pairs.append(ContactPair(system, name, a, b, rule.restitution, rule.mu, rule=rule.name))
            except LookupError as error:
                faults.append(Fault(str(error.args[0]), (*_RULES, i, "between")))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(pairs), unsupported


def _refuse_same_names(rules: Sequence[ContactRule], pairs: Sequence[ContactPair]) -> None:
    """Refuse rules with one name, and a rule with the name of a pair of another rule.

    Raises:
        ScenarioFaults: There is one.
    """
    faults = []
    for i, rule in enumerate(rules):
        others = {other.name for other in rules[:i]} | {pair.name for pair in pairs if pair.rule != rule.name}
        if rule.name in others:
            message = f"another rule or pair has the name {rule.name!r}; give this rule a name of its own"
            faults.append(Fault(message, (*_RULES, i, "name")))
    if faults:
        raise ScenarioFaults(faults)
