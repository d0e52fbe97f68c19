"""Closing of a grasp: the plastic impulse that stops the relative motions that the latch does not permit, and its record.

A grasp that closes alone attaches its object as a child body. Where others are closed, its impulse keeps their rows as well
(:mod:`ffsm_mj.contact_models.grasp.loops`).
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.event import EventTime, Scene, event_fields
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.impulse import plastic_impulse
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.loop_latch import ClosingPose, closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.loops import LoopClosing, LoopForces
from ffsm_mj.contact_models.grasp.nearness import Nearness
from ffsm_mj.contact_models.grasp.record import GraspRecord
from ffsm_mj.dynamics.loops.mass_weighted import PlasticClosing
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.records.signals import SUBSYSTEMS


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
        record = self._record(found, found.impulses, int(held.model.nv), pose)
        force, moment = found.impulses[:3], found.impulses[3:]
        on_objects = np.concatenate((force, moment + cross(self._point, force)))
        return record, Exchange(_energies(self._scene) - self._energies, on_objects)

    def further(self, loops: LoopForces) -> tuple[GraspRecord, Exchange]:
        """Close the grasp by rows in the motion to which ``loops`` is bound, beside those that are closed."""
        scene, grasp = self._scene, self._latch.grasp
        pose = closing_pose(scene.system, scene.data, grasp)
        found = loops.close(grasp.name, loop_latch(scene.system, grasp, pose))
        mujoco.mj_forward(scene.system.mj, scene.data)
        record = self._record(found, found.wrenches[grasp.name], found.mobility, pose)
        # Other closed grasps pass impulses on: the momenta of the objects show them all.
        return record, Exchange(_energies(scene) - self._energies, _of_objects(scene) - self._of_objects)

    def _record(
        self, found: PlasticClosing | LoopClosing, impulse: FloatArray, mobility: int, pose: ClosingPose
    ) -> GraspRecord:
        """The record, with the state in ``data`` as that after the impulse.

        Args:
            found: The plastic impulse on all rows.
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
            held_position_m=pose.position_m,
            held_quaternion=pose.quaternion,
            rank=found.rank,
            mobility=mobility,
            least_ratio=found.least_ratio,
            impulse_N_s=as_tuple(impulse[:3]),
            angular_impulse_N_m_s=as_tuple(impulse[3:]),
            loss_J=found.loss_J,
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
    own = (momentum_matrix(scene.system.mj, scene.data, tree.root) @ scene.data.qvel for tree in scene.system.objects)
    return sum(own, np.zeros(6))


def _by_subsystem(energies: FloatArray) -> dict[str, tuple[float, ...]]:
    return {subsystem: (energy,) for subsystem, energy in zip(SUBSYSTEMS, energies.tolist(), strict=True)}
