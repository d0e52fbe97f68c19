"""One run of a simulator: the simulation under way, and the contexts that it needs from its first step to its last."""

from __future__ import annotations

import math
from collections.abc import Collection
from contextlib import ExitStack
from contextvars import copy_context
from dataclasses import replace
from functools import partial
from hashlib import sha256
from typing import Any
from weakref import finalize

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.blas_threads import one_blas_thread
from ffsm_mj.assembly.given_command import given_command
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.assembly.recording import Recording
from ffsm_mj.assembly.run import with_run
from ffsm_mj.assembly.step import SimulatorError, SimulatorState, Step
from ffsm_mj.assembly.step_interrupts import StepInterrupts
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import InputError
from ffsm_mj.log.recorder import EventTap
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.model.mujoco_process import collecting, collectors, handled_warnings, stopped_clock
from ffsm_mj.records.events import Outcome
from ffsm_mj.simulation.loop import Simulation
from ffsm_mj.state import StateError

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
            columns: See :class:`~ffsm_mj.assembly.recording.Recording`.
            start_s: Time of the state that is restored next, s; None: the run begins as the scenario says.
            check: Raise what ended the run by an exception, of a control law, an estimator or a contact model.

        Raises:
            InputError: The folder of the run cannot be used.
        """
        self._prepared, self.origin, self._check = prepared, (overrides, seed), check
        self._tap, self.assembly = EventTap(), seeded(prepared, seed).assemble()
        start = self.assembly.start() if self.assembly.start is not None else None
        begins_s = start.time_s if start is not None else 0.0
        self._folder = folder
        self._recording = Recording(
            self.assembly,
            folder,
            with_rerun=with_rerun,
            live=live,
            columns=columns,
            watchers=[self._tap],
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
        self._controller.given = None if command is None else given_command(self.assembly.system, command)
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
        found = sha256(f"{self._prepared.scenario_yaml}\n{seed}\n".encode())
        for name, content in sorted(self._prepared.logged_files.items()):
            found.update(name.encode() + b"\n" + content)
        return found.hexdigest()

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
