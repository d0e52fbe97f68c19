"""Impact pairs of a scenario, validated against models, ignored pairs and the initial state."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ffsm_mj.contact.features.search import persistence_fault
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.model.system import System
from ffsm_mj.scenario.impact_config import ImpactPairConfig
from ffsm_mj.scenario.scenario import Scenario
from ffsm_mj.tolerances import CONTACT_GAP_M


def impact_pairs(scenario: Scenario, system: System) -> tuple[ContactPair, ...]:
    """Impact pairs of a scenario, in its order.

    Raises:
        ScenarioFaults: An unknown geom, or one of the wrong model, that cannot meet the other or has no exact distance.
    """
    pairs, faults = [], []
    for i, config in enumerate(scenario.impact_pairs):
        wrong = [Fault(fault.message, ("impact_pairs", i, *fault.path)) for fault in _geom_faults(system, config)]
        faults += wrong
        if wrong:
            continue
        try:
            pair = ContactPair(system, config.name, *config.sides, config.restitution, config.mu)
            # An elastic pair never comes to rest.
            if config.restitution < 1.0 and (fault := persistence_fault(system.mj, *pair.ids)):
                faults.append(Fault(f"{pair}: {fault}; or set restitution to 1", ("impact_pairs", i)))
            pairs.append(pair)
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("impact_pairs", i)))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(pairs)


def _geom_faults(system: System, config: ImpactPairConfig) -> Iterator[Fault]:
    """What is wrong with the names of a pair's geoms."""
    if config.geoms is None:
        for key, name, side in zip(("robot_geom", "object_geom"), config.sides, ("the robot", "an object"), strict=True):
            fault = _side_fault(system, name, side)
            if fault:
                yield Fault(fault, (key,))
        return
    for k, name in enumerate(config.geoms):
        try:
            system.resolve("geom", name)
        except LookupError as error:
            yield Fault(str(error.args[0]), ("geoms", k))


def _side_fault(system: System, name: str, side: str) -> str:
    """What is wrong with the name of a geom that must be of the robot, or of an object; empty if it is valid."""
    valid = [full for full in system.names("geom") if full.startswith(f"{system.robot.name}/") == (side == "the robot")]
    try:
        full = system.resolve("geom", name)
    except LookupError as error:
        message = str(error.args[0])
        return unknown_name(f"geom of {side}", name, valid) if message.startswith("unknown") else message
    return "" if full in valid else f"{full} is not a geom of {side}; allowed: {', '.join(sorted(valid))}"


def refuse_undetectable(system: System, data: Any, pairs: tuple[ContactPair, ...]) -> None:
    """Refuse pairs that overlap initially, or whose speed is not bounded by the energy.

    Raises:
        ScenarioFaults: There is such a pair.
    """
    faults = []
    for i, pair in enumerate(pairs):
        if math.isinf(pair.speed_bound_per_root_energy(system.mj, data)):
            message = f"a moment of inertia of {pair.geom_a} or {pair.geom_b} is less than rounding of the others"
            faults.append(Fault(f"{message}: no energy bounds how fast it spins", ("impact_pairs", i)))
        gap = pair.gap(system.mj, data, 1.0)
        if gap < -CONTACT_GAP_M:
            message = f"{pair.geom_a} and {pair.geom_b} overlap by {-gap:.6g} m at the start; move one of them"
            faults.append(Fault(message, ("impact_pairs", i)))
    if faults:
        raise ScenarioFaults(faults)


def ignored_pairs(scenario: Scenario, system: System, pairs: tuple[ContactPair, ...]) -> frozenset[frozenset[int]]:
    """Geom ids of all ignored pairs of the scenario.

    Raises:
        ScenarioFaults: A name that there is not, or a pair that is listed twice, ignored too, or has the name of another.
    """
    ignored: set[frozenset[int]] = set()
    faults = []
    for i, config in enumerate(scenario.ignored_pairs):
        sides = []
        for k, name in enumerate(config.pair):
            geoms = _geoms_of(system, name)
            if not geoms:
                names = {part.name for part in system.models} | {
                    *system.names("body"),
                    *system.names("geom"),
                }
                faults.append(Fault(unknown_name("geom, body or model", name, names), ("ignored_pairs", i, "pair", k)))
            sides.append(geoms)
        ignored |= {frozenset((a, b)) for a in sides[0] for b in sides[1]}
    if faults:
        raise ScenarioFaults(faults)
    _refuse_contradictions(pairs, ignored)
    return frozenset(ignored)


def _refuse_contradictions(pairs: tuple[ContactPair, ...], ignored: set[frozenset[int]]) -> None:
    """Refuse pairs that are listed twice, share a name, or are also ignored."""
    faults: list[Fault] = []
    for i, pair in enumerate(pairs):
        if any(pair.geom_ids == other.geom_ids for other in pairs[:i]):
            faults.append(Fault(f"{pair} is listed twice", ("impact_pairs", i)))
        else:
            same = next((other for other in pairs[:i] if pair.name == other.name), None)
            if same is not None:
                message = f"{pair} and {same} have the name {pair.name!r}; give one of them another"
                faults.append(Fault(message, ("impact_pairs", i, "name")))
        if pair.geom_ids in ignored:
            faults.append(Fault(f"{pair} is also in ignored_pairs", ("impact_pairs", i)))
    if faults:
        raise ScenarioFaults(faults)


def _geoms_of(system: System, name: str) -> list[int]:
    """Geoms of a name: those of a model, of a body, or the geom itself."""
    model = system.mj
    for part in system.models:
        if part.name == name:
            return [g for g in range(model.ngeom) if model.geom_bodyid[g] in part.bodies]
    for kind in ("geom", "body"):
        try:
            index = system.index(kind, name)
        except LookupError:
            continue
        return [index] if kind == "geom" else [g for g in range(model.ngeom) if model.geom_bodyid[g] == index]
    return []
