"""Grasp contact model: an armed grasp closes by a plastic impulse and attaches its object to the robot until release.

Requests come from phases and control laws: ``<grasp>.arm``, ``<grasp>.disarm``, ``<grasp>.release``. They are executed at
the start of the next step, a release first. While a grasp is closed, another model is integrated, in which the object is
part of a link, or joined to it by the joints of the latch: the attachment is exact and has no compliance, unlike MuJoCo's
soft ``weld`` constraint. A grasp of the same two sites may take over from the closed one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closing import close_grasp, state_fields
from ffsm_mj.contact_models.grasp.columns import SIGNALS
from ffsm_mj.contact_models.grasp.config import CaptureConfig
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.load import LoadBuffer
from ffsm_mj.contact_models.grasp.near_miss import near_miss
from ffsm_mj.contact_models.grasp.nearness import Nearness
from ffsm_mj.contact_models.grasp.opening import open_grasp
from ffsm_mj.contact_models.grasp.record import ArmingRecord, CaptureRecord, ReleaseRecord
from ffsm_mj.contact_models.grasp.record_kinds import KINDS
from ffsm_mj.contact_models.interface import EventEffect, EventSource, EventTime, ForceSource, LoggedEvent, Replayable, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import ImpactRecord, Outcome, RunEnded

ARM, DISARM, RELEASE = "arm", "disarm", "release"
"""Requests of a grasp, after its name and a dot."""


class GraspModel(EventSource, Replayable):
    """All grasps of a run; at most one is closed. See :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "capture"
    records = KINDS

    def __init__(
        self,
        scene: Scene,
        free: Motion,
        grasps: Sequence[tuple[Grasp, CaptureConfig, System]],
        others: Sequence[ForceSource] = (),
    ) -> None:
        """Initialise with all grasps disarmed and open.

        Args:
            scene: The logged system and its data.
            free: Its motion.
            grasps: Each grasp with its configuration, and the system in which it is closed, with a model owned by the run.
            others: Contact models that may exert forces on a grasped object.
        """
        super().__init__(None, scene)
        self._free = free
        self._latches = {each[0].name: Latch(i, scene, free, *each, others) for i, each in enumerate(grasps, start=1)}
        self._step_s = float(scene.system.mj.opt.timestep)
        self._closed_latch: Latch | None = None
        self._closing: Latch | None = None
        self._opening: Latch | None = None
        self._requests: set[str] = set()
        self.requests = tuple(f"{name}.{what}" for name in self._latches for what in (ARM, DISARM, RELEASE))
        self._loads, self._logged_grasp = LoadBuffer(), 0.0
        self.columns = (
            Columns(SIGNALS, table=self._loads.table, on_sample=self._write_values, resume=self._restore_values),
        )

    @property
    def disarmed(self) -> dict[str, frozenset[frozenset[int]]]:
        """Pairs of geoms that are on one rigid body while a grasp is closed, by grasp name."""
        return {name: latch.held.disabled for name, latch in self._latches.items()}

    def data_of(self, grasp: str) -> Any:
        """MuJoCo data of the motion while a grasp is closed."""
        return self._latches[grasp].held.data

    def names(self) -> str:
        """The grasps that are armed or closed."""
        return (
            ", ".join(name for name, latch in self._latches.items() if latch.armed or latch is self._closed_latch)
            or self.kind
        )

    def handle_request(self, request: str) -> None:
        """Store a request of a phase or control law; it is executed at the start of the next step."""
        self._requests.add(request)
        self._update_watched()

    def on_records(self, records: Sequence[Any]) -> None:
        """An impact of one of its pairs closes an armed grasp."""
        hit = {name for record in records if isinstance(record, ImpactRecord) for name in (record.pair, record.rule)}
        if hit and self._closing is None:
            self._closing = next((latch for latch in self._latches.values() if latch.armed and latch.contacts & hit), None)

    def restart(self) -> None:
        """Discard the tracked path."""
        for latch in self._latches.values():
            latch.clear_path()
        self._update_watched()

    def _update_watched(self) -> None:
        self._watching = [latch for latch in self._latches.values() if latch.watches]
        self._limited = (
            self._closed_latch if self._closed_latch is not None and self._closed_latch.limit is not None else None
        )
        watches = self._requests or self._closing or self._opening or self._watching or self._limited
        self.event_bound = -math.inf if watches else math.inf

    def due(self) -> bool:
        """Whether a request is pending, an impact closes a grasp, or the bounds of an armed grasp are satisfied."""
        if self._requests or self._closing is not None:
            return True
        self._opening = self._overloaded()
        within = [latch for latch in self._watching if latch.is_within()]
        self._closing = within[0] if within else None
        return bool(within) or self._opening is not None

    def _overloaded(self) -> Latch | None:
        """The closed grasp if its load limit is reached at the state in ``data``, at the start of a step."""
        latch = self._limited
        return latch if latch is not None and latch.limit is not None and latch.limit.is_reached() else None

    def is_clear(self) -> bool:
        """Whether the bounds of every armed grasp were certainly violated throughout the last step, and no limit reached."""
        clear = [latch.was_clear(self._step_s) for latch in self._watching]  # every latch must record the end of the step
        if self._limited is not None and self._limited.limit is not None:
            clear.append(self._limited.limit.was_clear())
        return all(clear)

    def first_event(self, duration_s: float) -> float | None:
        """First time at which the bounds of an armed grasp are satisfied, or the load limit of the closed one is reached."""
        path = self.motion.path
        found = [(at, latch) for latch in self._watching if (at := latch.first(path, duration_s)) is not None]
        at_s, self._closing = min(found, key=lambda each: each[0]) if found else (None, None)
        self._opening = self._limited
        if self._limited is not None and self._limited.limit is not None:
            opens_s = self._limited.limit.first(path, duration_s if at_s is None else at_s)
            at_s = at_s if opens_s is None else opens_s
        return at_s

    def after_substep(self, duration_s: float) -> None:
        """Update the closest approach of each armed grasp, for the near-miss record."""
        for latch in self._watching:
            latch.after_substep(self.motion.path, duration_s)

    def on_event_located(self, _: float) -> None:
        """Keep what closes or opens only if its condition holds here: an event of another model may have come first."""
        self._opening = self._overloaded() if self._opening is not None else None
        self._closing = next((latch for latch in self._watching if latch is self._closing and latch.is_within()), None)

    def act(self, instant: EventTime) -> EventEffect | None:
        """Execute the pending requests, open a grasp at its load limit, or close one.

        Raises:
            RunEnded: A grasp is armed, or would close, while one of other sites is closed.
        """
        if not self._requests and self._opening is not None:
            return self._break(self._opening, instant)
        if not self._requests:
            latch, self._closing = self._closing, None
            return self._close(latch, instant) if latch is not None else None
        asked, closed_latch, self._requests, self._opening = self._requests, self._closed_latch, set(), None
        records: list[Any] = []
        if closed_latch is not None and f"{closed_latch.grasp.name}.{RELEASE}" in asked:
            records.append(self._release(closed_latch, instant))
        released = bool(records)
        for name, latch in self._latches.items():
            if f"{name}.{DISARM}" in asked and latch.armed:
                records += self._disarm(latch, instant)
            if f"{name}.{ARM}" in asked:
                self._refuse_second(latch, "is armed", instant.time_s)
                records += self._arm(latch, instant)
        return (
            EventEffect(tuple(records), motion=self._free if released else None, triggers_control=released)
            if records
            else None
        )

    def _arm(self, latch: Latch, instant: EventTime) -> list[Any]:
        """Arm the latch; no effect if it is already armed."""
        if latch.armed:
            return []
        latch.arm(instant.time_s)
        who = self.scene.numbers.next_number(), latch.grasp.name
        return [ArmingRecord(*who, instant.time_s, instant.step, **state_fields(self.scene, self.scene.data.qvel))]

    def finish(self, instant: EventTime) -> Sequence[Any]:
        """Disarm all grasps at the end of the run; those still armed produce near-miss records."""
        return [record for latch in self._latches.values() if latch.armed for record in self._disarm(latch, instant)]

    def _refuse_second(self, latch: Latch, does: str, time_s: float) -> None:
        """End the run if a grasp is closed from which this one cannot take over."""
        closed = self._closed_latch
        if closed is None or (closed is not latch and closed.grasp.joins_sites_of(latch.grasp)):
            return
        message = f"grasp {latch.grasp.name!r} {does} at t = {time_s:.6g} s while {closed.grasp.name!r} holds"
        reason = "only one grasp of other sites can be closed at a time; release it first"
        raise RunEnded(Outcome.CONTROLLER_FAILED, f"{message} {closed.grasp.tree!r}: {reason}")

    def _close(self, latch: Latch, instant: EventTime) -> EventEffect:
        self._refuse_second(latch, "would close", instant.time_s)
        replaced = self._closed_latch.grasp.name if self._closed_latch is not None else ""
        record, exchange = close_grasp(self.scene, latch, instant, replaced)
        self._closed_latch = latch
        latch.disarm()
        return EventEffect((record,), exchange, latch.held)

    def _break(self, latch: Latch, instant: EventTime) -> EventEffect:
        """Open a grasp at its load limit."""
        self._opening = self._closing = None
        load = latch.limit.load() if latch.limit is not None else (0.0, 0.0)
        record = self._release(latch, instant, "load_limit", *load)
        return EventEffect((record,), motion=self._free)

    def _release(
        self, latch: Latch, instant: EventTime, reason: str = "request", force_N: float = 0.0, torque_N_m: float = 0.0
    ) -> ReleaseRecord:
        """Release the object; its velocity is continuous, as no impulse acts."""
        self._closed_latch = None
        return open_grasp(self.scene, latch, instant, reason, force_N, torque_N_m)

    def _disarm(self, latch: Latch, instant: EventTime) -> list[Any]:
        """Disarm the latch; record a near miss if it was armed with bounds and never closed."""
        latch.disarm()
        if self._closing is latch:
            self._closing = None
        return [] if latch.least is None else [near_miss(self.scene, latch, *latch.least, instant)]

    def after_event(self, time_s: float) -> None:
        """Record the load on a grasped object after an event, since it may change discontinuously."""
        if self._closed_latch is not None:
            self._loads.after_event(self._closed_latch.load, time_s)

    def _write_values(self, _: float) -> None:
        """Record the closed grasp and its load under the efforts of the next step."""
        self._loads.append(self._closed_latch.load if self._closed_latch is not None else None)

    def _restore_values(self, values: FloatArray) -> None:
        self._logged_grasp = float(values[0])
        force, torque, at_s = values[-3:].tolist()
        self._loads.between = force, torque, at_s if force > 0.0 else math.nan

    def restore_state(self, events: Sequence[LoggedEvent] = ()) -> Motion | None:  # noqa: ARG002
        """Restore the closed grasp from the columns, at the state in ``data``; armed grasps are not logged in columns."""
        for latch in self._latches.values():
            latch.disarm()
        logged, latches = self._logged_grasp, [*self._latches.values()]
        self._closed_latch = latches[int(logged) - 1] if 1.0 <= logged <= len(latches) else None
        if self._closed_latch is None:
            return None
        self._closed_latch.held.hold()
        return self._closed_latch.held

    def prepare_replay(self, records: Sequence[Any]) -> None:
        """Prepare to reproduce logged records with the next :meth:`act`.

        Raises:
            ValueError: A record names an unknown grasp.
        """
        self.scene.numbers.continue_from(records[0].event)
        for record in records:
            if record.grasp not in self._latches:
                raise ValueError(f"no grasp {record.grasp!r}")
            latch = self._latches[record.grasp]
            if isinstance(record, CaptureRecord):
                self._closing = latch
            elif isinstance(record, ReleaseRecord) and record.reason != "request":
                self._opening = latch
            elif isinstance(record, ReleaseRecord):
                self._requests.add(f"{record.grasp}.{RELEASE}")
            elif isinstance(record, ArmingRecord):
                self._requests.add(f"{record.grasp}.{ARM}")
            else:
                # The part of the log in which it was armed may be lost: the closest approach is then taken from the record.
                if not latch.armed or latch.least is None:
                    near = Nearness(record.position_m, record.angle_rad, record.speed_m_s, record.rate_rad_s)
                    latch.armed, latch.least = True, (near, record.least_s)
                self._requests.add(f"{record.grasp}.{DISARM}")
