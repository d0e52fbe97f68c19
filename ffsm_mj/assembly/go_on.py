"""What if: a logged run goes on from one of its instants, with some of its settings changed.

A log has rows and events, not the memory of control laws, of contacts and of valves. The run is therefore made again up to
the instant, from the scenario and the models in its folder; its state there is compared with the logged one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.recording import Recording
from ffsm_mj.errors import InputError
from ffsm_mj.log.run_folder import SCENARIO, RunFolder
from ffsm_mj.model.mujoco_clock import stopped_clock
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.report.run import Run, load_run
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.simulation.progress import Start

TOLERANCE = 1e-6
"""Allowed difference from the logged state, relative to max(1, |x|): another processor rounds otherwise."""
_KEPT = (
    *("robot", "objects", "model", "controller_model", "initial", "time_step_s", "control_period_s", "accuracy"),
    *("actuation", "sensors", "estimator", "seed"),
)
"""Sections of a scenario that cannot change in the midst of a motion."""


class GoingOn:
    """A run that goes on from an instant of a logged one.

    Attributes:
        prepared: The run that goes on.
        start: State from which it goes on.
    """

    def __init__(
        self,
        folder: Path,
        from_s: float,
        overrides: Sequence[str] | Mapping[str, Any] = (),
        *,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Make the logged run again up to the instant.

        Args:
            folder: Folder of the logged run.
            from_s: The instant, s: it goes on from the first control tick or event at or after it.
            overrides: Settings that change there, see :func:`ffsm_mj.run`.
            controllers: Control laws of the caller's own, of both runs.
            estimators: Estimators of the caller's own, likewise.

        Raises:
            InputError: The folder has no scenario, the run does not reach the instant, it cannot be made again, or a setting
                cannot change in the midst of it.
        """
        file = folder / SCENARIO
        if not file.is_file():
            raise InputError(f"{folder}: is no run folder that can go on: it has no {SCENARIO}")
        before = prepare(file, (), controllers=controllers, estimators=estimators)
        self.prepared = prepare(file, overrides, controllers=controllers, estimators=estimators)
        _refuse_changes(before, self.prepared)
        if not 0.0 < from_s < min(before.scenario.duration_s, self.prepared.scenario.duration_s):
            raise InputError(
                f"{folder}: {from_s:g} s is not an instant of the run, which lasts {before.scenario.duration_s:g} s"
            )
        simulation, changes = _made_again(before, from_s, load_run(folder))
        _refuse_other_parts(simulation, self.prepared)
        new_laws = (
            before.scenario.phases != self.prepared.scenario.phases or before.scenario.task != self.prepared.scenario.task
        )
        self.start = Start(simulation.progress.time_s, changes, new_laws)


def go_on(
    run: str | Path,
    from_s: float,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    out: str | Path | None = None,
    force: bool = False,
    rerun: bool | None = None,
    live: str | None = None,
    report: Callable[[float, float], None] | None = None,
    raise_errors: bool = False,
) -> Run:
    """Simulate on from an instant of a logged run, bit for bit, or with some of its settings changed there.

    Args:
        run: Folder of the logged run.
        from_s: The instant, s: the run goes on from the first control tick or event at or after it.
        overrides: Settings that change there: of phases, task, contacts, captures, actuators and limits, or the duration. If
            phases or task change, the control law of the phase under way begins anew.
        controllers: See :func:`ffsm_mj.run`, likewise the others.
        estimators: Estimators of the caller's own.
        out: Run folder to write; None keeps the run in memory only.
        force: Replace a run that ``out`` already holds.
        rerun: Write ``run.rrd`` into the folder.
        live: ``host:port`` of a Rerun viewer.
        report: Told (simulation time, duration) in s as the run goes.
        raise_errors: Raise an exception of a control law or of a contact model again.

    Returns:
        The run from the instant on; its times are those of the logged run.

    Raises:
        InputError: See :class:`GoingOn`.
    """
    folder = RunFolder(Path(out), force=force) if out is not None else None
    if folder is not None:
        folder.refuse_earlier_run()
    made = GoingOn(Path(run), from_s, overrides, controllers=controllers, estimators=estimators)
    return made.prepared.run(
        folder=folder, rerun=rerun, live=live, report=report, raise_errors=raise_errors, start=made.start
    )


def _refuse_changes(before: PreparedRun, after: PreparedRun) -> None:
    """Refuse settings that cannot change in the midst of a motion."""
    old, new = before.scenario, after.scenario
    changed = [key for key in _KEPT if getattr(old, key, None) != getattr(new, key, None)]
    if changed:
        raise InputError(f"{', '.join(changed)}: cannot change where a run goes on; give it to a run of its own")


@one_blas_thread()
@stopped_clock()
@np.errstate(all="ignore")
def _made_again(prepared: PreparedRun, from_s: float, logged: Run) -> tuple[Simulation, bytes]:
    """Simulate to an instant, and compare the state there with the logged one; the simulation and what has changed in it."""
    recording = Recording(prepared.assemble(), columns=())
    simulation = recording.simulation
    with noted() as simulation.interrupted, collected_warnings(simulation.warnings), recording:
        simulation.begin()
        simulation.remember(changes=True)
        while simulation.ended is None and simulation.progress.time_s < from_s - 1e-9 * prepared.scenario.control_period_s:
            simulation.advance(to_event=True)
        changes = simulation.save(changes=True)
    if simulation.interrupted():
        raise KeyboardInterrupt
    if simulation.ended is not None:
        end_s, why = simulation.progress.time_s, simulation.ended.outcome.value
        raise InputError(f"{logged.path}: the run ends at {end_s:.6g} s ({why}), before {from_s:g} s")
    data = simulation.observation().free
    row = int(np.searchsorted(logged.time, simulation.progress.time_s - 1e-9))
    if row < len(logged.time) and simulation.progress.due is None:
        state, told = np.concatenate((data.qpos, data.qvel)), np.concatenate((logged.qpos[row], logged.qvel[row]))
        apart = np.abs(state - told) / np.maximum(1.0, np.abs(told))
        if not apart.max() <= TOLERANCE:
            raise InputError(
                f"{logged.path}: the run cannot be made again: at {simulation.progress.time_s:.6g} s its state differs from"
                f" the logged one by {apart.max():.3g}; it was made by another version, or its files have changed"
            )
    return simulation, changes


def _refuse_other_parts(simulation: Simulation, after: PreparedRun) -> None:
    """Refuse settings that give the simulation other parts: their memory is not in the state."""
    other = Recording(after.assemble(), columns=()).simulation
    other.begin()
    other.remember()
    pairs = zip_longest(simulation.structure, other.structure, fillvalue="nothing")
    found = next(((old, new) for old, new in pairs if old != new), None)
    if found is not None:
        raise InputError(
            "settings that change where a run goes on may change values, not the parts of the simulation:"
            f" there is {found[1]} where there was {found[0]}"
        )
