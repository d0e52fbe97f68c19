"""The contact that every configuration of an impact map reaches: an impact of a scenario, or one moved elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.simulator import Simulator
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.records import GraspRecord
from ffsm_mj.dynamics.rigid_body import skew
from ffsm_mj.errors import InputError
from ffsm_mj.impact import Contact
from ffsm_mj.model.system import Joint, System
from ffsm_mj.records.events import ImpactRecord

Vector = Sequence[float]


@dataclass(frozen=True, eq=False)
class Target:
    """A contact of the robot with something else, and the state of the whole scene there.

    Attributes:
        system: Robot and objects.
        pair: The two geoms.
        contact: Contact point, normal from a to b, restitution and friction.
        qpos: Configuration of the scene in the run, (nq,).
        qvel: Its velocity before the impact, (nv,).
        velocity: Velocity of b relative to a at the contact point before the impact in world axes, (3,), m/s.
        tip_velocity: Velocity of the robot's point at the contact in world axes, (3,), m/s.
        law: Name of the impact law.
        ignored: Geom ids of pairs whose overlaps the scenario ignores.
        time_s: Time of the impact in the run.
    """

    system: System
    pair: ContactPair
    contact: Contact
    qpos: FloatArray
    qvel: FloatArray
    velocity: FloatArray
    tip_velocity: FloatArray
    law: str
    ignored: frozenset[frozenset[int]]
    time_s: float

    @property
    def robot_is_a(self) -> bool:
        """Whether geom a is the robot's."""
        return self.pair.body_a in self.system.robot.bodies

    @property
    def geom(self) -> int:
        """Id of the robot's geom."""
        return self.pair.ids[0 if self.robot_is_a else 1]

    @property
    def body(self) -> int:
        """Id of the body of the robot's geom."""
        return self.pair.body_a if self.robot_is_a else self.pair.body_b

    @property
    def other_body(self) -> int:
        """Id of the body that the robot hits."""
        return self.pair.body_b if self.robot_is_a else self.pair.body_a

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the arm: those between the base and the robot's geom, from the base outwards."""
        bodies, body = set[int](), self.body
        while body != self.system.robot.root:
            bodies.add(body)
            body = int(self.system.mj.body_parentid[body])
        return tuple(joint for joint in self.system.robot.joints if joint.body in bodies)

    @property
    def arm_dofs(self) -> list[int]:
        """Degrees of freedom of these joints."""
        return [dof for joint in self.joints for dof in range(joint.dofs.start, joint.dofs.stop)]

    @property
    def outward(self) -> FloatArray:
        """Unit normal from the robot to what it hits, (3,)."""
        return self.contact.normal if self.robot_is_a else -self.contact.normal

    @property
    def approach_speed(self) -> float:
        """Speed of approach along the normal, m/s."""
        return -float(self.velocity @ self.contact.normal)

    def data(self) -> Any:
        """New MuJoCo data in the state of the run before the impact, derived quantities current."""
        data = mujoco.MjData(self.system.mj)
        data.qpos[:], data.qvel[:] = self.qpos, self.qvel
        mujoco.mj_forward(self.system.mj, data)
        return data


def target_of(
    scenario: str | Path,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    impact: int = 1,
    report: Callable[[float, float], None] | None = None,
) -> tuple[Target, dict[str, str]]:
    """Simulate a scenario up to one of its impacts, which becomes the target.

    Args:
        scenario: A path, or the name of a shipped scenario.
        overrides: See :func:`ffsm_mj.run`.
        impact: Which impact of the run, from 1.
        report: Told (simulation time, duration) in s.

    Returns:
        The target, and the names that the scenario gives joints, by full name.

    Raises:
        InputError: The run has no such impact, or it is not one contact point of the robot with something else.
    """
    if impact < 1:
        raise InputError(f"impact: {impact}, allowed are the numbers of impacts, from 1")
    with Simulator(scenario, overrides, record=False) as simulator:
        simulator.reset()
        duration_s = simulator.assembly.scenario.duration_s
        if place := next(iter(simulator.system.equalities.values()), ""):
            raise InputError(
                f"{place} constrains the joints: no map is made; maps are of arms whose joints are independent "
                "(robot.strip: [equalities])"
            )
        while simulator.ended is None:
            step = simulator.step(until="event")
            if report is not None:
                report(simulator.time_s, duration_s)
            if any(isinstance(each, GraspRecord) for each in step.events):
                raise InputError(
                    f"{simulator.assembly.scenario.name}: a grasp closes before impact {impact}; no map is made"
                )
            found = [each for each in step.events if isinstance(each, ImpactRecord) and each.event == impact - 1]
            if found:
                initial = simulator.assembly.scenario.initial
                keys = {simulator.system.joint(key).name: key for key in (*initial.joints, *initial.rates)}
                return _from_records(simulator.assembly, found), keys
        name, end_s, how = simulator.assembly.scenario.name, simulator.time_s, simulator.ended.outcome.value
    raise InputError(f"{name}: the run has no impact {impact}; it ends at {end_s:.6g} s ({how})")


def _from_records(assembly: Assembly, records: Sequence[ImpactRecord]) -> Target:
    """Target from the records of one impact.

    Raises:
        InputError: It is not one contact point of the robot with something else.
    """
    record, system = records[0], assembly.system
    where = f"{assembly.scenario.name}: impact {record.event + 1} at {record.time_s:.6g} s"
    if len(records) > 1:
        names = ", ".join(each.pair for each in records)
        raise InputError(f"{where} has {len(records)} contacts at one instant ({names}); a map is of one contact point")
    pair = next((each for each in assembly.pairs if each.name == record.pair), None)
    if pair is None:
        raise InputError(f"{where} is at a joint limit; a map is of a contact of the robot with an object")
    on_robot = [body in system.robot.bodies for body in (pair.body_a, pair.body_b)]
    if sum(on_robot) != 1:
        raise InputError(f"{where} is of {pair}; a map is of a contact of the robot with an object")
    # The arrays of the simulator end with it.
    own = system.copy()
    qvel = np.concatenate([record.qvel_before[joint] for joint in own.joints])
    e, outward = record.restitution_used, np.array(record.normal) * (1.0 if on_robot[0] else -1.0)
    # The root finder leaves a gap of rounding, which configurations must not inherit: half of it is each side's.
    point = np.array(record.point_m) + 0.5 * record.gap_m * outward
    contact = Contact(pair.body_a, pair.body_b, point, np.array(record.normal), e, record.mu)
    ignored, law = assembly.contacts.ignored, assembly.scenario.impact.law
    here = Target(own, pair, contact, np.array(record.qpos), qvel, np.zeros(3), np.zeros(3), law, ignored, record.time_s)
    a, b = (_point_velocity(here, body, point) for body in (pair.body_a, pair.body_b))
    return replace(here, velocity=b - a, tip_velocity=a if on_robot[0] else b)


def moved(target: Target, point: Vector | None, normal: Vector | None) -> Target:
    """The target at another point of the object, with the same velocity relative to the normal there.

    Args:
        target: The target.
        point: Contact point in world axes at the instant of the impact, m; None: as it is.
        normal: Normal from the robot to the object in world axes; None: as it is.

    Raises:
        InputError: The normal has no direction.
    """
    if point is None and normal is None:
        return target
    where = target.contact.point if point is None else np.array(point, dtype=np.float64)
    outward = target.outward if normal is None else np.array(normal, dtype=np.float64)
    if not (np.isfinite(where).all() and np.isfinite(outward).all() and np.linalg.norm(outward) > 0.0):
        raise InputError(
            f"point {list(where)}, normal {list(outward)}: three finite numbers each, and a normal of some length"
        )
    outward = outward / np.linalg.norm(outward)
    turn = _turn(target.outward, outward)
    velocity = turn @ target.velocity
    other = _point_velocity(target, target.other_body, where)
    contact = replace(target.contact, point=where, normal=outward if target.robot_is_a else -outward)
    tip_velocity = other - velocity if target.robot_is_a else other + velocity
    return replace(target, contact=contact, velocity=velocity, tip_velocity=tip_velocity)


def _point_velocity(target: Target, body: int, point: FloatArray) -> FloatArray:
    """Velocity of a point fixed to a body, (3,), m/s."""
    data, jacobian = target.data(), np.empty((3, target.system.mj.nv))
    mujoco.mj_jac(target.system.mj, data, jacobian, None, point, body)
    return np.asarray(jacobian @ target.qvel)


def _turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """The smallest rotation that takes one unit vector to another, (3, 3)."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -1.0 + 1e-12:  # half a turn about any axis across a
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    K = skew(axis)
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + cosine))
