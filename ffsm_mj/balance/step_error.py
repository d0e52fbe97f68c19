"""Error of one step in energy and momenta, relative to the tolerances of the checks."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.balance import Balance
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.model.actuators import has_servos
from ffsm_mj.model.system import Joint, System, Tree
from ffsm_mj.records.signals import SUBSYSTEMS

_NUMBERS = 7
"""Number of values per subsystem: kinetic energy in J, P in N s, L about the world origin in N m s."""
_TOTAL, _ROBOT, _OBJECTS = range(len(SUBSYSTEMS))
_FACTOR = 12.0
"""The error of an RK4 step is (rate times step)^5 / 120 for motion at a single rate; the bound is ten times this."""


class StepError:
    """Residual of the balance over one (sub-)step, of energy and momenta of each subsystem.

    An RK4 step does not conserve them exactly, so its residual is its truncation error in the quantities that are checked:
    measured, not estimated. It is a function of the state at the start of the step, the efforts and the duration.
    """

    def __init__(self, system: System, data: Any, balance: Balance) -> None:
        """Measure the steps of a system.

        Args:
            system: Robot and objects.
            data: Their state, derived quantities current wherever a method is called.
            balance: Accounts for the efforts during a step.
        """
        self._model, self._data, self._balance = system.mj, data, balance
        self._rates = data.qvel
        self._trees = [self._views(tree) for tree in system.trees]
        lengths = [[i for joint in tree.joints for i in _lengths(joint)] for tree in system.trees]
        self._robot_lengths, self._lengths = lengths[0], [i for tree_lengths in lengths for i in tree_lengths]
        roots = {tree.root for tree in system.trees}
        self._system, self._mass = system, float(system.mj.body_mass.sum())
        self._weights = np.hstack((_changes(balance.free), -balance.entered()))
        self._turning = np.array([i for joint in self._joints() for i in _turns(joint)], dtype=np.intp)
        # A body that slides along a rotating one adds a rate, its speed over a length that is unknown.
        # Springs, dampers and servos accelerate at rest.
        springs = JointSprings(system.mj)
        self._bounded = not (springs.elastic or springs.damped or has_servos(system.mj)) and all(
            joint.kind != "slide" or joint.body in roots for joint in self._joints()
        )
        self._start: list[float] | None = None
        self._rates_before: list[float] = []

    def _views(self, tree: Tree) -> tuple[float, slice, FloatArray, FloatArray, FloatArray]:
        data, root = self._data, tree.root
        mass = float(self._model.body_subtreemass[root])
        return mass, tree.dofs, data.subtree_linvel[root], data.subtree_com[root], data.subtree_angmom[root]

    def _joints(self) -> tuple[Joint, ...]:
        return tuple(self._system.joints.values())

    def begin(self, *, measured: bool) -> None:
        """Begin a step at the state in ``data``.

        Args:
            measured: Whether its error will be measured; otherwise :meth:`bound` may suffice.
        """
        self._start, self._rates_before = None, self._rates[self._turning].tolist()
        if measured or not self._bounded:
            mujoco.mj_mulM(self._model, self._data, self._balance.momentum, self._rates)
            self._start = self._now()

    @property
    def is_measured(self) -> bool:
        """Whether the data to measure the residual was stored at the start of the step."""
        return self._start is not None

    def bound(self, duration_s: float) -> float:
        """Upper bound on the error of a step without contact forces, over (1 + scale); infinite if there is none.

        It follows from the angular rates at both ends and their change.
        """
        if not self._bounded:
            return math.inf
        before, after = self._rates_before, self._rates[self._turning].tolist()
        fastest = max(sum(map(abs, before)), sum(map(abs, after)))
        change = sum(abs(b - a) for a, b in zip(before, after, strict=True))
        turn = fastest * duration_s + math.sqrt(change * duration_s)
        lever = math.hypot(*self._data.qpos[self._lengths].tolist())
        # The sum of all m |v| is at most sqrt(2 m T); it may cancel in P and L, and its error does not.
        momentum = math.sqrt(abs(self._mass * float(self._balance.momentum.dot(self._rates))))
        return float(turn**5) / _FACTOR * max(1.0, momentum * (1.0 + lever))

    def residuals(self, duration_s: float, exchanges: Iterable[Exchange]) -> FloatArray:
        """Residuals at the state in ``data``, (3, 7): energy, P and L of (total, robot, objects).

        A grasped object counts with the robot, as in the checks; other objects keep their residual.

        Args:
            duration_s: Since :meth:`begin`.
            exchanges: What contacts exchanged in that time.
        """
        assert self._start is not None
        change = np.subtract(self._now(), self._start)
        moved, grasped = change[: 2 * _NUMBERS], change[2 * _NUMBERS :]
        accounts = self._balance.increments(duration_s, exchanges, grasped if grasped.size else None)
        left = self._weights.dot(np.concatenate((moved, accounts)))
        return np.asarray(left.reshape(len(SUBSYSTEMS), _NUMBERS))

    def relative(self, duration_s: float, exchanges: Iterable[Exchange], *, grasped: bool) -> float:
        """Largest residual over (1 + scale), the scale being that of the checks; infinite where one is not finite.

        Args:
            duration_s: Since :meth:`begin`.
            exchanges: What contacts exchanged in that time.
            grasped: Whether an object is grasped: the exchange between robot and object is then its gain by definition.
        """
        left = self.residuals(duration_s, exchanges).tolist()
        # The whole is at most the sum of robot and objects.
        subsystems = (_TOTAL,) if grasped else (_ROBOT, _OBJECTS)
        size = max(self._size(left[subsystem], subsystem) for subsystem in subsystems)
        return size if math.isfinite(size) else math.inf

    def scales(self) -> FloatArray:
        """1 + the scales of energy, P and L of (total, robot, objects) as in the checks, (3, 3), where a step starts."""
        by_subsystem = np.array([self._scales(subsystem) for subsystem in range(len(SUBSYSTEMS))])
        if self._balance.grasped_object is not None:  # what the robot gives to the object cancels in the robot's balance
            by_subsystem[_ROBOT] += by_subsystem[_OBJECTS] - 1.0
        return by_subsystem

    def _size(self, left: list[float], subsystem: int) -> float:
        """Largest relative residual of one subsystem."""
        energy, linear, angular = self._scales(subsystem)
        return abs(left[0]) / energy + math.hypot(*left[1:4]) / linear + math.hypot(*left[4:]) / angular

    def _scales(self, subsystem: int) -> tuple[float, float, float]:
        """1 + the scales of ``verification/checks.py`` at the start of the step: of energy, P and L."""
        assert self._start is not None
        start, qpos = self._start, self._data.qpos
        robot, objects = start[:_NUMBERS], start[_NUMBERS : 2 * _NUMBERS]
        accounts = {_TOTAL: [a + b for a, b in zip(robot, objects, strict=True)], _ROBOT: robot, _OBJECTS: objects}[
            subsystem
        ]
        members = {_TOTAL: (robot, objects), _ROBOT: (robot,), _OBJECTS: (objects,)}[subsystem]
        linear = sum(math.hypot(*member[1:4]) for member in members)
        lever = math.hypot(*qpos[self._robot_lengths if subsystem == _ROBOT else self._lengths].tolist())
        return 1.0 + abs(accounts[0]), 1.0 + linear, 1.0 + math.hypot(*accounts[4:]) + lever * linear

    def _now(self) -> list[float]:
        """Energy and momenta of the robot, of all objects, and of a grasped one alone, at the state in ``data``."""
        mujoco.mj_subtreeVel(self._model, self._data)
        momentum, rates = self._balance.momentum, self._rates
        accounts, alone, grasped = [[0.0] * _NUMBERS, [0.0] * _NUMBERS], [], self._balance.grasped_object
        for i, (mass, dofs, velocity, centre, spin) in enumerate(self._trees):
            (u, v, w), (x, y, z), (a, b, c) = velocity.tolist(), centre.tolist(), spin.tolist()
            p, q, r = mass * u, mass * v, mass * w
            energy = 0.5 * float(momentum[dofs].dot(rates[dofs]))
            about_origin = (energy, p, q, r, a + y * r - z * q, b + z * p - x * r, c + x * q - y * p)
            subsystem = accounts[min(i, 1)]
            subsystem[:] = [before + added for before, added in zip(subsystem, about_origin, strict=True)]
            if grasped is not None and dofs == grasped.dofs:
                alone = list(about_origin)
        return accounts[0] + accounts[1] + alone


def _changes(free: FloatArray) -> FloatArray:
    """Matrix from the changes of robot and objects, (14,), to those of each subsystem on its free components, (21, 14)."""
    robot, objects = np.eye(_NUMBERS, 2 * _NUMBERS), np.eye(_NUMBERS, 2 * _NUMBERS, _NUMBERS)
    masks = np.hstack((np.ones((len(SUBSYSTEMS), 1)), free))
    return np.vstack([mask[:, None] * part for mask, part in zip(masks, (robot + objects, robot, objects), strict=True)])


def _lengths(joint: Joint) -> range:
    """Indices in ``qpos`` of the coordinates of a joint that are in m."""
    size = {"free": 3, "slide": 1}.get(joint.kind, 0)
    return range(joint.qpos.start, joint.qpos.start + size)


def _turns(joint: Joint) -> range:
    """Indices in ``qvel`` of the rates of a joint that are in rad/s."""
    first = {"slide": joint.dofs.stop, "free": joint.dofs.start + 3}.get(joint.kind, joint.dofs.start)
    return range(first, joint.dofs.stop)
