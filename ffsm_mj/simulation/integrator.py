"""Event-driven integrator: integrates a motion until an event of a contact model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ffsm_mj._core.steppers import FreeStepper
from ffsm_mj._core.tick import SteadyForces
from ffsm_mj._core.travel import Travel
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.interface import (
    EventEffect,
    EventSource,
    EventTime,
    ForceOrder,
    ForceSource,
    LoggedEvent,
    Replayable,
    Source,
)
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.simulation.step_control import StepControl
from ffsm_mj.state import entries, get_states
from ffsm_mj.ties import apart, instant_s, last_of_first, shortest_s
from ffsm_mj.unchanging import with_state

_SHORTEST_S = 1e-10
"""An implicit step this short is kept even if its stages are not solved: it hardly moves anything."""


class CoreSteps(NamedTuple):
    """What the core needs to make steps.

    Attributes:
        move: Makes a step of the motion, where that is more than a step of its model; None: the stepper makes it.
        stepper: Stepper of the motion.
        forces: Its applied forces, all of closed contacts or of closed loops; None: there are none.
        event_bound: Motion bound from which other events are possible.
        travels: Motions of the coordinates.
        bound_within: The same bound while all these are within their reach.
    """

    move: Callable[[float], bool] | None
    stepper: FreeStepper
    forces: SteadyForces | None
    event_bound: float
    travels: tuple[Travel, ...]
    bound_within: float


class EventDrivenIntegrator:
    """Integrates a motion and locates the events of contact models.

    Most steps skip event detection: the kinetic energy bounds how far anything can have moved, and a contact model is asked
    only once this motion bound exceeds its ``event_bound``.

    Attributes:
        motion: The current motion.
        sources: All contact models.
        event_sources: Those with events, in the order in which simultaneous events are applied.
        replayable: Those with a state or forces that a log replay restores or checks.
        control: Step-size control by sub-steps; None for fixed steps.
    """

    def __init__(self, motion: Motion, sources: Sequence[Source]) -> None:
        """Start at the state of the motion, which is that of the logged system."""
        self.sources, self._of_system = tuple(sources), motion
        names = [source.kind for source in sources]
        self._stateful = {
            name if names.count(name) == 1 else f"{name} {i}": with_state(source, f"the contact model {name!r}")
            for i, (name, source) in enumerate(zip(names, sources, strict=True))
        }
        self.event_sources = tuple(source for source in sources if isinstance(source, EventSource))
        self._after_substeps = [
            source for source in self.event_sources if type(source).after_substep is not EventSource.after_substep
        ]
        self.replayable = tuple(source for source in sources if isinstance(source, Replayable))
        self._travels = tuple(travel for source in self.event_sources for travel in source.travels)
        self._force_sources = tuple(source for source in sources if isinstance(source, ForceSource))
        self.control: StepControl | None = None
        self._active: list[ForceSource] = []
        self._fields = [source for source in self._force_sources if source.order == ForceOrder.EXTERNAL]
        self._poll: Callable[[], None] | None = None
        self._event_s: float | None = None
        self.bind(motion)

    def bind(self, motion: Motion) -> None:
        """Integrate another motion from now on."""
        self.motion = motion
        if self._poll is not None:
            motion.path.poll = self._poll
        for source in self.sources:
            source.bind(motion)
        self.restart()

    def restore_state(self, system: Motion, events: Sequence[LoggedEvent] = ()) -> None:
        """Start at the state in ``data``, with contact models restored from their columns.

        Args:
            system: Motion of the logged system; used unless a contact model decides on another one.
            events: Logged events before this state; none at the start of a run.
        """
        self._event_s = None
        for source in self.replayable:
            source.restore_state(events)
        self.bind(self._current_motion() or system)

    def _current_motion(self) -> Motion | None:
        """The motion that the state of a contact model gives; None: that of the logged system."""
        return next((motion for one in self.sources if (motion := one.current_motion()) is not None), None)

    @dataclass
    class State:
        """What contact models remember, the time of an event of which they are not told yet, s, and step-size control."""

        sources: dict[str, Any]
        event_s: float | None
        control: Any

    def get_state(self) -> State:
        """What the contact models remember."""
        control = None if self.control is None else self.control.get_state()
        return self.State(get_states(self._stateful), self._event_s, control)

    def set_state(self, state: Any) -> None:
        """Go on from a state; that of the logged system is in ``data``, with its efforts."""
        values = entries(state, ("sources", "event_s", "control"), "EventDrivenIntegrator")
        of_models = entries(values["sources"], [*self._stateful], "the sources")
        for source in self.sources:
            source.forget()
        deciding = [name for name, one in zip(self._stateful, self.sources, strict=True) if one.current_motion()]
        for name in deciding:
            self._stateful[name].set_state(of_models[name])
        self._event_s = None
        self.bind(self._current_motion() or self._of_system)
        for name, part in self._stateful.items():
            if name not in deciding:
                part.set_state(of_models[name])
        self.restart()
        self._event_s = values["event_s"]
        if self.control is not None:
            self.control.set_state(values["control"])

    def interrupt_by(self, poll: Callable[[], None]) -> None:
        """Set a function to be called before every move along a path; an exception it raises ends :meth:`advance`."""
        self._poll = self.motion.path.poll = poll

    def restart(self) -> None:
        """Reset detection and applied forces after a discontinuity: velocities, active contact models or the motion."""
        self._active = [source for source in self._force_sources if source.active and source not in self._fields]
        pushing = sorted((*self._fields, *self._active), key=lambda one: one.order)
        pushes = [one.push for one in pushing if one.order < ForceOrder.REACTIVE]
        answers = [one.push for one in pushing if one.order >= ForceOrder.REACTIVE]
        of_system = any(one.order in (ForceOrder.INDEPENDENT, ForceOrder.REACTIVE) for one in pushing)
        self.motion.push_with(pushes, answers, of_system=of_system)
        for source in self.sources:
            source.restart()
        self.motion.stepper.clear(self._event_bound())
        if self.control is not None:
            self.control.restart()

    def discard_idle(self) -> None:
        """Restart if a contact model has ceased to exert forces without an event, as at a limit that a joint leaves at once.

        A step without forces is MuJoCo's own, one with forces another method of order four: their truncation differs.
        """
        if not all(source.active for source in self._active):
            self.restart()

    def reconsider(self) -> None:
        """Update the event bound after a contact model has handled a request."""
        self.motion.stepper.event_bound = self._event_bound()

    def after_event(self, time_s: float) -> None:
        """Store the time of an event: contact models are notified when the next step begins, with its efforts set."""
        self._event_s = time_s

    def _begin_step(self, left_s: float) -> float:
        """Begin a (sub-)step; returns the longest one that the forces allow, s."""
        if self._event_s is not None:
            for one in self.event_sources:
                one.after_event(self._event_s)
            self._event_s = None
        return min([left_s, *[source.begin_step(left_s) for source in self._active]])

    def _event_bound(self) -> float:
        return min([source.event_bound for source in self.event_sources], default=math.inf)  # in every step

    @property
    def columns(self) -> list[Columns]:
        """Columns of all contact models."""
        return [columns for source in self.sources for columns in source.columns]

    @property
    def pushed(self) -> bool:
        """Whether a contact model that applies forces is active."""
        return bool(self._active)

    def begin_core_steps(self) -> CoreSteps | None:
        """Begin steps that the core makes: of a fixed length, under steady forces of one kind at most.

        Returns:
            None: the core cannot make them.
        """
        motion = self.motion
        if self._event_s is not None or self.control is not None:
            return None
        if not self._active:
            # A grasped object is part of the model of a motion of its own, which the logged system follows.
            move = None if type(motion).step is Motion.step else motion.step
            return CoreSteps(move, motion.stepper, None, *self._bounds(()))
        if type(motion) is not Motion:
            return None
        # Where forces watch for events themselves, as closed contacts do, others may need a call after each sub-step: no
        # motion bound excludes it.
        watched = self._after_substeps and isinstance(self._active[0], EventSource)
        forces = self._active[0].begin_steady_steps() if len(self._active) == 1 and not watched else None
        if forces is None:
            return None
        return CoreSteps(None, motion.stepper, forces, *self._bounds(self._active))

    def _bounds(self, active: Sequence[Source]) -> tuple[float, tuple[Travel, ...], float]:
        """Event bound of the models that are not active, motions of the coordinates, and the bound within their reach."""
        others = [source for source in self.event_sources if source not in active]
        bound = min((other.event_bound for other in others), default=math.inf)
        within = min((other.bound_within if other.travels else other.event_bound for other in others), default=math.inf)
        return bound, self._travels, within

    def excludes_events(self) -> bool:
        """Whether the motion bound excludes events at the end of the last step; renews the bound where it is used up."""
        watching = self._watching()
        if any(math.isinf(source.event_bound) or not source.is_clear() for source in watching):
            return False
        self.motion.stepper.event_bound = self._event_bound()
        return not self._watching()

    def contacts(self) -> tuple[ActiveContact, ...]:
        """Closed contacts at the state in ``data``, with forces under its efforts."""
        return tuple(contact for source in self._active for contact in source.active_contacts())

    def wrenches(self) -> tuple[Wrench, ...]:
        """Forces of the active contact models on bodies of the logged system, at the state and efforts in ``data``."""
        return tuple(wrench for source in (*self._fields, *self._active) for wrench in source.wrenches(source.scene.data))

    @property
    def kinetic_energy_J(self) -> float:
        """Total kinetic energy at the state in ``data``."""
        return self.motion.stepper.energy

    def advance(self, duration_s: float, *, stepped: bool = False) -> tuple[float, EventSource | None]:
        """Integrate for a time, a sub-step of it, or until the first event.

        Args:
            duration_s: The time, s.
            stepped: Whether a step of this duration has been made already.

        Returns:
            Time integrated in s, and the contact model with an event there; None if there is no event.

        Raises:
            UnsupportedContactError: The motion is too fast for event detection.
            StepLimitError: The motion is too fast for the required accuracy.
        """
        motion, stepper = self.motion, self.motion.stepper
        if stepped and stepper.kinked:
            motion.path.at_s = duration_s
            step_s, clear = self._to_kink(duration_s, clear=False)
            clear = clear and stepper.motion_bound < stepper.event_bound
        elif stepped:
            motion.path.at_s = step_s = duration_s
            clear = stepper.motion_bound < stepper.event_bound
        else:
            for source in self._watching():
                if source.due():
                    return 0.0, source
            step_s, clear = self._step(duration_s, duration_s)
            self._add_travel(step_s)
        # A non-finite state is reported by the caller; event detection on it would not end.
        if clear or not math.isfinite(stepper.energy):
            return step_s, None
        watching = [source for source in self._watching() if not source.is_clear()]
        motion.path.at_s = step_s
        if not watching:
            self._after_substep(step_s)
            stepper.event_bound = self._event_bound()
            return step_s, None
        first = self._first_event(watching, step_s)
        at_s = step_s if first is None else first[0]
        motion.path.move_to(at_s)
        self._after_substep(at_s)
        for source in self.event_sources:
            source.on_event_located(at_s)
        motion.stepper.clear(self._event_bound())
        return first if first is not None else (step_s, None)

    def _first_event(self, watching: Sequence[EventSource], step_s: float) -> tuple[float, EventSource] | None:
        """Time in the last step of its first event, and the contact model that has it.

        At one instant the earlier model in the order has it, when the events of all are due: rounding prefers none.
        """
        now_s = float(self.motion.path.start[0])
        located: list[tuple[float, EventSource]] = []
        until_s = step_s
        for source in watching:
            time_s = source.first_event(until_s)
            if time_s is not None:
                located.append((time_s, source))
                until_s = min(until_s, time_s + instant_s(now_s))
        if not located:
            return None
        at_s = last_of_first([time_s for time_s, _ in located], now_s)
        return apart(at_s, step_s, now_s), next(source for time_s, source in located if time_s <= at_s)

    def _watching(self) -> list[EventSource]:
        """Contact models with possible events: the motion bound exceeds their ``event_bound``."""
        moved = self.motion.stepper.motion_bound
        if moved < self.motion.stepper.event_bound:
            return []
        sources = self.event_sources
        return [source for source in sources if not (moved < source.event_bound or source.excludes_events(moved))]

    def _add_travel(self, duration_s: float) -> None:
        for travel in self._travels:
            travel.add(duration_s)

    def act(self, source: EventSource, instant: EventTime) -> EventEffect | None:
        """Apply the event of a contact model; one that it leaves to impacts is resolved by the model of these.

        Raises:
            RunEnded: The motion that follows is not modelled.
        """
        effect = source.act(instant)
        if effect is not None and effect.leaves_to_impacts:
            effect = next(one for one in self.event_sources if one.resolves_impacts).act(instant)
        return effect

    def integrate(self, most_s: float, left_s: float) -> float:
        """Integrate for a time or a sub-step of it without event detection; returns the duration.

        Args:
            most_s: The time.
            left_s: Remaining time of the grid step: step-size control chooses the same sub-steps as in the run.

        Raises:
            StepLimitError: The motion is too fast for the required accuracy.
        """
        step_s, _ = self._step(left_s, most_s)
        self._add_travel(step_s)
        self.motion.path.at_s = step_s
        self._after_substep(step_s)
        return step_s

    def continue_step(self, duration_s: float) -> None:
        """Integrate for a time with the contacts and modes chosen for the step before, without event detection."""
        for source in self._active:
            source.begin_step(duration_s, continues=True)
        self.motion.step(duration_s)
        self._add_travel(duration_s)
        self.motion.path.at_s = duration_s
        self._after_substep(duration_s)

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores what the active contact models change at the start of a step."""
        restoring = [source.snapshot() for source in self._active]

        def restore() -> None:
            for restore_one in restoring:
                restore_one()

        return restore

    def _step(self, left_s: float, most_s: float) -> tuple[float, bool]:
        """Integrate a (sub-)step of at most ``most_s``: its duration, and whether no event is possible in it."""
        control = self.control
        if control is not None:
            control.begin(left_s, pushed=bool(self._active))
        elif not self._active and self._event_s is None and self.motion.stiff is None:  # as in most steps: nothing limits it
            motion, step_s = self.motion, min(most_s, left_s)
            clear, motion.path.at_s = motion.step(step_s), step_s
            return (step_s, clear) if not motion.stepper.kinked else self._to_kink(step_s, clear)
        # Step-size control must not try a step that contact forces forbid; events, which shorten a step, do not concern it.
        reach_s = self._begin_step(left_s)
        if reach_s < left_s < reach_s + shortest_s(float(self.motion.data.time)):
            reach_s = left_s
        most_s = min(most_s, reach_s)
        if control is None:
            return self._to_kink(*self._solved_step(most_s))
        return self._to_kink(*control.step(self.motion, reach_s, most_s, self.exchanged))

    def _solved_step(self, step_s: float) -> tuple[float, bool]:
        """A step of a given duration, or of a half, a quarter, ... of it: the longest one whose stages have a solution.

        They have none where a sliding point stops within an implicit step that was not expected to see it stop.
        """
        motion = self.motion
        clear, motion.path.at_s = motion.step(step_s), step_s
        while not motion.is_solved and step_s > _SHORTEST_S:
            motion.path.move_to(0.0)
            step_s *= 0.5
            clear, motion.path.at_s = motion.step(step_s), step_s
        return step_s, clear

    def _to_kink(self, step_s: float, clear: bool) -> tuple[float, bool]:
        """The step that was made, or as much of it as there is before a force reaches its limit, or leaves it."""
        motion = self.motion
        if motion.force_limits is None or not motion.stepper.kinked:
            return step_s, clear
        of_activation = motion.activations.kink_s if motion.activations is not None else math.inf
        at_s = motion.force_limits.first_kink(motion.path, min(step_s, of_activation))
        if at_s is None and of_activation < step_s:
            at_s = of_activation
        if at_s is not None and at_s + shortest_s(float(motion.data.time)) < step_s:
            step_s = at_s
        clear, motion.path.at_s = motion.step(step_s), step_s
        return step_s, clear

    def exchanged(self, duration_s: float) -> list[Exchange]:
        """Exchanges of the active contact models in a trial step that may be rejected."""
        return [done for source in self._active if (done := source.end_step(duration_s, trial=True)) is not None]

    def _after_substep(self, duration_s: float) -> None:
        for source in self._after_substeps:
            source.after_substep(duration_s)

    def finish(self, instant: EventTime) -> list[Any]:
        """Records of the contact models at the end of the run."""
        return [record for source in self.event_sources for record in source.finish(instant)]

    def exchanges(self, duration_s: float) -> list[Exchange]:
        """Exchanges of the active contact models in the finished (sub-)step."""
        if not self._active or duration_s <= 0.0:
            return []  # no forces are applied, or an event was due before the step
        return [done for source in self._active if (done := source.end_step(duration_s)) is not None]
