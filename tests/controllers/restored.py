"""A control law in an open loop, saved at a tick and restored: what it does then, and which fields of its state matter."""

from __future__ import annotations

import copy
import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import mujoco
import numpy as np

import ffsm_mj
from ffsm_mj.controller_protocol import Command, Observation, Stateful
from ffsm_mj.state import from_bytes, to_bytes
from tests.laws import Law

START_S, SAVED, TICKS = 0.3, 12, 24


@dataclass(frozen=True)
class Case:
    """A control law, or the trigger of its phase, with the states that it sees.

    Attributes:
        scenario: Name or path of the scenario.
        overrides: Its overrides.
        grasp: Name of the grasp in whose system the law is; empty: that without a grasp.
        controllers: Control laws of its own.
        trigger: The trigger of the first ending of the phase is looked at in place of the law.
        size: Size of the deviation from the initial state by the tick, from 0.
    """

    scenario: Any
    overrides: Mapping[str, Any] = field(default_factory=dict)
    grasp: str = ""
    controllers: Mapping[str, Any] = field(default_factory=dict)
    trigger: bool = False
    size: Callable[[int], float] = lambda tick: 0.1 if 0 < tick < 6 else 0.02


class Trigger(Law):
    """A trigger of a phase as if it were a control law: it commands whether it is due."""

    def __init__(self, trigger: Any) -> None:
        self._trigger = trigger
        self.start, self.get_state, self.set_state = trigger.begin, trigger.get_state, trigger.set_state

    def control(self, observation: Observation, command: Command) -> None:
        """Say whether it is due."""
        command.effort[0] = self._trigger.is_due(observation, START_S, self)


class OpenLoop:
    """A case with its states: one MuJoCo data for all laws."""

    def __init__(self, case: Case) -> None:
        """Assemble it once to have the model."""
        self._case = case
        with self._simulator() as simulator:
            simulator.reset()
            assembly = simulator.assembly
            self.model = (assembly.grasped_systems[case.grasp].system if case.grasp else assembly.system).mj
            self.period_s = assembly.scenario.control_period_s
            self._qpos, self._qvel = self.model.qpos0.copy(), np.zeros(self.model.nv)
            if not case.grasp:
                self._qpos, self._qvel = assembly.plant.data.qpos.copy(), assembly.plant.data.qvel.copy()
        self.data = mujoco.MjData(self.model)

    def _simulator(self) -> ffsm_mj.Simulator:
        case = self._case
        return ffsm_mj.Simulator(case.scenario, dict(case.overrides), controllers=case.controllers, record=False)

    def law(self) -> Any:
        """The law, made anew."""
        with self._simulator() as simulator:
            simulator.reset()
            phase = simulator.assembly.controller.phases[0]
            return Trigger(phase.endings[0].trigger) if self._case.trigger else phase.law(self._case.grasp)

    def at(self, tick: int, phase_start_s: float = START_S) -> Observation:
        """The state at a tick, all derived quantities current."""
        model, data, time_s, size = self.model, self.data, START_S + tick * self.period_s, self._case.size(tick)
        direction = np.sin(np.arange(1.0, model.nv + 1.0) + 0.05 * tick)
        data.qpos[:], data.qvel[:], data.time = self._qpos, self._qvel + size * direction, time_s
        mujoco.mj_integratePos(model, data.qpos, size * np.cos(3.0 * np.arange(model.nv)) + 0.001 * tick * direction, 1.0)
        mujoco.mj_forward(model, data)
        return Observation(time_s, data, free=data, phase_start_s=phase_start_s)

    def follow(self, law: Any, ticks: Sequence[int]) -> list[str]:
        """All that a law tells before, at and after some ticks, in texts that are exact."""
        found = [_told(law)]
        for tick in ticks:
            observation, command = self.at(tick), Command.off(self.model.nu)
            finished = law.is_finished(observation.time_s) if hasattr(law, "is_finished") else None
            law.control(observation, command)
            found.append(repr((finished, command.effort.tolist(), command.powered.tolist(), _told(law))))
        return found

    def restored(self, law: Any, state: Any) -> list[str]:
        """What a law tells that is restored by a state: begun at another time than that of its phase."""
        law.start(self.at(SAVED, phase_start_s=START_S + SAVED * self.period_s))
        law.set_state(state)
        return self.follow(law, range(SAVED, TICKS))


@dataclass
class Outcome:
    """What came of a case.

    Attributes:
        uninterrupted: What the law tells after the tick of the state.
        anew: The same of a law made anew and restored.
        back: The same of the first law, taken back from the last tick.
        idle: What a law tells that is restored without a start, as one whose phase is over.
        begun: What the first law tells of all ticks, and tells when it is taken back to before its start and started.
        noticed: Fields, as ``Class.field``, without which the restored law tells something else.
    """

    uninterrupted: list[str]
    anew: list[str]
    back: list[str]
    idle: str
    begun: tuple[list[str], list[str]]
    noticed: set[str]


def outcome(case: Case) -> Outcome:
    """Run a law, save it at a tick, and restore it: with its state, and with each field left as a new law has it."""
    loop = OpenLoop(case)
    law, other = loop.law(), loop.law()
    new = through_bytes(law)
    law.start(loop.at(0))
    first = loop.follow(law, range(SAVED))
    saved = through_bytes(law)
    other.set_state(saved)
    idle = _told(other)
    other.set_state(new)
    uninterrupted = loop.follow(law, range(SAVED, TICKS))
    other.start(loop.at(SAVED, phase_start_s=START_S + SAVED * loop.period_s))
    fresh, anew = through_bytes(other), loop.restored(other, saved)
    back = loop.restored(law, saved)
    noticed: set[str] = set()
    for path, owners in fields_of(other if not case.trigger else other._trigger, saved):
        if loop.restored(other, with_entry(saved, path, entry(fresh, path))) != uninterrupted:
            noticed |= owners
    law.set_state(new)
    law.start(loop.at(0))
    return Outcome(uninterrupted, anew, back, idle, (first, loop.follow(law, range(SAVED))), noticed)


def _told(law: Any) -> str:
    summary = law.summary() if hasattr(law, "summary") else None
    return repr((list(map(float, law.telemetry())), summary))


def through_bytes(part: Any) -> Any:
    """State of a part, as another process reads it."""
    return from_bytes(to_bytes(part.get_state()))


def fields_of(part: Any, state: Any, path: tuple[Any, ...] = (), owners: frozenset[str] = frozenset()) -> Iterator[Any]:
    """Path of each field in a state, with the names ``Class.field`` of it and of those that it is in."""
    for name, value in state.items():
        inside = getattr(part, f"_{name}") if hasattr(part, f"_{name}") else getattr(part, name, None)
        here, above = (*path, name), owners | {_declared_as(type(part), name)}
        parts = inside.items() if isinstance(inside, dict) else enumerate(inside) if isinstance(inside, list) else ()
        parts = [(key, each) for key, each in parts if hasattr(each, "get_state")]
        if hasattr(inside, "get_state") and value is not None:
            yield from fields_of(inside, value, here, above)
        elif parts:
            for key, each in parts:
                if value[key] is not None:
                    yield from fields_of(each, value[key], (*here, key), above)
        else:
            yield here, above


def _declared_as(kind: type, name: str) -> str:
    """Class whose state declares a field, and the field."""
    states = getattr(kind, "State", kind).__mro__
    owner = next((each for each in states if name in vars(each).get("__annotations__", {})), kind)
    return f"{owner.__qualname__.removesuffix('.State')}.{name}"


def entry(state: Any, path: Sequence[Any]) -> Any:
    """An entry of a state."""
    for key in path:
        state = state[key]
    return state


def with_entry(state: Any, path: Sequence[Any], value: Any) -> Any:
    """A state with another value of an entry."""
    changed = copy.deepcopy(state)
    entry(changed, path[:-1])[path[-1]] = value
    return changed


def declared(package: str) -> set[str]:
    """All fields of all states of a package, as ``Class.field``."""
    for module in pkgutil.walk_packages(import_module(package).__path__, f"{package}."):
        import_module(module.name)
    found, kinds = set(), [Stateful]
    for kind in kinds:
        kinds += kind.__subclasses__()
        if hasattr(kind, "State") and kind.__module__.startswith(package):
            found |= {_declared_as(kind, name) for name in kind.State.__dataclass_fields__}
    return found
