"""A simulator that steps: the program that owns it decides when time goes on, and with which efforts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from contextvars import copy_context
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.given_command import given_command
from ffsm_mj.assembly.prepare import PreparedRun, as_overrides, prepare
from ffsm_mj.assembly.recording import Recording
from ffsm_mj.assembly.step_interrupts import StepInterrupts
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import FfsmError, InputError
from ffsm_mj.log.event_tap import EventTap
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.mujoco_clock import stopped_clock
from ffsm_mj.model.mujoco_warnings import collecting, handled_warnings
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.run import Run
from ffsm_mj.simulation.ending import Ended
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.progress import EventDue

_DECISIONS = ("tick", "event")
_SAME_TIME = 1e-9
"""A control tick this close to a time, in control periods, is at it."""


class SimulatorError(FfsmError):
    """A simulator was used in a way that its state does not allow."""


@dataclass(frozen=True)
class SimulatorState:
    """State of a simulator; can be pickled.

    Attributes:
        time_s: Its simulation time, s.
        overrides: Overrides of the run, beside those of the simulator.
        seed: Key ``seed`` of the run, if one was given.
        fingerprint: Fingerprint of the scenario and of the parts of the simulation.
        contents: What these parts remember.
    """

    time_s: float
    overrides: tuple[str, ...]
    seed: int | None
    fingerprint: str
    contents: bytes


class Step(NamedTuple):
    """Result of a step.

    Attributes:
        observation: What a control law sees at the end of the step, before its decision there. Its MuJoCo data are those of
            the simulation: they show the present, and must not be written.
        events: Records of what happened in the step, contact events and phases.
        ended: How the run ended; None while it lasts.
    """

    observation: Observation
    events: tuple[Any, ...]
    ended: Ended | None


class Simulator:
    """Simulates a scenario step by step. A context manager: leaving it closes the run.

    A step takes the decision that is due, at a control tick or at an event, and simulates to the next. Without a command the
    phases of the scenario decide, exactly as in :func:`ffsm_mj.run`, which is the same simulation driven to its end. With a
    command the phases begin and end as the scenario says, but their control laws command only the actuators that the command
    leaves to them.

    A simulator serves one thread at a time; several simulators may run in several threads.
    """

    def __init__(
        self,
        scenario: str | Path,
        overrides: Sequence[str] | Mapping[str, Any] = (),
        *,
        record: str | Path | bool | None = None,
        seed: int | None = None,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
        rerun: bool | None = None,
        live: str | None = None,
        force: bool = False,
        raise_errors: bool = False,
    ) -> None:
        """Read, validate and compile a scenario; :meth:`reset` must follow.

        Args:
            scenario: A path, or the name of a shipped scenario.
            overrides: See :func:`ffsm_mj.run`, likewise ``controllers``, ``estimators``, ``rerun``, ``live``, ``force``.
            record: Run folder to write; each further run goes to a folder with a number appended. None keeps the rows of the
                run in memory; False keeps only its events.
            seed: The scenario's key ``seed``.
            controllers: Control laws of the caller's own.
            estimators: Estimators of the caller's own.
            rerun: Write ``run.rrd`` into the folder.
            live: ``host:port`` of a Rerun viewer to stream to.
            force: Replace a run that ``record`` already holds.
            raise_errors: Raise an exception of a control law, an estimator or a contact model, with its traceback.

        Raises:
            InputError: The scenario or a model is wrong, or the folder holds a run.
        """
        self._scenario, self._controllers, self._estimators = scenario, controllers, estimators
        self._overrides, self._seed, self._record = _as_list(overrides), seed, record
        self._rerun, self._live, self._force, self._raises = rerun, live, force, raise_errors
        self._runs = 0
        self._prepared: dict[tuple[str, ...], PreparedRun] = {}
        self._recording: Recording | None = None
        self._stack = ExitStack()
        # A run ends if its state is not finite; numpy's warnings would only repeat that.
        self._context = copy_context()
        self._context.run(np.seterr, all="ignore")
        self._recipe(())
        if isinstance(record, str | Path):
            self._folder().refuse_earlier_run()

    def reset(self, seed: int | None = None, overrides: Sequence[str] | Mapping[str, Any] | None = None) -> Observation:
        """Begin a run at the initial state of the scenario; one under way is closed as interrupted.

        Args:
            seed: The scenario's key ``seed`` for this run; None: that of the simulator.
            overrides: Further overrides for this run.

        Returns:
            What a control law sees at the start.

        Raises:
            InputError: The scenario does not allow an override, or the folder cannot be used.
        """
        self._begin(tuple(_as_list(overrides or ())), self._seed if seed is None else seed)
        return self.observation

    def _begin(self, overrides: tuple[str, ...], seed: int | None, start_s: float = 0.0) -> None:
        """Begin a run in place of one under way, which goes on if the overrides or the seed are wrong."""
        made = self._seeded(self._recipe(overrides), seed)
        self.close()
        assembly, self._recipe_of_run = made.assemble(), (overrides, seed)
        self._tap, self._assembly, self._controller = EventTap(), assembly, assembly.controller
        self._period_s, self._reported = made.scenario.control_period_s, 0
        with_rerun = made.scenario.log.rerun if self._rerun is None else self._rerun
        columns = () if self._record is False else None
        folder = self._folder() if isinstance(self._record, str | Path) else None
        recording = Recording(
            assembly, folder, with_rerun=with_rerun, live=self._live, columns=columns, watchers=[self._tap], start_s=start_s
        )
        # Held to the end of the run: to enter these contexts at each step would take as long as a step.
        with ExitStack() as stack:
            stack.enter_context(one_blas_thread())
            stack.enter_context(stopped_clock())
            stack.enter_context(handled_warnings())
            self._interrupts = stack.enter_context(StepInterrupts())
            stack.enter_context(recording)
            recording.simulation.interrupted = self._interrupts.noted
            with collecting(recording.simulation.warnings):
                self._context.run(recording.simulation.begin)
            recording.simulation.remember()
            of_scenario = (self._recipe(overrides).scenario_yaml, str(seed), *recording.simulation.structure)
            self._fingerprint = sha256("\n".join(of_scenario).encode()).hexdigest()
            self._recording, self._stack, self._runs = recording, stack.pop_all(), self._runs + 1
        self._release = finalize(self, self._stack.close)

    def step(self, command: Any = None, until: str | float = "tick") -> Step:
        """Take the decision that is due, and simulate to the next one.

        Args:
            command: Efforts in N or N m: an array (nu,), a mapping of actuators or models to efforts, or a
                :class:`~ffsm_mj.controller_protocol.Command`, also with requests; see
                :func:`~ffsm_mj.assembly.given_command.given_command`. It is held to the end of the step. None: the phases of
                the scenario decide.
            until: ``tick``: the next control tick; ``event``: the first event before it, or else the tick, so that events
                of contacts can be answered at once; a time in s: the first control tick at or after it.

        Raises:
            InputError: The command does not fit the actuators, or is not finite.
            SimulatorError: There is no run, or it has ended.
            KeyboardInterrupt: The step was interrupted: the run has ended, and can be closed.
        """
        simulation = self._going()
        end_s = -math.inf if until in _DECISIONS else self._end_s(until)
        self._controller.given = None if command is None else given_command(self._assembly.system, command)
        self._interrupts.begin_step()
        try:
            self._context.run(self._advance, simulation, until == "event", command is not None, end_s)
        finally:
            self._interrupts.end_step()
        if self._raises and simulation.error is not None:
            raise simulation.error
        ended = simulation.ended
        if self._interrupts.noted() or (ended is not None and ended.outcome == Outcome.INTERRUPTED):
            simulation.interrupt()  # by a signal that came after the last time that the step looked for one
            raise KeyboardInterrupt
        return Step(simulation.observation(), self._new_events(simulation.progress.due), ended)

    def _advance(self, simulation: Simulation, to_event: bool, commanded: bool, end_s: float) -> None:
        with collecting(simulation.warnings):
            simulation.advance(to_event, commanded)
            while end_s > -math.inf and simulation.ended is None and simulation.next_tick_s < end_s:
                simulation.advance()

    def state(self) -> SimulatorState:
        """Everything that determines how the run goes on, at the decision that is due.

        Raises:
            SimulatorError: There is no run, or it has ended.
            StateError: A control law, an estimator or a contact model of a plug-in holds what cannot be saved.
        """
        simulation = self._going()
        overrides, seed = self._recipe_of_run
        time_s = simulation.progress.time_s
        return SimulatorState(time_s, overrides, seed, self._fingerprint, self._context.run(simulation.save))

    def restore(self, state: SimulatorState) -> Observation:
        """Go on from a state, bit for bit, also from one of another process; a log begins anew, at the time of the state.

        Returns:
            What a control law sees at the state.

        Raises:
            SimulatorError: The state is that of another scenario.
        """
        has_parts = self._recording is not None and self._recipe_of_run == (state.overrides, state.seed)
        if has_parts:
            self._compare(state)  # the run under way goes on if the state is refused
        if not has_parts or self._record is not False:
            self._begin(state.overrides, state.seed, state.time_s)
            self._compare(state)
        simulation = self._running().simulation
        simulation.restore(state.contents)
        self._tap.take()
        self._reported = len(simulation.progress.due.records) if simulation.progress.due is not None else 0
        return self.observation

    def _compare(self, state: SimulatorState) -> None:
        """Refuse a state of other parts than those of the run."""
        if state.fingerprint != self._fingerprint:
            raise SimulatorError("the state is that of another scenario, of other versions, or of compiled parts")

    def close(self) -> Run | None:
        """End the run: its log is closed, with its outcome and summary. One that has not reached its end was interrupted.

        Returns:
            The run, as :func:`ffsm_mj.run` returns it; None if there is none. Further calls return None.

        Raises:
            KeyboardInterrupt: Ctrl-C while the files were written; they are whole.
        """
        recording, self._recording = self._recording, None
        if recording is None:
            return None
        self._release.detach()
        self._interrupts.begin_step()  # a signal waits until the files are written
        try:
            with self._stack, collecting(recording.simulation.warnings):
                recording.end(self._context.run(recording.simulation.finish))
            run = recording.run()
        finally:
            self._interrupts.end_step()
        if self._interrupts.noted():
            raise KeyboardInterrupt
        return run

    @property
    def observation(self) -> Observation:
        """What a control law sees now, before the decision that is due.

        Raises:
            SimulatorError: There is no run.
        """
        return self._running().simulation.observation()

    @property
    def time_s(self) -> float:
        """Simulation time, s."""
        return self.observation.time_s

    @property
    def ended(self) -> Ended | None:
        """How the run ended; None while it lasts."""
        return self._running().simulation.ended

    @property
    def system(self) -> System:
        """Robot and objects: the MuJoCo model, with names and index maps."""
        return self.assembly.system

    @property
    def unhandled_overlaps(self) -> tuple[tuple[str, ...], ...]:
        """Geoms of the overlaps at the last control tick that no contact model handles and that are not ignored."""
        return self._running().simulation.unhandled_overlaps

    @property
    def prepared(self) -> PreparedRun:
        """The scenario as it was prepared, with the overrides of the simulator but not those of a reset."""
        return self._recipe(())

    @property
    def assembly(self) -> Assembly:
        """Components of the run under way: they show its present, and must not be written."""
        self._running()
        return self._assembly

    def __enter__(self) -> Simulator:
        """The simulator itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the run."""
        self.close()

    def _running(self) -> Recording:
        if self._recording is None:
            raise SimulatorError("there is no run: reset() begins one")
        return self._recording

    def _recipe(self, overrides: tuple[str, ...]) -> PreparedRun:
        """The scenario with further overrides; the latest is kept."""
        if overrides not in self._prepared:
            given = [*self._overrides, *overrides]
            made = prepare(self._scenario, given, controllers=self._controllers, estimators=self._estimators)
            self._prepared = {key: value for key, value in self._prepared.items() if not key} | {overrides: made}
        return self._prepared[overrides]

    def _seeded(self, made: PreparedRun, seed: int | None) -> PreparedRun:
        if seed is None:
            return made
        if not 0 <= seed < 2**63:
            raise InputError(f"seed: {seed}, allowed are 0 to 2^63 - 1")
        return replace(made, scenario=made.scenario.model_copy(update={"seed": seed}))

    def _folder(self) -> RunFolder:
        path = Path(str(self._record))
        return RunFolder(path.with_name(f"{path.name}-{self._runs + 1}") if self._runs else path, force=self._force)

    def _end_s(self, until: str | float) -> float:
        """Time from which on a control tick ends the step."""
        if isinstance(until, str) or not math.isfinite(until):
            raise InputError(f"until: {until!r}, allowed are 'tick', 'event' and a time in s")
        if until <= self.time_s:
            raise InputError(f"until: {until} s is not after the present, t = {self.time_s:.6g} s")
        return until - _SAME_TIME * self._period_s

    def _new_events(self, due: EventDue | None) -> tuple[Any, ...]:
        """Events of the step. Those of a decision that is due come without efforts, and not again when it is taken."""
        events = self._tap.take()
        if self._reported:
            events, self._reported = events[self._reported :], 0
        if due is None:
            return events
        self._reported = len(due.records)
        return (*events, *due.records)

    def _going(self) -> Simulation:
        """The simulation of a run that has not ended."""
        simulation = self._running().simulation
        if simulation.ended is not None:
            how = f"{simulation.ended.outcome.value} at t = {simulation.progress.time_s:.6g} s"
            raise SimulatorError(f"the run has ended ({how}): reset() begins another, close() returns it")
        return simulation


def _as_list(overrides: Sequence[str] | Mapping[str, Any]) -> list[str]:
    return as_overrides(overrides) if isinstance(overrides, Mapping) else list(overrides)
