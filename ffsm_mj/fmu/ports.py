"""Variables of a functional mock-up unit, declared by the scenario that it holds.

Names, units and meanings of outputs are those of the columns of a log. A scenario with the same text has the same variables
in the same order, so that their places identify them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.plant import record_kinds
from ffsm_mj.records.events import PhaseRecord
from ffsm_mj.records.kinds import kind_of, kinds_of
from ffsm_mj.records.signals import identifier
from ffsm_mj.simulation.outcome import Ended
from ffsm_mj.yaml import plain_value

Value = float | int | bool | str
Kind = Literal["Real", "Integer", "Boolean", "String"]
Causality = Literal["input", "output", "parameter"]

EXTERNAL = "{}.external"
"""Name of the parameter that hands an actuator to the master, whose input then commands it."""
OVERRIDES, RECORD = "overrides", "record"
"""Names of the parameters with further overrides, and with the run folder to write."""
PHASE, ENDED, OUTCOME = "phase.index", "ended", "outcome"
_IDENTIFYING = ("schema_version", "name", "description", "robot", "objects", "log")
"""Keys of a scenario whose values are no numbers to vary: what it is, its models, and what is written."""
_OF_STATE = ("state.q_", "state.v_", "state.tip_x_")
"""How columns of the state begin that show the present at any time; others are evaluated for rows."""


@dataclass(frozen=True)
class Port:
    """A variable of a unit.

    Attributes:
        name: Its name.
        kind: Its type.
        causality: What it is.
        start: Value at the start; of an output that before the first step.
        unit: Its unit; empty for none.
        description: Its meaning.
        least: Least value; None if it has none, or an infinite one.
        greatest: Greatest value; likewise.
    """

    name: str
    kind: Kind
    causality: Causality
    start: Value
    unit: str = ""
    description: str = ""
    least: float | None = None
    greatest: float | None = None


def parameters(scenario_yaml: str, actuators: Sequence[str]) -> list[Port]:
    """Parameters: what the scenario states as numbers or truths, actuators to hand over, further overrides, run folder."""
    text = "the master commands {} by its input, not the control laws of the phases"
    ports = [Port(EXTERNAL.format(name), "Boolean", "parameter", False, "", text.format(name)) for name in actuators]
    stated = {key: value for key, value in plain_value(scenario_yaml).items() if key not in _IDENTIFYING}
    for key, value in _leaves(stated):
        kind: Kind = "Boolean" if isinstance(value, bool) else "Real"
        ports.append(Port(key, kind, "parameter", value, "", f"key {key} of the scenario"))
    text = "further overrides of the scenario, KEY=VALUE separated by ';'"
    ports.append(Port(OVERRIDES, "String", "parameter", "", "", text))
    ports.append(Port(RECORD, "String", "parameter", "", "", "run folder to write; empty: none"))
    return ports


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, float | bool]]:
    """Numbers and truths of a scenario with their dotted keys."""
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _leaves(entry, f"{key}.{name}" if key else str(name))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for place, entry in enumerate(value):
            yield from _leaves(entry, f"{key}.{place}")
    elif isinstance(value, bool) or (isinstance(value, int | float) and math.isfinite(value)):
        yield key, value


def inputs(assembly: Assembly) -> list[Port]:
    """Commands of the actuators, in MuJoCo's order."""
    actuation, ports = assembly.actuation, []
    declared = {signal.key: signal for part in actuation.columns for signal in part.signals}
    for i, (key, (_, _, low, high)) in enumerate(zip(actuation.keys["command"], actuation.table.tolist(), strict=True)):
        # Bounds of a powered actuator; one that has none, or is without power at the start, states none.
        bounds = (low, high) if low < high else (-math.inf, math.inf)
        least, greatest = (bound if math.isfinite(bound) else None for bound in bounds)
        text = f"{declared[key].description}, if {EXTERNAL.format(actuation.names[i])}"
        ports.append(Port(key, "Real", "input", 0.0, declared[key].unit, text, least, greatest))
    return ports


class Outputs:
    """Outputs: state and sensors as in the rows of a log, contact forces, the phase, counts of events, how the run ended.

    Attributes:
        ports: They, with their values at the start.
    """

    def __init__(self, assembly: Assembly) -> None:
        """Bind to the components of a run at its start."""
        self._plant = plant = assembly.plant
        live = [part for part in plant.state.columns if part.signals[0].key.startswith(_OF_STATE)]
        live += () if plant.sampler is None else plant.sampler.columns
        self._live = [(part.signals, part.live) for part in live]
        self._rules = {pair.name: pair.rule for pair in assembly.pairs}
        self._forces = {rule: np.zeros(3) for rule in dict.fromkeys(self._rules.values())}
        names = record_kinds(assembly.scenario, (*assembly.pairs, *assembly.limits), plant.integrator.sources)
        self.counts = {kind.plural: 0 for kind in kinds_of(names) if kind.plural}
        self.phase = 0
        declared = [(signal.key, signal.unit, signal.description) for signals, _ in self._live for signal in signals]
        for rule in self._forces:
            text = f"sum of the contact forces of {rule} on the second body, world axes"
            declared += [(f"contact.{identifier(rule)}_force_{axis}_N", "N", text) for axis in "xyz"]
        whole = [(PHASE, "number of the phase, from 0")]
        whole += [(f"events.{name}", f"{name.replace('_', ' ')} so far") for name in self.counts]
        values = iter(self.values(None))
        self.ports = [Port(name, "Real", "output", next(values), unit, text) for name, unit, text in declared]
        self.ports += [Port(name, "Integer", "output", next(values), "", text) for name, text in whole]
        self.ports.append(Port(ENDED, "Boolean", "output", next(values), "", "the run has ended"))
        self.ports.append(Port(OUTCOME, "String", "output", next(values), "", "how it ended"))

    def count(self, events: Iterable[Any]) -> None:
        """Take the events of a step into account."""
        for event in events:
            if (name := kind_of(event).plural) in self.counts:
                self.counts[name] += 1
            if isinstance(event, PhaseRecord):
                self.phase = event.index

    def values(self, ended: Ended | None) -> list[Value]:
        """Values at the present state, in the order of the ports."""
        numbers = [value for _, live in self._live for value in live.tolist()]
        for force in self._forces.values():
            force[:] = 0.0
        for contact in self._plant.integrator.contacts():
            self._forces[self._rules[contact.pair]] += contact.force_N
        for force in self._forces.values():
            numbers += force.tolist()
        how = ("", "") if ended is None else (ended.outcome.value, ended.message)
        return [*numbers, self.phase, *self.counts.values(), ended is not None, ": ".join(filter(None, how))]
