"""Effort of each actuator in a run, rotation of the base, and angular momentum: who gave it, who took it."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.dynamics.rigid_body import cross, external_actuators
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.log.recorder import Sink
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.driven_joints import drives_rotation
from ffsm_mj.model.inputs import controller_of, further_inputs
from ffsm_mj.model.magnetorquers import magnetorquer_mask
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Event
from ffsm_mj.records.metadata import free_components
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import COMPONENTS, Layout, coordinate_keys, identifier, rate_keys
from ffsm_mj.verification.model_checks import grasped_objects

MEASURES = {
    "integral_u2": "integral of the applied effort squared, N^2 s or (N m)^2 s",
    "work_J": "work done by the applied effort, J",
    "peak": "greatest magnitude of the applied effort, N or N m",
    "at_bound": "share of the ticks at which the applied effort is at the least or greatest possible one",
}
"""Statistics of each actuator, by name."""
SUMMED = ("integral_u2", "work_J")
"""Those whose value of several actuators is a sum; of the others it is the greatest."""


class Effort(Sink):
    """Accumulates the effort statistics. An effort is held from one row to the next, so sums over rows are integrals.

    That of a servo varies between two rows: its numbers are those of the force at the rows, held to the next. The work of an
    effort on a joint is effort times displacement, exact while the effort is held. The work of an effort at a
    site, whose direction moves with the site, is its power at the rows, integrated by the trapezoidal rule.

    Attributes:
        base_rotation: Rotation of the base, which a free-floating robot pays its motion with.
        momentum_exchange: Angular momentum by body and actuator, before and after.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        self._system = system
        self._actuators = np.flatnonzero(~further_inputs(system.mj) & ~magnetorquer_mask(system.mj))
        self._names = tuple(system.names("actuator")[i] for i in self._actuators.tolist())
        self.base_rotation, self.momentum_exchange = BaseRotation(system), MomentumExchange(system)
        self._joint, self._gear = (part[self._actuators] for part in _drives(system.mj))
        n = len(self._names)
        self._square, self._work, self._peak, self._bounded, self._ticks = *np.zeros((4, n)), 0
        self._last: tuple[float, FloatArray, FloatArray, FloatArray] | None = None

    def open(self, header: RunHeader) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        layout, joints = header.layout, self._system.joints.values()
        suffixes = ["N_m" if drives_rotation(self._system.mj, i) else "N" for i in self._actuators.tolist()]
        units = list(zip(map(identifier, self._names), suffixes, strict=True))
        servos = servo_mask(self._system.mj)[self._actuators]
        self._time = layout.time
        self.base_rotation.open(layout)
        self.momentum_exchange.open(header)
        # A servo is at a bound where a limit of its model file changes its force.
        columns = (("applied", "force"), ("lower", "unclamped"), ("upper", "unclamped"))
        self._applied, self._lower, self._upper = (
            layout.places(
                f"actuators.{name}_{of_servo if servo else of_motor}_{suffix}"
                for (name, suffix), servo in zip(units, servos, strict=True)
            )
            for of_motor, of_servo in columns
        )
        self._servos = servos
        self._qpos, self._qvel = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        self.base_rotation.rows(block)
        self.momentum_exchange.rows(block)
        applied, lower, upper = block[:, self._applied], block[:, self._lower], block[:, self._upper]
        self._ticks += len(block)
        self._peak = np.maximum(self._peak, np.abs(applied).max(axis=0, initial=0.0))
        bounded = ((applied <= lower) | (applied >= upper)) & (upper > lower)
        self._bounded += np.where(self._servos, applied != lower, bounded).sum(axis=0)
        length, power = self._lengths_and_powers(block[:, self._qpos], block[:, self._qvel], applied)
        times = block[:, self._time]
        if self._last is not None:
            t, efforts, at, rate = self._last
            times, applied = np.append(t, times), np.vstack([efforts, applied])
            length, power = np.vstack([at, length]), np.vstack([rate, power])
        steps, efforts = np.diff(times)[:, None], applied[:-1]
        self._square = _added(self._square, efforts**2 * steps)
        self._work = _added(self._work, efforts * np.diff(length, axis=0) + 0.5 * (power[1:] + power[:-1]) * steps)
        self._last = float(times[-1]), applied[-1].copy(), length[-1].copy(), power[-1].copy()

    def _lengths_and_powers(self, qpos: FloatArray, qvel: FloatArray, applied: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates of driven scalar joints, and power of all other actuators, both (rows, actuators)."""
        model, scalar = self._system.mj, self._joint >= 0
        length, power = np.zeros_like(applied), np.zeros_like(applied)
        length[:, scalar] = qpos[:, model.jnt_qposadr[self._joint[scalar]]]
        if not scalar.all():
            data = self._data
            for row in np.flatnonzero(applied[:, ~scalar].any(axis=1)):
                data.qpos[:], data.qvel[:] = qpos[row], qvel[row]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_transmission(model, data)
                mujoco.mj_fwdVelocity(model, data)
                power[row] = np.where(scalar, 0.0, applied[row] * data.actuator_velocity[self._actuators] / self._gear)
        return length, power

    @cached_property
    def _data(self) -> Any:
        """Data for the kinematics of actuators that drive no scalar joint."""
        return mujoco.MjData(self._system.mj)

    def event(self, event: Event) -> None:
        """Note what is grasped; efforts are in the rows."""
        self.momentum_exchange.event(event)

    def summary(self) -> dict[str, Any]:
        """``effort``, ``base_rotation`` and ``angular_momentum`` of ``summary.json``; None for what is not finite."""
        effort = {
            name: {measure: value if math.isfinite(value) else None for measure, value in measures.items()}
            for name, measures in self.by_actuator().items()
        }
        return {
            "effort": effort,
            "base_rotation": self.base_rotation.summary(),
            "angular_momentum": self.momentum_exchange.summary(),
        }

    def by_actuator(self) -> dict[str, dict[str, float]]:
        """Each of :data:`MEASURES` by actuator, under its name in the columns of a log."""
        share = self._bounded / max(self._ticks, 1)
        rows = np.column_stack([self._square, self._work, self._peak, share]).tolist()
        names = map(identifier, self._names)
        return {name: dict(zip(MEASURES, row, strict=True)) for name, row in zip(names, rows, strict=True)}


def _added(total: FloatArray, terms: FloatArray) -> FloatArray:
    """Sum term by term, so that its bits do not depend on the division of the rows into blocks."""
    return np.asarray(np.cumsum(np.vstack([total, terms]), axis=0)[-1])


def _drives(model: Any) -> tuple[IntArray, FloatArray]:
    """Hinge or slide that each actuator drives, -1 for none; ratio of MuJoCo's actuator velocity to the joint's."""
    on_joint = np.asarray(model.actuator_trntype) == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = np.where(on_joint, np.asarray(model.actuator_trnid)[:, 0], -1).astype(np.intp)
    kinds = np.asarray(model.jnt_type)[joint]
    scalar = on_joint & np.isin(kinds, (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)))
    gear = np.where(on_joint, np.asarray(model.actuator_gear)[:, 0], 1.0)
    return np.where(scalar, joint, -1), gear


class BaseRotation:
    """Accumulates the angle between the orientation of the base and that at the first row.

    About the axis of a hinge it is the angle turned by, else the angle of the rotation, at most pi.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        robot = system.robot
        turning = [joint for joint in robot.joints if joint.body == robot.root and joint.kind != "slide"]
        self._keys = coordinate_keys(turning)[-1 if turning[0].kind == "hinge" else -4 :] if len(turning) == 1 else ()
        self._first: FloatArray | None = None
        self._final_rad, self._largest_rad = 0.0, 0.0

    def open(self, layout: Layout) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        self._places = layout.places(self._keys)

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        if not self._keys or not len(block):
            return
        columns = block[:, self._places]
        if self._first is None:
            self._first = columns[0].copy()
        angles = np.abs(columns[:, 0] - self._first[0]) if len(self._keys) == 1 else _angles(columns, self._first)
        self._final_rad, self._largest_rad = float(angles[-1]), max(self._largest_rad, float(angles.max()))

    def summary(self) -> dict[str, float] | None:
        """``final_rad`` at the last row, ``largest_rad`` over all rows; None if the base does not turn by one joint."""
        if self._first is None or not np.isfinite((self._final_rad, self._largest_rad)).all():
            return None
        return {"final_rad": self._final_rad, "largest_rad": self._largest_rad}


def _angles(quaternions: FloatArray, first: FloatArray) -> FloatArray:
    """Angles between unit quaternions and another one, rad, (n,).

    From the chords to it and to its opposite, which is the same orientation: precise for small angles too.
    """
    chords = [np.linalg.norm(quaternions + sign * first, axis=1) for sign in (1.0, -1.0)]
    return np.asarray(4.0 * np.arctan2(np.minimum(*chords), np.maximum(*chords)))


_OUTSIDE = ("external", "external_on_objects", "fixed_on_robot", "fixed_on_objects")
_FIELDS = ("field_on_robot", "field_on_objects")


class _OuterLoad(NamedTuple):
    """Centre of mass, (3,), total force, (3,), and moment of each outer actuator about that centre, (nu, 3)."""

    centre: FloatArray
    force: FloatArray
    moments: FloatArray


class MomentumExchange:
    """Accumulates the angular momentum that comes from outside, and compares the last state with the first, body by body.

    All of it is about the centre of mass of everything that moves, in world axes, so that it is the same in every inertial
    frame. The total changes by what acts from outside alone: thrusters, actuators on the base, fixed bodies, fields. Uniform
    gravity has no moment about that centre.

    What comes from outside is taken from the balance, whose moments are about the world origin: with c the centre of mass
    between two rows, dL = dL_origin - c x dP. The share of one thruster is its moment at the rows by the trapezoidal
    rule.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        self._system, self._model, self._stack = system, system.mj, StackMomentum(system)
        self._names = tuple(map(identifier, system.names("actuator")))
        self._outer, self._dipoles = np.flatnonzero(external_actuators(system)), np.flatnonzero(magnetorquer_mask(system.mj))
        self._external, self._by_actuator = np.zeros(3), np.zeros((len(self._names), 3))
        self._passed = np.zeros(len(self._names))
        self._events: list[Any] = []
        self._first: FloatArray | None = None
        self._last: FloatArray | None = None
        self._place: FloatArray | None = None

    def open(self, header: RunHeader) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        layout, joints = header.layout, self._system.joints.values()
        self._time = layout.time
        self._qpos, self._qvel = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))
        suffixes = ["N_m" if drives_rotation(self._model, i) else "N" for i in range(len(self._names))]
        for i in self._dipoles.tolist():
            suffixes[i] = "A_m2"
        what = np.where(servo_mask(self._model), "force", "applied").tolist()
        names = [self._names[controller_of(self._model, i)] for i in range(len(self._names))]  # inputs have no force
        self._applied = layout.places(
            f"actuators.{name}_{column}_{suffix}" for name, column, suffix in zip(names, what, suffixes, strict=True)
        )
        self._impulses, self._fields = (
            [
                layout.places(f"balance.{name}_{component}" for component in COMPONENTS)
                for name in names
                if f"balance.{name}_{COMPONENTS[0]}" in layout.index
            ]
            for names in (_OUTSIDE, _FIELDS)
        )
        self._momentum = layout.places(f"momentum.total_{component}" for component in COMPONENTS[:3])
        self._free = free_components(header.metadata, "total")[3:]

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        if not len(block):
            return
        if self._first is None:
            self._first = self._last = block[0].copy()
            block = block[1:]
        assert self._last is not None
        rows = np.vstack((self._last, block))
        steps, efforts = np.diff(rows[:, self._time]), rows[:-1, self._applied]
        self._passed = np.cumsum(np.vstack((self._passed, efforts * steps[:, None])), axis=0)[-1]
        changes = np.zeros((len(block), 6))
        for places in self._impulses:
            changes += np.diff(rows[:, places], axis=0)
        for i in np.flatnonzero(changes.any(axis=1)).tolist():
            before, after = self._moments(rows[i], efforts[i]), self._moments(rows[i + 1], efforts[i])
            # Of c x F with both linear in time: the product of the means, and a twelfth of that of the changes.
            turning = cross(after.centre - before.centre, after.force - before.force) * (float(steps[i]) / 12.0)
            middle = 0.5 * (before.centre + after.centre)
            self._external += changes[i, 3:] - cross(middle, changes[i, :3]) - turning
            self._by_actuator += 0.5 * float(steps[i]) * (before.moments + after.moments)
        if self._fields:
            self._add_fields(rows, steps)
        self._last = rows[-1].copy()

    def _add_fields(self, rows: FloatArray, steps: FloatArray) -> None:
        """Add the angular impulse of fields between rows: they act all the time, and change little from row to row.

        The centre of mass c moves at P / m, so no row needs its kinematics; the force F is the slope of the impulse. Of
        c x F with both linear between rows see :meth:`rows`.
        """
        if self._place is None:
            self._place = self._centre(self._state(rows[0]))
        if len(rows) < 2:
            return
        mass = float(self._model.body_subtreemass[[tree.root for tree in self._system.trees]].sum())
        speeds, dt = rows[:, self._momentum] / mass, steps[:, None]
        impulses = np.sum([rows[:, places] for places in self._fields], axis=0)
        changes = np.diff(impulses, axis=0)
        with np.errstate(all="ignore"):  # a damaged log may repeat a time; what is not finite is no summary
            forces = np.gradient(impulses[:, :3], rows[:, self._time], axis=0, edge_order=2 if len(rows) > 2 else 1)
        turned = np.diff(forces, axis=0)
        moved = np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * dt - turned * dt**2 / (12.0 * mass), axis=0)
        places = self._place + np.vstack((np.zeros(3), moved))
        middle, turning = 0.5 * (places[1:] + places[:-1]), np.cross(np.diff(places, axis=0), turned) * dt / 12.0
        self._external += (changes[:, 3:] - np.cross(middle, changes[:, :3]) - turning).sum(axis=0)
        self._place = places[-1]

    def event(self, event: Any) -> None:
        """Note the closing or release of a grasp."""
        if isinstance(event, GraspRecord | ReleaseRecord):
            self._events.append(event)

    def _moments(self, row: FloatArray, efforts: FloatArray) -> _OuterLoad:
        """Load of the outer actuators under efforts at the state of a row."""
        data = self._state(row)
        moments, centre, total = np.zeros((len(efforts), 3)), self._centre(data), np.zeros(3)
        for i in self._outer[efforts[self._outer] != 0.0].tolist():
            force, moments[i] = self._load(data, i, float(efforts[i]), centre)
            total += force
        return _OuterLoad(centre, total, moments)

    def _load(self, data: Any, actuator: int, effort: float, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Force of an actuator at a site, or on a joint of the base, and its moment about a point."""
        model = self._model
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_SITE:
            site = int(model.actuator_trnid[actuator, 0])
            force, torque = model.actuator_gear[actuator].reshape(2, 3) @ data.site_xmat[site].reshape(3, 3).T * effort
            return force, torque + cross(data.site_xpos[site] - centre, force)
        joint = int(model.actuator_trnid[actuator, 0])
        axis = data.xaxis[joint] * effort
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            return np.zeros(3), axis
        return axis, cross(data.xanchor[joint] - centre, axis)

    def _state(self, row: FloatArray) -> Any:
        data = self._data
        data.qpos[:], data.qvel[:] = row[self._qpos], row[self._qvel]
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        return data

    @cached_property
    def _data(self) -> Any:
        return mujoco.MjData(self._model)

    def _centre(self, data: Any) -> FloatArray:
        roots = [tree.root for tree in self._system.trees]
        masses = self._model.body_subtreemass[roots]
        return np.asarray(masses @ data.subtree_com[roots] / masses.sum())

    def summary(self) -> dict[str, Any] | None:
        """``angular_momentum`` of ``summary.json``; None without rows, or where a number is not finite."""
        if self._first is None or self._last is None:
            return None
        (bodies0, spin0), (bodies1, spin1) = self._parts(self._first), self._parts(self._last)
        initial, final = sum(bodies0.values(), np.zeros(3)), sum(bodies1.values(), np.zeros(3))
        residual = (final - initial - self._external) * self._free
        if not np.isfinite([initial, final, self._external]).all() or not np.isfinite(self._passed).all():
            return None
        return {
            "initial_N_m_s": initial.tolist(),
            "external_N_m_s": self._external.tolist(),
            "final_N_m_s": final.tolist(),
            "stack_without_wheels_N_m_s": self._stack_without_wheels(),
            "residual_N_m_s": math.hypot(*residual.tolist()),
            "subsystems": _changes(self._subsystems(bodies0, spin0), self._subsystems(bodies1, spin1)),
            "bodies": _changes(bodies0, bodies1),
            "actuators": self._actuators(spin0, spin1),
        }

    def _stack_without_wheels(self) -> float:
        """|L| at the end of robot and grasped object about their own centre of mass, without the wheels."""
        assert self._last is not None
        rest, _ = self._stack.parts(self._state(self._last), grasped_objects(self._events))
        return math.hypot(*rest.tolist())

    def _parts(self, row: FloatArray) -> tuple[dict[str, FloatArray], FloatArray]:
        """Angular momentum of each body, and that of each wheel relative to its bearing, (n, 3)."""
        model, data = self._model, self._state(row)
        mujoco.mj_fwdVelocity(model, data)
        centre, twist, by_body = self._centre(data), np.empty(6), {}
        total = mass = 0.0
        velocities = {}
        for body in [body for tree in self._system.trees for body in tree.bodies]:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
            velocities[body] = twist.copy()
            total, mass = total + model.body_mass[body] * twist[3:], mass + model.body_mass[body]
        for body, (*spin, x, y, z) in velocities.items():
            frame = data.ximat[body].reshape(3, 3)
            about_centre = frame @ (model.body_inertia[body] * (frame.T @ np.array(spin)))
            relative = np.array([x, y, z]) - total / mass
            by_body[model.body(body).name] = about_centre + model.body_mass[body] * cross(
                data.xipos[body] - centre, relative
            )
        columns = self._stack.wheel_columns(data)
        return by_body, columns.T * data.qvel[self._stack.dofs][:, None]

    def _subsystems(self, bodies: dict[str, FloatArray], spin: FloatArray) -> dict[str, FloatArray]:
        """Angular momentum of each tree, of the robot without its wheels."""
        groups = {}
        for tree in self._system.trees:
            groups[tree.name] = sum((bodies[self._model.body(body).name] for body in tree.bodies), np.zeros(3))
        if len(spin):
            wheels = spin.sum(axis=0)
            robot = groups.pop("robot") - wheels
            return {"robot without wheels": robot, "wheels": wheels, **groups}
        return groups

    def _actuators(self, spin0: FloatArray, spin1: FloatArray) -> dict[str, dict[str, Any]]:
        """By actuator: ``impulse`` is its effort over time, ``taken_N_m_s`` what a wheel stores or a thruster brings.

        What magnetorquers bring is that of external fields.
        """
        actuators: dict[str, dict[str, Any]] = {}
        for i in np.flatnonzero(~further_inputs(self._model) & ~magnetorquer_mask(self._model)).tolist():
            name, on_joint = self._names[i], self._model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
            joint = self._model.joint(int(self._model.actuator_trnid[i, 0])).name if on_joint else ""
            exchanged, kind = np.zeros(3), "joint"
            if i in self._outer:
                exchanged, kind = self._by_actuator[i], "external"
            elif joint in self._stack.wheels:
                k = self._stack.wheels.index(joint)
                exchanged, kind = spin1[k] - spin0[k], "wheel"
            unit = "N_m_s" if drives_rotation(self._model, i) else "N_s"
            actuators[name] = {"kind": kind, f"impulse_{unit}": float(self._passed[i]), "taken_N_m_s": exchanged.tolist()}
        return actuators


def _changes(before: dict[str, FloatArray], after: dict[str, FloatArray]) -> dict[str, dict[str, list[float]]]:
    return {name: {"before_N_m_s": before[name].tolist(), "after_N_m_s": after[name].tolist()} for name in before}
