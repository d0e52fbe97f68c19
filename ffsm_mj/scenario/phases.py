"""Configuration of the phases of a scenario, and their graph: which leads where, and loops that take no time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self, TypeAlias

from pydantic import (
    ConfigDict,
    Field,
    PositiveFloat,
    SerializeAsAny,
    model_validator,
)

from ffsm_controllers import kinds
from ffsm_controllers.settled import SettledConfig
from ffsm_controllers.stop_condition import StopCondition
from ffsm_mj.config import Name, PartName, StrictModel, chosen_by_kind
from ffsm_mj.errors import Fault, unknown_name

if TYPE_CHECKING:
    ControllerConfig: TypeAlias = Any
    OptionalController: TypeAlias = Any
else:
    ControllerConfig = chosen_by_kind(kinds().configs)
    OptionalController = ControllerConfig | None


class _SensorBound(StrictModel):
    """A bound on a measurement."""

    above: float | None = None
    """The phase ends above this value, in the unit of the sensor."""
    below: float | None = None
    """The phase ends below this value."""

    @model_validator(mode="after")
    def _has_one_bound(self) -> Self:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', one of the two")
        return self


class SensorEndConfig(_SensorBound):
    """A phase ends at a control tick at which a valid measurement is beyond a bound."""

    sensor: Name
    """A sensor; of a vector its norm counts, of a force or torque sensor the greater one of its value and its mean over the
    interval, which contains impulses."""


class SensorBranchConfig(_SensorBound):
    """A measurement beyond a bound, of a vector its norm, and the phase that follows."""

    phase: Name
    """The phase that follows."""


class PhaseEnd(NamedTuple):
    """One of the ends of a phase.

    Attributes:
        keys: Its keys in the phase.
        trigger: ``impact``, ``time``, ``settled``, ``stop_when``, ..., or the bound on a measurement.
        to: Name of the phase that follows; None: the next one.
    """

    keys: tuple[str, ...]
    trigger: str | SensorEndConfig
    to: str | None

    @property
    def event(self) -> str | None:
        """The event or state of the control law that it waits for; None for times, conditions and measurements."""
        return self.trigger if isinstance(self.trigger, str) and self.trigger not in ("time", "stop_when") else None


class PhaseConfig(StrictModel):
    """A phase of the task; it ends at events, when the tip has settled, after a time, or with the run."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["controller"]}, {"required": ["controllers"]}]})

    name: Name
    until: Name | SensorEndConfig | None = None
    """``impact``, ``contact_begins``, ``contact_ends``, ``contact_slips``, ``contact_sticks`` (of a contact with friction),
    ``limit_impact``, ``limit_begins``, ``limit_ends`` (of a joint at a limit), ``grasp``, ``release`` or a record of a
    contact model: the first such event after the start of the phase; ``settled``: see that key; ``finished``: the control
    law has finished (``playback``: the record is over; ``joint_path``: the time of the last waypoint); ``end``: the end of
    the run; ``{sensor: NAME, above: VALUE}`` (or ``below``): a measurement."""
    on: dict[Name, Name | SensorBranchConfig] = {}
    """Phases that follow at other ends than that of ``until``, by what ends this one: an event or state as in ``until``,
    ``time`` (with ``for_s``), ``stop_when`` (with that key), or a sensor with ``{above: VALUE, phase: NAME}`` (or below).
    Of several at one instant the first one listed counts, and those here before ``until``. A phase may be entered again."""
    stop_when: str | None = None
    """A condition that ends the phase: ``base_rate``, ``joint_rate`` in rad/s, ``base_speed``, ``tip_speed`` in m/s or
    ``tip_error`` in m, or ``stack_momentum`` in N m s (of robot and grasped object without the wheels), ``<`` or ``>``,
    number and unit, and for how long: ``base_rate < 1e-3 rad/s for 2 s``."""
    settled: SettledConfig | None = None
    """With ``settled`` in ``until`` or ``on``: the phase ends when the tip has been near its target and slow for a time."""
    for_s: PositiveFloat | None = None
    """Duration in s; the phase ends at the first control tick at or after it, or before at the event of ``until``."""
    arm: tuple[Name, ...] = ()
    """Grasps that are armed during the phase; their bounds may already be met at its start."""
    release: tuple[Name, ...] = ()
    """Grasps that are released at the start of the phase."""
    controller: SerializeAsAny[OptionalController] = None
    """Control law, chosen by ``kind``."""
    controllers: Annotated[dict[PartName, SerializeAsAny[ControllerConfig]], Field(min_length=1)] | None = None
    """In place of ``controller``: several control laws at once by part of the robot, each with actuators of its own."""
    drives: dict[PartName, Name] = {}
    """Objects that parts of ``controllers`` drive, by the name of the part; all other parts drive the robot. For its law the
    object is in the place of the robot: its base, its joints, its thrusters and wheels."""

    @model_validator(mode="after")
    def _is_consistent(self) -> PhaseConfig:
        if self.controller is None and self.controllers is None:
            raise ValueError("a phase needs 'controller: {kind: ...}', or 'controllers: {PART: {kind: ...}, ...}'")
        if self.controller is not None and self.controllers is not None:
            raise ValueError("has both 'controller' and 'controllers'; leave one of them out")
        if unknown := [part for part in self.drives if part not in (self.controllers or {})]:
            raise ValueError(f"'drives' names {unknown[0]!r}, which is no part of 'controllers'")
        if self.stop_when is not None:
            StopCondition.parse(self.stop_when)
        if message := self._fault_of_ends():
            raise ValueError(message)
        return self

    def _fault_of_ends(self) -> str:
        """What is wrong with the ends of the phase as a whole; empty if nothing is."""
        ends = {"time": ("for_s", self.for_s), "stop_when": ("stop_when", self.stop_when)}
        needs = ends | {"settled": ("settled", self.settled)}
        faults = [
            f"'on: {trigger}' needs {key!r}" for trigger, (key, value) in needs.items() if trigger in self.on and not value
        ]
        if isinstance(self.until, str) and self.until in self.on:
            faults.append(f"{self.until!r} is in 'until' and in 'on'; leave one of them out")
        if not (self.until or self.for_s or self.stop_when or self.on):
            faults.append("a phase needs 'until' (impact, settled, end, ...) or 'for_s', or an event and 'for_s'")
        if self.until == "settled" and self.settled is None:
            faults.append("'until: settled' needs 'settled: {error_m: ..., speed_m_s: ..., for_s: ...}'")
        if self.until != "settled" and "settled" not in self.on and self.settled is not None:
            faults.append("'settled' has no effect without 'until: settled'; leave it out")
        if self.until == "end":
            without = [key for trigger, (key, value) in ends.items() if value is not None and trigger not in self.on]
            faults += [f"{key!r} has no effect with 'until: end'; leave one of them out" for key in without]
        return faults[0] if faults else ""

    @property
    def ends(self) -> list[PhaseEnd]:
        """What ends the phase, in the order in which it counts at one instant; empty if only the end of the run does."""
        phase_ends = [
            PhaseEnd(("on", name), name, to)
            if isinstance(to, str)
            else PhaseEnd(("on", name), SensorEndConfig(sensor=name, above=to.above, below=to.below), to.phase)
            for name, to in self.on.items()
        ]
        if self.until is not None and self.until != "end":
            phase_ends.append(PhaseEnd(("until",), self.until, None))
        for trigger, key, value in (("stop_when", "stop_when", self.stop_when), ("time", "for_s", self.for_s)):
            if value is not None and trigger not in self.on:
                phase_ends.append(PhaseEnd((key,), trigger, None))
        return phase_ends

    @property
    def laws(self) -> dict[tuple[str, ...], Any]:
        """Configurations of the control laws by their keys in the phase: ``controller``, or ``controllers`` and a part."""
        if self.controllers is None:
            return {("controller",): self.controller}
        return {("controllers", part): law for part, law in self.controllers.items()}

    @property
    def kind(self) -> str:
        """Kind of the control law; with several parts ``name: kind`` of each."""
        if self.controllers is None:
            return str(self.controller.kind)
        return ", ".join(f"{part}: {law.kind}" for part, law in self.controllers.items())


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
    edges = []
    for i, phase in enumerate(phases):
        for end in phase.ends:
            to = i + 1 if end.to is None else names.index(end.to) if end.to in names else len(names)
            if to < len(names):
                edges.append(PhaseEdge(i, end, to))
    return edges


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
        leaving = [edge for edge in edges if edge.start == i]
        for k, edge in enumerate(leaving):
            stem = "└─" if k == len(leaving) - 1 else "├─"
            back = " (again)" if edge.to <= i else ""
            lines.append(f"  {stem} {trigger_text(phase, edge.end)} → {phases[edge.to].name}{back}")
        if not leaving:
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
        node = waiting.pop()
        for edge in edges:
            if edge.start == node and edge.to not in reached:
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
        if edge.start == way[-1].to and all(edge.to != passed.to for passed in way):
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
