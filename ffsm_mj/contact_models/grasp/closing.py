"""Closing of a grasp: the plastic impulse that stops the relative motions that the latch does not permit, and its record."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact_models.event import EventTime, Scene
from ffsm_mj.contact_models.grasp.impulse import plastic_impulse
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.record import CaptureRecord
from ffsm_mj.dynamics.rigid_body import cross, momentum_matrix
from ffsm_mj.records.signals import SUBSYSTEMS


def close_grasp(scene: Scene, latch: Latch, instant: EventTime, replaces: str = "") -> tuple[CaptureRecord, Exchange]:
    """Apply the plastic impulse of a grasp at the state in ``data``, and put its motion to the state after it.

    Args:
        scene: The logged system and its data.
        latch: The latch that closes.
        instant: Time and step of the event.
        replaces: Name of the closed grasp of the same two sites that it takes over from; empty if there is none.
    """
    system, data, held = scene.system, scene.data, latch.held
    sites, near, point = latch.sites, latch.near(), latch.sites.point(data)
    # A plastic impact in all relative directions at once that the latch stops.
    found = plastic_impulse(system.mj, data, sites.link, sites.root, point, held.joints.stopped(data))
    axis_angle_rad = held.joints.axis_angle_rad(data)
    before, energies, momentum = np.array(data.qvel), _energies(scene), _momentum(scene)
    data.qvel[:] += found.change
    mujoco.mj_forward(system.mj, data)
    held.hold()
    energies_after, momentum_after = _energies(scene), _momentum(scene)
    gained, change = energies_after - energies, momentum_after - momentum
    force, moment = found.impulse[:3], found.impulse[3:]
    record = CaptureRecord(
        event=scene.numbers.next_number(),
        grasp=latch.grasp.name,
        time_s=instant.time_s,
        step=instant.step,
        robot_site=latch.grasp.robot_site,
        object_site=latch.grasp.object_site,
        point_m=as_tuple(point),
        **near._asdict(),
        joint=latch.grasp.joint.kind,
        axis=latch.grasp.joint.axis or (0.0, 0.0, 0.0),
        axis_angle_rad=axis_angle_rad,
        replaces=replaces,
        held_position_m=as_tuple(held.model.body_pos[held.root]),
        held_quaternion=as_tuple(held.model.body_quat[held.root]),
        rank=found.rank,
        impulse_N_s=as_tuple(force),
        angular_impulse_N_m_s=as_tuple(moment),
        loss_J=found.loss_J,
        energy_before_J=_by_subsystem(energies),
        energy_after_J=_by_subsystem(energies_after),
        momentum_before={"total": as_tuple(momentum)},
        momentum_after={"total": as_tuple(momentum_after)},
        energy_change_J=float(gained[0]),
        linear_momentum_change_N_s=float(np.linalg.norm(change[:3])),
        angular_momentum_change_N_m_s=float(np.linalg.norm(change[3:])),
        **state_fields(scene, before),
    )
    return record, Exchange(gained, np.concatenate((force, moment + cross(point, force))))


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


def _by_subsystem(energies: FloatArray) -> dict[str, tuple[float, ...]]:
    return {subsystem: (energy,) for subsystem, energy in zip(SUBSYSTEMS, energies.tolist(), strict=True)}
