"""Interface of contact models; see ``docs/contact-models.md``.

A contact model locates its events within a step, adds its forces to the smooth motion while it is active, changes the state
at its events, and reports the effect: records for the log and wrenches for the balances. Impacts are one contact model.
Others are registered by kind, or through the entry-point group ``ffsm_mj.contact_models``, and are declared in the
``contact_models`` of a scenario.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import entry_points
from typing import Any, ClassVar, NamedTuple

import mujoco

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange, ExchangeIntegrator
from ffsm_mj.config import StrictModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import described, unknown_name
from ffsm_mj.model.system import System
from ffsm_mj.records import kinds
from ffsm_mj.records.active_contact import ActiveContact
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import Layout
from ffsm_mj.records.wrench import Wrench

GROUP = "ffsm_mj.contact_models"
BUILT_IN_KINDS = ("impact", "contact", "capture")
"""Kinds of the built-in contact models, which no other may have."""


class EventCounter:
    """Counter shared by the contact models of a run: it orders events that happen at the same time."""

    def __init__(self) -> None:
        """Start at 0."""
        self._next: int | None = 0

    def next_number(self) -> int:
        """Return the number of the next event, and advance the counter."""
        number = self._next or 0
        self._next = number + 1
        return number

    def mark_unknown(self) -> None:
        """Mark the count as unknown: a log replay continues after a gap in the log, which may have contained events."""
        self._next = None

    def continue_from(self, number: int) -> None:
        """Continue from the number of a logged event if the count is unknown; else do nothing."""
        if self._next is None:
            self._next = number


@dataclass(frozen=True)
class Scene:
    """The logged system and its data, which every motion keeps current; what a contact model is constructed with."""

    system: System
    data: Any
    numbers: EventCounter = field(default_factory=EventCounter)
    """Event numbers of persistent contacts and grasps."""


class EventTime(NamedTuple):
    """Simulation time of an event in s, and the index of the integration step that contains it, from 0."""

    time_s: float
    step: int


@dataclass(frozen=True)
class LoggedEvent:
    """One event of a log.

    Attributes:
        kind: Name of the kind of its records.
        name: Name for messages, such as ``impact 1``.
        number: Its number among the events of its kind, from 0.
        records: Its records.
        state: Coordinates and rates before, (nq + nv,).
        state_after: Coordinates and rates after, (nq + nv,).
        efforts: Efforts after the event, (nu,).
    """

    kind: str
    name: str
    number: int
    records: tuple[Any, ...]
    state: FloatArray
    state_after: FloatArray
    efforts: FloatArray

    @property
    def time_s(self) -> float:
        """Time of the event."""
        return float(self.records[0].time_s)

    @property
    def step(self) -> int:
        """Index of its integration step."""
        return int(self.records[0].step)


class EventEffect(NamedTuple):
    """The effect of an event.

    Attributes:
        records: Event records for the log, the controller and the phases.
        exchange: Energy and momentum exchanged, to be entered in the balance; None if nothing was exchanged.
        motion: The motion to integrate from now on; None if it does not change.
        end: How the run ends at this event; None if it continues. The controller is evaluated once more only if the run
            completes.
        triggers_control: Whether the controller is evaluated immediately; else it receives the records at its next tick.
    """

    records: tuple[Any, ...]
    exchange: Exchange | None = None
    motion: Motion | None = None
    end: RunEnded | None = None
    triggers_control: bool = True


class ContactModel:
    """Base class of all contact models: has no events and exerts no forces. An instance serves one run.

    Times within a step are measured from its start. ``scene.data`` always holds the state of the current query: at each
    stage of a step, and during event localisation along the path.

    Attributes:
        kind: Name by which a scenario declares it.
        Config: Configuration model, with a field ``kind``. The contact model is constructed as ``cls(config, scene)``.
        records: Kinds of event records it produces. Each has the fields ``step``, ``time_s``, ``qpos``, ``qvel_before``,
            ``qvel_after`` and ``efforts_after``, as :class:`~ffsm_mj.records.events.ImpactRecord` has.
        requests: Request names in a controller command that it handles.
        columns: Columns of the log that it owns.
        watched: Pairs of geom ids that it handles; overlaps of other pairs are reported as unhandled.
        active: Whether it exerts forces: the exchange of each step is then entered in the balance.
        pushes: Whether its wrenches are evaluated in the stages of each step while it is active.
        is_reactive: Whether its forces depend on those of the other contact models: it is evaluated after them.
        event_bound: Motion bound since the last restart (``motion_bound`` of
            :class:`~ffsm_mj.dynamics.free_stepper.FreeStepper`) below which no event is possible: event detection is
            skipped until the motion bound exceeds it.
        scene: The logged system and its data.
        motion: The current motion.
    """

    kind: ClassVar[str]
    Config: ClassVar[type[StrictModel]]
    records: ClassVar[tuple[RecordKind, ...]] = ()
    requests: Sequence[str] = ()
    columns: Sequence[Columns] = ()
    watched: frozenset[frozenset[int]] = frozenset()
    active = False
    pushes: ClassVar[bool] = True
    is_reactive: ClassVar[bool] = False
    event_bound = math.inf
    motion: Motion

    def __init__(self, config: Any, scene: Scene) -> None:
        """Initialise the model at the current state of a scene.

        Args:
            config: Its configuration in the scenario.
            scene: The logged system and its data.

        Raises:
            ScenarioFaults: The scene lacks something that the configuration names; paths are relative to ``config``.
            LookupError: The same, without a path.
        """
        self.scene = scene

    def bind(self, motion: Motion) -> None:
        """Use another motion from now on; contact models earlier in the order are already bound. A restart follows."""
        self.motion = motion

    def restart(self) -> None:
        """Discard everything cached: the state or the efforts changed discontinuously. Start from the state in ``data``."""

    def due(self) -> bool:
        """Whether an event is due at the current state, before the next step."""
        return False

    def is_clear(self) -> bool:
        """Whether the last step certainly contains no event; called only when the motion bound exceeds ``event_bound``."""
        return True

    def first_event(self, duration_s: float) -> float | None:
        """Locate the first event in the first ``duration_s`` of the last step, along ``motion.path``, or None."""
        return None

    def on_event_located(self, time_s: float) -> None:
        """Called after event localisation; the state is that at ``time_s`` in the step."""

    def after_event(self, time_s: float) -> None:
        """Called after an event of any contact model: the efforts for the next step are set, and a step begins."""

    def after_substep(self, duration_s: float) -> None:
        """Called at the end of a (sub-)step, while ``motion.path`` still covers it; skipped if no model needs detection."""

    def act(self, instant: EventTime) -> EventEffect | None:
        """Apply the event due at the current state, and update derived quantities; None if there is no event after all.

        Raises:
            RunEnded: The motion that follows is not modelled.
        """
        return None

    def wrenches(self, data: Any) -> Sequence[Wrench]:
        """Wrenches that it exerts on bodies of the system; positions and velocities in ``data`` are current.

        A model that overrides :meth:`push` with generalised forces of its own, and may act on a grasped object, must return
        the equivalent wrenches here: the balance separates robot and object by body.
        """
        return ()

    def begin_step(self) -> None:
        """Called at the start of a (sub-)step while it is active."""
        self._exchange.begin(self.motion.grasped_bodies)

    def end_step(self, duration_s: float) -> Exchange | None:
        """Called at the end of a (sub-)step: energy and momentum exchanged by its wrenches."""
        return self._exchange.end(duration_s)

    def exchanged(self, duration_s: float) -> Exchange | None:
        """The same for a trial step that step-size control may reject: must not accumulate anything."""
        return self.end_step(duration_s)

    @cached_property
    def _exchange(self) -> ExchangeIntegrator:
        return ExchangeIntegrator(self.scene.system, self.scene.data, self.wrenches)

    def handle_request(self, request: str) -> None:
        """Handle a request of the controller, one of ``requests``; an event may be due immediately after."""

    def restore_state(self) -> Motion | None:
        """Restore the internal state from its columns and the state in ``data``: a log replay continues from here.

        Returns:
            The motion from now on; None for that of the system itself.
        """
        return None

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """Records to write at the end of the run; they do not change the state."""
        return ()

    def record_fault(self, records: Sequence[Any]) -> str:
        """Why logged records of one event do not fit the models, in one word; empty if they do."""
        return ""

    def prepare_replay(self, records: Sequence[Any]) -> None:
        """Prepare to reproduce these records of its own: a log replay has reached their event and calls :meth:`act` next."""

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event at its logged state, which is in ``data``; the logged state after it is set next.

        Returns:
            The effect, whose records are compared with the logged ones; None if no event is possible here.
        """
        self.prepare_replay(event.records)
        return self.act(EventTime(event.time_s, event.step))

    def after_replayed_step(self) -> None:
        """Called at the end of a replayed (sub-)step, with the logged state in ``data`` where the log has it."""

    def force_check(self, layout: Layout) -> Callable[[FloatArray], float] | None:
        """Independent check of its forces in the rows of a log.

        Args:
            layout: Layout of the rows.

        Returns:
            Function of a row whose state is in ``data``: the largest difference between logged and independently recomputed
            forces, N. None if there is no such check.
        """
        return None

    def active_contacts(self) -> tuple[ActiveContact, ...]:
        """Closed contacts and their forces under the efforts in ``data``, for control laws; called only while active."""
        return ()

    def names(self) -> str:
        """The contacts it acts on now, for messages."""
        return self.kind

    def push(self, data: Any) -> None:
        """Add its wrenches to ``data.qfrc_applied`` (``data`` of the motion), after those of the non-reactive models."""
        motion = self.motion
        for body, point, force, torque in self.wrenches(self.scene.data):
            mujoco.mj_applyFT(motion.model, data, force, torque, point, motion.bodies[body], data.qfrc_applied)


_REGISTERED: dict[str, type[ContactModel]] = {}
_BROKEN: dict[str, str] = {}


def register(contact_model: type[ContactModel]) -> type[ContactModel]:
    """Register a contact model by its kind.

    Raises:
        ValueError: Another contact model has the same kind.
    """
    if contact_model.kind in BUILT_IN_KINDS:
        raise ValueError(f"{contact_model.kind!r} is the kind of a built-in contact model")
    if _REGISTERED.setdefault(contact_model.kind, contact_model) is not contact_model:
        raise ValueError(f"another contact model has the kind {contact_model.kind!r}")
    for kind in contact_model.records:
        kinds.register(kind)
    return contact_model


def contact_models() -> dict[str, type[ContactModel]]:
    """Contact models that a scenario may declare, by kind: registered ones and those of installed packages."""
    for entry_point in entry_points(group=GROUP):
        if entry_point.name in BUILT_IN_KINDS:
            _BROKEN[entry_point.name] = f"{entry_point.value} has the name of a built-in contact model; rename it"
        elif entry_point.name not in _REGISTERED:
            try:
                register(entry_point.load())
            except Exception as error:  # noqa: BLE001 (a package may fail in any way: only its contact model is unavailable)
                _BROKEN[entry_point.name] = described(error)
    return dict(_REGISTERED)


def contact_model_of(kind: str) -> type[ContactModel]:
    """Look up a contact model by kind.

    Raises:
        LookupError: There is none; the message lists the known kinds.
    """
    known = contact_models()
    if kind in _BROKEN:
        raise LookupError(f"the contact model {kind!r} of an installed package cannot be used ({_BROKEN[kind]})")
    if not known:
        raise LookupError(f"unknown contact model {kind!r}: no installed package provides one")
    if kind not in known:
        raise LookupError(unknown_name("contact model", kind, known))
    return known[kind]
