"""What can happen at a contact: contact models, behind one interface; see ``docs/contact-models.md``.

A contact model watches steps and says when it acts, takes part in the smooth motion while it is active, changes the state
at its
events, and says what that did: records, and wrenches for the balances. The impact is one; others are registered by their
kind, or by the entry-point group ``ffsm_mj.contact_models``, and declared in a scenario's ``contact_models``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import entry_points
from typing import Any, ClassVar, NamedTuple

import mujoco

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
from ffsm_mj.records.wrench import Wrench

GROUP = "ffsm_mj.contact_models"


class EventCounter:
    """Numbers of the events of a run that share one count: at one instant nothing else tells which came first."""

    def __init__(self) -> None:
        """From 0."""
        self._next: int | None = 0

    def take(self) -> int:
        """The number of an event that happens now."""
        number = self._next or 0
        self._next = number + 1
        return number

    def forget(self) -> None:
        """``analyze`` goes on behind a hole in a log: how many events there were in it is not known."""
        self._next = None

    def believe(self, number: int) -> None:
        """``analyze`` is where a log has an event of this number: where the count is not known it goes on from there."""
        if self._next is None:
            self._next = number


@dataclass(frozen=True)
class Scene:
    """What a contact model is built for: the system that is logged, and its data, which every motion keeps current."""

    system: System
    data: Any
    numbers: EventCounter = field(default_factory=EventCounter)
    """Of what happens to contacts that last and to grasps."""


class EventTime(NamedTuple):
    """When a contact model acts: simulation time in s, and the integration step that it falls in, from 0."""

    time_s: float
    step: int


class EventEffect(NamedTuple):
    """What an event did.

    Attributes:
        records: For the log, the controller and the phases.
        booking: For the balance; None where nothing was exchanged.
        motion: What moves from here on; None: as before.
        end: The run ends here, and how; the controller is asked once more only where it is completed.
        asks: The controller is asked at once; else it hears of the records when it is asked next.
    """

    records: tuple[Any, ...]
    exchange: Exchange | None = None
    motion: Motion | None = None
    end: RunEnded | None = None
    triggers_control: bool = True


class ContactModel:
    """Base of all contact_models: watches nothing, does nothing. An instance serves one run.

    Times in a step count from its start. ``scene.data`` is always at the state that is asked about: at the stages of a step,
    and while a search moves along the path.

    Attributes:
        kind: Name by which a scenario declares it.
        Config: What a scenario may say of it; has a field ``kind``. The contact model is made as ``cls(config, scene)``.
        records: Kinds of record that it leaves. Each has the fields ``step``, ``time_s``, ``qpos``, ``qvel_before``,
            ``qvel_after`` and ``efforts_after``, as :class:`~ffsm_mj.records.events.ImpactRecord` has.
        requests: Names in a command that it hears.
        columns: Columns of the log that it owns.
        watched: Pairs of geom ids that it takes care of; others are reported when they overlap.
        active: It acts on the motion: its steps are booked.
        pushes: While it is active, its wrenches take part in the stages of each step.
        answers: Its push depends on the forces of the others: it is asked after them.
        horizon: Way (:class:`~ffsm_mj.dynamics.free_stepper.FreeStepper`) since the last restart before which nothing can
            happen.
        scene: What it was built for.
        motion: What moves now.
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
    horizon = math.inf
    motion: Motion

    def __init__(self, config: Any, scene: Scene) -> None:
        """Watch a scene from its state on.

        Args:
            config: What the scenario says of it.
            scene: What it is built for.

        Raises:
            ScenarioFaults: The scene has not what the scenario names; paths are those of ``config``.
            LookupError: The same, without a path.
        """
        self.scene = scene

    def bind(self, motion: Motion) -> None:
        """This moves from here on; the others that come before it know that already. A restart follows."""
        self.motion = motion

    def restart(self) -> None:
        """Something changed at one instant: look anew from the state in ``data``."""

    def due(self) -> bool:
        """Whether it acts right now, before the next step."""
        return False

    def is_clear(self) -> bool:
        """Whether nothing can have happened in the last step; asked once the way is beyond the horizon."""
        return True

    def first_event(self, duration_s: float) -> float | None:
        """When it first acts within so much of the last step, found along ``motion.path``; None where it does not."""
        return None

    def on_event_located(self, time_s: float) -> None:
        """The search is over, and the state is that of this time in the step."""

    def after_event(self, time_s: float) -> None:
        """An event was told of at this time, anybody's; what acts from here on is decided, and a step begins."""

    def after_substep(self, duration_s: float) -> None:
        """A (sub-)step is over, ``data`` at its end; ``motion.path`` leads back into it. Not where none looks."""

    def act(self, instant: EventTime) -> EventEffect | None:
        """Change the state at an event, derived quantities current after; None where nothing happened after all.

        Raises:
            RunEnded: What comes now is not modelled.
        """
        return None

    def wrenches(self, data: Any) -> Sequence[Wrench]:
        """What it puts on which bodies of the system while it pushes; positions and velocities in ``data`` are current.

        One that pushes in generalised forces of its own, and may touch what is held, says here what they are on bodies.
        """
        return ()

    def begin_step(self) -> None:
        """A (sub-)step begins, while it is active."""
        self._exchange.begin(self.motion.carried_bodies)

    def end_step(self, duration_s: float) -> Exchange | None:
        """It has ended: what its wrenches did."""
        return self._exchange.end(duration_s)

    def exchanged(self, duration_s: float) -> Exchange | None:
        """The same for a step that may yet be taken back, and a shorter one made: nothing is kept of it."""
        return self.end_step(duration_s)

    @cached_property
    def _exchange(self) -> ExchangeIntegrator:
        return ExchangeIntegrator(self.scene.system, self.scene.data, self.wrenches)

    def handle_request(self, request: str) -> None:
        """A controller asked for something that it knows of; it may be due at once."""

    def restore_state(self) -> Motion | None:
        """Be as its columns say, at the state in ``data``: ``analyze`` flies on from here.

        Returns:
            What moves from here on; None: the system itself.
        """
        return None

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """The run is over: records that are still to be left; they change nothing."""
        return ()

    def prepare_replay(self, records: Sequence[Any]) -> None:
        """``analyze`` is where a log has these records of its: be about to leave them."""

    def active_contacts(self) -> tuple[ActiveContact, ...]:
        """What it holds closed, with the forces under the efforts in ``data``: control laws see them; asked while active."""
        return ()

    def names(self) -> str:
        """The contacts that it acts on now, for a person."""
        return self.kind

    def push(self, data: Any) -> None:
        """Add its wrenches to ``data.qfrc_applied``, ``data`` being that of what moves; all others have been added."""
        motion = self.motion
        for body, point, force, torque in self.wrenches(self.scene.data):
            mujoco.mj_applyFT(motion.model, data, force, torque, point, motion.bodies[body], data.qfrc_applied)


_REGISTERED: dict[str, type[ContactModel]] = {}
_BROKEN: dict[str, str] = {}


def register(contact_model: type[ContactModel]) -> type[ContactModel]:
    """Make a contact model known by its kind.

    Raises:
        ValueError: Another one has that kind.
    """
    if _REGISTERED.setdefault(contact_model.kind, contact_model) is not contact_model:
        raise ValueError(f"another contact model has the kind {contact_model.kind!r}")
    for kind in contact_model.records:
        kinds.register(kind)
    return contact_model


def contact_models() -> dict[str, type[ContactModel]]:
    """Contact models that a scenario may declare, by kind: those registered, and those of installed packages."""
    for entry_point in entry_points(group=GROUP):
        if entry_point.name not in _REGISTERED:
            try:
                register(entry_point.load())
            except Exception as error:  # noqa: BLE001 (a package may fail in any way: its contact model alone is not there)
                _BROKEN[entry_point.name] = described(error)
    return dict(_REGISTERED)


def contact_model_of(kind: str) -> type[ContactModel]:
    """Contact model of a kind.

    Raises:
        LookupError: There is none; the message lists those that are known.
    """
    known = contact_models()
    if kind in _BROKEN:
        raise LookupError(f"the contact model {kind!r} of an installed package cannot be used ({_BROKEN[kind]})")
    if not known:
        raise LookupError(f"unknown contact model {kind!r}: no package is installed that brings one")
    if kind not in known:
        raise LookupError(unknown_name("contact model", kind, known))
    return known[kind]
