"""The graph of the phases of a scenario: which leads where, what is never reached, and loops that take no time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ffsm_controllers.stop_condition import StopCondition
from ffsm_mj.errors import Fault, unknown_name
from ffsm_mj.scenario.phase_config import PhaseConfig, PhaseEnd, SensorEndConfig


class PhaseEdge(NamedTuple):
    """A way from one phase to another.

    Attributes:
        start: Position of the phase that ends.
        end: That end of it.
        to: Position of the phase that follows.
    """

    start: int
    end: PhaseEnd
    to: int


def is_branching(phases: Sequence[PhaseConfig]) -> bool:
    """Whether a phase may lead to another one than the next."""
    return any(phase.on for phase in phases)


def phase_edges(phases: Sequence[PhaseConfig]) -> list[PhaseEdge]:
    """Ways between phases, in the order in which they count; without those to phases that do not exist."""
    names = [phase.name for phase in phases]
    found = []
    for i, phase in enumerate(phases):
        for end in phase.ends:
            to = i + 1 if end.to is None else names.index(end.to) if end.to in names else len(names)
            if to < len(names):
                found.append(PhaseEdge(i, end, to))
    return found


def trigger_text(phase: PhaseConfig, end: PhaseEnd) -> str:
    """What ends a phase, for a person: ``impact``, ``time 2.3 s``, ``gyro > 0.3``."""
    if isinstance(end.trigger, SensorEndConfig):
        sign, bound = (">", end.trigger.above) if end.trigger.above is not None else ("<", end.trigger.below)
        return f"{end.trigger.sensor} {sign} {bound:g}"
    if end.trigger == "time":
        return f"time {phase.for_s:g} s"
    return str(phase.stop_when) if end.trigger == "stop_when" else end.trigger


def graph_lines(phases: Sequence[PhaseConfig]) -> list[str]:
    """The graph as lines of text: every phase with its law, below it what ends it and what follows."""
    edges, lines = phase_edges(phases), []
    for i, phase in enumerate(phases):
        lines.append(f"{phase.name} ({phase.kind})")
        own = [edge for edge in edges if edge.start == i]
        for k, edge in enumerate(own):
            stem = "└─" if k == len(own) - 1 else "├─"
            back = " (again)" if edge.to <= i else ""
            lines.append(f"  {stem} {trigger_text(phase, edge.end)} → {phases[edge.to].name}{back}")
        if not own:
            lines.append("  └─ end of the run")
    return lines


def graph_faults(phases: Sequence[PhaseConfig]) -> list[Fault]:
    """Unknown phases, phases that are never reached, and loops that may take no time."""
    names = [phase.name for phase in phases]
    faults = [
        Fault(unknown_name("phase", end.to, names), ("phases", i, *end.keys))
        for i, phase in enumerate(phases)
        for end in phase.ends
        if end.to is not None and end.to not in names
    ]
    if faults:
        return faults
    edges = phase_edges(phases)
    reached, waiting = {0}, [0]
    while waiting:
        here = waiting.pop()
        for edge in edges:
            if edge.start == here and edge.to not in reached:
                reached.add(edge.to)
                waiting.append(edge.to)
    faults += [
        Fault("no phase that is reached leads to this one", ("phases", i, "name"))
        for i in range(len(phases))
        if i not in reached
    ]
    immediate = [edge for edge in edges if _is_immediate(phases[edge.start], edge.end)]
    return [*faults, *_loops_of_no_time(phases, immediate)]


def _is_immediate(phase: PhaseConfig, end: PhaseEnd) -> bool:
    """Whether this may end the phase as it begins: a measurement or a condition that already holds."""
    if isinstance(end.trigger, SensorEndConfig):
        return True
    return end.trigger == "stop_when" and StopCondition.parse(str(phase.stop_when)).for_s == 0.0


def _loops_of_no_time(phases: Sequence[PhaseConfig], edges: Sequence[PhaseEdge]) -> Iterator[Fault]:
    """Loops of ends that may all be due at once: no bounds in them exclude each other."""
    for first in edges:
        for loop in _loops([first], edges):
            if loop[0].start == min(edge.start for edge in loop) and _is_possible(phases, loop):
                way = " -> ".join(phases[edge.start].name for edge in [*loop, loop[0]])
                message = f"{way} is a loop of no time: all of its ends may be due at once; make one last, by 'for ... s'"
                yield Fault(message, ("phases", first.start, *first.end.keys))


def _loops(way: list[PhaseEdge], edges: Sequence[PhaseEdge]) -> Iterator[list[PhaseEdge]]:
    """Ways that go on from one and come back to its start, through no phase twice."""
    if way[-1].to == way[0].start:
        yield way
        return
    for edge in edges:
        if edge.start == way[-1].to and all(edge.to != each.to for each in way):
            yield from _loops([*way, edge], edges)


def _is_possible(phases: Sequence[PhaseConfig], loop: Sequence[PhaseEdge]) -> bool:
    """Whether the bounds of all ends of a loop can hold at once."""
    between: dict[str, tuple[float, float]] = {}
    for edge in loop:
        quantity, low, high = _bounds(phases[edge.start], edge.end)
        least, most = between.get(quantity, (-math.inf, math.inf))
        between[quantity] = max(least, low), min(most, high)
    return all(least < most for least, most in between.values())


def _bounds(phase: PhaseConfig, end: PhaseEnd) -> tuple[str, float, float]:
    """Quantity of an immediate end, and the values between which it is due."""
    if isinstance(end.trigger, SensorEndConfig):
        above, below = end.trigger.above, end.trigger.below
        return f"sensor {end.trigger.sensor}", -math.inf if above is None else above, math.inf if below is None else below
    condition = StopCondition.parse(str(phase.stop_when))
    return (condition.quantity, *((-math.inf, condition.bound) if condition.below else (condition.bound, math.inf)))
