"""A run that begins at an instant of another one: ``initial.from`` of a scenario, and ``ffsm run RUN --from TIME``.

A log has states only where the scenario asks for them (``log.states``): the other run goes on from the last one before the
instant, or is made again from its beginning, with the scenario and the models in its folder; its state at the instant is
compared with the logged row. A run that begins so keeps that scenario and these models in its own folder, and does not
depend on the other run any more.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import load_run
from ffsm_mj.assembly.assemble import CompiledScenario
from ffsm_mj.assembly.process import noted, one_blas_thread
from ffsm_mj.assembly.run import Recording
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.log.mcap.reader import stored_states
from ffsm_mj.log.run_folder import BEFORE, SCENARIO, find_log, holds_log
from ffsm_mj.log.scenario import laws_differ
from ffsm_mj.model.mujoco_process import collected_warnings, stopped_clock
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.scenario.source import YamlSource
from ffsm_mj.similar_names import similar_file
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.progress import Start
from ffsm_mj.state import StateError, as_mappings, from_bytes
from ffsm_mj.yaml import plain_value

TOLERANCE = 1e-6
"""Allowed difference from the logged state, relative to max(1, |x|): another processor rounds otherwise."""
_KEPT = (
    *("robot", "objects", "model", "controller_model", "time_step_s", "control_period_s", "accuracy"),
    *("actuation", "sensors", "estimator", "seed", "environment"),
)
"""Sections of a scenario that cannot change in the midst of a motion, beside the initial state."""
_MAY_CHANGE = ("environment", "fields")
"""But for this part: where the origin is on its orbit follows from its past, what other fields do does not."""
_OF_FILE = ("name", "description", "initial", "log", "duration_s")
"""Keys that never change the parts of the simulation."""
_FROM, _AT = ("initial", "from"), ("initial", "at_s")
INSTANT = 1e-9
"""A tick or event this close before an instant, in control periods, is at it."""
_UNDER_WAY: ContextVar[tuple[Path, ...]] = ContextVar("scenarios that are being prepared", default=())


@dataclass(eq=False)
class Origin:
    """The instant of another run at which a run begins.

    Attributes:
        folder: Folder of the other run.
        before: The other run.
        at_s: The instant, s: the run begins at the first control tick or event at or after it.
        new_laws: Phases or task change there: the control law of the phase under way begins anew.
        replaced: Phases, by position, whose control laws are of another kind from there on.
    """

    folder: Path
    before: CompiledScenario
    at_s: float
    new_laws: bool = False
    replaced: tuple[int, ...] = ()
    _start: list[Start] = field(default_factory=list)

    @property
    def files(self) -> dict[str, bytes]:
        """What the run keeps of the other one, contents by name in run folder and log."""
        kept = {SCENARIO: self.before.scenario_yaml.encode(), **self.before.logged_files}
        return {f"{BEFORE}/{name}": content for name, content in kept.items()}

    @property
    def notes(self) -> list[str]:
        """What begins anew there, one line each."""
        anew = "the control law of the phase under way begins anew"
        return [f"phases or task are not those of {self.folder}: {anew} at {self.at_s:g} s"] if self.new_laws else []

    def start(self) -> Start:
        """State at which the run begins; the other run is made again at the first call.

        Raises:
            InputError: It does not reach the instant, or does not arrive at its logged state.
            KeyboardInterrupt: It was interrupted.
        """
        if not self._start:
            self._start.append(self._repeated_start())
        return self._start[0]

    @one_blas_thread()
    @stopped_clock()
    @np.errstate(all="ignore")
    def _repeated_start(self) -> Start:
        until_s = self.at_s - INSTANT * self.before.scenario.control_period_s
        for kept in (*self._states_before(until_s), None):
            with suppress(StateError):  # of another version, or damaged: another one, or the beginning, will do
                simulation, state = self._at_instant(kept, until_s)
                break
        if simulation.interrupted():
            raise KeyboardInterrupt
        if simulation.ended is not None:
            end_s, why = simulation.progress.time_s, simulation.ended.outcome.value
            raise InputError(f"{self.folder}: the run ends at {end_s:.6g} s ({why}), before {self.at_s:g} s")
        if holds_log(self.folder):
            self._compare(simulation)
        return Start(simulation.progress.time_s, state, self.new_laws, self.replaced)

    def _states_before(self, until_s: float) -> Iterator[Any]:
        """States in the log of the other run up to a time, the last one first; none if its files have changed since."""
        if not holds_log(self.folder):
            return
        before, header = self.before, load_run(self.folder).log.header
        if header.scenario_yaml != before.scenario_yaml or before.logged_files.items() - header.files.items():
            return
        for data in reversed(stored_states(find_log(self.folder))):
            with suppress(StateError, LookupError, TypeError, ValueError):  # of another version, or damaged
                state = from_bytes(data)
                if state["progress"]["time_s"] <= until_s:
                    yield state

    def _at_instant(self, kept: Any, until_s: float) -> tuple[Simulation, Any]:
        """The other run at the instant, with its state there, from a state of its log or from its beginning."""
        assembly = self.before.assemble()
        recording = Recording(assembly, columns=())
        simulation, state = recording.simulation, None
        with noted() as simulation.interrupted, collected_warnings(simulation.warnings), recording:
            simulation.begin()
            if kept is not None:
                simulation.set_state(kept)
            elif self.before.start is not None:
                simulation.go_on_from(self.before.start())
            while simulation.ended is None and simulation.progress.time_s < until_s:
                simulation.advance(to_event=True)
            if simulation.ended is None:
                state = simulation.get_state()
        return simulation, state

    def _compare(self, simulation: Simulation) -> None:
        """Compare the state with the logged one; between two ticks, at an event, there is none.

        Raises:
            InputError: They differ.
        """
        logged, now = load_run(self.folder), simulation.progress.time_s
        row = int(np.searchsorted(logged.time, now - 1e-9))
        if row == len(logged.time) or simulation.due is not None:
            return
        data = simulation.observation().free
        state, expected = np.concatenate((data.qpos, data.qvel)), np.concatenate((logged.qpos[row], logged.qvel[row]))
        apart = np.abs(state - expected) / np.maximum(1.0, np.abs(expected))
        if not apart.max() <= TOLERANCE:
            raise InputError(
                f"{self.folder}: the run cannot be made again: at {now:.6g} s its state differs from the logged one by"
                f" {apart.max():.3g}; it was made by another version, or its files have changed"
            )


def origin_of(config: ScenarioConfig, source: YamlSource, prepare: Callable[[Path], CompiledScenario]) -> Origin | None:
    """The instant of another run at which a scenario begins; None if it begins at t = 0.

    Args:
        config: The scenario.
        source: Where its keys stand.
        prepare: Prepares the scenario of the other run.

    Raises:
        InputError: There is no such run, it does not last until then, or it begins at an instant of itself.
    """
    initial = config.initial
    if initial.from_ is None or initial.at_s is None:
        return None
    folder = source.beside(_FROM, initial.from_)
    with source.locating():
        file = folder / SCENARIO
        if not os.path.lexists(folder):
            raise ScenarioFaults([Fault(f"no such run {folder}{similar_file(folder)}", _FROM)])
        if not file.is_file():
            raise ScenarioFaults([Fault(f"{folder} is no run folder that can go on: it has no {SCENARIO}", _FROM)])
        if file.resolve() in _UNDER_WAY.get():
            raise ScenarioFaults([Fault(f"{folder} begins at an instant of itself", _FROM)])
        token = _UNDER_WAY.set((*_UNDER_WAY.get(), file.resolve()))
        try:
            before = prepare(file)
        finally:
            _UNDER_WAY.reset(token)
        begins_s = before.scenario.initial.at_s or 0.0
        if not begins_s < initial.at_s < before.scenario.duration_s:
            lasts = f"which lasts from {begins_s:g} to {before.scenario.duration_s:g} s"
            raise ScenarioFaults([Fault(f"{initial.at_s:g} s is not an instant of {folder}, {lasts}", _AT)])
        if not initial.at_s < config.duration_s:
            raise ScenarioFaults([Fault(f"{initial.at_s:g} s is not before the end, {config.duration_s:g} s", _AT)])
    return Origin(folder, before, initial.at_s)


def with_initial_state(config: ScenarioConfig, origin: Origin, source: YamlSource) -> ScenarioConfig:
    """The scenario with the state at t = 0 of the run that it goes on from.

    Raises:
        InputError: It states another one.
    """
    before, initial = origin.before.scenario.initial, config.initial
    with source.locating():
        for key, left_out in (("joints", {}), ("rates", {}), ("frame", "world")):
            if getattr(initial, key) not in (left_out, getattr(before, key)):
                raise ScenarioFaults([Fault(_cannot_change(origin), ("initial", key))])
    state = before.model_copy(update={"from_": str(origin.folder), "at_s": initial.at_s})
    return config.model_copy(update={"initial": state})


def refuse_changes(origin: Origin, after: CompiledScenario) -> None:
    """Refuse what cannot change in the midst of a motion, and note whether the control laws do.

    Raises:
        InputError: One line per fault.
    """
    before = origin.before
    old, new = plain_value(before.scenario_yaml), plain_value(after.scenario_yaml)
    changed = (path for key in _KEPT for path in _differences(old.get(key), new.get(key), (key,)))
    faults = [Fault(_cannot_change(origin), path) for path in changed if path[:2] != _MAY_CHANGE]
    old_files, new_files = before.system.logged_files, after.system.logged_files
    if not faults and old_files != new_files:
        names = sorted(name for name in old_files.keys() | new_files.keys() if old_files.get(name) != new_files.get(name))
        faults.append(Fault(f"the models are not those of {origin.folder}: {', '.join(names[:3])} differ", _FROM))
    with after.source.locating():
        if faults:
            raise ScenarioFaults(faults)
        changed_keys = [key for key in new if key not in _OF_FILE and old.get(key) != new[key]]
        origin.replaced = _replaced_laws(before, after, changed_keys)
    origin.new_laws = laws_differ(old, new) or before.recorded.contents != after.recorded.contents


def _cannot_change(origin: Origin) -> str:
    return f"cannot change where a run goes on, but is not that of {origin.folder}"


def _differences(old: Any, new: Any, path: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:
    """Keys with different values, innermost ones."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*old, *new]):
            yield from _differences(old.get(key), new.get(key), (*path, key))
    elif old != new:
        yield path


def _replaced_laws(before: CompiledScenario, after: CompiledScenario, changed: Sequence[str]) -> tuple[int, ...]:
    """Phases, by position, whose control laws are of another kind: they remember nothing of the motion so far.

    Raises:
        ScenarioFaults: The simulation has other parts beside these laws, whose memory is not in the state.
    """
    old, new = _begun(before), _begun(after)
    phases = zip(before.scenario.phases, after.scenario.phases, strict=False)
    others = tuple(i for i, (one, other) in enumerate(phases) if one.kind != other.kind)
    difference = _difference(old, new, others)
    if difference is not None:
        message = "where a run goes on, values may change, but not the parts of the simulation:"
        path = (changed[0],) if len(changed) == 1 else _FROM
        of = f"; these keys differ: {', '.join(changed)}" if len(changed) > 1 else ""
        raise ScenarioFaults([Fault(f"{message} there is {difference[1]} where there was {difference[0]}{of}", path)])
    return others


def _begun(compiled: CompiledScenario) -> Any:
    """State of a run before its first step: it says which parts there are."""
    simulation = Recording(compiled.assemble(), columns=()).simulation
    simulation.begin()
    return as_mappings(simulation.get_state())


def _difference(old: Any, new: Any, replaced: Sequence[int], place: str = "") -> tuple[str, str] | None:
    """The first parts that two states do not share, beside the control laws of some phases: those of either one."""
    if not (isinstance(old, Mapping) and isinstance(new, Mapping)):
        return None
    of_laws = place == "controller.laws"
    names, others = ([key for key in mapping if not (of_laws and key[0] in replaced)] for mapping in (old, new))
    if names != others and not place.endswith("telemetry"):
        one, other = (f"{place or 'simulation'}: {', '.join(map(str, keys)) or 'nothing'}" for keys in (names, others))
        return one, other
    differences = (_difference(old[key], new[key], replaced, f"{place}.{key}".lstrip(".")) for key in names if key in new)
    return next(filter(None, differences), None)
