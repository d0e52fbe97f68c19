"""Energies, impulses and event records of a resolved impact, for the balance and the log."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.manifold import manifold_name
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.closed_pairs import ClosedPairs, contact_points
from ffsm_mj.contact_models.impact.contact import LimitContact
from ffsm_mj.contact_models.impact.limit_record import LimitImpactRecord
from ffsm_mj.contact_models.impact.resolution import Impact
from ffsm_mj.contact_models.impact.rest_rule import RestingResult
from ffsm_mj.contact_models.interface import EventTime
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord

_EXCHANGES = (("robot", "objects"), ("fixed", "robot"), ("fixed", "objects"))


def impact_energies(system: System, data: Any, impact: Impact) -> FloatArray:
    """Kinetic energies of (total, robot, objects) before and after an impact, (2, 3), J."""
    robot, momentum = system.robot.dofs, np.empty(system.mj.nv)
    out = np.empty((2, 3))
    for k, state in enumerate((impact.before, impact.after)):
        mujoco.mj_mulM(system.mj, data, momentum, state.qvel)
        share = float(0.5 * momentum[robot] @ state.qvel[robot])
        out[k] = state.kinetic_energy_J, share, state.kinetic_energy_J - share
    return out


def impulses_between(system: System, impact: Impact) -> FloatArray:
    """Impulses of the robot on the objects, of fixed bodies on the robot, and of fixed bodies on the objects, (3, 6).

    Each row is an impulse in N s and its moment about the world origin in N m s. A contact of two objects, or of the robot
    with itself, is within one subsystem and contributes nothing; nor does a joint at its limit.
    """
    impulses = np.zeros((3, 6))
    for contact, vector in zip(impact.contacts, impact.vectors, strict=True):
        if isinstance(contact, LimitContact):
            continue
        a, b = (_subsystem(system, body) for body in (contact.body_a, contact.body_b))
        for number, (source, target) in enumerate(_EXCHANGES):
            if {a, b} == {source, target}:
                force = vector if b == target else -vector
                impulses[number] += np.concatenate((force, np.cross(contact.point, force)))
    return impulses


def _subsystem(system: System, body: int) -> str:
    if body in system.fixed_bodies:
        return "fixed"
    return "robot" if body in system.robot.bodies else "objects"


def _centre(system: System, data: Any, body: int) -> FloatArray:
    """Centre of mass of the robot or object of a body; for a fixed body the origin of its model's frame, (3,), m."""
    tree = system.tree_of_body(body)
    return np.asarray(data.xpos[system.mj.body_rootid[body]] if tree is None else data.subtree_com[tree.root])


def impact_records(
    system: System,
    data: Any,
    touching: ClosedPairs,
    met: RestingResult,
    energies: FloatArray,
    event: int,
    instant: EventTime,
) -> tuple[ImpactRecord | LimitImpactRecord, ...]:
    """Records of an impact, one per contact point and joint limit."""
    impact, used, vectors = met.impact, met.used.tolist(), met.impact.vectors
    shared = _shared_fields(system, data, impact, energies)
    points = contact_points(touching)
    stated = [pair.restitution for pair, _, _ in points]
    omitted = [_omitted_flights(*each) for each in zip(met.speeds.tolist(), met.pressing.tolist(), stated, strict=True)]
    records: list[ImpactRecord | LimitImpactRecord] = []
    for i, (pair, near, point) in enumerate(points):
        common = {
            "event": event,
            "time_s": instant.time_s,
            "step": instant.step,
            "restitution": pair.restitution,
            "restitution_used": used[i],
            "dropped_flights_s": omitted[i][1],
            **shared,
        }
        if isinstance(pair, JointLimit):
            records.append(_at_limit(pair, near, pair.value(data), impact, i, dropped_gap=omitted[i][0], **common))
        else:
            moment = np.cross(point - _centre(system, data, pair.body_b), vectors[i])
            records.append(_at_point(pair, near, point, moment, impact, i, dropped_gap_m=omitted[i][0], **common))
    return tuple(records)


def _at_point(
    pair: ContactPair, near: Proximity, point: FloatArray, moment: FloatArray, impact: Impact, i: int, **common: Any
) -> ImpactRecord:
    """Record of a contact point with the moment of its impulse, N m s, (3,)."""
    return ImpactRecord(
        pair=pair.name,
        geoms=pair.geoms,
        robot_geom=pair.geom_a if pair.robot_on_object else "",
        object_geom=pair.geom_b if pair.robot_on_object else "",
        point_m=tuple(point.tolist()),
        normal=tuple(near.normal.tolist()),
        manifold=manifold_name(len(near.points)),
        approach_speed_m_s=float(impact.approach_speeds[i]),
        separation_speed_m_s=float(impact.separation_speeds[i]),
        impulse_N_s=float(impact.impulses[i]),
        angular_impulse_N_m_s=tuple(moment.tolist()),
        mu=pair.mu,
        rule=pair.rule,
        gap_m=near.gap,
        **_friction(impact, i),
        **common,
    )


def _at_limit(limit: JointLimit, near: Proximity, value: float, impact: Impact, i: int, **common: Any) -> LimitImpactRecord:
    """Record of a joint at its limit, at a coordinate ``value``."""
    found = _friction(impact, i)
    return LimitImpactRecord(
        joint=limit.joint,
        side=limit.side,
        unit=limit.unit,
        value=value,
        limit=limit.limit,
        theta=found.get("theta", 1.0),
        approach_rate=float(impact.approach_speeds[i]),
        separation_rate=float(impact.separation_speeds[i]),
        impulse=float(impact.impulses[i]),
        work_J=found["normal_work_J"],
        gap=near.gap,
        point_m=tuple(near.points[0].tolist()),
        axis=tuple(near.normal.tolist()),
        **common,
    )


def _shared_fields(system: System, data: Any, impact: Impact, energies: FloatArray) -> dict[str, Any]:
    """Fields that are equal in the records of all contacts of an impact."""
    change = impact.momentum_change
    before, after = (
        {subsystem: (float(value),) for subsystem, value in zip(("total", "robot", "objects"), values, strict=True)}
        for values in energies
    )
    return {
        "law": impact.law,
        "status": impact.status,
        "qpos": tuple(data.qpos.tolist()),
        "qvel_before": system.by_joint(impact.before.qvel),
        "qvel_after": system.by_joint(impact.after.qvel),
        "energy_before_J": before,
        "energy_after_J": after,
        "momentum_before": {"total": tuple(impact.before.momentum.tolist())},
        "momentum_after": {"total": tuple(impact.after.momentum.tolist())},
        "energy_change_J": impact.energy_change_J,
        "linear_momentum_change_N_s": float(np.linalg.norm(change[:3])),
        "angular_momentum_change_N_m_s": float(np.linalg.norm(change[3:])),
    }


def _friction(impact: Impact, i: int) -> dict[str, Any]:
    """Fields of a record about friction at one contact, or about its absence."""
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


def _omitted_flights(speed: float, pressing: float, restitution: float) -> tuple[float, float]:
    """Flights omitted by the rest rule at one contact: highest gap in m, and total duration in s."""
    if speed <= 0.0 or pressing <= 0.0:
        return 0.0, 0.0
    # Bounces at restitution e last 2 speed / b * (1 + e + e^2 + ...).
    left = 2.0 * speed / (pressing * (1.0 - restitution)) if restitution < 1.0 else 0.0
    return 0.5 * speed**2 / pressing, left
