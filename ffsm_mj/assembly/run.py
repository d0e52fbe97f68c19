"""Execution of an assembled run from its start to its end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.assembly.recording import Recording
from ffsm_mj.log.recorder import Sink
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.mujoco_process import stopped_clock
from ffsm_mj.records.events import Outcome
from ffsm_mj.simulation.outcome import Ended


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
        watchers: Further receivers of rows and events during the run.
        check: Raise what ended the run by an exception, of a control law or an unexpected one, when the log is closed.

    Raises:
        InputError: The folder cannot be used, or there is no room for the run.
        Exception: With ``check``, the exception that ended the run; see :func:`with_run`.
    """
    start = assembly.start() if assembly.start is not None else None
    start_s = start.time_s if start is not None else 0.0
    recording = Recording(
        assembly, folder, with_rerun=with_rerun, live=live, columns=columns, watchers=watchers, start_s=start_s
    )
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
