"""A simulator that steps: the program that owns it decides when time goes on, and with which efforts."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from contextlib import ExitStack
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import PreparedRun, Scenario, law_errors, scenario_of, warn_of_notes
from ffsm_mj.assembly.process import StepInterrupts, one_blas_thread
from ffsm_mj.assembly.run import Recording, with_run
from ffsm_mj.controller_protocol import Command, ExternalCommand, Observation
from ffsm_mj.errors import FfsmError, InputError, described
from ffsm_mj.log.recorder import EventTap
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.mujoco_process import collecting, collectors, handled_warnings, stopped_clock
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome
from ffsm_mj.scenario.overrides import Overrides, as_texts
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.outcome import Ended
from ffsm_mj.state import StateError, entries, from_bytes, to_bytes


class SimulatorError(FfsmError):
    """A simulator was used in a way that its state does not allow."""


@dataclass(frozen=True)
class SimulatorState:
    """State of a simulator: numbers, texts and arrays, which move between processes and machines as bytes.

    Attributes:
        time_s: Its simulation time, s.
        overrides: Overrides of the run, beside those of the simulator.
        seed: Key ``seed`` of the run, if one was given.
        fingerprint: Fingerprint of the scenario and its models.
        parts: What the parts of the simulation remember.
    """

    time_s: float
    overrides: tuple[str, ...]
    seed: int | None
    fingerprint: str
    parts: Any = field(repr=False)

    def to_bytes(self) -> bytes:
        """The state as bytes; see :mod:`ffsm_mj.state` for their format."""
        return to_bytes(self)

    @classmethod
    def from_bytes(cls, data: bytes) -> SimulatorState:
        """A state from bytes; nothing is executed.

        Raises:
            StateError: They are no state of a simulator, of another version, or damaged.
        """
        state = entries(from_bytes(data), cls, "a simulator")
        return cls(**state)


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


def as_command(system: System, value: Any) -> ExternalCommand:
    """Command from what a program gives.

    Args:
        system: Robot and objects.
        value: A :class:`Command`; or an array (nu,) of efforts in N or N m, which power all actuators; or a mapping of names
            to efforts: of an actuator, or of a model, such as ``robot``, to the efforts of all its actuators. A mapping
            powers the actuators that it names and leaves the others to the control laws of the phase; None in place of an
            effort switches an actuator off. A :class:`ExternalCommand` is taken as it is, unchecked.

    Raises:
        InputError: It has another shape, names no actuator, or is not finite.
    """
    if isinstance(value, ExternalCommand):
        return value
    count = int(system.mj.nu)
    command, named = Command.off(count), np.ones(count, dtype=np.bool_)
    if isinstance(value, Command):
        command.drive(slice(None), _efforts(system, value.effort, range(count), "command"))
        np.copyto(command.powered, value.powered)
        command.requests.update(value.requests)
    elif isinstance(value, Mapping):
        named[:] = False
        for name, effort in value.items():
            _take_efforts(system, command, named, name, effort)
    else:
        command.drive(slice(None), _efforts(system, value, range(count), "command"))
    return ExternalCommand(command, named)


def _take_efforts(system: System, command: Command, named: Any, name: Any, effort: Any) -> None:
    """Write the efforts of one name of a mapping."""
    ids = _actuators(system, name)
    if named[ids].any():
        raise InputError(f"command: {name!r} names actuators that another name gives too")
    named[ids] = True
    if effort is not None:
        command.drive(ids, _efforts(system, effort, ids, f"command of {name!r}"))


def _actuators(system: System, name: Any) -> Any:
    """Ids of the actuators that a name stands for."""
    names = system.names("actuator")
    of_model = [i for i, full in enumerate(names) if full.split("/", 1)[0] == name and full != name]
    if of_model:
        return np.array(of_model)
    try:
        return np.array([system.index("actuator", name)])
    except LookupError as error:
        models = sorted({full.split("/", 1)[0] for full in names if "/" in full})
        raise InputError(f"command: {error.args[0]}; or a model: {', '.join(models)}") from error


def _efforts(system: System, values: Any, ids: Iterable[int], what: str) -> FloatArray:
    """Finite efforts of some actuators."""
    names = [system.names("actuator")[i] for i in ids]
    try:
        efforts = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: not numbers ({described(error)})") from error
    if efforts.shape != (len(names),):
        raise InputError(f"{what}: shape {efforts.shape}, but one effort each is needed for {', '.join(names)}")
    bad = [f"{name} {value}" for name, value in zip(names, efforts, strict=True) if not np.isfinite(value)]
    if bad:
        raise InputError(f"{what}: efforts and setpoints must be finite: {', '.join(bad)}")
    return efforts


_DECISIONS = ("tick", "event")
_SAME_TIME = 1e-9
"""A control tick this close to a time, in control periods, is at it."""
_step = partial(tuple.__new__, Step)  # takes half as long as Step(...)


class SteppedRun:
    """A run that a program steps.

    A step costs little only because the contexts of the run are entered once, and because a step calls few functions.

    Attributes:
        assembly: Components of the run.
        simulation: Their simulation.
        origin: Overrides of the run, beside those of its simulator, and key ``seed``, if one was given.
    """

    def __init__(
        self,
        prepared: PreparedRun,
        overrides: tuple[str, ...],
        seed: int | None,
        *,
        folder: RunFolder | None,
        with_rerun: bool,
        live: str | None,
        columns: Collection[str] | None,
        start_s: float | None,
        check: bool,
    ) -> None:
        """Begin the run.

        Args:
            prepared: The scenario with the overrides.
            overrides: Those that are not of the simulator.
            seed: Key ``seed``; None: that of the scenario.
            folder: See :func:`ffsm_mj.assembly.run.simulate`, likewise the next two.
            with_rerun: Write ``run.rrd`` into the folder.
            live: ``host:port`` of a Rerun viewer.
            columns: See :class:`~ffsm_mj.assembly.run.Recording`.
            start_s: Time of the state that is restored next, s; None: the run begins as the scenario says.
            check: Raise what ended the run by an exception, of a control law, an estimator or a contact model.

        Raises:
            InputError: The folder of the run cannot be used.
        """
        self._prepared, self.origin, self._check = prepared, (overrides, seed), check
        self._tap, self.assembly = EventTap(), seeded(prepared, seed).assemble()
        start = self.assembly.compiled.start() if self.assembly.compiled.start is not None else None
        begins_s = start.time_s if start is not None else 0.0
        self._folder = folder
        self._recording = Recording(
            self.assembly,
            folder,
            with_rerun=with_rerun,
            live=live,
            columns=columns,
            tap=self._tap,
            start_s=begins_s if start_s is None else start_s,
        )
        self.simulation, self._controller = self._recording.simulation, self.assembly.controller
        self._period_s, self._reported = self.assembly.scenario.control_period_s, 0
        # A run ends if its state is not finite; numpy's warnings would only repeat that.
        self._context = copy_context()
        self._context.run(np.seterr, all="ignore")
        with ExitStack() as stack:
            stack.enter_context(one_blas_thread())
            stack.enter_context(stopped_clock())
            stack.enter_context(handled_warnings())
            self._interrupts = stack.enter_context(StepInterrupts())
            stack.enter_context(self._recording)
            self.simulation.interrupted = self._interrupts.noted
            with collecting(self.simulation.warnings):
                self._context.run(self.simulation.begin)
            if start_s is None and start is not None:
                self.simulation.go_on_from(start)
            self._stack = stack.pop_all()
        self._release = finalize(self, self._stack.close)

    def step(self, command: Any, until: str | float) -> Step:
        """Take the decision that is due, and simulate to the next one; see :class:`ffsm_mj.Simulator`."""
        simulation, interrupts = self._going(), self._interrupts
        end_s = None if until in _DECISIONS else self._end_s(until)
        self._controller.external = None if command is None else as_command(self.assembly.system, command)
        collected = collectors()
        interrupts.begin_step()
        collected.append(simulation.warnings)
        try:
            self._context.run(simulation.advance, until == "event", command is not None)
            while end_s is not None and simulation.next_tick_s < end_s and simulation.ended is None:
                self._context.run(simulation.advance)
        finally:
            collected.pop()
            interrupts.end_step()
        ended = simulation.ended
        if ended is not None or interrupts.is_noted:
            self._raise_failure()
        return _step((simulation.observation(), self._new_events(), ended))

    def _raise_failure(self) -> None:
        """Raise what ended the run: an interrupt, or an exception that the caller wants."""
        simulation = self.simulation
        if self._check and simulation.error is not None:
            raise with_run(simulation.error, simulation.ended, self._folder)
        if self._interrupts.is_noted or (simulation.ended is not None and simulation.ended.outcome == Outcome.INTERRUPTED):
            simulation.interrupt()  # by a signal that came after the last time that the step looked for one
            raise KeyboardInterrupt

    def _going(self) -> Simulation:
        """The simulation of a run that has not ended."""
        simulation = self.simulation
        ended = simulation.ended
        if ended is not None:
            how = f"{ended.outcome.value} at t = {simulation.progress.time_s:.6g} s"
            raise SimulatorError(f"the run has ended ({how}): reset() begins another, close() returns it")
        return simulation

    def _end_s(self, until: str | float) -> float:
        """Time from which on a control tick ends the step."""
        if isinstance(until, str) or not math.isfinite(until):
            raise InputError(f"until: {until!r}, allowed are 'tick', 'event' and a time in s")
        now = self.simulation.observation().time_s
        if until <= now:
            raise InputError(f"until: {until} s is not after the present, t = {now:.6g} s")
        return until - _SAME_TIME * self._period_s

    def _new_events(self) -> tuple[Any, ...]:
        """Events of the step. Those of a decision that is due come without efforts, and not again when it is taken."""
        events, due = self._tap.take(), self.simulation.due
        if self._reported:
            events, self._reported = events[self._reported :], 0
        if due is None:
            return events
        self._reported = len(due.records)
        return (*events, *due.records)

    def get_state(self) -> SimulatorState:
        """Everything that determines how the run goes on."""
        simulation = self._going()
        parts = self._context.run(simulation.get_state)
        return SimulatorState(simulation.progress.time_s, *self.origin, self._fingerprint(), parts)

    def compare(self, state: SimulatorState) -> None:
        """Refuse a state of another scenario.

        Raises:
            SimulatorError: It is one.
        """
        if state.fingerprint != self._fingerprint():
            raise SimulatorError("the state is that of another scenario, or of other models")

    def set_state(self, state: SimulatorState) -> Observation:
        """Go on from a state of the same scenario; if it is refused, from where the run is.

        Returns:
            What a control law sees at the state.
        """
        simulation = self.simulation
        present = self._context.run(simulation.get_state) if simulation.ended is None else None
        try:
            self._context.run(simulation.set_state, state.parts)
        except StateError:
            if present is not None:
                self._context.run(simulation.set_state, present)
            raise
        self._tap.take()
        self._reported = len(simulation.due.records) if simulation.due is not None else 0
        return simulation.observation()

    def _fingerprint(self) -> str:
        _, seed = self.origin
        digest = sha256(f"{self._prepared.scenario_yaml}\n{seed}\n".encode())
        for name, content in sorted(self._prepared.logged_files.items()):
            digest.update(name.encode() + b"\n" + content)
        return digest.hexdigest()

    def close(self) -> Run:
        """End the run, and close its log.

        Raises:
            KeyboardInterrupt: Ctrl-C while the files were written; they are whole.
        """
        self._release.detach()
        self._interrupts.begin_step()  # a signal waits until the files are written
        try:
            with self._stack, collecting(self.simulation.warnings):
                self._recording.end(self._context.run(self.simulation.finish))
            run = self._recording.run()
        finally:
            self._interrupts.end_step()
        if self._interrupts.is_noted:
            raise KeyboardInterrupt
        return run


def seeded(prepared: PreparedRun, seed: int | None) -> PreparedRun:
    """A scenario with another key ``seed``; None: its own.

    Raises:
        InputError: It is out of bounds.
    """
    if seed is None:
        return prepared
    if not 0 <= seed < 2**63:
        raise InputError(f"seed: {seed}, allowed are 0 to 2^63 - 1")
    if prepared.origin is not None and seed != prepared.scenario.seed:
        raise InputError("seed: cannot change where a run goes on from another one")
    return replace(prepared, scenario=prepared.scenario.model_copy(update={"seed": seed}))


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
        scenario: Scenario | Mapping[str, Any] | str | Path,
        overrides: Overrides = (),
        *,
        record: str | Path | bool | None = None,
        seed: int | None = None,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
        rerun: bool | None = None,
        live: str | None = None,
        realtime: float | None = None,
        force: bool = False,
        check: bool = True,
    ) -> None:
        """Read, validate and compile a scenario; :meth:`reset` must follow.

        Args:
            scenario: A :class:`ffsm_mj.Scenario`, a mapping of its keys, a path, or the name of a shipped scenario.
            overrides: See :func:`ffsm_mj.run`, likewise ``controllers``, ``estimators``, ``rerun``, ``live``, ``force``.
            record: Run folder to write; each further run goes to a folder with a number appended. None keeps the rows of the
                run in memory; False keeps only its events.
            seed: The scenario's key ``seed``.
            controllers: Control laws of the caller's own.
            estimators: Estimators of the caller's own.
            rerun: Write ``run.rrd`` into the folder.
            live: ``host:port`` of a Rerun viewer to stream to.
            realtime: Simulated seconds per second: a step ends when the clock has come to its end, see the scenario's key
                of the same name. None: as the scenario says.
            force: Replace a run that ``record`` already holds.
            check: Let a step raise what a control law, an estimator or a contact model raised, as :func:`ffsm_mj.run` does.
                If false, the step ends the run, and the run says how.

        Raises:
            InputError: The scenario or a model is wrong, or the folder holds a run.
        """
        paced = () if realtime is None else (f"realtime.factor={realtime!r}",)
        overrides = [*as_texts(overrides), *paced]
        self._scenario = scenario_of(scenario, overrides, controllers=controllers, estimators=estimators)
        self._seed, self._record = seed, record
        self._rerun, self._live, self._force, self._check = rerun, live, force, check
        self._runs = 0
        self._prepared: dict[tuple[str, ...], PreparedRun] = {}
        self._run: SteppedRun | None = None
        warn_of_notes(self._recipe(()))
        if isinstance(record, str | Path):
            self._folder().refuse_earlier_run()

    def reset(self, seed: int | None = None, overrides: Overrides | None = None) -> Observation:
        """Begin a run at the initial state of the scenario; one under way is closed as interrupted.

        Args:
            seed: The scenario's key ``seed`` for this run; None: that of the simulator.
            overrides: Further overrides for this run.

        Returns:
            What a control law sees at the start.

        Raises:
            InputError: The scenario does not allow an override, or the folder cannot be used.
        """
        return self._begin(tuple(as_texts(overrides or ())), self._seed if seed is None else seed).simulation.observation()

    def _begin(self, overrides: tuple[str, ...], seed: int | None, start_s: float | None = None) -> SteppedRun:
        """Begin a run in place of one under way, which goes on if the overrides or the seed are wrong."""
        prepared = self._recipe(overrides)
        seeded(prepared, seed)
        with ExitStack() as stack:
            if self._run is not None and self._run.origin[0] == overrides:
                stack.enter_context(one_blas_thread())  # to lift the limit and set it again takes a fifth of a reset
            self.close()
            self._run = SteppedRun(
                prepared,
                overrides,
                seed,
                folder=self._folder() if isinstance(self._record, str | Path) else None,
                with_rerun=prepared.scenario.log.rerun if self._rerun is None else self._rerun,
                live=self._live,
                columns=() if self._record is False else None,
                start_s=start_s,
                check=self._check,
            )
        self._runs += 1
        return self._run

    def step(self, command: Any = None, until: str | float = "tick") -> Step:
        """Take the decision that is due, and simulate to the next one.

        Args:
            command: Efforts in N or N m: an array (nu,), a mapping of actuators or models to efforts, or a
                :class:`~ffsm_mj.controller_protocol.Command`, also with requests; see
                :func:`~ffsm_mj.assembly.simulator.as_command`. It is held to the end of the step. None: the phases of
                the scenario decide.
            until: ``tick``: the next control tick; ``event``: the first event before it, or else the tick, so that events
                of contacts can be answered at once; a time in s: the first control tick at or after it.

        Raises:
            InputError: The command does not fit the actuators, or is not finite.
            SimulatorError: There is no run, or it has ended.
            KeyboardInterrupt: The step was interrupted: the run has ended, and can be closed.
        """
        return self._running().step(command, until)

    def get_state(self) -> SimulatorState:
        """Everything that determines how the run goes on, at the decision that is due.

        Raises:
            SimulatorError: There is no run, or it has ended.
            StateError: A control law, an estimator or a contact model of a plug-in remembers something, and has no
                ``get_state`` and ``set_state``.
        """
        return self._running().get_state()

    def set_state(self, state: SimulatorState) -> Observation:
        """Go on from a state, bit for bit, also from one of another process or machine; a log begins anew, at its time.

        If the state is refused, a run without a record goes on from where it is; one with a record has ended.

        Returns:
            What a control law sees at the state.

        Raises:
            SimulatorError: The state is that of another scenario.
            StateError: It does not fit the simulation: it is damaged.
        """
        run = self._run
        if run is not None and run.origin == (state.overrides, state.seed):
            run.compare(state)  # the run under way goes on if the state is refused
        else:
            run = None
        if run is not None and self._record is False:
            return run.set_state(state)
        run = self._begin(state.overrides, state.seed, state.time_s)
        try:
            run.compare(state)
            return run.set_state(state)
        except FfsmError:
            self.close()  # its log would begin at a time at which nothing is known
            raise

    def close(self) -> Run | None:
        """End the run: its log is closed, with its outcome and summary. One that has not reached its end was interrupted.

        Returns:
            The run, as :func:`ffsm_mj.run` returns it; None if there is none. Further calls return None.

        Raises:
            KeyboardInterrupt: Ctrl-C while the files were written; they are whole.
        """
        run, self._run = self._run, None
        return run.close() if run is not None else None

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
        return self._running().assembly

    def __enter__(self) -> Simulator:
        """The simulator itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the run."""
        self.close()

    def _running(self) -> SteppedRun:
        if self._run is None:
            raise SimulatorError("there is no run: reset() begins one")
        return self._run

    def _recipe(self, overrides: tuple[str, ...]) -> PreparedRun:
        """The scenario with further overrides; the latest is kept."""
        if overrides not in self._prepared:
            with law_errors(self._check):
                prepared = self._scenario.with_overrides(overrides).prepared
            self._prepared = {key: value for key, value in self._prepared.items() if not key} | {overrides: prepared}
        return self._prepared[overrides]

    def _folder(self) -> RunFolder:
        path = Path(str(self._record))
        return RunFolder(path.with_name(f"{path.name}-{self._runs + 1}") if self._runs else path, force=self._force)
