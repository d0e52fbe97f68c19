"""Simulation loop: observe, control, actuate, integrate, locate and apply events, record.

At a control tick the controller computes the efforts from the current state, a row is recorded, and the plant is integrated
step by step with constant efforts. An event inside a step ends the step there and is applied; the rest of the step follows,
so that rows stay on the time grid. The loop knows nothing of phases or control laws.
"""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import mujoco

from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.interface import EventEffect, EventSource, EventTime
from ffsm_mj.controller_protocol import Command, Observation, TaskController
from ffsm_mj.errors import ControllerError, LogWriteError, UnsupportedContactError, described, raised_at, unknown_name
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.records.active_contact import ActiveContacts
from ffsm_mj.records.events import ControllerReport, Outcome, OutcomeRecord, RunEnded
from ffsm_mj.sensing.measurement import Measurement
from ffsm_mj.simulation.internal_error import internal_error
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.rows import RowWriter
from ffsm_mj.simulation.settings import Settings
from ffsm_mj.simulation.step_control import StepLimitError
from ffsm_mj.simulation.told_records import told_records

MOST_EVENTS_PER_STEP = 1000
_NOT_MEASURED: Mapping[str, Measurement] = MappingProxyType({})


@dataclass
class _Progress:
    time_s: float = 0.0
    steps: int = 0
    ticks: int = 0


class Simulation:
    """Simulates a plant under a controller; an instance serves one run.

    Attributes:
        error: Exception of a control law or an unexpected one that ended the run, with its traceback; None otherwise.
    """

    def __init__(
        self,
        plant: Plant,
        watch: ContactWatch,
        controller: TaskController,
        rows: RowWriter,
        recorder: Recorder,
        settings: Settings,
    ) -> None:
        """Store the parts; ``watch`` reports overlaps that no contact model handles."""
        self._plant, self._watch, self._controller, self._rows = plant, watch, controller, rows
        self._recorder, self._settings = recorder, settings
        self._command = Command.off(int(plant.system.mj.nu))
        self._done = _Progress()
        self._warnings: list[str] = []
        self._pending_records: tuple[Any, ...] = ()
        self._callback_error: Exception | None = None
        self.error: Exception | None = None

    def run(self, interrupted: Callable[[], bool], report: Callable[[float], None]) -> OutcomeRecord:
        """Simulate to the end of the run.

        Args:
            interrupted: Called at each step and during event localisation; True ends the run.
            report: Called with the simulation time at each tick.

        Returns:
            The outcome, without software versions. Exceptions become outcomes too, except those raised by ``report``.
        """
        started = time.perf_counter()

        def tell(time_s: float) -> None:
            try:
                report(time_s)
            except Exception as error:
                self._callback_error = error
                raise

        with collected_warnings(self._warnings):
            ended = self._outcome_of(lambda: self._loop(interrupted, tell))
            finished = self._outcome_of(self._finish)
        # The first cause is the outcome, except that a failed write of the log is always reported.
        completed = ended[0] == Outcome.COMPLETED or finished[0] == Outcome.WRITE_FAILED
        outcome, message = finished if completed else ended
        outcome, message, reports = self._with_reports(outcome, message)
        return OutcomeRecord(
            outcome=outcome.value,
            message=message,
            end_s=self._done.time_s,
            steps=self._done.steps,
            wall_s=time.perf_counter() - started,
            controller_ticks=self._done.ticks,
            reports=reports,
            **self._sub_steps(),
        )

    def _sub_steps(self) -> dict[str, Any]:
        """Statistics of step-size control; empty without it."""
        control = self._plant.integrator.control
        return {"sub_steps": control.steps, "smallest_step_s": control.smallest_s} if control and control.steps else {}

    def _outcome_of(self, part: Callable[[], None]) -> tuple[Outcome, str]:
        """Execute a part of the run; returns its outcome and message."""
        try:
            part()
        except RunEnded as end:
            if end.outcome == Outcome.CONTROLLER_FAILED and isinstance(end.__cause__, Exception):
                self.error = end.__cause__
            return end.outcome, end.message if end.outcome != Outcome.COMPLETED else ""
        except KeyboardInterrupt:
            return Outcome.INTERRUPTED, Outcome.INTERRUPTED.sentence
        except LogWriteError as error:
            return Outcome.WRITE_FAILED, str(error)
        except mujoco.FatalError as error:
            return Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: MuJoCo gave up ({described(error)})"
        except Exception as error:
            if error is self._callback_error:
                raise
            return self._failed(error)
        return Outcome.COMPLETED, ""

    def _failed(self, error: Exception) -> tuple[Outcome, str]:
        """Log an unexpected exception with its traceback."""
        self.error = self.error or error
        record = internal_error(error, self._done.time_s, self._done.steps)
        with suppress(Exception):  # the log itself may have raised it; the outcome reports it in any case
            self._recorder.event(record)
        return Outcome.INTERNAL_ERROR, f"at t = {record.time_s:.6g} s: {record.error} ({record.where})"

    def _with_reports(self, outcome: Outcome, message: str) -> tuple[Outcome, str, Mapping[str, ControllerReport]]:
        """The outcome, with the reports of the control laws; a law that raises in its report has failed."""
        try:
            return outcome, message, self._controller.reports()
        except Exception as error:  # noqa: BLE001 (a plugin's code)
            if outcome != Outcome.COMPLETED:
                return outcome, message, {}
            self.error = error
            reason = str(error) if isinstance(error, ControllerError) else described(error) + raised_at(error)
            return Outcome.CONTROLLER_FAILED, f"{self._controller.in_charge} at its end: {reason}", {}

    def _loop(self, interrupted: Callable[[], bool], report: Callable[[float], None]) -> None:
        settings = self._settings
        period = settings.time_step_s * settings.steps_per_tick

        def poll() -> None:
            if interrupted():
                raise RunEnded(Outcome.INTERRUPTED)

        self._plant.integrator.interrupt_by(poll)
        if self._plant.sampler is not None:
            self._plant.sampler.begin()
        for tick in range(settings.ticks):
            now = tick * period
            if self._is_on_time(now, tick):
                self._evaluate_controller(now, self._pending_records, at_tick=True)
                self._report_phases()
            self._record(now)
            report(now)
            poll()
            self._step()
            for _ in range(1, settings.steps_per_tick):
                poll()
                self._step()
        self._record(settings.ticks * period)

    def _is_on_time(self, time_s: float, tick: int) -> bool:
        """Whether the controller is called at a tick of the time grid; otherwise an event calls it later."""
        control = self._plant.control
        if control is None:
            return True
        on_time = control.begin_tick(time_s, tick)
        self._plant.integrator.reconsider()
        return on_time

    def _finish(self) -> None:
        """Write the remaining records at the end of the run, whatever its outcome."""
        self._report_phases()  # a phase whose control law failed as it began
        for record in self._watch.finish(self._done.time_s):
            self._recorder.event(record)
        for record in self._plant.integrator.finish(EventTime(self._done.time_s, self._done.steps)):
            self._recorder.event(replace(record, efforts_after=self._plant.actuation.by_name()))
        self._recorder.pass_on()

    def _evaluate_controller(self, time_s: float, events: tuple[Any, ...], *, at_tick: bool) -> None:
        """Evaluate the controller and apply its command within the actuator limits."""
        self._command.clear()
        self._pending_records = ()
        try:
            self._control(time_s, events, at_tick=at_tick)
            self._send(time_s)
            if self._command.requests:
                self._forward_requests()
        except RunEnded:
            raise
        except Exception as error:
            reason = str(error) if isinstance(error, ControllerError) else described(error) + raised_at(error)
            message = f"{self._controller.in_charge} at t = {time_s:.6g} s: {reason}"
            raise RunEnded(Outcome.CONTROLLER_FAILED, message) from error
        self._done.ticks += 1

    def _control(self, time_s: float, events: tuple[Any, ...], *, at_tick: bool) -> None:
        """Let the controller write its command."""
        free, integrator, sampler = self._plant.data, self._plant.integrator, self._plant.sampler
        motion = integrator.motion
        shown = motion.data if motion.grasp else free
        measured = sampler.measured(time_s) if sampler is not None else _NOT_MEASURED
        contacts = ActiveContacts(integrator.contacts) if integrator.pushed else ()
        observation = Observation(time_s, shown, events, at_tick, contacts, free, motion.grasp, measured)
        self._controller.control(observation, self._command)
        if isinstance(contacts, ActiveContacts):
            kept = weakref.ref(contacts)
            del observation, contacts
            # A controller that keeps an observation may read its contacts later, under other efforts.
            if (unread := kept()) is not None:
                unread.found()

    def _send(self, time_s: float) -> None:
        """Send the command to the actuators."""
        plant = self._plant
        if plant.control is None:
            plant.actuation.apply(self._command, plant.data, time_s)
            return
        plant.control.send(self._command, time_s)
        plant.integrator.reconsider()

    def _forward_requests(self) -> None:
        """Forward the requests of the controller to the contact models that handle them."""
        handlers = {
            request: contact_model
            for contact_model in self._plant.integrator.event_sources
            for request in contact_model.requests
        }
        for request in sorted(self._command.requests):
            if request not in handlers:
                raise ControllerError(unknown_name("request", request, handlers))
            handlers[request].handle_request(request)
        self._plant.integrator.reconsider()

    def _report_phases(self) -> None:
        for phase in self._controller.drain_phases():
            self._recorder.event(phase)

    def _record(self, time_s: float) -> None:
        self._rows.fill(self._recorder.line, time_s)
        self._recorder.commit()
        for record in self._watch.look(time_s):
            self._recorder.event(record)

    def _step(self) -> None:
        """Integrate one grid step, with all events in it."""
        plant, step_s = self._plant, self._settings.time_step_s
        end_s, left = (self._done.steps + 1) * step_s, step_s
        events = 0
        while left > 0.0:
            elapsed, contact_model = self._advance(left, end_s)
            self._check_finite()
            left -= elapsed
            if contact_model is not None:
                events += 1
                plant.data.time = self._done.time_s = end_s - left
                self._act(contact_model, end_s - left, events)
        self._done.steps += 1
        # Time is a multiple of the step, not a sum, so that it does not accumulate rounding.
        plant.data.time = self._done.time_s = end_s

    def _advance(self, left: float, end_s: float) -> tuple[float, EventSource | None]:
        """Integrate in the grid step that ends at ``end_s``, with ``left`` seconds remaining."""
        try:
            return self._plant.advance(left)
        except UnsupportedContactError as error:
            raise RunEnded(Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: {error}") from error
        except StepLimitError as error:
            message = f"{Outcome.STEP_LIMIT.sentence}: at t = {end_s - left:.6g} s {error}"
            raise RunEnded(Outcome.STEP_LIMIT, f"{message}; use a shorter time_step_s or a larger accuracy") from error

    def _check_finite(self) -> None:
        if self._warnings or not math.isfinite(self._plant.integrator.kinetic_energy_J):
            message = self._warnings[-1] if self._warnings else "the state is not finite"
            raise RunEnded(Outcome.DIVERGED, f"{Outcome.DIVERGED.sentence}: {' '.join(message.split())}")

    def _act(self, contact_model: EventSource, time_s: float, events: int) -> None:
        """Apply an event: enter it in the balance, record it, and evaluate the controller."""
        plant, done = self._plant, self._done
        plant.integrator.motion.path.poll()
        if events > MOST_EVENTS_PER_STEP:
            message = f"{contact_model.names()} touched {events - 1} times within the step before t = {time_s:.6g} s"
            raise RunEnded(Outcome.EVENT_LIMIT, f"{message}; use a shorter time_step_s")
        effect = plant.apply(lambda: plant.integrator.act(contact_model, EventTime(time_s, done.steps)))
        if effect is None:
            return
        if effect.motion is not None:
            self._watch.rigid = effect.motion.rigid
        self._after_event(effect, time_s)

    def _after_event(self, effect: EventEffect, time_s: float) -> None:
        """Evaluate the controller if the event triggers it, and record the event with the efforts that follow."""
        told = told_records(effect.records, self._settings.told_above_N_s)
        triggers_control = effect.is_tick or (effect.triggers_control and (bool(told) or not effect.records))
        end, events = effect.end, (*self._pending_records, *told)
        try:
            if not triggers_control:
                self._pending_records = events
            elif end is None or end.outcome == Outcome.COMPLETED:
                self._evaluate_controller(time_s, events, at_tick=effect.is_tick)
        finally:
            efforts = self._plant.actuation.by_name()
            for record in effect.records:
                self._recorder.event(replace(record, efforts_after=efforts))
        self._report_phases()
        self._plant.integrator.after_event(time_s)
        if end is not None:
            if end.outcome == Outcome.COMPLETED:
                self._record(time_s)
            raise end
