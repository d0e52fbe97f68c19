"""A resolved impact as the log and the balance want it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.manifold import manifold_name
from ffsm_mj.contact_models.impact.resolution import Impact
from ffsm_mj.contact_models.impact.resting import RestingResult
from ffsm_mj.contact_models.impact.touching import Touching, touching_points
from ffsm_mj.contact_models.interface import EventTime
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord

_EXCHANGES = (("robot", "objects"), ("fixed", "robot"), ("fixed", "objects"))


def impact_energies(system: System, data: Any, impact: Impact) -> FloatArray:
    """Kinetic energies of (total, robot, objects) before and after, (2, 3), J."""
    robot, momentum = system.robot.dofs, np.empty(system.mj.nv)
    out = np.empty((2, 3))
    for k, state in enumerate((impact.before, impact.after)):
        mujoco.mj_mulM(system.mj, data, momentum, state.qvel)
        share = float(0.5 * momentum[robot] @ state.qvel[robot])
        out[k] = state.kinetic_energy_J, share, state.kinetic_energy_J - share
    return out


def impulses_between(system: System, impact: Impact) -> FloatArray:
    """Impulses of the robot on the objects, of fixed bodies on the robot, and of those on the objects, (3, 6).

    Each is (force part, moment about the world origin). A contact of two objects, or of the robot with itself, is within one
    subsystem and adds nothing.
    """
    impulses = np.zeros((3, 6))
    for contact, vector in zip(impact.contacts, impact.vectors, strict=True):
        a, b = (_party(system, body) for body in (contact.body_a, contact.body_b))
        for number, (giver, taker) in enumerate(_EXCHANGES):
            if {a, b} == {giver, taker}:
                force = vector if b == taker else -vector
                impulses[number] += np.concatenate((force, np.cross(contact.point, force)))
    return impulses


def _party(system: System, body: int) -> str:
    if body in system.fixed_bodies:
        return "fixed"
    return "robot" if body in system.robot.bodies else "objects"


def _centre(system: System, data: Any, body: int) -> FloatArray:
    """Mass centre of what a body belongs to; where it is fixed the origin of its model's frame, (3,), m."""
    tree = system.tree_of_body(body)
    return np.asarray(data.xpos[system.mj.body_rootid[body]] if tree is None else data.subtree_com[tree.root])


def impact_records(
    system: System,
    data: Any,
    touching: Touching,
    met: RestingResult,
    energies: FloatArray,
    event: int,
    instant: EventTime,
) -> tuple[ImpactRecord, ...]:
    """What the log says of an impact: one record per contact."""

    def by_party(values: Any) -> dict[str, tuple[float, ...]]:
        return {subsystem: (float(value),) for subsystem, value in zip(("total", "robot", "objects"), values, strict=True)}

    impact, used, vectors = met.impact, met.used.tolist(), met.impact.vectors
    change = impact.momentum_change
    stated = [pair.restitution for pair, _, _ in touching_points(touching)]
    dropped = [_dropped(*each) for each in zip(met.speeds.tolist(), met.pressing.tolist(), stated, strict=True)]
    records = []
    for i, (pair, near, point) in enumerate(touching_points(touching)):
        arm = point - _centre(system, data, pair.body_b)
        records.append(
            ImpactRecord(
                event=event,
                time_s=instant.time_s,
                step=instant.step,
                pair=pair.name,
                geoms=pair.geoms,
                robot_geom=pair.geom_a if pair.robot_on_object else "",
                object_geom=pair.geom_b if pair.robot_on_object else "",
                point_m=tuple(point.tolist()),
                normal=tuple(near.normal.tolist()),
                manifold=manifold_name(len(near.points)),
                law=impact.law,
                status=impact.status,
                restitution=pair.restitution,
                restitution_used=used[i],
                dropped_gap_m=dropped[i][0],
                dropped_flights_s=dropped[i][1],
                approach_speed_m_s=float(impact.approach_speeds[i]),
                separation_speed_m_s=float(impact.separation_speeds[i]),
                impulse_N_s=float(impact.impulses[i]),
                angular_impulse_N_m_s=tuple(np.cross(arm, vectors[i]).tolist()),
                mu=pair.mu,
                **_friction(impact, i),
                gap_m=near.gap,
                qpos=tuple(data.qpos.tolist()),
                qvel_before=system.by_joint(impact.before.qvel),
                qvel_after=system.by_joint(impact.after.qvel),
                energy_before_J=by_party(energies[0]),
                energy_after_J=by_party(energies[1]),
                momentum_before={"total": tuple(impact.before.momentum.tolist())},
                momentum_after={"total": tuple(impact.after.momentum.tolist())},
                energy_change_J=impact.energy_change_J,
                linear_momentum_change_N_s=float(np.linalg.norm(change[:3])),
                angular_momentum_change_N_m_s=float(np.linalg.norm(change[3:])),
            )
        )
    return tuple(records)


def _friction(impact: Impact, i: int) -> dict[str, Any]:
    """Fields of a record that say what friction did at a contact, or that there was none."""
    found = impact.friction
    if found is None:
        mean = 0.5 * float(impact.separation_speeds[i] - impact.approach_speeds[i])
        return {"normal_work_J": float(impact.impulses[i]) * mean}
    return {
        "theta": found.theta,
        "tangential_impulse_N_s": tuple(found.impulses[i].tolist()),
        "slip_before_m_s": tuple(found.slip_before[i].tolist()),
        "slip_after_m_s": tuple(found.slip_after[i].tolist()),
        "path": found.paths[i],
        "normal_work_J": float(found.normal_work[i]),
        "friction_work_J": float(found.friction_work[i]),
        "compression_work_J": float(found.compression_work[i]),
    }


def _dropped(speed: float, pressing: float, restitution: float) -> tuple[float, float]:
    """What a contact that comes to rest would have flown yet: the highest gap in m, and for how long in all in s."""
    if speed <= 0.0 or pressing <= 0.0:
        return 0.0, 0.0
    left = 2.0 * speed / (pressing * (1.0 - restitution)) if restitution < 1.0 else 0.0
    return 0.5 * speed**2 / pressing, left
