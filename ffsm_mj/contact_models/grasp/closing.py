"""Closing of a grasp: the plastic impulse that stops the relative motions that the latch does not permit, and its record.

A grasp that closes alone attaches its object as a child body. Where others are closed, its impulse keeps their rows as well
(:mod:`ffsm_mj.contact_models.grasp.loops`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.event import EventTime, Scene
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.impulse import plastic_impulse
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.loop_latch import ClosingPose, closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.grasp.nearness import Nearness
from ffsm_mj.contact_models.grasp.record import GraspRecord
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.records.signals import SUBSYSTEMS


class _Joined(NamedTuple):
    """What the impulse of a closing was, and what holds from then on: fields of the record."""

    impulse: FloatArray
    loss_J: float
    rank: int
    mobility: int
    least_ratio: float
    pose: ClosingPose


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
        self._near, self._point = Nearness.of(latch.sites.vectors(data)), latch.sites.point(data)
        self._axis_angle_rad = latch.axis_angle_rad()
        self._rates = np.array(data.qvel)
        self._energies, self._momentum, self._of_objects = _energies(scene), _momentum(scene), _of_objects(scene)

    def first(self, held: GraspedMotion) -> tuple[GraspRecord, Exchange]:
        """Close the only grasp: its object becomes a child of the link.

        Args:
            held: The motion with this grasp closed; put to the state after the impulse.
        """
        system, data, sites = self._scene.system, self._scene.data, self._latch.sites
        # A plastic impact in all relative directions at once that the latch stops.
        found = plastic_impulse(system.mj, data, sites.link, sites.root, self._point, held.joints.stopped(data))
        data.qvel[:] += found.change
        mujoco.mj_forward(system.mj, data)
        held.hold()
        pose = ClosingPose(as_tuple(held.model.body_pos[held.root]), as_tuple(held.model.body_quat[held.root]))
        mobility = int(held.model.nv)
        record = self._record(_Joined(found.impulse, found.loss_J, found.rank, mobility, found.least_ratio, pose))
        force, moment = found.impulse[:3], found.impulse[3:]
        on_objects = np.concatenate((force, moment + cross(self._point, force)))
        return record, Exchange(_energies(self._scene) - self._energies, on_objects)

    def further(self, loops: LoopForces) -> tuple[GraspRecord, Exchange]:
        """Close the grasp by rows in the motion to which ``loops`` is bound, beside those that are closed."""
        scene, grasp = self._scene, self._latch.grasp
        pose = closing_pose(scene.system, scene.data, grasp)
        found = loops.close(grasp.name, loop_latch(scene.system, grasp, pose))
        mujoco.mj_forward(scene.system.mj, scene.data)
        impulse = found.wrenches[grasp.name]
        record = self._record(_Joined(impulse, found.loss_J, found.rank, found.mobility, found.least_ratio, pose))
        # Other closed grasps pass impulses on: the momenta of the objects show them all.
        return record, Exchange(_energies(scene) - self._energies, _of_objects(scene) - self._of_objects)

    def _record(self, joined: _Joined) -> GraspRecord:
        """The record, with the state in ``data`` as that after the impulse."""
        scene, latch = self._scene, self._latch
        energies, momentum = _energies(scene), _momentum(scene)
        change = momentum - self._momentum
        return GraspRecord(
            event=scene.numbers.next_number(),
            grasp=latch.grasp.name,
            time_s=self._instant.time_s,
            step=self._instant.step,
            robot_site=latch.grasp.robot_site,
            object_site=latch.grasp.object_site,
            point_m=as_tuple(self._point),
            **self._near._asdict(),
            joint=latch.grasp.joint.kind,
            axis=latch.grasp.joint.axis or (0.0, 0.0, 0.0),
            axis_angle_rad=self._axis_angle_rad,
            replaces=self._replaces,
            place=self._place,
            held_position_m=joined.pose.position_m,
            held_quaternion=joined.pose.quaternion,
            rank=joined.rank,
            mobility=joined.mobility,
            least_ratio=joined.least_ratio,
            impulse_N_s=as_tuple(joined.impulse[:3]),
            angular_impulse_N_m_s=as_tuple(joined.impulse[3:]),
            loss_J=joined.loss_J,
            energy_before_J=_by_subsystem(self._energies),
            energy_after_J=_by_subsystem(energies),
            momentum_before={"total": as_tuple(self._momentum)},
            momentum_after={"total": as_tuple(momentum)},
            energy_change_J=float((energies - self._energies)[0]),
            linear_momentum_change_N_s=float(np.linalg.norm(change[:3])),
            angular_momentum_change_N_m_s=float(np.linalg.norm(change[3:])),
            **state_fields(scene, self._rates),
        )


def state_fields(scene: Scene, before: FloatArray) -> dict[str, Any]:
    """State fields of a record; the state after the event is that in ``data``.

    Args:
        scene: The logged system and its data.
        before: Generalised velocity before the event, (nv,).
    """
    system, data = scene.system, scene.data
    return {
        "qpos": as_tuple(data.qpos),
        "qvel_before": system.by_joint(before),
        "qvel_after": system.by_joint(data.qvel),
    }


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
    own = (momentum_matrix(scene.system.mj, scene.data, tree.root) @ scene.data.qvel for tree in scene.system.objects)
    return sum(own, np.zeros(6))


def _by_subsystem(energies: FloatArray) -> dict[str, tuple[float, ...]]:
    return {subsystem: (energy,) for subsystem, energy in zip(SUBSYSTEMS, energies.tolist(), strict=True)}
