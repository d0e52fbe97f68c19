"""The contact that every configuration of an impact map reaches, and the configurations of the robot that reach it.

These are its self-motion manifold at the contact (Burdick 1989): the robot's geom keeps its contact point and its normal
there, so it may turn about the normal; a sphere may turn about its centre. Of a floating base the centre of mass of the
robot keeps its place, or the base keeps its pose, or neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.simulator import Simulator
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.grasp.records import GraspRecord
from ffsm_mj.dynamics.rigid_body import base_jacobian, mass_matrix, momentum_matrix, skew
from ffsm_mj.errors import InputError
from ffsm_mj.impact import Contact
from ffsm_mj.model.system import Joint, System
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.scenario.overrides import Overrides

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
    overrides: Overrides = (),
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
            if any(isinstance(event, GraspRecord) for event in step.events):
                raise InputError(
                    f"{simulator.assembly.scenario.name}: a grasp closes before impact {impact}; no map is made"
                )
            event_impacts = [event for event in step.events if isinstance(event, ImpactRecord) and event.event == impact - 1]
            if event_impacts:
                initial = simulator.assembly.scenario.initial
                keys = {simulator.system.joint(key).name: key for key in (*initial.joints, *initial.rates)}
                return _from_records(simulator.assembly, event_impacts), keys
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
        names = ", ".join(hit.pair for hit in records)
        raise InputError(f"{where} has {len(records)} contacts at one instant ({names}); a map is of one contact point")
    pair = next((candidate for candidate in assembly.pairs if candidate.name == record.pair), None)
    if pair is None:
        raise InputError(f"{where} is at a joint limit; a map is of a contact of the robot with an object")
    on_robot = [body in system.robot.bodies for body in (pair.body_a, pair.body_b)]
    if sum(on_robot) != 1:
        raise InputError(f"{where} is of {pair}; a map is of a contact of the robot with an object")
    # The arrays of the simulator end with it.
    model_copy = system.copy()
    qvel = np.concatenate([record.qvel_before[joint] for joint in model_copy.joints])
    e, outward = record.restitution_used, np.array(record.normal) * (1.0 if on_robot[0] else -1.0)
    # The root finder leaves a gap of rounding, which configurations must not inherit: half of it is each side's.
    point = np.array(record.point_m) + 0.5 * record.gap_m * outward
    of_pair = (e, record.mu, record.compliance_ratio)
    contact = Contact(pair.body_a, pair.body_b, point, np.array(record.normal), *of_pair)
    ignored, law = assembly.contacts.ignored, assembly.scenario.impact.law
    target = Target(
        model_copy, pair, contact, np.array(record.qpos), qvel, np.zeros(3), np.zeros(3), law, ignored, record.time_s
    )
    a, b = (_point_velocity(target, body, point) for body in (pair.body_a, pair.body_b))
    return replace(target, velocity=b - a, tip_velocity=a if on_robot[0] else b)


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


Hold = Literal["com", "base", "nothing"]
HOLDS: tuple[Hold, ...] = ("com", "base", "nothing")
REACHED = 1e-12
"""Largest residual of a configuration that reaches the contact, m and 1: rounding of positions of some metres."""
_MOST_STEPS, _LARGEST_STEP = 60, 1.0
"""Steps of Gauss-Newton, which converges quadratically near a solution, and the largest of a joint, rad or m: far from one
the linearization is no guide beyond it. Sixty are several turns of every joint."""
_SCALAR = ("hinge", "slide")
_NO_BOUNDS: Mapping[str, Sequence[float]] = MappingProxyType({})


class SelfMotion:
    """The configurations of a robot that reach a target.

    Attributes:
        target: The contact.
        hold: What of a floating base is kept.
        dofs: Degrees of freedom that move, those of the base included unless its pose is kept.
        bounds: Lowest and highest coordinate of each moving hinge and slide by dof; infinite without a range.
        free_directions: Directions in which the base joints let the robot move as a whole, (3, k).
        free_axes: Axes about which they let it turn about its centre of mass, (3, k).
    """

    def __init__(self, target: Target, hold: Hold = "com", bounds: Mapping[str, Sequence[float]] = _NO_BOUNDS) -> None:
        """Find the moving joints and the bounds.

        Raises:
            InputError: An unknown ``hold``, or a bound of something else than a moving joint of one coordinate.
        """
        if hold not in HOLDS:
            raise InputError(f"hold: {hold!r}, allowed are {', '.join(HOLDS)}")
        self.target, self.hold = target, hold
        system, model = target.system, target.system.mj
        tree = system.robot
        base = range(tree.base_dofs.start, tree.base_dofs.stop)
        self.base_dofs = np.array(base, dtype=np.intp)
        self.dofs = np.array([*(base if hold != "base" else ()), *target.arm_dofs], dtype=np.intp)
        self.bounds = {
            joint.dofs.start: _range(model, joint)
            for joint in tree.joints
            if joint.kind in _SCALAR and joint.dofs.start in self.dofs.tolist()
        }
        self._narrow(bounds)
        data = target.data()
        self._data = target.data()
        self.com = np.array(data.subtree_com[tree.root])
        self.free_directions, self.free_axes = _free(base_jacobian(model, data, tree), self.com)
        turn = data.geom_xmat[target.geom].reshape(3, 3)
        self._is_sphere = int(model.geom_type[target.geom]) == int(mujoco.mjtGeom.mjGEOM_SPHERE)
        # Where a sphere touches changes as it turns; its centre is one radius from the contact point.
        radius = float(model.geom_size[target.geom, 0]) if self._is_sphere else 0.0
        start = _reference_contact(target, data)
        self._point = turn.T @ (start[0] - data.geom_xpos[target.geom])
        self._normal = turn.T @ start[1]
        self._centre = target.contact.point - radius * target.outward

    def _narrow(self, bounds: Mapping[str, Sequence[float]]) -> None:
        """Take narrower ranges of joints.

        Raises:
            InputError: No such joint, or no such range.
        """
        for name, bound in bounds.items():
            try:
                joint = self.target.system.joint(name)
            except LookupError as error:
                raise InputError(f"bounds: {error.args[0]}") from None
            if joint.dofs.start not in self.bounds:
                raise InputError(f"bounds: {joint.name} is no moving hinge or slide of the robot")
            low, high = self.bounds[joint.dofs.start]
            if len(bound) != 2 or not low <= bound[0] < bound[1] <= high:
                raise InputError(
                    f"bounds: {joint.name}: {list(bound)}, allowed are two rising numbers from {low:g} to {high:g}"
                )
            self.bounds[joint.dofs.start] = (float(bound[0]), float(bound[1]))

    def residual(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual of the conditions at a configuration and its Jacobian by the moving dofs, (m,) and (m, n)."""
        model, data, target = self.target.system.mj, self._data, self.target
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        jacp, jacr = np.empty((3, model.nv)), np.empty((3, model.nv))
        place, turn = data.geom_xpos[target.geom], data.geom_xmat[target.geom].reshape(3, 3)
        if self._is_sphere:
            mujoco.mj_jac(model, data, jacp, None, place, target.body)
            residuals, rows = [place - self._centre], [jacp]
        else:
            point, normal = place + turn @ self._point, turn @ self._normal
            mujoco.mj_jac(model, data, jacp, jacr, point, target.body)
            residuals = [point - target.contact.point, normal - target.outward]
            rows = [jacp, -skew(normal) @ jacr]
        if self.hold == "com" and self.free_directions.size:
            com = np.empty((3, model.nv))
            mujoco.mj_jacSubtreeCom(model, data, com, target.system.robot.root)
            residuals.append(self.free_directions.T @ (data.subtree_com[target.system.robot.root] - self.com))
            rows.append(self.free_directions.T @ com)
        return np.concatenate(residuals), np.vstack(rows)[:, self.dofs]

    def displaced(self, qpos: FloatArray, step: FloatArray) -> FloatArray:
        """A configuration displaced by a step of the moving dofs, (n,), within the bounds."""
        velocity, out = np.zeros(self.target.system.mj.nv), np.array(qpos)
        velocity[self.dofs] = step
        mujoco.mj_integratePos(self.target.system.mj, out, velocity, 1.0)
        return self._bounded(out)

    def projected(self, qpos: FloatArray) -> tuple[FloatArray, float]:
        """The configuration that Gauss-Newton steps of least length reach from another, and its residual.

        Joints stay within their bounds; a residual above :data:`REACHED` is that of a configuration that does not reach.
        """
        best, least = qpos, math.inf
        for _ in range(_MOST_STEPS):
            r, J = self.residual(qpos)
            size = float(np.abs(r).max())
            if size < least:
                best, least = qpos, size
            elif size <= REACHED:
                break
            step = -np.asarray(np.linalg.lstsq(J, r, rcond=1e-10)[0], dtype=np.float64)
            qpos = self.displaced(qpos, step * min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-300)))
        return best, least

    def drawn(self, random: np.random.Generator) -> FloatArray:
        """A configuration of the arm and an attitude of the base, drawn evenly between the bounds; it need not reach."""
        qpos, tree = self.target.qpos.copy(), self.target.system.robot
        step = np.zeros(len(self.dofs))
        for joint in tree.joints:
            for k, dof in enumerate(range(joint.dofs.start, joint.dofs.stop)):
                coordinates = np.flatnonzero(self.dofs == dof)
                turns = joint.kind in ("hinge", "ball") or (joint.kind == "free" and k >= 3)
                bounded = np.isfinite(self.bounds.get(dof, (-math.inf, math.inf))).all()
                if not len(coordinates) or not (turns or bounded):
                    continue
                if bounded:
                    qpos[joint.qpos] = random.uniform(*self.bounds[dof])
                else:
                    step[coordinates] = random.uniform(-math.pi, math.pi)
        return self.displaced(qpos, step)

    def _bounded(self, qpos: FloatArray) -> FloatArray:
        """Within the bounds; hinges without a range within half a turn of zero."""
        for joint in self.target.system.robot.joints:
            if (bounds := self.bounds.get(joint.dofs.start)) is None or joint.kind not in _SCALAR:
                continue
            value = float(qpos[joint.qpos.start])
            if joint.kind == "hinge" and not np.isfinite(bounds).any():
                value = math.remainder(value, 2.0 * math.pi) if abs(value) > math.pi else value
            qpos[joint.qpos.start] = min(max(value, bounds[0]), bounds[1])
        return qpos


def _range(model: Any, joint: Joint) -> tuple[float, float]:
    """Range of a hinge or slide."""
    mj_joint = model.joint(joint.name)
    low, high = map(float, mj_joint.range) if mj_joint.limited[0] else (-math.inf, math.inf)
    return low, high


def _free(base: FloatArray, com: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions and axes through a point in which base joints leave a body free, from their twists about the origin."""
    if base.shape[1] == 0:
        return np.zeros((3, 0)), np.zeros((3, 0))
    blocked = np.eye(6) - base @ np.linalg.pinv(base)
    return _null_space(blocked[:, :3]), _null_space(blocked @ np.vstack((skew(com), np.eye(3))))


def _null_space(matrix: FloatArray) -> FloatArray:
    _, values, rows = np.linalg.svd(matrix)
    return np.asarray(rows[values <= 1e-9].T)


def _reference_contact(target: Target, data: Any) -> tuple[FloatArray, FloatArray]:
    """Contact point and outward normal of the impact in the run, from the pair: a target may have been moved elsewhere."""
    near = target.pair.proximity(target.system.mj, data)
    normal = near.normal if target.robot_is_a else -near.normal
    return near.points[0] - 0.5 * near.gap * normal, normal


_RANK = 1e-9
"""Singular values of the conditions below this share of the largest are zero: there the arm is singular."""
_SATISFIED = 1e-9
"""Largest residual of the conditions, over their size, of velocities that satisfy them."""


class ArrivalRates:
    """Velocities with which configurations arrive at a target."""

    def __init__(self, motion: SelfMotion) -> None:
        """Take the momenta from the state of the run."""
        target = motion.target
        self._motion, self._data = motion, target.data()
        self._momentum = self._conditions(target.qpos)[0][3:] @ target.qvel
        self._moving = np.unique(np.concatenate((motion.base_dofs, motion.dofs)))
        self._others = np.setdiff1d(np.arange(target.system.mj.nv), self._moving)

    def velocities(self, qpos: FloatArray) -> FloatArray | None:
        """Velocities of the scene at a configuration, (nv,); None if no rates of the arm satisfy the conditions."""
        target, moving, others = self._motion.target, self._moving, self._others
        A, M = self._conditions(qpos)
        qvel = target.qvel.copy()
        wanted = np.concatenate((target.tip_velocity, self._momentum)) - A[:, others] @ qvel[others]
        L = np.linalg.cholesky(M[np.ix_(moving, moving)])
        # In w = L^T v + L^-1 M_mo v_o the kinetic energy is |w|^2 / 2 and a constant: the shortest w has the least.
        driven = np.linalg.solve(L, M[np.ix_(moving, others)] @ qvel[others])
        B = np.linalg.solve(L, A[:, moving].T).T
        w = np.linalg.lstsq(B, wanted + B @ driven, rcond=_RANK)[0]
        qvel[moving] = np.linalg.solve(L.T, w - driven)
        miss = np.abs(A[:, moving] @ qvel[moving] - wanted).max()
        return qvel if miss <= _SATISFIED * (1.0 + float(np.abs(wanted).max())) else None

    def _conditions(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows that give the velocity of the contact point and the free momenta, (3 + k, nv), and the mass matrix."""
        motion, data = self._motion, self._data
        system = motion.target.system
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(system.mj, data)
        jacp, root = np.empty((3, system.mj.nv)), system.robot.root
        mujoco.mj_jac(system.mj, data, jacp, None, motion.target.contact.point, motion.target.body)
        momenta = momentum_matrix(system.mj, data, root)
        about_com = momenta[3:] - skew(data.subtree_com[root]) @ momenta[:3]
        rows = (jacp, motion.free_directions.T @ momenta[:3], motion.free_axes.T @ about_com)
        return np.vstack(rows), mass_matrix(system.mj, data)
