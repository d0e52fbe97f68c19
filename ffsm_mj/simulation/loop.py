"""Simulation loop: observe, control, actuate, integrate, locate and apply events, record.

At a control tick the controller computes the efforts from the current state, a row is recorded, and the plant is integrated
step by step with constant efforts. An event inside a step ends the step there and is applied; the rest of the step follows,
so that rows stay on the time grid. The loop knows nothing of phases or control laws.

The loop advances from decision to decision, at a control tick or at an event: a run does so to its end, and a program that
steps a simulation sees the state before each decision.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.interface import EventEffect
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import described
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.records.events import EffortChange, Outcome, OutcomeRecord, RunEnded
from ffsm_mj.simulation.controller import Evaluation, TaskController
from ffsm_mj.simulation.outcome import Ended, Guard
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import EventDue, Progress, Settings, Start
from ffsm_mj.simulation.rows import LogWriter, RowWriter
from ffsm_mj.simulation.steps import FreeFlight, GridStep
from ffsm_mj.simulation.wall_clock import WallClock
from ffsm_mj.state import StateError, entries


class Simulation:
    """Simulates a plant under a controller; an instance serves one run.

    Attributes:
        interrupted: Called at each step and during event localisation; True ends the run.
        report: Called with the simulation time at each tick; an exception that it raises is not an outcome of the run.
        progress: How far the run has come.
        due: Event at which a decision is due; None: the next decision is that of the next control tick.
        warnings: MuJoCo's warnings; the first one ends the run.
    """

    def __init__(
        self,
        plant: Plant,
        watch: ContactWatch,
        controller: TaskController,
        rows: RowWriter,
        recorder: Recorder,
        settings: Settings,
        clock: WallClock | None = None,
    ) -> None:
        """Store the parts; ``watch`` reports overlaps that no contact model handles, ``clock`` paces decisions."""
        self._plant, self._watch, self._controller, self._settings = plant, watch, controller, settings
        self._clock = clock
        self._log = LogWriter(recorder, rows, watch, controller, plant)
        self._evaluation = Evaluation(plant, controller)
        self.progress = Progress()
        self.due: EventDue | None = None
        self.warnings: list[str] = []
        free = recorder, rows, self._log
        self._free_flight = FreeFlight(plant, watch, controller, free, settings, self.progress, self.warnings)
        self._grid_step = GridStep(plant, settings.time_step_s, self.progress, self.warnings)
        self._wall_s, self._law_wall_s = 0.0, 0.0
        self._guard = Guard(recorder, self.progress)
        self._observed: Observation | None = None
        self.interrupted: Callable[[], bool] = bool
        self.report: Callable[[float], object] | None = None

    @property
    def ended(self) -> Ended | None:
        """How the run has ended; None while it lasts."""
        return self._guard.ended

    @property
    def error(self) -> Exception | None:
        """Exception of a control law or an unexpected one that ended the run, with its traceback; None otherwise."""
        return self._guard.error

    def run(self, start: Start | None = None) -> OutcomeRecord:
        """Simulate to the end of the run.

        Args:
            start: State from which it goes on; None: the initial state.

        Returns:
            The outcome, without software versions. Exceptions become outcomes too, except those raised by ``report``.
        """
        with collected_warnings(self.warnings):
            self.begin()
            if start is not None:
                self.go_on_from(start)
            while self.ended is None:
                self.advance(flying=True)
            return self.finish()

    def begin(self) -> None:
        """Begin: the decision of the first control tick is due."""
        with self._guard:
            self._plant.integrator.interrupt_by(self._poll)
            if self._plant.sampler is not None:
                self._plant.sampler.begin()

    def advance(self, to_event: bool = False, commanded: bool = False, flying: bool = False) -> None:
        """Take the decision that is due, and simulate to the next one or to the end of the run.

        MuJoCo's warnings must be collected in ``warnings``, also in :meth:`finish`.

        Args:
            to_event: Stop at an event before the next control tick: the state is that after it, its decision is due.
            commanded: A command was given: the controller is evaluated even at an event that does not trigger it.
            flying: Take the decisions of control ticks in free flight too, as many as follow each other.
        """
        started = time.perf_counter()
        with self._guard:
            if self._clock is not None and not self._clock.runs:
                self._clock.begin(self.observation().time_s)
            if self.due is not None:
                due, self.due = self.due, None
                self._settle(due, commanded)
            elif not (flying and self._clock is None and self._free_ticks()):
                self._tick()
            self._observed = None
            self._step_to_tick(to_event)
            if self._clock is not None:
                self._clock.wait(self.next_tick_s if self.due is None else self.due.observation.time_s, self._poll)
        self._wall_s += time.perf_counter() - started

    @dataclass
    class State:
        """State at the decision that is due, at a control tick or at an event."""

        progress: Any
        due: Any
        plant: Any
        evaluation: Any
        controller: Any
        watch: Any

    def get_state(self) -> State:
        """The state at the decision that is due; rows so far are written.

        Raises:
            StateError: A part remembers something that it does not say.
        """
        self._log.pass_on()
        due = None if self.due is None else self.due.get_state()
        parts = self._plant.get_state(), self._evaluation.get_state(), self._controller.get_state(), self._watch.get_state()
        return self.State(self.progress.get_state(), due, *parts)

    def go_on_from(self, start: Start) -> None:
        """Go on from a state of another simulation; called after :meth:`begin`, before the first decision."""
        self.set_state(start.state, start)

    def set_state(self, state: Any, start: Start | None = None) -> None:
        """Go on from a state of a simulation of the same scenario; called after :meth:`begin`.

        Args:
            state: The state.
            start: How the scenario differs from that of the state; None: it does not.

        Raises:
            StateError: The state does not fit the parts.
        """
        try:
            self._set_state(state, start)
        except StateError:
            raise
        except Exception as error:  # whatever numbers that do not fit lead to
            raise StateError(f"a state that does not fit the simulation: {described(error)}") from error

    def _set_state(self, state: Any, start: Start | None) -> None:
        replaced = start.replaced if start is not None else ()
        values = entries(state, self.State, "the simulation")
        self._log.pass_on()
        self.progress.set_state(values["progress"])
        self._evaluation.set_state(values["evaluation"])
        self._plant.set_state(values["plant"])
        self._watch.set_state(values["watch"])
        self._watch.disabled = self._plant.integrator.motion.disabled
        self._observed, self.due = None, None
        if values["due"] is not None:
            self.due = self._evaluation.due_of_state(values["due"], self.progress.time_s)
        self._guard.go_on()
        self.warnings.clear()
        self._controller.set_state(values["controller"], self.observation(), replaced)
        if start is not None and start.new_laws:
            self._controller.begin_law_again(replaced)
        self._controller.tell_phase_again()
        self._log.phases()
        if self._clock is not None:
            self._clock.runs = False

    def observation(self) -> Observation:
        """What the controller sees at the decision that is due, or at the end of the run."""
        progress = self.progress
        if self.due is not None:
            return self.due.observation
        if self.ended is not None:  # the state may be beyond what contacts can be computed for
            return self._evaluation.observed(progress.time_s, at_tick=False)
        if self._observed is None:
            self._observed = self._evaluation.observed(self.next_tick_s, at_tick=True)
        return self._observed

    def interrupt(self) -> None:
        """End the run if it was interrupted and has not ended."""
        if self.ended is None:
            with self._guard:
                self._poll()

    def finish(self) -> OutcomeRecord:
        """Write what remains; a run that has not reached its end was interrupted.

        Returns:
            The outcome, without software versions.
        """
        reports = self._guard.finish(lambda: self._log.rest(self.progress, self.due), self._controller)
        assert self.ended is not None
        return OutcomeRecord(
            outcome=self.ended.outcome.value,
            message=self.ended.message,
            end_s=self.progress.time_s,
            steps=self.progress.steps,
            wall_s=self._wall_s,
            law_wall_s=self._law_wall_s,
            controller_ticks=self.progress.evaluations,
            reports=reports,
            **self._sub_steps(),
        )

    def _sub_steps(self) -> dict[str, Any]:
        """Statistics of step-size control; empty without it."""
        control = self._plant.integrator.control
        return {"sub_steps": control.steps, "smallest_step_s": control.smallest_s} if control and control.steps else {}

    def _step_to_tick(self, to_event: bool) -> None:
        """Take the steps up to the next control tick, or with ``to_event`` to an event whose decision is then due."""
        settings, progress = self._settings, self.progress
        while progress.steps < progress.ticks * settings.steps_per_tick:
            self._step(to_event)
            if self.due is not None:
                return
        if progress.ticks == settings.ticks:
            self._log.row(self.next_tick_s)
            raise RunEnded(Outcome.COMPLETED)

    @property
    def unhandled_overlaps(self) -> tuple[tuple[str, ...], ...]:
        """Geoms of the overlaps at the last control tick that no contact model handles and that are not ignored."""
        return self._watch.open_overlaps

    @property
    def next_tick_s(self) -> float:
        """Time of the next control tick of the time grid, s."""
        return self.progress.ticks * (self._settings.time_step_s * self._settings.steps_per_tick)

    def _poll(self) -> None:
        if self.interrupted():
            raise RunEnded(Outcome.INTERRUPTED)

    def _free_ticks(self) -> bool:
        """Take the control ticks of free flight; returns whether there are any."""
        if self._evaluation.pending:  # an event may end the phase: its records are for the controller alone
            return False
        interrupted = None if self.interrupted is bool else self._poll
        report = None if self.report is None else self._report
        ticks, law_s = self._free_flight.take(self._evaluation.command, self._decide, interrupted, report)
        self._law_wall_s += law_s
        return ticks > 0

    def _decide(self, time_s: float) -> bool:
        """Decide at a control tick; returns whether another phase has begun, or the controller makes a request."""
        self._evaluate(self._observed or self._evaluation.observed(time_s, at_tick=True))
        self._observed = None
        return self._log.phases() or bool(self._evaluation.command.requests)

    def _report(self, time_s: float) -> None:
        assert self.report is not None
        try:
            self.report(time_s)
        except Exception as error:
            self._guard.passed_on = error
            raise

    def _tick(self) -> None:
        """Decide at a control tick of the time grid, and record a row."""
        now, tick = self.next_tick_s, self.progress.ticks
        self.progress.ticks += 1
        if self._evaluation.is_on_time(now, tick):
            self._decide(now)
        if self._clock is not None:
            self._clock.decided()
        self._log.row(now)
        if self.report is not None:
            self._report(now)

    def _evaluate(self, observation: Observation) -> None:
        started = time.perf_counter()
        self._evaluation.evaluate(observation)
        self._law_wall_s += time.perf_counter() - started
        self.progress.evaluations += 1

    def _step(self, to_event: bool) -> None:
        """Integrate one grid step with its events; with ``to_event`` up to the first one, whose decision is then due."""
        progress, grid_step, stepped = self.progress, self._grid_step, self._free_flight.continue_step()
        if not progress.is_within_step:
            if not stepped:
                self._poll()
            grid_step.begin()
        while (effect := grid_step.to_event(stepped=stepped)) is not None:
            stepped = False
            self._react(effect, to_event)
            if self.due is not None:
                return

    def _react(self, effect: EventEffect, to_event: bool) -> None:
        """Take the decision of an event, or leave it due."""
        if effect.motion is not None:
            self._watch.disabled = effect.motion.disabled
        due = self._evaluation.due(effect, self.progress.time_s, self._settings.feedback_impulse_N_s)
        is_event = effect.end is None and any(not isinstance(record, EffortChange) for record in effect.records)
        if is_event and self._settings.keeps_states:
            self._keep_state(due)
        if to_event and is_event:
            self.due = due
        else:
            self._settle(due)

    def _keep_state(self, due: EventDue) -> None:
        """Write the state at an event, before its decision, into the log."""
        self.due = due
        try:
            self._log.state(self.progress.time_s, self.get_state())
        except StateError as error:
            raise RunEnded(Outcome.CONTROLLER_FAILED, f"log.states: {error}") from error
        finally:
            self.due = None

    def _settle(self, due: EventDue, commanded: bool = False) -> None:
        """Evaluate the controller if the event triggers it, and record the event with the efforts that follow."""
        end = due.end
        try:
            if (due.triggers_control or commanded) and (end is None or end.outcome == Outcome.COMPLETED):
                self._evaluate(due.observation)
        finally:
            self._log.event(due)
        self._plant.integrator.after_event(due.observation.time_s)
        if end is not None:
            if end.outcome == Outcome.COMPLETED:
                self._log.row(due.observation.time_s)
            raise end
