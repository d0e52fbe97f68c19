"""Contact rules of a scenario, resolved to pairs of geoms, which are validated at the initial state."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.cone_pair import ConePair, cone_fault, cone_pairs
from ffsm_mj.contact.motion_bound import speeds_per_root_energy
from ffsm_mj.contact.pairs import ContactPair, shape_fault
from ffsm_mj.contact.sides import Sides
from ffsm_mj.contact.solid.welding import TooThinError
from ffsm_mj.contact.union_pair import UnionPair
from ffsm_mj.contact.watch import Matrix, collidable
from ffsm_mj.errors import Faults, plural, unknown_name
from ffsm_mj.model.system import System
from ffsm_mj.scenario.contacts import ContactRuleConfig, ContactsConfig
from ffsm_mj.tolerances import CLEARLY_APART_M, CONTACT_GAP_M

ALL, SELF, SUBTREE = "*", "self", "/*"
_RULES, _IGNORED = ("contacts", "rules"), ("contacts", "ignored")
_SHOWN = 5
"""Faults of one kind that are listed for one rule; of the others, only the number."""


@dataclass(frozen=True)
class GeomSelection:
    """The geoms of one side.

    Attributes:
        geoms: Mask over all geoms, (ngeom,).
        is_geom: Whether the side names a single geom.
        is_all: Whether it is ``"*"``.
    """

    geoms: npt.NDArray[np.bool_]
    is_geom: bool = False
    is_all: bool = False


class GeomSelector:
    """Resolves sides of contact rules.

    Attributes:
        part: Number of the model of each geom, in the order of the scenario; -1 for geoms of the world, (ngeom,).
    """

    def __init__(self, system: System) -> None:
        """Index the geoms of a system."""
        self._system, model = system, system.mj
        self._bodies = np.asarray(model.geom_bodyid)
        part_of_body = np.full(model.nbody, -1)
        for number, part in enumerate(system.models):
            part_of_body[list(part.bodies)] = number
        self.part = part_of_body[self._bodies]
        self._parts = {part.name: number for number, part in enumerate(system.models)}
        names = geom_names(system)
        self._geoms = {name: geom for some in (short_names(names), names) for geom, name in enumerate(some)}

    def side(self, name: str) -> GeomSelection:
        """Geoms of a side other than ``self``.

        Raises:
            LookupError: No model, body, subtree or geom has this name, or the name is ambiguous.
        """
        if name == ALL:
            return GeomSelection(self.part >= 0, is_all=True)
        if name in self._parts:
            return GeomSelection(self.part == self._parts[name])
        if name.endswith(SUBTREE):
            return GeomSelection(self._subtree(name))
        if name in self._geoms:
            chosen = np.zeros(len(self.part), dtype=bool)
            chosen[self._geoms[name]] = True
            return GeomSelection(chosen, is_geom=True)
        return GeomSelection(self._bodies == self._body(name, name))

    def same_parts(self, side: GeomSelection) -> GeomSelection:
        """All geoms of the models that the geoms of a side belong to."""
        return GeomSelection(np.isin(self.part, self.part[side.geoms]) & (self.part >= 0))

    def _subtree(self, name: str) -> npt.NDArray[np.bool_]:
        model, body = self._system.mj, self._body(name.removesuffix(SUBTREE), name)
        inside = np.zeros(model.nbody, dtype=bool)
        inside[body] = True
        for descendant in range(body + 1, model.nbody):  # a parent precedes its children
            inside[descendant] |= inside[model.body_parentid[descendant]]
        return np.asarray(inside[self._bodies])

    def _body(self, body: str, name: str) -> int:
        system = self._system
        try:
            return system.index("body", body)
        except LookupError as error:
            if "ambiguous" in str(error):
                raise
            if name == body and sum(full.endswith(f"/{name}") for full in system.names("geom")) > 1:
                system.resolve("geom", name)  # raises: several models have this geom
            known = {*self._parts, *system.names("body"), *system.names("geom")}
            raise LookupError(unknown_name("model, body or geom", name, known)) from None


def geom_names(system: System) -> tuple[str, ...]:
    """Full names of all geoms by id."""
    return tuple(system.mj.geom(geom).name for geom in range(system.mj.ngeom))


def short_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names without the prefix of their model, where what remains is unique."""
    bare = [name.split("/", 1)[-1] for name in names]
    count = Counter(bare)
    return tuple(
        short if count[short] == 1 and short not in names else name for short, name in zip(bare, names, strict=True)
    )


@dataclass(frozen=True)
class ContactRule:
    """A rule with the pairs that it has.

    Attributes:
        name: Name of the rule.
        between: Its two sides as written.
        restitution: Coefficient of restitution.
        mu: Coefficient of friction.
        compliance_ratio: Tangential over normal compliance; 0: not stated.
        matched: Number of pairs that its sides name.
        ignored: Number of these that are ignored.
        geoms: Ids of the geoms a and b of its pairs: those that no later rule and no ignored contact takes.
    """

    name: str
    between: tuple[str, ...]
    restitution: float
    mu: float
    compliance_ratio: float
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
    selector, can = GeomSelector(system), collidable(system.mj, system.cones)
    can &= (selector.part[:, None] >= 0) & (selector.part[None, :] >= 0)
    is_default = config.rules is None
    stated = _default_rules(config, system, selector, can) if is_default else _stated_rules(config, selector, can)
    ignored = _ignored(config, selector)
    rules = _winners(stated, ignored)
    if is_default:
        rules = tuple(rule for rule in rules if rule.geoms)
    pairs, unsupported = _pairs(rules, system, config.weld_m)
    _refuse_ineffective(rules, pairs)
    filtered, behind_filters = _filtered(system, selector, can, pairs, ignored)
    for rule in rules:
        a, b = np.array(rule.geoms, dtype=np.intp).reshape(-1, 2).T
        can[a, b] = can[b, a] = False
    cones = list(system.cones)
    can[cones] = can[:, cones] = behind_filters[cones] = behind_filters[:, cones] = False  # no overlap of theirs is reported
    left_out = frozenset(frozenset(pair) for pair in np.argwhere(np.triu((can | behind_filters) & ~ignored)).tolist())
    ignored_ids = frozenset(frozenset(pair) for pair in np.argwhere(np.triu(ignored, 1)).tolist())
    return Contacts(rules, pairs, unsupported, ignored_ids, left_out, is_default, filtered)


def _filtered(
    system: System, selector: GeomSelector, can: Matrix, pairs: Sequence[ContactPair], ignored: Matrix
) -> tuple[tuple[tuple[str, str], ...], Matrix]:
    """Two models each that the filters of their files keep from meeting at all, and the pairs of their geoms.

    A satellite whose file switches the contacts of its own parts off would otherwise fly through another one unseen.
    """
    ruled = [{int(selector.part[geom]) for geom in pair.ids} for pair in pairs]
    shielding, behind = [], np.zeros_like(can)
    for (i, a), (k, b) in combinations(enumerate(system.models), 2):
        between = np.ix_(selector.part == i, selector.part == k)
        if (a in system.fixed and b in system.fixed) or can[between].any() or {i, k} in ruled:
            continue
        if ignored[between].size == 0 or not ignored[between].all():
            shielding.append((a.name, b.name))
            behind[between] = True
    return tuple(shielding), behind | behind.T


@dataclass(frozen=True)
class _Stated:
    """A rule with all pairs that its sides name: a of the first side, b of the second, (ngeom, ngeom)."""

    config: ContactRuleConfig
    restitution: float
    mu: float
    compliance_ratio: float
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
    rules = []
    with Faults() as faults:
        for i, rule in enumerate(config.rules or ()):
            with faults.below(*_RULES, i):
                rules.append(_stated(rule, config, selector, can))
                if not rules[-1].pairs.any():
                    faults.add(_no_pair(rule.between, selector, can), *_RULES, i, "between")
    return rules


def _stated(rule: ContactRuleConfig, config: ContactsConfig, selector: GeomSelector, can: Matrix) -> _Stated:
    sides = _sides(rule.between, selector)
    # Two geoms by name are a pair whatever the filters say, as a <pair> of an MJCF is.
    pairs = _named(sides, selector) if all(side.is_geom for side in sides) else _named(sides, selector) & can
    elastic = config.elastic_of(rule)
    ratio = 0.0 if elastic is None else elastic.compliance_ratio
    return _Stated(rule, config.restitution_of(rule), config.mu_of(rule), ratio, pairs)


def _sides(names: Sequence[str], selector: GeomSelector) -> tuple[GeomSelection, GeomSelection]:
    """Geoms of the two sides of a rule.

    Raises:
        ScenarioFaults: An unknown name.
    """
    selections: list[GeomSelection | None] = []
    with Faults() as faults:
        for k, name in enumerate(names):
            with faults.below("between", k):
                selections.append(None if name == SELF else selector.side(name))
        if not faults.collected and not any(selections):
            faults.add("'self' needs a model on the other side, such as [robot, self]", "between")
    one, other = selections
    named = one or other
    assert named is not None
    return one or selector.same_parts(named), other or selector.same_parts(named)


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
    with Faults() as faults:
        for i, rule in enumerate(config.ignored):
            with faults.below(*_IGNORED, i):
                first, second = _sides(rule.between, selector)
                pairs = first.geoms[:, None] & second.geoms[None, :]
                if first.is_all or second.is_all:
                    pairs &= selector.part[:, None] != selector.part[None, :]
                ignored |= pairs | pairs.T
    return ignored


def _winners(stated: Sequence[_Stated], ignored: Matrix) -> tuple[ContactRule, ...]:
    """The rules with the pairs that no later rule has."""
    claimed, rules = ignored.copy(), []
    for stated_rule in reversed(stated):
        left = stated_rule.pairs & ~claimed
        claimed |= left | left.T
        geoms = tuple((a, b) for a, b in np.argwhere(left).tolist())
        rule, matched, lost = stated_rule.config, int(stated_rule.pairs.sum()), int((stated_rule.pairs & ignored).sum())
        coefficients = (stated_rule.restitution, stated_rule.mu, stated_rule.compliance_ratio)
        rules.append(ContactRule(rule.name, rule.between, *coefficients, matched, lost, geoms))
    return tuple(reversed(rules))


def _pairs(
    rules: Sequence[ContactRule], system: System, weld_m: float
) -> tuple[tuple[ContactPair, ...], dict[frozenset[int], str]]:
    """Pairs of all rules, and those that the shape of a geom rules out.

    Geoms of rigid bodies with several pieces that touch each other are one pair for each two bodies.

    Raises:
        ScenarioFaults: A pair that a rule names by its two geoms cannot meet, or has no exact distance; or
            ``contacts.weld_m`` is too large for a piece.
    """
    names = short_names(geom_names(system))
    pairs: list[ContactPair] = []
    unsupported: dict[frozenset[int], str] = {}
    thin: dict[int, str] = {}
    oriented: set[tuple[int, int]] = set()
    sides = Sides(
        system, {geom for rule in rules for pair in rule.geoms for geom in pair if geom not in system.cones}, weld_m
    )
    with Faults() as faults:
        for i, rule in enumerate(rules):
            united: dict[tuple[int, int], list[tuple[int, int]]] = {}
            first = len(pairs)
            for a, b in rule.geoms:
                fault = shape_fault(system, a) or shape_fault(system, b)
                if fault and rule.matched > 1:
                    unsupported[frozenset((a, b))] = fault
                    continue
                if not fault and not system.cones.keys() & {a, b} and (sides.is_union(a) or sides.is_union(b)):
                    # All pairs of two bodies have one sense, whatever the order in which rules name their geoms.
                    bodies = sides.body_of(a), sides.body_of(b)
                    turned = bodies[::-1] in oriented
                    oriented.add(bodies[::-1] if turned else bodies)
                    united.setdefault(bodies[::-1] if turned else bodies, []).append((b, a) if turned else (a, b))
                    continue
                name = rule.name if rule.matched == 1 else f"{names[a]}-{names[b]}"
                with faults.below(*_RULES, i, "between"):
                    if system.cones.keys() & {a, b}:
                        # No overlap with the inside of a cone is seen by MuJoCo: the run could not end where they meet.
                        if fault := cone_fault(system, a, b):
                            faults.add(f"{fault}; list a geom that stays away in contacts.ignored", *_RULES, i, "between")
                        pairs += cone_pairs(system, name, (a, b), rule.restitution, rule.mu, rule.name)
                    else:
                        pairs.append(ContactPair(system, name, a, b, rule.restitution, rule.mu, rule=rule.name))
            for geoms in united.values():
                with faults.below(*_RULES, i, "between"):
                    try:
                        pairs.append(_union_pair(system, sides, rule, geoms, names))
                    except TooThinError as error:
                        thin[error.source] = error.sentence
            for pair in pairs[first:]:
                pair.compliance_ratio = rule.compliance_ratio
        for geom, sentence in thin.items():
            faults.add(f"{names[geom]} {sentence}", "contacts", "weld_m")
    UnionPair.join_rules(pairs)
    return tuple(pairs), unsupported


def _union_pair(
    system: System, sides: Sides, rule: ContactRule, geoms: Sequence[tuple[int, int]], names: Sequence[str]
) -> UnionPair:
    """The pair of the rigid bodies of some geoms."""
    first, second = (sorted({pair[k] for pair in geoms}) for k in (0, 1))
    a, b = (
        names[some[0]] if len(some) == 1 else rigid_body_name(system, sides.body_of(some[0])) for some in (first, second)
    )
    name = rule.name if rule.matched == len(geoms) else f"{a}-{b}"
    both = sides.of(first[0]), sides.of(second[0])
    return UnionPair(system, name, both, geoms, rule.restitution, rule.mu, rule.name)


def rigid_body_name(system: System, body: int) -> str:
    """Name of a rigid body without the prefix of its model, or that of the model for its base or a fixed object."""
    for fixed in system.fixed:
        if body in fixed.bodies:
            return fixed.name
    model, _, name = str(system.mj.body(body).name).partition("/")
    return name or model


def _refuse_ineffective(rules: Sequence[ContactRule], pairs: Sequence[ContactPair]) -> None:
    """Refuse rules that lose all their pairs, and rules with the name of another rule or of a pair of one."""
    with Faults() as faults:
        for i, rule in enumerate(rules):
            if not rule.geoms:
                takers = ["contacts.ignored"] * (rule.ignored > 0) + ["later rules, which win"] * (
                    rule.ignored < rule.matched
                )
                faults.add(f"has no effect: every pair that it names is in {' or '.join(takers)}", *_RULES, i)
        for i, rule in enumerate(rules if not faults.collected else ()):
            others = {other.name for other in rules[:i]} | {pair.name for pair in pairs if pair.rule != rule.name}
            if rule.name in others:
                message = f"another rule or pair has the name {rule.name!r}; give this rule a name of its own"
                faults.add(message, *_RULES, i, "name")


def refuse_undetectable(system: System, data: Any, contacts: Contacts) -> None:
    """Refuse pairs that overlap initially, or whose speed is not bounded by the energy.

    Raises:
        ScenarioFaults: There is such a pair.
    """
    names = [contact_rule.name for contact_rule in contacts.rules]
    with Faults() as faults:
        for failures in (_unbounded(system, data, contacts), overlapping(system, data, contacts)):
            by_rule: dict[str, list[str]] = {}
            for pair, message in failures:
                by_rule.setdefault(pair.rule, []).append(message)
            for rule, messages in by_rule.items():
                place = ("contacts",) if contacts.is_default else ("contacts", "rules", names.index(rule))
                for message in messages[:_SHOWN]:
                    faults.add(message, *place)
                if (more := len(messages) - _SHOWN) > 0:
                    faults.add(f"and {plural(more, 'more pair')} of this rule", *place)


def _unbounded(system: System, data: Any, contacts: Contacts) -> Iterator[tuple[ContactPair, str]]:
    speeds = speeds_per_root_energy(system.mj, data, contacts.pairs)
    for pair, speed in zip(contacts.pairs, speeds.tolist(), strict=True):
        if math.isinf(speed):
            message = f"a moment of inertia of {pair.geom_a} or {pair.geom_b} is less than rounding of the others"
            yield pair, f"{message}: no energy bounds how fast it spins"


def overlapping(system: System, data: Any, contacts: Contacts) -> Iterator[tuple[ContactPair, str]]:
    """Pairs that overlap at a state, kinematics current, each with a message; the deepest one of two geoms."""
    deepest: dict[frozenset[int], tuple[float, ContactPair]] = {}
    for i in BroadPhase(system.mj, contacts.pairs).within(data, 0.0):
        pair = contacts.pairs[i]
        # Queries of parts of meshes are of single precision: the support functions say what an overlap is.
        gap = pair.gap(system.mj, data)
        if -CLEARLY_APART_M < gap < -CONTACT_GAP_M:
            gap = min(near.gap for near in pair.proximities(system.mj, data))
        if gap < -CONTACT_GAP_M and (pair.geom_ids not in deepest or gap < deepest[pair.geom_ids][0]):
            deepest[pair.geom_ids] = gap, pair
    for gap, pair in deepest.values():
        message = f"{pair.geom_a} and {pair.geom_b} overlap by {-gap:.6g} m at the start"
        if isinstance(pair, ConePair):
            message += " (a cone is seen from inside; its outside is made of geoms of its body)"
        yield pair, f"{message}; move one of them, or list them in contacts.ignored"
