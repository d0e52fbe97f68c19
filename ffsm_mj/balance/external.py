"""Impulse and work of external forces over (sub-)steps: gravity, thrusters, and other actuators that push on the base.

Gravity is uniform. The weight of a body is m g, reduced by the share that MuJoCo's ``gravcomp`` compensates; both act at
its centre of mass. Over a (sub-)step the impulse is weight times duration and the work weight times displacement, exactly.
The moment about the origin needs the time integral of the position of the centre of mass: the cubic Hermite polynomial
through both ends gives it with a fifth-order error per step, like RK4.

Thrusters are actuators that act at a site, with a wrench that is constant in the body's frame. All those of one body form
one wrench about the origin of its frame. Its impulse and work over a (sub-)step follow from the body's pose and twist at
both ends: Simpson's rule, with the midpoint by cubic Hermite interpolation of position and quaternion. The arithmetic is in
Python floats, which are faster than numpy arrays of three elements.

The others are base joint motors, tendons, and sites with a reference site. Their wrench on their tree follows from the
generalised forces on its base joints.

All of them act on the tree that they are mounted on, the robot or an object, and are entered there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.balance.quadrature import hermite_midpoint, simpson
from ffsm_mj.dynamics.rigid_body import (
    base_jacobian,
    base_wrench,
    external_actuators,
    free_projector,
    site_actuators,
    site_wrench,
)
from ffsm_mj.model.actuators import without_servos
from ffsm_mj.model.system import System, Tree

_BODY = int(mujoco.mjtObj.mjOBJ_XBODY)


class Gravity:
    """Integrates the work and impulse of gravity on each tree over each (sub-)step."""

    SIZE = 7
    """Values per tree: work in J, impulse (P, L about the world origin) in N s and N m s."""

    def __init__(self, system: System, data: Any, accounts: FloatArray) -> None:
        """Bind to the bodies of the trees.

        Args:
            system: Robot and objects.
            data: Its state.
            accounts: Work and impulse by tree, (number of trees, SIZE).
        """
        model = system.mj
        self._data, self._accounts = data, accounts
        self._g, self._roots = np.array(model.opt.gravity), np.array(model.body_rootid)
        weighted = model.body_mass * (1.0 - model.body_gravcomp)
        self._masses = np.zeros((len(system.trees), model.nbody))
        for row, tree in zip(self._masses, system.trees, strict=True):
            row[list(tree.bodies)] = weighted[list(tree.bodies)]
        self._force = self._masses.sum(axis=1)[:, None] * self._g
        self._start = self._look()

    def open(self) -> None:
        """Begin a (sub-)step at the state in ``data``, derived quantities current."""
        self._start = self._look()

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``, derived quantities current."""
        (first, first_rate), (last, last_rate) = self._start, self._look()
        area = 0.5 * duration_s * (first + last) + duration_s**2 / 12.0 * (first_rate - last_rate)
        self._accounts[:, 0] += (last - first) @ self._g
        self._accounts[:, 1:4] += duration_s * self._force
        self._accounts[:, 4:] += _cross(area, self._g)

    def _look(self) -> tuple[FloatArray, FloatArray]:
        """Sums of mass times position and velocity of bodies' centres of mass by tree, kg m and kg m/s, (trees, 3) each."""
        data, twists = self._data, self._data.cvel
        # MuJoCo's twists are about the centre of mass of the whole tree, angular part first.
        lever = data.xipos - data.subtree_com[self._roots]
        return self._masses @ data.xipos, self._masses @ (twists[:, 3:] + _cross(twists[:, :3], lever))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows, (n, 3), as ``numpy.cross`` computes them at six times the cost of so few."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=1)


class _BodyState(NamedTuple):
    """Position and quaternion (of any norm) of a body, their rates, and its angular velocity, in world axes."""

    pose: list[float]
    rate: list[float]
    spin: list[float]


class Thrusters:
    """Thrusters of one body; integrates their impulse and work over each (sub-)step.

    Attributes:
        actuators: Ids of the thrusters, (n,).
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        body: int,
        actuators: IntArray,
        wrenches: FloatArray,
        felt: FloatArray,
        work: FloatArray,
        impulse: FloatArray,
    ) -> None:
        """Bind to the body.

        Args:
            model: MuJoCo model.
            data: Its data.
            body: Id of the body.
            actuators: Ids of its thrusters, (n,).
            wrenches: Wrench per unit of the force of each, about the origin of the body's frame in its axes, (6, n).
            felt: Map from an impulse (P, L about the world origin) to what the base joints leave free of it, (6, 6).
            work: Receives the work, J, (1,).
            impulse: Receives the impulse, (6,).
        """
        self._model, self._data, self._body = model, data, body
        self.actuators, self._wrenches, self._felt = actuators, wrenches, felt
        self._ctrl, self._force, self._twist = data.ctrl, data.actuator_force, np.empty(6)
        self._position, self._quaternion = data.xpos[body], data.xquat[body]
        self._work, self._impulse = work, impulse
        self._start: _BodyState | None = None

    def open(self) -> None:
        """Begin a (sub-)step with the efforts in ``data``; poses and velocities must be current."""
        self._start = self._look() if any(self._ctrl[self.actuators].tolist()) else None

    def close(self, duration_s: float) -> None:
        """End the step; derived quantities must be current, and the efforts those at its start."""
        if self._start is None:
            return
        wrench = self._wrenches.dot(self._force[self.actuators]).tolist()
        end = self._look()
        first, middle, last = (_rates(at, wrench) for at in (self._start, _middle(self._start, end, duration_s), end))
        sixth = duration_s / 6.0
        done = [sixth * (a + 4.0 * b + c) for a, b, c in zip(first, middle, last, strict=True)]
        self._work[0] += done[6]
        self._impulse += self._felt.dot(done[:6])

    def _look(self) -> _BodyState:
        """Current pose and twist of the body."""
        mujoco.mj_objectVelocity(self._model, self._data, _BODY, self._body, self._twist, 0)
        x, y, z, *velocity = self._twist.tolist()
        quaternion = a, b, c, d = self._quaternion.tolist()
        turning = (
            -0.5 * (x * b + y * c + z * d),
            0.5 * (x * a + y * d - z * c),
            0.5 * (y * a + z * b - x * d),
            0.5 * (z * a + x * c - y * b),
        )
        return _BodyState([*self._position.tolist(), *quaternion], [*velocity, *turning], [x, y, z])


def _middle(start: _BodyState, end: _BodyState, duration_s: float) -> _BodyState:
    """State at the middle of a step; pose and rates are fourth-order accurate in the duration."""
    first, last, first_rate, last_rate = start.pose, end.pose, start.rate, end.rate
    (*_, a, b, c, d), (*_, e, f, g, h) = first, last
    if a * e + b * f + c * g + d * h < 0.0:  # q and -q are the same rotation
        last, last_rate = ([*full[:3], *(-part for part in full[3:])] for full in (last, last_rate))
    eighth, chord = 0.125 * duration_s, 1.5 / duration_s
    pose, rate = [], []
    for p, q, v, w in zip(first, last, first_rate, last_rate, strict=True):
        pose.append(0.5 * (p + q) + eighth * (v - w))
        rate.append(chord * (q - p) - 0.25 * (v + w))
    (a, b, c, d), (s, x, y, z) = pose[3:], rate[3:]
    double = 2.0 / (a * a + b * b + c * c + d * d)
    spin = [
        double * (a * x - s * b + c * z - d * y),
        double * (a * y - s * c + d * x - b * z),
        double * (a * z - s * d + b * y - c * x),
    ]
    return _BodyState(pose, rate, spin)


def _rates(at: _BodyState, wrench: list[float]) -> tuple[float, ...]:
    """Force, moment about the world origin, and power of a wrench about a body's origin in its axes, (7,)."""
    px, py, pz, a, b, c, d = at.pose
    double = 2.0 / (a * a + b * b + c * c + d * d)
    parts: list[float] = []
    for x, y, z in (wrench[:3], wrench[3:]):
        # v + 2 u x (a v + u x v) / |q|^2, with q = (a, u)
        e, f, g = a * x + c * z - d * y, a * y + d * x - b * z, a * z + b * y - c * x
        parts += (x + double * (c * g - d * f), y + double * (d * e - b * g), z + double * (b * f - c * e))
    fx, fy, fz, tx, ty, tz = parts
    (vx, vy, vz, *_), (wx, wy, wz) = at.rate, at.spin
    power = fx * vx + fy * vy + fz * vz + tx * wx + ty * wy + tz * wz
    return fx, fy, fz, tx + py * fz - pz * fy, ty + pz * fx - px * fz, tz + px * fy - py * fx, power


def thrusters(system: System, data: Any, tree: Tree, work: FloatArray, impulse: FloatArray) -> list[Thrusters]:
    """Thrusters of a tree, grouped by body.

    Actuators with a reference site are left out, and all are if the constraint directions of the base joints rotate or are
    limited: the impulse on the tree then does not follow from the pose of the body alone.

    Args:
        system: Robot and objects.
        data: Their state.
        tree: Robot or object.
        work: Takes their work, J, (1,).
        impulse: Takes their impulse on the tree (P, L about the world origin), (6,).
    """
    model = system.mj
    felt = free_projector(system, tree)
    if felt is None or model.jnt_actfrclimited[model.jnt_bodyid == tree.root].any():
        return []
    ids = np.flatnonzero(site_actuators(model))
    bodies = model.site_bodyid[model.actuator_trnid[ids, 0]]
    groups = []
    for body in sorted(set(bodies.tolist()) & set(tree.bodies)):  # np.unique imports numpy.ma
        of_body = ids[bodies == body]
        wrenches = np.stack([site_wrench(model, i) for i in of_body], axis=1)
        groups.append(Thrusters(model, data, body, of_body, wrenches, felt, work, impulse))
    return groups


class BaseMotors:
    """Integrates impulse and work over each (sub-)step by Simpson's rule with a cubic Hermite midpoint."""

    def __init__(
        self,
        system: System,
        data: Any,
        tree: Tree,
        chosen: npt.NDArray[np.bool_],
        elsewhere: npt.NDArray[np.bool_],
        work: FloatArray,
        impulse: FloatArray,
    ) -> None:
        """Bind to the system.

        Args:
            system: Robot and objects.
            data: Their state.
            tree: Robot or object that they act on.
            chosen: Mask of the actuators to account for, (nu,).
            elsewhere: Mask of the actuators whose work is accounted for elsewhere, (nu,).
            work: Receives the work, J, (1,).
            impulse: Receives the impulse on the tree (P, L about the world origin), (6,).
        """
        self._tree, self._model, self._data = tree, without_servos(system.mj), data
        self._scratch, self._chosen, self._worked = mujoco.MjData(self._model), chosen, 1.0 - elsewhere
        self._work, self._impulse = work, impulse
        self._pushing = False

    def open(self) -> None:
        """Begin a (sub-)step with the state and the efforts in ``data``."""
        data, efforts = self._data, np.where(self._chosen, self._data.ctrl, 0.0)
        self._pushing = bool(efforts.any())
        if self._pushing:
            self._qpos, self._qvel, self._scratch.ctrl[:] = data.qpos.copy(), data.qvel.copy(), efforts

    def close(self, duration_s: float) -> None:
        """End the step at the state in ``data``."""
        if not self._pushing:
            return
        data = self._data
        q_mid, v_mid = hermite_midpoint(self._model, self._qpos, self._qvel, data.qpos, data.qvel, duration_s)
        start, middle, end = (
            self._rates(qpos, qvel) for qpos, qvel in ((self._qpos, self._qvel), (q_mid, v_mid), (data.qpos, data.qvel))
        )
        done = simpson(start, middle, end, duration_s)
        self._impulse += done[:6]
        self._work += done[6]

    def _rates(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Wrench on the tree about the world origin, and power, at a state, (7,)."""
        model, scratch, tree = self._model, self._scratch, self._tree
        scratch.qpos[:], scratch.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, scratch)
        mujoco.mj_fwdVelocity(model, scratch)
        mujoco.mj_fwdActuation(model, scratch)
        wrench = base_wrench(base_jacobian(model, scratch, tree), scratch.qfrc_actuator[tree.base_dofs])
        return np.append(wrench, (scratch.actuator_force * scratch.actuator_velocity) @ self._worked)


class JointMotors:
    """Accumulates the work of motors on the joints of an object: force times displacement, exactly."""

    def __init__(self, data: Any, motors: IntArray, work: FloatArray) -> None:
        """Bind to the state.

        Args:
            data: State of robot and objects.
            motors: Ids of the actuators, (n,).
            work: Receives the work, J, (1,).
        """
        self._length, self._force, self._motors, self._work = data.actuator_length, data.actuator_force, motors, work
        self.open()

    def open(self) -> None:
        """Begin a (sub-)step at the state in ``data``."""
        self._start = self._length[self._motors]

    def close(self, duration_s: float) -> None:  # noqa: ARG002
        """End the step at the state in ``data``, with the efforts that acted in it."""
        self._work += self._force[self._motors].dot(self._length[self._motors] - self._start)


def external_parts(
    system: System, data: Any, tree: int, account: tuple[FloatArray, FloatArray], elsewhere: npt.NDArray[np.bool_]
) -> list[Thrusters | BaseMotors]:
    """What accounts for the external actuators of a tree.

    Args:
        system: Robot and objects.
        data: Their state.
        tree: Index of the tree.
        account: Receives the work, J, (1,), and the impulse on the tree (P, L about the world origin), (6,).
        elsewhere: Mask of the actuators whose work is accounted for elsewhere, (nu,).
    """
    external = external_actuators(system) & (np.array(system.actuator_trees) == tree)
    by_pose = thrusters(system, data, system.trees[tree], *account)
    for group in by_pose:
        external[group.actuators] = False
    motors = [BaseMotors(system, data, system.trees[tree], external, elsewhere, *account)] if external.any() else []
    return [*by_pose, *motors]
