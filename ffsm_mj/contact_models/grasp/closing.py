"""Closing and opening of grasps: impulse and records, and the motion with the closed ones.

A grasp that closes alone attaches its object as a child body. Where others are closed, its impulse keeps their rows as well
(:mod:`ffsm_mj.contact_models.grasp.loops`).

Opening of a grasp: its record; no impulse acts.

Near miss of a grasp: it is disarmed without ever having satisfied its bounds.

The closed grasps of a run: the motion that they give, and how it changes as one of them closes or opens.

The first closed grasp of the robot on the base of an object attaches it as a child body of the link: the motion is that of
another model. Further ones, and those of a moving link of an object, are held by rows in that model. When the first one
opens, the next one of the robot on a base attaches its object in turn: if only that is left, the model has no loop any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.grasp.closing_condition import ClosestApproach
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse
from ffsm_mj.contact_models.grasp.loops import ClosingPose, LoopClosing, LoopForces, closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.records import GraspRecord, NearMissRecord, ReleaseRecord
from ffsm_mj.contact_models.interface import EventEffect, EventTime, Scene, event_fields
from ffsm_mj.dynamics.loops.closed_loops import PlasticClosing
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.state import StateError, entries


class GraspClosing:
    """Closing of one grasp at the state in ``data``: states before and after its impulse, and its record."""

    def __init__(self, scene: Scene, latch: Latch, instant: EventTime, place: int, replaces: str = "") -> None:
        """Take the state before the impulse.

        Args:
            scene: The logged system and its data.
            latch: The latch that closes.
            instant: Time and step of the event.
            place: Its place in the order in which the closed grasps close, from 1.
            replaces: Name of the closed grasp of the same two sites that it takes over from; empty if there is none.
        """
        self._scene, self._latch, self._instant, self._place, self._replaces = scene, latch, instant, place, replaces
        data = scene.data
        self._near, self._point = latch.sites.nearness(data), latch.sites.point(data)
        self._axis_angle_rad = latch.axis_angle_rad()
        self._rates = np.array(data.qvel)
        # Before the impulse: afterwards only the difference would tell what it changed.
        self._energies, self._momentum, self._of_objects = _energies(scene), _momentum(scene), _of_objects(scene)

    def first(self, motion: GraspedMotion) -> tuple[GraspRecord, Exchange]:
        """Close the only grasp: its object becomes a child of the link.

        Args:
            motion: The motion with this grasp closed; put to the state after the impulse.
        """
        system, data, sites = self._scene.system, self._scene.data, self._latch.sites
        # A plastic impact in all relative directions at once that the latch stops.
        # With e > 0 the sites would part again: a latch closes for good, so its impulse is plastic.
        impact = plastic_impulse(system.mj, data, sites.link, sites.root, self._point, motion.joints.stopped(data))
        data.qvel[:] += impact.change
        mujoco.mj_forward(system.mj, data)
        motion.hold()
        pose = ClosingPose(as_tuple(motion.model.body_pos[motion.root]), as_tuple(motion.model.body_quat[motion.root]))
        record = self._record(impact, impact.impulses, int(motion.model.nv), pose)
        force, moment = impact.impulses[:3], impact.impulses[3:]
        # Shifted to the world origin: about it the angular momenta of the balance are conserved.
        on_objects = np.concatenate((force, moment + cross(self._point, force)))
        return record, Exchange(_energies(self._scene) - self._energies, on_objects)

    def further(self, loops: LoopForces) -> tuple[GraspRecord, Exchange]:
        """Close the grasp by rows in the motion to which ``loops`` is bound, beside those that are closed."""
        scene, grasp = self._scene, self._latch.grasp
        pose = closing_pose(scene.system, scene.data, grasp)
        closing = loops.close(grasp.name, loop_latch(scene.system, grasp, pose))
        mujoco.mj_forward(scene.system.mj, scene.data)
        record = self._record(closing, closing.wrenches[grasp.name], closing.mobility, pose)
        # Other closed grasps pass impulses on: the momenta of the objects show them all.
        return record, Exchange(_energies(scene) - self._energies, _of_objects(scene) - self._of_objects)

    def _record(
        self, closing: PlasticClosing | LoopClosing, impulse: FloatArray, mobility: int, pose: ClosingPose
    ) -> GraspRecord:
        """The record, with the state in ``data`` as that after the impulse.

        Args:
            closing: The plastic impulse on all rows.
            impulse: What it is on the object at its site, in N s, with the moment in N m s, (6,).
            mobility: Degrees of freedom that are left.
            pose: Pose of the object in the frame of the link.
        """
        scene, latch = self._scene, self._latch
        energies, momentum = _energies(scene), _momentum(scene)
        change = momentum - self._momentum
        return GraspRecord(
            grasp=latch.grasp.name,
            robot_site=latch.grasp.robot_site,
            object_site=latch.grasp.object_site,
            point_m=as_tuple(self._point),
            **self._near._asdict(),
            joint=latch.grasp.joint.kind,
            axis=latch.grasp.joint.axis or (0.0, 0.0, 0.0),
            axis_angle_rad=self._axis_angle_rad,
            replaces=self._replaces,
            place=self._place,
            object_position_m=pose.position_m,
            object_quaternion=pose.quaternion,
            rank=closing.rank,
            mobility=mobility,
            least_ratio=closing.least_ratio,
            impulse_N_s=as_tuple(impulse[:3]),
            angular_impulse_N_m_s=as_tuple(impulse[3:]),
            loss_J=closing.loss_J,
            energy_before_J=_by_subsystem(self._energies),
            energy_after_J=_by_subsystem(energies),
            momentum_before={"total": as_tuple(self._momentum)},
            momentum_after={"total": as_tuple(momentum)},
            energy_change_J=float((energies - self._energies)[0]),
            linear_momentum_change_N_s=float(np.linalg.norm(change[:3])),
            angular_momentum_change_N_m_s=float(np.linalg.norm(change[3:])),
            **event_fields(scene, self._instant, self._rates),
        )


def as_tuple(values: Any) -> tuple[float, ...]:
    """An array as a field of a record."""
    return tuple(np.asarray(values).tolist())


def _energies(scene: Scene) -> FloatArray:
    """Kinetic energy of (total, robot, objects), J."""
    system, data, h = scene.system, scene.data, np.empty(scene.system.mj.nv)
    mujoco.mj_mulM(system.mj, data, h, data.qvel)
    total, robot = 0.5 * float(h @ data.qvel), 0.5 * float(h[system.robot.dofs] @ data.qvel[system.robot.dofs])
    return np.array((total, robot, total - robot))


def _momentum(scene: Scene) -> FloatArray:
    return np.asarray(momentum_matrix(scene.system.mj, scene.data, 0) @ scene.data.qvel)


def _of_objects(scene: Scene) -> FloatArray:
    """Momentum of all objects, (6,)."""
    momenta = (momentum_matrix(scene.system.mj, scene.data, tree.root) @ scene.data.qvel for tree in scene.system.objects)
    return sum(momenta, np.zeros(6))


def _by_subsystem(energies: FloatArray) -> dict[str, tuple[float, ...]]:
    return {subsystem: (energy,) for subsystem, energy in zip(SUBSYSTEMS, energies.tolist(), strict=True)}


def open_grasp(
    scene: Scene, latch: Latch, instant: EventTime, reason: str, force_N: float, torque_N_m: float
) -> ReleaseRecord:
    """Compute the derived quantities at the state in ``data`` and record the release; velocities are continuous.

    Args:
        scene: The logged system and its data.
        latch: The latch that opens.
        instant: Time and step of the event.
        reason: ``request`` or ``load_limit``.
        force_N: Force on the object right before, N; 0 for a request.
        torque_N_m: Torque on the object about its site right before, N m; 0 for a request.
    """
    mujoco.mj_forward(scene.system.mj, scene.data)
    point = as_tuple(latch.sites.point(scene.data))
    return ReleaseRecord(
        grasp=latch.grasp.name,
        point_m=point,
        reason=reason,
        force_N=force_N,
        torque_N_m=torque_N_m,
        **event_fields(scene, instant, scene.data.qvel),
    )


def near_miss(scene: Scene, grasp: str, closest: ClosestApproach, instant: EventTime) -> NearMissRecord | None:
    """The record of a near miss, at the state in ``data``; None if no time has passed since the grasp was armed.

    Args:
        scene: The logged system and its data.
        grasp: Name of the grasp.
        closest: Its closest approach.
        instant: Time and step at which it was disarmed.
    """
    # Armed and disarmed at one instant: there was no approach whose failure a record could name.
    if (first := closest.first()) is None:
        return None
    near, least_s, failed = first
    bounds = closest.bounds.stated
    return NearMissRecord(
        grasp=grasp,
        least_ratio=closest.bounds.ratio(near),
        least_s=least_s,
        **near._asdict(),
        bounds={name: (bound,) for name, bound in bounds.items()},
        failed=failed,
        failed_value=getattr(near, failed),
        failed_bound=bounds[failed],
        **event_fields(scene, instant, scene.data.qvel),
    )


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
            [closed.grasp.name for closed in self.latches],
            attached.grasp.name if attached is not None else None,
            {name: vars(latch) for name, latch in self._rows.items()},
            attached.grasped_motion.get_state() if attached is not None and attached.grasped_motion is not None else None,
        )

    def set_state(self, state: Any, latches: Mapping[str, Latch]) -> None:
        """Close these grasps, at the state in ``data``.

        Args:
            state: The state.
            latches: All grasps of the run by name.

        Raises:
            StateError: It names others.
        """
        values = entries(state, ("closed", "attached", "rows", "motion"), "ClosedGrasps")
        # A state may come from a file, or from a scenario that had other grasps: a name without a latch would fail steps
        # later.
        if unknown := {*values["closed"], *values["rows"], values["attached"]} - {*latches, None}:
            raise StateError(f"a state with grasps that there are not: {', '.join(sorted(unknown))}")
        attached = latches[values["attached"]] if values["attached"] is not None else None
        self._rows = {name: LatchedBodies(**pose) for name, pose in values["rows"].items()}
        self._set([latches[name] for name in values["closed"]], attached)
        if attached is not None and attached.grasped_motion is not None:
            attached.grasped_motion.set_state(values["motion"])

    def order_of(self, latch: Latch) -> int:
        """Place of a grasp in the order in which the closed ones closed, from 1; 0 if it is open."""
        return self.latches.index(latch) + 1 if latch in self.latches else 0

    def close(self, latch: Latch, instant: EventTime) -> EventEffect:
        """Close a grasp at the state in ``data``; one of the same two sites that is closed opens.

        Raises:
            RunEnded: A load limit cannot be applied, as the load that it limits is not unique.
        """
        # Two latches of one pair of sites would hold the same relative motion twice: the loads of both would not be unique.
        gone = next((other for other in self.latches if other.grasp.joins_sites_of(latch.grasp)), None)
        # It takes the place of the one that it replaces, as the order of closing decides which object is a child of its
        # link.
        latches = [latch if other is gone else other for other in self.latches]
        latches += [] if gone is not None else [latch]
        replaces = gone.grasp.name if gone is not None else ""
        closing = GraspClosing(self._scene, latch, instant, latches.index(latch) + 1, replaces)
        if gone is not None:
            self._rows.pop(replaces, None)
        # One object at most is a child body of the link: its model has no loop. Every other closed grasp closes one, by
        # rows.
        attaches = latch.grasped_motion is not None and self._attached in (gone, None)
        # Without any rows the impulse on the latch alone is the whole solution; with rows it would open the closed ones.
        if latch.grasped_motion is not None and attaches and not self._rows and not self._loops.equalities:
            record, exchange = closing.first(latch.grasped_motion)
            self._set(latches, latch)
        else:
            # An object that is attached from now on was free but for the rows of the other grasps, and of the models.
            self._loops.set_closed(self._rows)
            self._loops.bind(self._free if attaches else self.motion)
            record, exchange = closing.further(self._loops)
            if not attaches:
                self._rows[latch.grasp.name] = self._latch(latch, record)
            elif latch.grasped_motion is not None:
                latch.grasped_motion.hold()
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
        latches, attached = [other for other in self.latches if other is not latch], self._attached
        # Its object was a child of the link. Another model must move now: that with the next object attached, else the free
        # one.
        if attached is latch:
            attached = next((other for other in latches if other.grasped_motion is not None), None)
            if attached is not None and attached.grasped_motion is not None:
                # A child of the link needs no rows: with both the same motion would be held twice.
                self._rows.pop(attached.grasp.name)
                attached.grasped_motion.hold()
        self._set(latches, attached)
        self._refuse_limits(instant)
        return record

    def restore(self, latches: Sequence[Latch], records: Sequence[GraspRecord]) -> None:
        """Set the closed grasps, at the state in ``data``.

        Args:
            latches: The closed grasps in the order in which they closed.
            records: Earlier closings in order. A further grasp without one is held in its present pose.
        """
        # In the order of closing, as in the run: which object is attached decides the coordinates, and so the rounding, of
        # the replay.
        attached = next((latch for latch in latches if latch.grasped_motion is not None), None)
        last = {record.grasp: record for record in records}
        rows = [latch for latch in latches if latch is not attached]
        self._rows = {latch.grasp.name: self._latch(latch, last.get(latch.grasp.name)) for latch in rows}
        if attached is not None and attached.grasped_motion is not None:
            attached.grasped_motion.hold()
        self._set(latches, attached)

    def _latch(self, latch: Latch, record: GraspRecord | None) -> LatchedBodies:
        """Rows of a further grasp, by the pose in the record of its closing."""
        system, grasp = self._scene.system, latch.grasp
        # The record may lie in a lost part of the log. The present pose then differs from that of the closing by drift only.
        if record is None:
            return loop_latch(system, grasp, closing_pose(system, self._scene.data, grasp))
        return loop_latch(system, grasp, ClosingPose(record.object_position_m, record.object_quaternion))

    def _set(self, latches: Sequence[Latch], attached: Latch | None) -> None:
        """Set the closed grasps; the motion with them is at the state in ``data``."""
        self.latches, self._attached = list(latches), attached
        self.motion = attached.grasped_motion if attached is not None and attached.grasped_motion is not None else self._free
        self._loops.set_closed(self._rows)
        further = [latch for latch in self.latches if latch is not attached]
        for latch in self.latches:
            latch.hold_by_rows(latch is not attached)
        first = [attached.grasp.name] if attached is not None else []
        self.motion.grasps = (*first, *(latch.grasp.name for latch in further))

    def _refuse_limits(self, instant: EventTime) -> None:
        """End the run if a closed grasp has a load limit and the loads are not unique.

        Raises:
            RunEnded: There is one.
        """
        limited = [latch.grasp.name for latch in self.latches if latch.limit is not None]
        # One latch that closes no loop has a load that the motion determines: there is nothing to refuse.
        if not limited or not self._rows:
            return
        self._loops.bind(self.motion)
        # Dependent rows leave the motion unique, not the split of the load (docs/capture.md): a limit on a convention is no
        # physics.
        if self._loops.is_unique():
            return
        closed = ", ".join(latch.grasp.name for latch in self.latches)
        message = f"the load limit of grasp {limited[0]!r} cannot be applied at t = {instant.time_s:.6g} s"
        reason = f"with {closed} closed, the joints do not determine the split of the load; leave out load_limit"
        raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: {reason}")
