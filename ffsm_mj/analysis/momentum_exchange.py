"""Angular momentum of a run by body, subsystem and actuator, before and after: who gave it, who took it.

All of it is about the centre of mass of everything that moves, in world axes, so that it is the same in every inertial
frame. The total changes by what acts from outside alone: thrusters, actuators on the base, fixed bodies. Uniform gravity
has no moment about that centre.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.dynamics.rigid_body import cross, external_actuators
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.driven_joints import drives_rotation
from ffsm_mj.model.inputs import controller_of, further_inputs
from ffsm_mj.model.system import System
from ffsm_mj.records.header import RunHeader
from ffsm_mj.records.metadata import free_components
from ffsm_mj.records.signals import COMPONENTS, coordinate_keys, identifier, rate_keys
from ffsm_mj.verification.model_checks import grasped_objects

_OUTSIDE = ("external", "external_on_objects", "fixed_on_robot", "fixed_on_objects")


class _OuterLoad(NamedTuple):
    """Centre of mass, (3,), total force, (3,), and moment of each outer actuator about that centre, (nu, 3)."""

    centre: FloatArray
    force: FloatArray
    moments: FloatArray


class MomentumExchange:
    """Accumulates the angular momentum that comes from outside, and compares the last state with the first.

    What comes from outside is taken from the balance, whose moments are about the world origin: with c the centre of mass
    between two rows, dL = dL_origin - c x dP. The share of one thruster is its moment at the rows by the trapezoidal
    rule.
    """

    def __init__(self, system: System) -> None:
        """Bind to robot and objects."""
        self._system, self._model, self._stack = system, system.mj, StackMomentum(system)
        self._names = tuple(map(identifier, system.names("actuator")))
        self._outer = np.flatnonzero(external_actuators(system))
        self._external, self._by_actuator = np.zeros(3), np.zeros((len(self._names), 3))
        self._passed = np.zeros(len(self._names))
        self._events: list[Any] = []
        self._first: FloatArray | None = None
        self._last: FloatArray | None = None

    def open(self, header: RunHeader) -> None:
        """Find the columns of a run.

        Raises:
            KeyError: The log lacks one of them.
        """
        layout, joints = header.layout, self._system.joints.values()
        self._time = layout.time
        self._qpos, self._qvel = layout.places(coordinate_keys(joints)), layout.places(rate_keys(joints))
        suffixes = ["N_m" if drives_rotation(self._model, i) else "N" for i in range(len(self._names))]
        what = np.where(servo_mask(self._model), "force", "applied").tolist()
        names = [self._names[controller_of(self._model, i)] for i in range(len(self._names))]  # inputs have no force
        self._applied = layout.places(
            f"actuators.{name}_{column}_{suffix}" for name, column, suffix in zip(names, what, suffixes, strict=True)
        )
        there = [name for name in _OUTSIDE if f"balance.{name}_{COMPONENTS[0]}" in layout.index]
        self._impulses = [layout.places(f"balance.{name}_{component}" for component in COMPONENTS) for name in there]
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
        steps, held = np.diff(rows[:, self._time]), rows[:-1, self._applied]
        self._passed = np.cumsum(np.vstack((self._passed, held * steps[:, None])), axis=0)[-1]
        changes = np.zeros((len(block), 6))
        for places in self._impulses:
            changes += np.diff(rows[:, places], axis=0)
        for i in np.flatnonzero(changes.any(axis=1)).tolist():
            before, after = self._moments(rows[i], held[i]), self._moments(rows[i + 1], held[i])
            # Of c x F with both linear in time: the product of the means, and a twelfth of that of the changes.
            turning = cross(after.centre - before.centre, after.force - before.force) * (float(steps[i]) / 12.0)
            middle = 0.5 * (before.centre + after.centre)
            self._external += changes[i, 3:] - cross(middle, changes[i, :3]) - turning
            self._by_actuator += 0.5 * float(steps[i]) * (before.moments + after.moments)
        self._last = rows[-1].copy()

    def event(self, event: Any) -> None:
        """Note the closing or release of a grasp."""
        if isinstance(event, GraspRecord | ReleaseRecord):
            self._events.append(event)

    def _moments(self, row: FloatArray, held: FloatArray) -> _OuterLoad:
        """Load of the outer actuators under efforts at the state of a row."""
        data = self._state(row)
        moments, centre, total = np.zeros((len(held), 3)), self._centre(data), np.zeros(3)
        for i in self._outer[held[self._outer] != 0.0].tolist():
            force, moments[i] = self._load(data, i, float(held[i]), centre)
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
        centre, twist, found = self._centre(data), np.empty(6), {}
        total = mass = 0.0
        velocities = {}
        for body in [body for tree in self._system.trees for body in tree.bodies]:
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
            velocities[body] = twist.copy()
            total, mass = total + model.body_mass[body] * twist[3:], mass + model.body_mass[body]
        for body, (*spin, x, y, z) in velocities.items():
            frame = data.ximat[body].reshape(3, 3)
            own = frame @ (model.body_inertia[body] * (frame.T @ np.array(spin)))
            relative = np.array([x, y, z]) - total / mass
            found[model.body(body).name] = own + model.body_mass[body] * cross(data.xipos[body] - centre, relative)
        columns = self._stack.wheel_columns(data)
        return found, columns.T * data.qvel[self._stack.dofs][:, None]

    def _subsystems(self, bodies: dict[str, FloatArray], spin: FloatArray) -> dict[str, FloatArray]:
        """Angular momentum of each tree, of the robot without its wheels."""
        found = {}
        for tree in self._system.trees:
            found[tree.name] = sum((bodies[self._model.body(body).name] for body in tree.bodies), np.zeros(3))
        if len(spin):
            wheels = spin.sum(axis=0)
            robot = found.pop("robot") - wheels
            return {"robot without wheels": robot, "wheels": wheels, **found}
        return found

    def _actuators(self, spin0: FloatArray, spin1: FloatArray) -> dict[str, dict[str, Any]]:
        """By actuator: ``impulse`` is its effort over time, ``taken_N_m_s`` what a wheel stores or a thruster brings."""
        found: dict[str, dict[str, Any]] = {}
        for i in np.flatnonzero(~further_inputs(self._model)).tolist():
            name, on_joint = self._names[i], self._model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
            joint = self._model.joint(int(self._model.actuator_trnid[i, 0])).name if on_joint else ""
            taken, kind = np.zeros(3), "joint"
            if i in self._outer:
                taken, kind = self._by_actuator[i], "external"
            elif joint in self._stack.wheels:
                k = self._stack.wheels.index(joint)
                taken, kind = spin1[k] - spin0[k], "wheel"
            unit = "N_m_s" if drives_rotation(self._model, i) else "N_s"
            found[name] = {"kind": kind, f"impulse_{unit}": float(self._passed[i]), "taken_N_m_s": taken.tolist()}
        return found


def _changes(before: dict[str, FloatArray], after: dict[str, FloatArray]) -> dict[str, dict[str, list[float]]]:
    return {name: {"before_N_m_s": before[name].tolist(), "after_N_m_s": after[name].tolist()} for name in before}
