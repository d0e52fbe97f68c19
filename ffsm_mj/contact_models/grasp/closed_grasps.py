"""The closed grasps of a run: the motion that they give, and how it changes as one of them closes or opens.

The first closed grasp of the robot on the base of an object attaches it as a child body of the link: the motion is that of
another model. Further ones, and those of a moving link of an object, are held by rows in that model. When the first one
opens, the next one of the robot on a base attaches its object in turn: if only that is left, the model has no loop any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ffsm_mj.contact_models.event import EventTime, Scene
from ffsm_mj.contact_models.grasp.closing import GraspClosing
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.loop_latch import ClosingPose, closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.grasp.opening import open_grasp
from ffsm_mj.contact_models.grasp.record import GraspRecord, ReleaseRecord
from ffsm_mj.contact_models.interface import EventEffect
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.state import StateError, entries


class ClosedGrasps:
    """Closed grasps in the order in which they closed.

    Attributes:
        latches: The closed grasps.
        motion: The motion with them.
    """

    def __init__(self, scene: Scene, free: Motion, loops: LoopForces) -> None:
        """Start with all grasps open.

        Args:
            scene: The logged system and its data.
            free: Its motion.
            loops: Rows of further grasps.
        """
        self._scene, self._free, self._loops = scene, free, loops
        self.latches: list[Latch] = []
        self.motion: Motion = free
        self._attached: Latch | None = None
        self._rows: dict[str, LatchedBodies] = {}

    @dataclass
    class State:
        """Names of the closed grasps in order, of the attached one, poses of those held by rows, and the motion's state."""

        closed: list[str]
        attached: str | None
        rows: dict[str, Any]
        motion: Any

    def get_state(self) -> State:
        """Which grasps are closed, and how they hold."""
        attached = self._attached
        return self.State(
            [each.grasp.name for each in self.latches],
            attached.grasp.name if attached is not None else None,
            {name: vars(latch) for name, latch in self._rows.items()},
            attached.held.get_state() if attached is not None and attached.held is not None else None,
        )

    def set_state(self, state: Any, latches: Mapping[str, Latch]) -> None:
        """Close these grasps, at the state in ``data``.

        Args:
            state: The state.
            latches: All grasps of the run by name.

        Raises:
            StateError: It names others.
        """
        told = entries(state, ("closed", "attached", "rows", "motion"), "ClosedGrasps")
        if unknown := {*told["closed"], *told["rows"], told["attached"]} - {*latches, None}:
            raise StateError(f"a state with grasps that there are not: {', '.join(sorted(unknown))}")
        attached = latches[told["attached"]] if told["attached"] is not None else None
        self._rows = {name: LatchedBodies(**pose) for name, pose in told["rows"].items()}
        self._set([latches[name] for name in told["closed"]], attached)
        if attached is not None and attached.held is not None:
            attached.held.set_state(told["motion"])

    def place(self, latch: Latch) -> int:
        """Place of a grasp in the order in which the closed ones closed, from 1; 0 if it is open."""
        return self.latches.index(latch) + 1 if latch in self.latches else 0

    def close(self, latch: Latch, instant: EventTime) -> EventEffect:
        """Close a grasp at the state in ``data``; one of the same two sites that is closed opens.

        Raises:
            RunEnded: A load limit cannot be applied, as the load that it limits is not unique.
        """
        gone = next((each for each in self.latches if each.grasp.joins_sites_of(latch.grasp)), None)
        latches = [latch if each is gone else each for each in self.latches]
        latches += [] if gone is not None else [latch]
        replaces = gone.grasp.name if gone is not None else ""
        closing = GraspClosing(self._scene, latch, instant, latches.index(latch) + 1, replaces)
        if gone is not None:
            self._rows.pop(replaces, None)
        attaches = latch.held is not None and self._attached in (gone, None)
        if latch.held is not None and attaches and not self._rows and not self._loops.equalities:
            record, exchange = closing.first(latch.held)
            self._set(latches, latch)
        else:
            # An object that is attached from now on was free but for the rows of the other grasps, and of the models.
            self._loops.set_closed(self._rows)
            self._loops.bind(self._free if attaches else self.motion)
            record, exchange = closing.further(self._loops)
            if not attaches:
                self._rows[latch.grasp.name] = self._latch(latch, record)
            elif latch.held is not None:
                latch.held.hold()
            self._set(latches, latch if attaches else self._attached)
        self._refuse_limits(instant)
        return EventEffect((record,), exchange, self.motion)

    def open(
        self, latch: Latch, instant: EventTime, reason: str = "request", force_N: float = 0.0, torque_N_m: float = 0.0
    ) -> ReleaseRecord:
        """Open a grasp at the state in ``data``; velocities are continuous, as no impulse acts.

        Args:
            latch: The grasp; it is closed.
            instant: Time and step of the event.
            reason: ``request`` or ``load_limit``.
            force_N: Force on the object right before, N; 0 for a request.
            torque_N_m: Torque on the object about its site right before, N m; 0 for a request.

        Raises:
            RunEnded: A load limit cannot be applied, as the load that it limits is not unique.
        """
        record = open_grasp(self._scene, latch, instant, reason, force_N, torque_N_m)
        self._rows.pop(latch.grasp.name, None)
        latches, attached = [each for each in self.latches if each is not latch], self._attached
        if attached is latch:
            attached = next((each for each in latches if each.held is not None), None)
            if attached is not None and attached.held is not None:
                self._rows.pop(attached.grasp.name)
                attached.held.hold()
        self._set(latches, attached)
        self._refuse_limits(instant)
        return record

    def restore(self, latches: Sequence[Latch], records: Sequence[GraspRecord]) -> None:
        """Set the closed grasps, at the state in ``data``.

        Args:
            latches: The closed grasps in the order in which they closed.
            records: Earlier closings in order. A further grasp without one is held in its present pose.
        """
        attached = next((each for each in latches if each.held is not None), None)
        last = {record.grasp: record for record in records}
        rows = [each for each in latches if each is not attached]
        self._rows = {each.grasp.name: self._latch(each, last.get(each.grasp.name)) for each in rows}
        if attached is not None and attached.held is not None:
            attached.held.hold()
        self._set(latches, attached)

    def _latch(self, latch: Latch, record: GraspRecord | None) -> LatchedBodies:
        """Rows of a further grasp, by the pose in the record of its closing."""
        system, grasp = self._scene.system, latch.grasp
        if record is None:
            return loop_latch(system, grasp, closing_pose(system, self._scene.data, grasp))
        return loop_latch(system, grasp, ClosingPose(record.held_position_m, record.held_quaternion))

    def _set(self, latches: Sequence[Latch], attached: Latch | None) -> None:
        """Set the closed grasps; the motion with them is at the state in ``data``."""
        self.latches, self._attached = list(latches), attached
        self.motion = attached.held if attached is not None and attached.held is not None else self._free
        self._loops.set_closed(self._rows)
        further = [each for each in self.latches if each is not attached]
        for each in self.latches:
            each.hold_by_rows(each is not attached)
        first = [attached.grasp.name] if attached is not None else []
        self.motion.grasps = (*first, *(each.grasp.name for each in further))

    def _refuse_limits(self, instant: EventTime) -> None:
        """End the run if a closed grasp has a load limit and the loads are not unique.

        Raises:
            RunEnded: There is one.
        """
        limited = [each.grasp.name for each in self.latches if each.limit is not None]
        if not limited or not self._rows:
            return
        self._loops.bind(self.motion)
        if self._loops.is_unique():
            return
        closed = ", ".join(each.grasp.name for each in self.latches)
        message = f"the load limit of grasp {limited[0]!r} cannot be applied at t = {instant.time_s:.6g} s"
        reason = f"with {closed} closed, the joints do not determine the split of the load; leave out load_limit"
        raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: {reason}")
