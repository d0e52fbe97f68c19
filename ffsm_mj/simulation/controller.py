"""The controller of a whole run: what the simulation asks of it, of which events it is told, and its evaluation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ffsm_mj.contact_models.grasp.records import KINDS
from ffsm_mj.contact_models.interface import EventEffect
from ffsm_mj.controller_protocol import Command, Controller, LawInCore, Observation
from ffsm_mj.errors import ControllerError, described, raised_at, unknown_name, written_at
from ffsm_mj.model.driven_joints import needs_motors
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.command import ExternalCommand
from ffsm_mj.records.contact_forces import ActiveContacts
from ffsm_mj.records.events import EffortChange, ImpactRecord, Outcome, PhaseRecord, RunEnded
from ffsm_mj.records.record import ControllerReport
from ffsm_mj.sensing.measured import Measured
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import EventDue, records_as_state, records_of_state
from ffsm_mj.state import entries


class TaskController(Protocol):
    """The controller of a whole run: the phase machine."""

    columns: tuple[Columns, ...]
    """Reports of the phases' controllers after the last call, NaN in the columns of other phases; the phase's position."""

    external: ExternalCommand | None
    """Command of the program that steps the simulation; None: the controllers of the phases command everything."""

    @property
    def in_charge(self) -> str:
        """Who decides now, for a person: phase and kind of controller."""

    @property
    def law(self) -> Controller:
        """The control law in charge."""

    def control(self, observation: Observation, command: Command) -> None:
        """Like :meth:`~ffsm_mj.controller_protocol.Controller.control`."""

    @property
    def grasp(self) -> str:
        """Name of the grasp for whose system the law in charge is made; empty: for the system without a grasp."""

    def in_core(self, command: Command, data: Any) -> LawInCore | None:
        """The law in charge, to be evaluated by the core at control ticks without events; None if it cannot be.

        Args:
            command: What it commands.
            data: Data of the plant.
        """

    def drain_phases(self) -> list[PhaseRecord]:
        """Phases begun since the last call, oldest first."""

    def tell_phase_again(self) -> None:
        """Let the phase under way be among the phases begun since the last call: a log begins with it."""

    def begin_law_again(self, replaced: Sequence[int] = ()) -> None:
        """Let the control law of the phase under way begin at its next call.

        Args:
            replaced: Phases, by position, whose control laws have done nothing yet, though the phases may have begun.
        """

    def get_state(self) -> Any:
        """What phases and control laws remember."""

    def set_state(self, state: Any, observation: Observation, replaced: Sequence[int] = ()) -> None:
        """Go on from a state.

        Args:
            state: The state.
            observation: What the controller sees at it.
            replaced: Phases, by position, whose control laws are of another kind: the state has nothing of them.
        """

    def reports(self) -> Mapping[str, ControllerReport]:
        """What the control laws of the phases begun say of their work, by phase."""


_OF_GRASPS = tuple(kind.record for kind in KINDS)


def reported_records(records: Sequence[Any], min_impulse_N_s: float | None) -> tuple[Any, ...]:
    """Records that are reported to the control law: those of its grasps always, those of contacts as configured.

    Args:
        records: Records of one event.
        min_impulse_N_s: Least impulse of an impact; -inf: all events are reported; None: none of contacts.
    """
    records = [record for record in records if not isinstance(record, EffortChange)]
    if min_impulse_N_s == -math.inf:
        return tuple(records)
    hard = min_impulse_N_s is not None and any(
        isinstance(record, ImpactRecord) and record.impulse_N_s >= min_impulse_N_s for record in records
    )
    kinds = (*_OF_GRASPS, ImpactRecord) if hard else _OF_GRASPS
    return tuple(record for record in records if isinstance(record, kinds))


def calls_controller(effect: EventEffect, reported: Sequence[Any]) -> bool:
    """Whether the controller is evaluated at an event of which it is told some records."""
    return effect.is_tick or (effect.triggers_control and (bool(reported) or not effect.records))


_NO_SENSORS = Measured({}, (), 0.0)


class Evaluation:
    """Evaluates the controller of a plant.

    Attributes:
        command: What the controller commands.
        pending: Records of events of which the controller is told at its next evaluation.
    """

    def __init__(self, plant: Plant, controller: TaskController) -> None:
        """Bind controller and plant."""
        self._plant, self._controller = plant, controller
        self.command = Command.off(plant.system.names("actuator"))
        if plant.control is None:
            plant.actuation.bind(self.command, plant.data)
        self._servos = plant.actuation.servos if plant.actuation.servos.any() else None
        self.pending: tuple[Any, ...] = ()

    @dataclass
    class State:
        """The records of which the controller is told next; a command is made anew at each evaluation."""

        pending: list[Any]

    def get_state(self) -> State:
        """The records."""
        return self.State(records_as_state(self.pending))

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        self.pending = records_of_state(entries(state, ("pending",), "Evaluation")["pending"])

    def due_of_state(self, state: Any, time_s: float) -> EventDue:
        """The decision that is due in a state, at the state of the plant."""
        values = entries(state, ("records", "triggers_control", "at_tick"), "EventDue")
        observed = self.observed(time_s, at_tick=values["at_tick"])
        return EventDue(records_of_state(values["records"]), observed, values["triggers_control"], None)

    def observed(self, time_s: float, at_tick: bool) -> Observation:
        """Observation for the controller, current until its command is sent."""
        free, integrator, sampler = self._plant.data, self._plant.integrator, self._plant.sampler
        motion = integrator.motion
        shown = motion.data if motion.grasp else free
        measured = sampler.measured(time_s) if sampler is not None else _NO_SENSORS
        contacts = ActiveContacts(integrator.contacts) if integrator.pushed else ()
        return Observation(time_s, shown, self.pending, at_tick, contacts, free, motion.grasps, measured)

    def is_on_time(self, time_s: float, tick: int) -> bool:
        """Whether the controller is called at a tick of the time grid; otherwise an event calls it later."""
        control = self._plant.control
        if control is None:
            return True
        on_time = control.begin_tick(time_s, tick)
        self._plant.integrator.reconsider()
        return on_time

    def due(self, effect: EventEffect, time_s: float, feedback_impulse_N_s: float | None) -> EventDue:
        """The decision that an event asks for.

        Args:
            effect: The event.
            time_s: Its time, s.
            feedback_impulse_N_s: See :class:`~ffsm_mj.simulation.progress.Settings`.
        """
        reported = reported_records(effect.records, feedback_impulse_N_s)
        self.pending = (*self.pending, *reported)
        observed = self.observed(time_s, at_tick=effect.is_tick)
        return EventDue(effect.records, observed, calls_controller(effect, reported), effect.end)

    def evaluate(self, observation: Observation) -> None:
        """Evaluate the controller and apply its command within the actuator limits.

        Raises:
            RunEnded: The controller fails.
        """
        self.command.clear()
        self.pending = ()
        try:
            self._controller.control(observation, self.command)
            if isinstance(observation.contacts, ActiveContacts):
                observation.contacts.expire()
            self._refuse_efforts_of_servos()
            self._send(observation.time_s)
            if self.command.requests:
                self._forward_requests()
        except RunEnded:  # the contacts that the controller reads cannot be computed
            raise
        except Exception as error:
            by_us = isinstance(error, ControllerError)  # who refuses a command does not know where it was written
            reason = str(error) + written_at(self._controller.law.control) if by_us else described(error) + raised_at(error)
            message = f"{self._controller.in_charge} at t = {observation.time_s:.6g} s: {reason}"
            raise RunEnded(Outcome.CONTROLLER_FAILED, message) from error

    def _refuse_efforts_of_servos(self) -> None:
        """Refuse efforts for servos, which would take them for setpoints.

        Raises:
            ControllerError: There are some.
        """
        if self._servos is None:
            return
        # Bytes are searched in a tenth of the time that the reduction of a short array takes, once per tick.
        if b"\1" in (wrong := self._servos & (self.command.powered > self.command.setpoints)).tobytes():
            advice = "a law that computes their setpoints gives them by 'command.set'"
            raise ControllerError(f"{needs_motors(self._plant.system, np.flatnonzero(wrong).tolist())}; {advice}")

    def _send(self, time_s: float) -> None:
        """Send the command to the actuators."""
        plant = self._plant
        if plant.control is None:
            plant.actuation.apply(self.command, plant.data, time_s)
            return
        plant.control.send(self.command, time_s)
        plant.integrator.reconsider()

    def _forward_requests(self) -> None:
        """Forward the requests of the controller to the contact models that handle them."""
        handlers = {
            request: contact_model
            for contact_model in self._plant.integrator.event_sources
            for request in contact_model.requests
        }
        for request in sorted(self.command.requests):
            if request not in handlers:
                raise ControllerError(unknown_name("request", request, handlers))
            handlers[request].handle_request(request)
        self._plant.integrator.reconsider()
