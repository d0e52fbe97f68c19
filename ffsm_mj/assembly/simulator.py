"""A simulator that steps: the program that owns it decides when time goes on, and with which efforts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.prepare import PreparedRun, Scenario, as_overrides, law_errors, scenario_of
from ffsm_mj.assembly.step import SimulatorError, SimulatorState, Step
from ffsm_mj.assembly.stepped_run import SteppedRun, seeded
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import FfsmError
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.system import System
from ffsm_mj.simulation.outcome import Ended


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
        overrides: Sequence[str] | Mapping[str, Any] = (),
        *,
        record: str | Path | bool | None = None,
        seed: int | None = None,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
        rerun: bool | None = None,
        live: str | None = None,
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
            force: Replace a run that ``record`` already holds.
            check: Let a step raise what a control law, an estimator or a contact model raised, as :func:`ffsm_mj.run` does.
                If false, the step ends the run, and the run says how.

        Raises:
            InputError: The scenario or a model is wrong, or the folder holds a run.
        """
        self._scenario = scenario_of(scenario, overrides, controllers=controllers, estimators=estimators)
        self._seed, self._record = seed, record
        self._rerun, self._live, self._force, self._check = rerun, live, force, check
        self._runs = 0
        self._prepared: dict[tuple[str, ...], PreparedRun] = {}
        self._run: SteppedRun | None = None
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
        return self._begin(
            tuple(as_overrides(overrides or ())), self._seed if seed is None else seed
        ).simulation.observation()

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
                :func:`~ffsm_mj.assembly.given_command.given_command`. It is held to the end of the step. None: the phases of
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
                made = self._scenario.with_overrides(overrides).prepared
            self._prepared = {key: value for key, value in self._prepared.items() if not key} | {overrides: made}
        return self._prepared[overrides]

    def _folder(self) -> RunFolder:
        path = Path(str(self._record))
        return RunFolder(path.with_name(f"{path.name}-{self._runs + 1}") if self._runs else path, force=self._force)
