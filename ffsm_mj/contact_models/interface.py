"""Interface of sources of events and forces, and of contact models; see ``docs/contact-models.md``.

A source of events locates them within a step, changes the state there, and reports the effect: records for the log and an
exchange for the balance. A source of forces adds wrenches to the smooth motion while it is active. One with a state of its
own, or whose forces a replay checks, is replayable. A contact model is a source of either, or both, that a scenario
declares in its ``contact_models``: registered by kind, or through the entry-point group ``ffsm_mj.contact_models``. Impacts,
persistent contact, grasps and delayed control are sources that a scenario has by other keys.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import mujoco

from ffsm_mj._core.travel import Travel
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.balance.exchange import Exchange, ExchangeIntegrator
from ffsm_mj.config import StrictModel
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import ActiveContact, Wrench
from ffsm_mj.records.events import RunEnded
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.signals import Layout
from ffsm_mj.state import Stateful
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S, INSTANT_S

if TYPE_CHECKING:
    from ffsm_mj._core.tick import SteadyForces


class EventCounter(Stateful):
    """Counter shared by the contact models of a run: it orders events that happen at the same time."""

    @dataclass
    class State:
        """Number of the next event; None: unknown."""

        next: int | None

    def __init__(self) -> None:
        """Start at 0."""
        self._next: int | None = 0

    def next_number(self) -> int:
        """Return the number of the next event, and advance the counter."""
        # It is unknown only in a log replay, where the record of an event sets it first (continue_from).
        number = self._next or 0
        self._next = number + 1
        return number

    def mark_unknown(self) -> None:
        """Mark the count as unknown: a log replay continues after a gap in the log, which may have contained events."""
        self._next = None

    def continue_from(self, number: int) -> None:
        """Continue from the number of a logged event if the count is unknown; else do nothing."""
        # A known count is that of the run: a logged number that differs shows in the comparison of records.
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
        in_step: Whether it was located in a step; others are due before one, at a tick or right after another event.
    """

    kind: str
    name: str
    number: int
    records: tuple[Any, ...]
    state: FloatArray
    state_after: FloatArray
    efforts: FloatArray
    in_step: bool = False

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
        leaves_to_impacts: Whether nothing was done because pairs touch, which the model that resolves impacts handles.
        accuracy: How well the state determines fields of the records that it determines worse than to rounding, by name.
        is_tick: Whether the controller is evaluated as at a control tick, only later.
        varied: In a log replay, the records as rounding of the state may change them, each time in another way.
    """

    records: tuple[Any, ...]
    exchange: Exchange | None = None
    motion: Motion | None = None
    end: RunEnded | None = None
    triggers_control: bool = True
    leaves_to_impacts: bool = False
    # Read-only, as all effects share the default.
    accuracy: Mapping[str, float] = MappingProxyType({})
    is_tick: bool = False
    varied: Sequence[tuple[Any, ...]] = ()


def event_fields(scene: Scene, instant: EventTime, before: FloatArray, number: int | None = None) -> dict[str, Any]:
    """Fields that records of persistent contacts, grasps and dry friction share; the state after is that in ``data``.

    Args:
        scene: The logged system and its data.
        instant: Time and step of the event.
        before: Generalised velocity before the event, (nv,).
        number: Number of the event; None: the next one.
    """
    system, data = scene.system, scene.data
    return {
        # Times of two events may agree to the last bit: only the number orders them.
        "event": scene.numbers.next_number() if number is None else number,
        "time_s": instant.time_s,
        "step": instant.step,
        "qpos": tuple(data.qpos.tolist()),
        "qvel_before": system.by_joint(before),
        "qvel_after": system.by_joint(data.qvel),
    }


def just_after(f: Callable[[float], float], start_s: float, end_s: float) -> float:
    """First time between two times at which a function becomes negative, rounded up until it is negative there.

    A log replay evaluates the same state with slightly different rounding: it must reach the same decision.

    Args:
        f: The function; positive at the first time and negative at the second.
        start_s: First time, s.
        end_s: Second time, s.
    """
    from scipy.optimize import brentq  # takes a second to import: only runs with such events pay

    root, late = float(brentq(f, start_s, end_s, xtol=EVENT_TIME_S, rtol=EVENT_TIME)), EVENT_TIME_S
    while True:
        # Doubled: near a flat root the rounding of f lasts for many times EVENT_TIME_S.
        root, late = min(root + late, end_s), 2.0 * late
        # At the end the function is known to be negative: nothing later is tried.
        if root >= end_s or f(root) < 0.0:
            return root


def first_root(f: Callable[[float], float], end_s: float) -> float:
    """The first of several such times from the start of a step on; see :func:`just_after`.

    Bracketing finds any one root, and a function that has fallen below zero may have risen again before it: where it is
    negative at a quarter of the way to the root, an earlier one precedes. Between these places a function that a step of
    order four resolves does not change its sign twice.

    Args:
        f: The function; positive at the start.
        end_s: A time at which it is negative, s.
    """
    root = just_after(f, 0.0, end_s)
    # Below this, an earlier root is at the same instant.
    while root > INSTANT_S:
        earlier = next((part * root for part in (0.25, 0.5, 0.75) if f(part * root) < 0.0), None)
        if earlier is None:
            break
        root = just_after(f, 0.0, earlier)
    return root


class Source:
    """Base class of all sources of events and forces. An instance serves one run.

    Times within a step are measured from its start. ``scene.data`` always holds the state of the current query: at each
    stage of a step, and during event localisation along the path. One that remembers something between two steps has
    ``get_state()`` and ``set_state(state)``, most simply as a :class:`~ffsm_mj.state.Stateful`.

    Attributes:
        kind: Name for messages and states; that by which a scenario declares a contact model.
        columns: Columns of the log that it owns.
        watched: Pairs of geom ids that it handles; overlaps of other pairs are reported as unhandled.
        scene: The logged system and its data.
        motion: The current motion.
    """

    kind: ClassVar[str] = "source"
    columns: Sequence[Columns] = ()
    watched: frozenset[frozenset[int]] = frozenset()
    motion: Motion

    def __init__(self, scene: Scene) -> None:
        """Initialise it at the current state of a scene."""
        self.scene = scene

    def bind(self, motion: Motion) -> None:
        """Use another motion from now on; sources earlier in the order are already bound. A restart follows."""
        self.motion = motion

    def restart(self) -> None:
        """Discard everything cached: the state or the efforts changed discontinuously. Start from the state in ``data``."""

    def names(self) -> str:
        """What it acts on now, for messages."""
        return self.kind

    def current_motion(self) -> Motion | None:
        """The motion that its own state gives, also after it was restored; None: it does not decide on the motion."""
        return None

    def forget(self) -> None:
        """Be as before the first step: nothing is closed or armed. A state, or a row of a log, follows."""


class ContactModel(Source):
    """A source that a scenario declares, with a configuration: a plug-in derives from it and from what it is a source of.

    Attributes:
        Config: Configuration model, with a field ``kind``. The contact model is constructed as ``cls(config, scene)``.
    """

    Config: ClassVar[type[StrictModel]]

    def __init__(self, config: Any, scene: Scene) -> None:
        """Initialise the model at the current state of a scene.

        Args:
            config: Its configuration in the scenario.
            scene: The logged system and its data.

        Raises:
            ScenarioFaults: The scene lacks something that the configuration names; paths are relative to ``config``.
            LookupError: The same, without a path.
        """
        super().__init__(scene)


class EventSource(Source):
    """A source of events, which change the state or are logged.

    Attributes:
        records: Kinds of event records it produces. Each has the fields ``step``, ``time_s``, ``qpos``, ``qvel_before``,
            ``qvel_after`` and ``efforts_after``, as :class:`~ffsm_mj.records.events.ImpactRecord` has.
        requests: Request names in a controller command that it handles.
        resolves_impacts: Whether it handles the events that other models leave to impacts.
        event_bound: Motion bound since the last restart (``motion_bound`` of
            :class:`~ffsm_mj._core.steppers.FreeStepper`) below which no event is possible: event detection is
            skipped until the motion bound exceeds it.
        travels: Motions of the coordinates; while all are within their reach, ``bound_within`` counts in place of
            ``event_bound``.
    """

    records: ClassVar[tuple[RecordKind, ...]] = ()
    requests: Sequence[str] = ()
    resolves_impacts: ClassVar[bool] = False
    # A source that detects nothing is never asked, however far the bodies move.
    event_bound = math.inf
    travels: tuple[Travel, ...] = ()
    bound_within = math.inf

    def excludes_events(self, motion_bound: float) -> bool:
        """Whether no event is possible up to a motion bound that is not below ``event_bound``."""
        # While no coordinate has come as far as the clearances reach, only what travels do not cover, as joint limits, is
        # bounded by the energy.
        return bool(self.travels) and motion_bound < self.bound_within and all(travel.is_within for travel in self.travels)

    def due(self) -> bool:
        """Whether an event is due at the current state, before the next step; asked as :meth:`is_clear` is."""
        return False

    def is_clear(self) -> bool:
        """Whether the last step certainly contains no event; called only when the motion bound exceeds ``event_bound``."""
        return True

    def first_event(self, duration_s: float) -> float | None:
        """Locate the first event in the first ``duration_s`` of the last step, along ``motion.path``, or None."""
        return None

    def on_event_located(self, time_s: float) -> None:
        """Called after event localisation; the state is that at ``time_s`` in the step."""

    def act(self, instant: EventTime) -> EventEffect | None:
        """Apply the event due at the current state, and update derived quantities; None if there is no event after all.

        Raises:
            RunEnded: The motion that follows is not modelled.
        """
        return None

    def on_records(self, records: Sequence[Any]) -> None:
        """Called after an event of any contact model, with its records; a restart follows."""

    def after_event(self, time_s: float) -> None:
        """Called after an event of any contact model: the efforts for the next step are set, and a step begins."""

    def after_substep(self, duration_s: float) -> None:
        """Called at the end of a (sub-)step, while ``motion.path`` still covers it; skipped if no model needs detection."""

    def handle_request(self, request: str) -> None:
        """Handle a request of the controller, one of ``requests``; an event may be due immediately after."""

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """Records to write at the end of the run; they do not change the state."""
        return ()

    def record_fault(self, records: Sequence[Any]) -> str:
        """Why logged records of one event do not fit the models, in one word; empty if they do."""
        return ""

    def replay(self, event: LoggedEvent) -> EventEffect | None:
        """Reproduce a logged event at its logged state, which is in ``data``; the logged state after it is set next.

        One that does not find the event by the state alone overrides this: it takes from the records what is due.

        Returns:
            The effect, whose records are compared with the logged ones; None if no event is possible here.
        """
        # The same code as in a run: what a replay compares is the event itself, not a second account of it.
        return self.act(EventTime(event.time_s, event.step))


class ForceOrder(IntEnum):
    """What forces depend on; sources are evaluated in this order in each stage.

    Attributes:
        EXTERNAL: The state of the motion alone. They act from outside the system as a field does: always, smoothly, without
            an exchange between the subsystems. The balance enters them by itself.
        INDEPENDENT: The state of the logged system alone.
        REACTIVE: Also all forces before them, as those of contacts do.
        BILATERAL: All other forces, and the state of the motion alone: they keep bilateral constraints.
    """

    EXTERNAL = 0
    INDEPENDENT = 1
    REACTIVE = 2
    BILATERAL = 3


class ForceSource(Source):
    """A source of forces, which it exerts while it is active.

    Attributes:
        active: Whether it exerts forces: the exchange of each step is then entered in the balance.
        order: What its forces depend on.
    """

    active = False
    order: ClassVar[ForceOrder] = ForceOrder.INDEPENDENT

    def wrenches(self, data: Any) -> Sequence[Wrench]:
        """Wrenches that it exerts on bodies of the system; positions and velocities in ``data`` are current.

        A model that overrides :meth:`add_forces` with generalised forces of its own, and may act on a grasped object, must
        return the equivalent wrenches here: the balance separates robot and object by body.
        """
        return ()

    def add_forces(self, applied: FloatArray) -> None:
        """Add its generalised forces at the state and efforts in ``data`` of the scene, (nv,) of the motion."""
        motion = self.motion
        # Wrenches are on bodies of the logged system; the motion may join some of them, or have other coordinates.
        for body, point, force, torque, _ in self.wrenches(self.scene.data):
            mujoco.mj_applyFT(motion.model, motion.data, force, torque, point, motion.bodies[body], applied)

    def push(self, data: Any) -> None:
        """Add its forces in a stage to ``data.qfrc_applied``, which has those before them; ``data`` is the motion's."""
        self.add_forces(data.qfrc_applied)

    def begin_step(self, left_s: float, *, continues: bool = False) -> float:
        """Begin a (sub-)step while it is active; returns the longest one that its forces allow from this state, s.

        Args:
            left_s: Remaining time of the grid step, s. The result may depend on it, but on no shorter step: a log replay
                makes the same sub-steps.
            continues: Whether a step goes on in shorter ones, with what was chosen at its start.
        """
        self._exchange.begin(self.motion.grasped_bodies)
        return left_s

    def begin_steady_steps(self) -> SteadyForces | None:
        """Begin (sub-)steps that the core makes while nothing changes, without :meth:`begin_step`; None: it cannot."""
        return None

    def snapshot(self) -> Callable[[], None]:
        """Return a function that restores what :meth:`begin_step` changes: several steps are tried from one state."""
        return _nothing

    def end_step(self, duration_s: float, *, trial: bool = False) -> Exchange | None:
        """End a (sub-)step: energy and momentum exchanged by its wrenches.

        Args:
            duration_s: Duration of the step.
            trial: Whether the step may be rejected: nothing must be accumulated.
        """
        return self._exchange.end(duration_s)

    @cached_property
    def _exchange(self) -> ExchangeIntegrator:
        # Only where it is used: contacts, for one, integrate their exchange from the stages of a step.
        return ExchangeIntegrator(self.scene.system, self.scene.data, self.wrenches)

    def active_contacts(self) -> tuple[ActiveContact, ...]:
        """Closed contacts and their forces under the efforts in ``data``, for control laws; called only while active."""
        return ()


def _nothing() -> None:
    """Do nothing."""


class LoggedForces(Protocol):
    """Independent check of the forces of a contact model in the rows of a log.

    Attributes:
        places: Places of these forces in a row: where all of them are zero, and nothing touches, they are right.
    """

    places: IntArray

    def residual(self, row: FloatArray) -> float:
        """Largest difference between logged and independently recomputed forces of a row whose state is in ``data``, N."""
        ...


class Replayable(Source):
    """A source with a state of its own that a log replay restores, or with forces that it checks."""

    def restore_state(self, events: Sequence[LoggedEvent] = ()) -> None:
        """Restore the internal state from its columns and the state in ``data``: a run or a log replay starts here.

        Args:
            events: Logged events before this state, in order; none at the start of a run.
        """

    def after_replayed_step(self) -> None:
        """Called at the end of a replayed (sub-)step, with the logged state in ``data`` where the log has it."""

    def catch_up(self) -> str:
        """Do what a run does without a record at the logged state in ``data``, from which a log replay goes on.

        Returns:
            Name of the records of an event that is due there, which a run would have logged; empty if none is.
        """
        return ""

    def varied_forces(self) -> Iterator[None]:
        """Vary its forces, one after the other, as far as rounding of the state in ``data`` may change them.

        Until the next step of the iteration, what it says of its forces at this state is with the present variation; after
        the end it is as before. Nothing, unless rounding of the state changes forces by more than rounding.
        """
        return iter(())

    def force_check(self, layout: Layout) -> LoggedForces | None:
        """Independent check of its forces in the rows of a log of some layout; None if there is none."""
        return None
