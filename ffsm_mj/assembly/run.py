"""Execution of an assembled run from its start to its end, and what becomes of its rows and events."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from types import TracebackType
from typing import Any

import numpy as np

from ffsm_mj._core import BUILT
from ffsm_mj.analysis.digest import Digest
from ffsm_mj.analysis.effort import Effort
from ffsm_mj.analysis.run import ModelResults, Run
from ffsm_mj.analysis.run_models import summary
from ffsm_mj.assembly.assemble import Assembly, refuse_without_room
from ffsm_mj.assembly.plant import environment_metadata, record_kinds
from ffsm_mj.assembly.process import noted, one_blas_thread, source_date
from ffsm_mj.assembly.recorded_files import RecordedFiles, resolved_data
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.errors import LogWriteError
from ffsm_mj.log.background import BackgroundSink
from ffsm_mj.log.mcap.reader import stored_rows
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.recorder import RECORDED_ROWS, Batches, MemorySink, Recorder, Sink
from ffsm_mj.log.rerun.viewer import LiveSink, rust_log
from ffsm_mj.log.run_folder import RECORDING, RunFolder
from ffsm_mj.model.mujoco_process import stopped_clock
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome, OutcomeRecord
from ffsm_mj.records.metadata import (
    FORMAT_VERSION,
    conservative_metadata,
    free_metadata,
    gravity_metadata,
    model_metadata,
    phase_graph_metadata,
    start_metadata,
    task_metadata,
    terminal_metadata,
)
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.scenario.phases import is_branching, phase_edges, trigger_text
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.outcome import Ended, internal_error
from ffsm_mj.simulation.progress import Settings
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.simulation.wall_clock import prompt_process

PACED_ROWS = 20
"""Rows that a run in real time passes on at once, which bounds what a tick does for its log."""
_PACKAGES = ("ffsm-mj", "mujoco", "numpy", "scipy", "mcap", "rerun-sdk", "pydantic", "protobuf")


class Recording:
    """The simulation of an assembly, and what becomes of its rows and events. A context manager: leaving it closes the log.

    Attributes:
        simulation: The simulation.
    """

    def __init__(
        self,
        assembly: Assembly,
        folder: RunFolder | None = None,
        *,
        with_rerun: bool = False,
        live: str | None = None,
        columns: Collection[str] | None = None,
        tap: Sink | None = None,
        start_s: float = 0.0,
    ) -> None:
        """Create the receivers; nothing is written yet.

        Args:
            assembly: Components that have not run yet.
            folder: See :func:`ffsm_mj.assembly.run.simulate`, likewise the others.
            with_rerun: Write ``run.rrd`` into the folder.
            live: ``host:port`` of a Rerun viewer to stream to.
            columns: What a run in memory keeps of its rows, beside the time; None: all.
            tap: Sink of its own for a program that steps the run.
            start_s: Time of the state from which the run goes on, s.

        Raises:
            InputError: There is no room for the run.
        """
        config, system, layout = assembly.scenario, assembly.system, assembly.row.layout
        clock = source_date()  # refuse a malformed date before the folder is created
        self._folder, self._layout, self._paced = folder, layout, assembly.clock is not None
        rows = RowWriter(assembly.row, assembly.plant.state.sampler, PACED_ROWS if self._paced else RECORDED_ROWS)
        # Ticks of a run in real time wait neither for rows to be completed nor for what can be computed from its log.
        postponed = rows.complete if self._paced else None
        kept = len(layout.signals) if columns is None else 1 + len(columns)
        if folder is None and self._paced:
            kept = rows.block.shape[1]
        refuse_without_room(config.ticks, kept, folder.path if folder is not None else None)
        self._compiled = partial(_models, config, system, assembly.compiled.recorded)
        self._header = _header(assembly, start_s, is_whole=columns is None)
        self._memory, self._stack = MemorySink(keep_rows=folder is None, columns=columns, complete=postponed), ExitStack()
        self._digest = Digest() if not self._paced else None
        self._effort = Effort(system) if not self._paced else None
        sinks: list[Sink] = [self._memory] if tap is None else [tap, self._memory]
        if self._digest is not None and self._effort is not None:
            sinks.append(Batches([self._digest, self._effort]))
        outside = self._outside(system, config, live, with_rerun=with_rerun)
        if outside and postponed is not None:
            outside = [BackgroundSink(outside, folder, postponed, rows.block.shape[1])]
        sinks += outside
        complete, by_clock = None if self._paced else rows.complete, self._paced or clock is None
        self._recorder = Recorder(rows.block, sinks, complete, by_clock=by_clock)
        contacts = assembly.contacts
        watch = ContactWatch(system.mj, assembly.data, assembly.known_pairs, contacts.unsupported, contacts.left_out)
        settings = _settings(config)
        self.simulation = Simulation(
            assembly.plant, watch, assembly.controller, rows, self._recorder, settings, assembly.clock
        )

    def _outside(self, system: System, config: ScenarioConfig, live: str | None, *, with_rerun: bool) -> list[Sink]:
        """Sinks that write files, or send to a viewer."""
        folder, rate_hz, sinks = self._folder, config.log.view_rate_hz, list[Sink]()
        if folder is not None:
            sinks += file_sinks(folder, self._header, system, with_rerun=with_rerun, view_rate_hz=rate_hz, view=config.view)
        if live is not None:
            sinks.append(LiveSink(live, system, rate_hz, config.view))
        return sinks

    def __enter__(self) -> Recording:
        """Open the log.

        Raises:
            InputError: The folder cannot be used.
        """
        self._recorder.__enter__()
        try:
            self._recorder.open(self._header)
            if self._paced:
                self._stack.enter_context(prompt_process())
        except BaseException as error:
            self._recorder.__exit__(type(error), error, error.__traceback__)
            raise
        return self

    def end(self, outcome: OutcomeRecord) -> None:
        """Set the outcome of the simulation; versions are added."""
        self._recorder.outcome = _with_versions(outcome)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> bool:
        """Close the log. Of a run that is over, one that cannot be finished only changes the outcome."""
        self._stack.close()
        try:
            self._recorder.__exit__(kind, error, trace)
        except Exception as failure:
            if self._recorder.outcome is None:
                raise
            error = failure
        if self._recorder.outcome is None or not isinstance(error, Exception):
            return False
        # The run is over but a log could not be finished: the summary only needs data in memory.
        self._memory.close(_unfinished(self._recorder.outcome, error))
        return True

    def run(self) -> Run:
        """The run, when the log is closed; writes the summary into its folder."""
        path, digest = self._folder.log.absolute() if self._folder is not None else None, self._digest
        log = self._memory.log(stored_rows(path, self._layout) if path is not None else None)
        finished = Run(log, path, digest, ModelResults(log, self._compiled, self._effort))
        if self._folder is not None:
            self._folder.write_summary(summary(finished))
        return finished


def _header(assembly: Assembly, start_s: float, *, is_whole: bool) -> RunHeader:
    """Header of the log; one of a part of the columns is no log that can be made again, and carries no scenario."""
    config, system = assembly.scenario, assembly.system
    kinds = record_kinds(config, (*assembly.pairs, *assembly.limits), assembly.plant.integrator.sources)
    scenario = resolved_data(config, system, assembly.compiled.recorded) if is_whole else {}
    return RunHeader(
        config.name,
        scenario,
        assembly.row.layout,
        assembly.compiled.logged_files,
        _metadata(assembly) | start_metadata(start_s),
        kinds,
    )


def _models(config: ScenarioConfig, system: System, recorded: RecordedFiles) -> tuple[System, dict[str, Any]]:
    """The models of a run, and its scenario as its log has it."""
    return system, resolved_data(config, system, recorded)


def _unfinished(outcome: OutcomeRecord, error: Exception) -> OutcomeRecord:
    """Outcome of a run whose log could not be finished."""
    if isinstance(error, LogWriteError):
        return replace(outcome, outcome=Outcome.WRITE_FAILED.value, message=str(error))
    record = internal_error(error, outcome.end_s, outcome.steps)
    message = f"the log could not be finished: {record.error} ({record.where})"
    return replace(outcome, outcome=Outcome.INTERNAL_ERROR.value, message=message)


def _settings(config: ScenarioConfig) -> Settings:
    keeps = config.log.states == "events"
    return Settings(config.time_step_s, config.steps_per_tick, config.ticks, config.feedback_impulse_N_s, keeps)


def _with_versions(outcome: OutcomeRecord) -> OutcomeRecord:
    """Add versions; with a source date also remove what differs from run to run."""
    if source_date() is not None:
        outcome = replace(outcome, wall_s=0.0, law_wall_s=0.0)
    return replace(outcome, versions=versions())


@cache
def versions() -> dict[str, str]:
    """Versions of the packages that affect results, and what the core is built for."""
    return {package: version(package) for package in _PACKAGES} | {"core": BUILT}


def _metadata(assembly: Assembly) -> dict[str, str]:
    config = assembly.scenario
    metadata = {
        "format_version": FORMAT_VERSION,
        "scenario": config.name,
        "created_utc": (source_date() or datetime.now(UTC)).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "duration_s": repr(config.duration_s),
        "time_step_s": repr(config.time_step_s),
        "control_period_s": repr(config.time_step_s * config.steps_per_tick),
        "phases": "\n".join(phase.name for phase in config.phases),
    }
    if is_branching(config.phases):
        edges = phase_edges(config.phases)
        ways = [(edge.start, trigger_text(config.phases[edge.start], edge.end), edge.to) for edge in edges]
        metadata |= phase_graph_metadata(ways)
    metadata |= conservative_metadata(assembly.system.faults) | free_metadata(assembly.plant.balance.free)
    metadata |= gravity_metadata(assembly.system.mj.opt.gravity)
    metadata |= environment_metadata(config) | model_metadata(assembly.compiled.changes)
    if config.task is not None:
        metadata |= task_metadata(config.task.axes, config.task.target_m)
    if config.terminal is not None:
        metadata |= terminal_metadata(config.terminal.model_dump())
    return metadata | {f"version {name}": text for name, text in versions().items()}


# A run ends if its state is not finite; numpy's warnings would only repeat that.
@np.errstate(all="ignore")
@one_blas_thread()
@stopped_clock()
def simulate(
    assembly: Assembly,
    folder: RunFolder | None = None,
    *,
    with_rerun: bool = False,
    live: str | None = None,
    report: Callable[[float, float], None] | None = None,
    columns: Collection[str] | None = None,
    check: bool = False,
) -> Run:
    """Run an assembly once; its components are left at the end of the run.

    Args:
        assembly: Components that have not run yet.
        folder: Where to write; None keeps the run in memory only.
        with_rerun: Write ``run.rrd`` into the folder.
        live: ``host:port`` of a Rerun viewer to stream to.
        report: Told (simulation time, duration) in s as the run goes.
        columns: What a run in memory keeps of its rows, beside the time; None: all. One that keeps a part of them is no log
            that can be made again, and carries no scenario.
        check: Raise what ended the run by an exception, of a control law or an unexpected one, when the log is closed.

    Raises:
        InputError: The folder cannot be used, or there is no room for the run.
        Exception: With ``check``, the exception that ended the run; see :func:`with_run`.
    """
    start = assembly.compiled.start() if assembly.compiled.start is not None else None
    start_s = start.time_s if start is not None else 0.0
    recording = Recording(assembly, folder, with_rerun=with_rerun, live=live, columns=columns, start_s=start_s)
    simulation, duration_s = recording.simulation, assembly.scenario.duration_s
    if report is not None:
        simulation.report = lambda time_s: report(time_s, duration_s)
    with noted() as simulation.interrupted:
        with recording:
            recording.end(simulation.run(start))
            if report is not None and simulation.ended and simulation.ended.outcome == Outcome.COMPLETED:
                report(duration_s, duration_s)  # what is left is to close the log
        finished = recording.run()  # writes the summary
    if check and simulation.error is not None:
        raise with_run(simulation.error, simulation.ended, folder)
    return finished


def with_run(error: Exception, ended: Ended | None, folder: RunFolder | None) -> Exception:
    """An exception that ended a run, with the end of the run as a note, and its folder as the attribute ``run_folder``.

    The traceback shows the note below the exception. The folder is a ``Path``; None of a run in memory.
    """
    # The exception is of any class, so that the attribute is declared nowhere.
    vars(error)["run_folder"] = folder.path if folder is not None else None
    if ended is not None:
        error.add_note(f"the run has ended: {ended.outcome.value}: {ended.message}")
    if folder is not None:
        error.add_note(f"log of the run: {folder.log}")
    return error


def file_sinks(
    folder: RunFolder,
    header: RunHeader,
    system: System,
    *,
    with_rerun: bool,
    view_rate_hz: float,
    view: Sequence[float] | None = None,
) -> list[Sink]:
    """Sinks that write a run into a folder: its log (opening it creates the folder) and optionally its recording."""
    sinks: list[Sink] = [McapSink(lambda opening: folder.take(opening, header), system, view_rate_hz)]
    if with_rerun:
        # Rerun reports an error at the end of its file, such as a full disk, on stderr only.
        with rust_log("error"):
            from ffsm_mj.log.rerun.sink import RerunSink  # importing it takes a second

        sinks.append(RerunSink(lambda: folder.path / RECORDING, system, view_rate_hz, view))
    return sinks
