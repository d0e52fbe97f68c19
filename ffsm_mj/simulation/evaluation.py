"""Evaluation of the controller: what it observes, its command and its requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ffsm_mj.contact_models.interface import EventEffect
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.errors import ControllerError, described, raised_at, unknown_name
from ffsm_mj.records.active_contact import ActiveContacts
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.sensing.measured import Measured
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import EventDue, records_as_state, records_of_state
from ffsm_mj.simulation.task_controller import TaskController
from ffsm_mj.simulation.told_records import calls_controller, told_records
from ffsm_mj.state import entries

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
        self.command = Command.off(int(plant.system.mj.nu))
        if plant.control is None:
            plant.actuation.bind(self.command, plant.data)
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
        told = entries(state, ("records", "triggers_control", "at_tick"), "EventDue")
        observed = self.observed(time_s, at_tick=told["at_tick"])
        return EventDue(records_of_state(told["records"]), observed, told["triggers_control"], None)

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

    def due(self, effect: EventEffect, time_s: float, told_above_N_s: float | None) -> EventDue:
        """The decision that an event asks for.

        Args:
            effect: The event.
            time_s: Its time, s.
            told_above_N_s: See :class:`~ffsm_mj.simulation.settings.Settings`.
        """
        told = told_records(effect.records, told_above_N_s)
        self.pending = (*self.pending, *told)
        observed = self.observed(time_s, at_tick=effect.is_tick)
        return EventDue(effect.records, observed, calls_controller(effect, told), effect.end)

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
            self._send(observation.time_s)
            if self.command.requests:
                self._forward_requests()
        except RunEnded:  # the contacts that the controller reads cannot be computed
            raise
        except Exception as error:
            reason = str(error) if isinstance(error, ControllerError) else described(error) + raised_at(error)
            message = f"{self._controller.in_charge} at t = {observation.time_s:.6g} s: {reason}"
            raise RunEnded(Outcome.CONTROLLER_FAILED, message) from error

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
