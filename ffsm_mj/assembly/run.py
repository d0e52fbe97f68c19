"""Execution of an assembled run: open the log, simulate, close the log, write the summary."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version

import numpy as np

from ffsm_mj.analysis.digest import DigestSink
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.contact_models import record_kinds
from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.assembly.resolved import resolved_yaml
from ffsm_mj.assembly.run_size import refuse_without_room
from ffsm_mj.assembly.source_date import source_date
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.errors import LogWriteError
from ffsm_mj.log.mcap.reader import stored_rows
from ffsm_mj.log.memory_sink import MemorySink
from ffsm_mj.log.recorder import BLOCK_ROWS, Recorder, Sink
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.mujoco_clock import stopped_clock
from ffsm_mj.records.events import Outcome, OutcomeRecord
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.metadata import (
    FORMAT_VERSION,
    conservative_metadata,
    free_metadata,
    gravity_metadata,
    model_metadata,
    task_metadata,
)
from ffsm_mj.report.run import Run
from ffsm_mj.scenario.scenario import Scenario
from ffsm_mj.simulation.internal_error import internal_error
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.simulation.settings import Settings

_PACKAGES = ("ffsm-mj", "mujoco", "numpy", "scipy", "mcap", "rerun-sdk", "pydantic", "protobuf")


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
    watchers: Sequence[Sink] = (),
    raise_errors: bool = False,
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
        watchers: Further receivers of rows and events during the run.
        raise_errors: Raise an exception of a control law or an unexpected one again when the log is closed.

    Raises:
        InputError: The folder cannot be used, or there is no room for the run.
        Exception: With ``raise_errors``, the exception that ended the run.
    """
    config, system, layout = assembly.scenario, assembly.system, assembly.row.layout
    clock = source_date()  # refuse a malformed date before the folder is created
    kept = len(layout.signals) if columns is None else 1 + len(columns)
    refuse_without_room(config.ticks, kept, folder.path if folder is not None else None)
    text = resolved_yaml(config, system) if columns is None else ""
    header = RunHeader(
        config.name,
        text,
        layout,
        system.logged_files,
        _metadata(assembly),
        record_kinds(config, (*assembly.pairs, *assembly.limits), delayed_control=assembly.plant.control is not None),
    )
    memory, digested = MemorySink(keep_rows=folder is None, columns=columns), DigestSink()
    sinks: list[Sink] = [memory, digested, *watchers]
    if folder is not None:
        sinks += folder.sinks(header, system, with_rerun=with_rerun, view_rate_hz=config.log.view_rate_hz)
    if live is not None:
        from ffsm_mj.log.rerun.live import LiveSink  # takes a second to import

        sinks.append(LiveSink(live, system, config.log.view_rate_hz))
    block = np.zeros((BLOCK_ROWS, len(layout.signals)))
    rows = RowWriter(assembly.row, assembly.plant.state.sampler, block)
    recorder = Recorder(block, sinks, rows.complete, by_clock=clock is None)
    watch = ContactWatch(system.mj, assembly.data, assembly.known_pairs, assembly.contacts.unsupported)
    simulation = Simulation(assembly.plant, watch, assembly.controller, rows, recorder, _settings(config))
    try:
        with noted() as interrupted, recorder:
            recorder.open(header)
            outcome = simulation.run(interrupted, lambda t: report(t, config.duration_s) if report else None)
            recorder.outcome = _with_versions(outcome)
            if report and outcome.outcome == Outcome.COMPLETED.value:
                report(config.duration_s, config.duration_s)  # what is left is to close the log
    except Exception as error:
        if recorder.outcome is None:
            raise
        # The run is over but a log could not be finished: the summary only needs data in memory.
        memory.close(_unfinished(recorder.outcome, error))
    if folder is None:
        finished = Run(memory.log(), digested=digested.digest)
    else:
        log = folder.log.absolute()
        finished = Run(memory.log(stored_rows(log, layout)), log, digested.digest)
        folder.write_summary(finished.summary())
    if raise_errors and simulation.error is not None:
        raise simulation.error
    return finished


def _unfinished(outcome: OutcomeRecord, error: Exception) -> OutcomeRecord:
    """Outcome of a run whose log could not be finished."""
    if isinstance(error, LogWriteError):
        return replace(outcome, outcome=Outcome.WRITE_FAILED.value, message=str(error))
    record = internal_error(error, outcome.end_s, outcome.steps)
    message = f"the log could not be finished: {record.error} ({record.where})"
    return replace(outcome, outcome=Outcome.INTERNAL_ERROR.value, message=message)


def _settings(config: Scenario) -> Settings:
    told = config.told_of_impacts
    above = (-math.inf if told else None) if isinstance(told, bool) else told.above_N_s
    return Settings(config.time_step_s, config.steps_per_tick, config.ticks, above)


def _with_versions(outcome: OutcomeRecord) -> OutcomeRecord:
    """Add versions; with a source date also remove what differs from run to run."""
    return replace(outcome, wall_s=outcome.wall_s if source_date() is None else 0.0, versions=versions())


@cache
def versions() -> dict[str, str]:
    """Versions of the packages that affect results."""
    return {package: version(package) for package in _PACKAGES}


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
    metadata |= conservative_metadata(assembly.system.faults) | free_metadata(assembly.plant.balance.free)
    metadata |= gravity_metadata(assembly.system.mj.opt.gravity)
    metadata |= model_metadata(assembly.changes)
    if config.task is not None:
        metadata |= task_metadata(config.task.axes, config.task.target_m)
    return metadata | {f"version {name}": text for name, text in versions().items()}
