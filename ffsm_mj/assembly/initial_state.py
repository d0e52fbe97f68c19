"""Initial state of a scenario, and its validation: joints that it leaves out close equality constraints, or it is refused.

Positions are found by Newton's method, dq = -J^+ phi in the metric of M, over the joints without a value; bases keep their
poses. Rates that are left out follow from those that are given; what is left of the velocities of the rows is stopped by
their plastic impulse, v - M^-1 B^T (B M^-1 B^T)^+ B v, which keeps the momenta.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.dynamics.loops.latch import LatchedBodies
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import Fault, Faults, ScenarioFaults, plural
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.system import Joint, System
from ffsm_mj.scenario.scenario import JointValue, ScenarioConfig
from ffsm_mj.simulation.orbit import orbit_of, start_in_world
from ffsm_mj.tolerances import MECHANISM_RANK

_CLOSED = 1e-12
"""Error of a row at which it is closed, m or rad, as a share of 1 m + the largest coordinate of a body."""
_SILENT, _NOTED = 1e-6, 5e-3
"""Errors of given coordinates, m or rad, up to which they are corrected: without a word, and with a note.

Numbers of six decimals are off by the first; the keyframe of Cassie is off by 1.5e-3 m.
"""
_ROUNDED = 1e-9
"""Error of dependent rows, m or rad, from which on it is noted: numbers in files are rounded, of Toddlerbot to 3e-8."""
_LONGEST_STEP = 0.1
"""Longest step of a coordinate, rad or m: whole steps of Newton's method land on a branch that is a turn away."""
_STEPS = 300
"""Most steps: a joint that turns once and a half takes a third of them."""
_MOVED = 1e-3
"""Displacement of a joint without a value, rad or m, from which on it is noted."""
_LOSS = 1e-12
"""Energy that the plastic impulse of the start takes, as a share of all, from which on it is noted."""


def close_loops(system: System, data: Any, joints: Mapping[str, Any], rates: Mapping[str, Any]) -> tuple[str, ...]:
    """Close the equality constraints of a system at its initial state, and return notes.

    Args:
        system: The system.
        data: The state as the scenario gives it, derived quantities current; changed.
        joints: Joints with coordinates in the scenario, by full or unambiguous name.
        rates: The same with rates.

    Raises:
        ScenarioFaults: They cannot be closed, or the given coordinates contradict them.
    """
    equalities = equalities_of(system.mj)
    if not equalities:
        return ()
    start = _Start(
        system, data, ClosedLoops(system.mj, data, [equality.source for equality in equalities], rank=MECHANISM_RANK)
    )
    named = {system.joint(name).name: name for name in joints}
    notes = [*start.close(named), *start.match_rates({system.joint(name).name for name in rates})]
    mujoco.mj_forward(system.mj, data)
    return tuple(notes)


class _Start:
    """An initial state that is brought onto its rows."""

    def __init__(self, system: System, data: Any, loops: ClosedLoops) -> None:
        self._system, self._model, self._data, self._loops = system, system.mj, data, loops
        self._latches = [source for source in loops.sources if isinstance(source, LatchedBodies)]
        self._closed = _CLOSED * (1.0 + float(np.abs(data.xpos).max()))

    def close(self, named: Mapping[str, str]) -> list[str]:
        """Close the rows in position; ``named`` has the joints with a value by their full names, as the scenario names them.

        Raises:
            ScenarioFaults: It is not possible.
        """
        data, notes = self._data, list[str]()
        before = data.qpos.copy()
        left = self._newton(self._movable(named))
        solved = data.qpos.copy()
        if left > self._closed:
            # The given coordinates contradict the rows: how much so, and which values near them do not?
            fits = self._nearest()
            self._refuse_open(self._left(), self._closed)
            self._refuse_open(float(np.abs(self._loops.errors()).max()), _SILENT)
            if left > _NOTED:
                raise ScenarioFaults([self._contradiction(named, solved, left, fits)])
            if left > _SILENT:
                changed = self._moved(solved, self._system.joints)
                notes.append(f"the initial state is off {self._worst(solved)} by {left:.2g}, corrected to {changed}")
        elif moved := self._moved(before, [name for name in self._system.joints if name not in named], _MOVED):
            notes.append(f"joints without an initial value move to close the equality constraints: {moved}")
        # Combinations of rows that no motion changes: rounded numbers of a file, or a loop that cannot close from here.
        dropped = float(np.abs(self._loops.errors()).max())
        self._refuse_open(dropped, _SILENT)
        if dropped > _ROUNDED:
            notes.append(f"equality constraints contradict each other by {dropped:.2g}, which no motion changes")
        return notes

    def _movable(self, named: Mapping[str, Any]) -> BoolArray:
        """Degrees of freedom that may change, (nv,): joints in rows without a value; bases only where rows join trees."""
        J = self._loops.rows().J
        free: BoolArray = np.any(J != 0.0, axis=0)
        for name in named:
            free[self._system.joints[name].dofs] = False
        trees = [tree.dofs for tree in self._system.trees]
        across = J[[sum(bool(row[dofs].any()) for dofs in trees) > 1 for row in J]]
        for tree in self._system.trees:
            if tree is self._system.robot or not across[:, tree.base_dofs].any():
                free[tree.base_dofs] = False
        return free

    def _nearest(self) -> bool:
        """Go to a state near this one that closes the rows; returns whether it is within the ranges of the joints.

        Joints that would be beyond the end of their range stay there. Where the rows cannot be closed so, ranges do not
        count.
        """
        data, start, at_ends = self._data, self._data.qpos.copy(), dict[str, float]()
        while True:
            self._go_to(start)
            for name, end in at_ends.items():
                data.qpos[self._system.joints[name].qpos] = end
            self._go_to(data.qpos.copy())
            left = self._newton(self._movable(at_ends))
            beyond = {name: end for name, end in self._beyond().items() if name not in at_ends}
            if not beyond or left > self._closed:
                break
            at_ends |= beyond
        if left <= self._closed:
            return True
        self._go_to(start)
        self._newton(self._movable({}))
        return False

    def _beyond(self) -> dict[str, float]:
        """Hinges and slides in rows that are beyond their range, with its nearer end."""
        model, ends = self._model, dict[str, float]()
        movable = self._movable({})
        for name, joint in self._system.joints.items():
            j = model.joint(name).id
            if joint.kind in ("hinge", "slide") and model.jnt_limited[j] and movable[joint.dofs].any():
                value, (low, high) = float(self._data.qpos[joint.qpos.start]), model.jnt_range[j].tolist()
                if not low - self._closed <= value <= high + self._closed:
                    ends[name] = min(max(value, low), high)
        return ends

    def _newton(self, free: BoolArray) -> float:
        """Close the rows by some degrees of freedom as far as possible; returns what is left."""
        start = self._data.qpos.copy()
        left = self._steps(free, lambda: self._loops.rows().J)
        if left > self._closed and self._latches:
            first = self._data.qpos.copy()
            self._go_to(start)
            if (other := self._steps(free, self._rows_of_ends)) < left:
                return other
            self._go_to(first)
        return left

    def _go_to(self, qpos: FloatArray) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)

    def _steps(self, free: BoolArray, rows: Callable[[], FloatArray]) -> float:
        """Steps of Newton's method with some rows J; returns what is left at the best of the states."""
        model, data, best = self._model, self._data, (np.inf, self._data.qpos.copy())
        for _ in range(_STEPS):
            was_closed, left = best[0] <= self._closed, self._left()
            if left < best[0]:
                best = left, data.qpos.copy()
            if was_closed:  # one more step: convergence is quadratic
                break
            step = self._least(free, rows(), -self._loops.errors())
            size = float(np.abs(step).max(initial=0.0))
            if size <= np.finfo(float).eps:
                break
            mujoco.mj_integratePos(model, data.qpos, step * min(1.0, _LONGEST_STEP / size), 1.0)
            mujoco.mj_forward(model, data)
        self._go_to(best[1])
        return best[0]

    def _least(self, free: BoolArray, J: FloatArray, wanted: FloatArray) -> FloatArray:
        """Least change in the metric of M of some rates by which rows J move as wanted, as far as they can, (nv,)."""
        change = np.zeros(self._model.nv)
        if free.any():
            L = np.linalg.cholesky(mass_matrix(self._model, self._data)[np.ix_(free, free)])
            A = np.linalg.solve(L, J[:, free].T)
            change[free] = np.linalg.solve(L.T, np.linalg.pinv(A.T, rcond=MECHANISM_RANK) @ wanted)
        return change

    def _rows_of_ends(self) -> FloatArray:
        """Rows J with those of latches for the two points that are to meet, not for one common point, (n, nv).

        Both are the same once the loops are closed. Far from there, steps along the rows for a common point turn a link that
        reaches beyond it the wrong way, as the rod of a slider-crank whose slider is too near.
        """
        model, data, J = self._model, self._data, self._loops.rows().J
        turn = np.empty((3, model.nv))
        for latch, part in zip(self._loops.sources, self._loops.parts, strict=True):
            if isinstance(latch, LatchedBodies):
                a, b = ((data.xpos[body], data.xmat[body].reshape(3, 3)) for body in (latch.first, latch.second))
                apart = b[0] + b[1] @ latch.point_in_second - a[0] - a[1] @ latch.point_in_first
                mujoco.mj_jacBody(model, data, None, turn, latch.first)
                J[part.start : part.start + 3] += np.cross(apart, (a[1] @ latch.axes_in_first).T) @ turn
        return J

    def _left(self) -> float:
        """Largest error that motions can remove, m or rad; infinite if the bodies of a weld are turned too far."""
        errors, frames = self._loops.errors(), self._data.xmat
        for latch in self._latches:
            # The error in orientation is the sine of the angle: it vanishes half a turn away, too.
            if latch.count == 6:
                a = frames[latch.first].reshape(3, 3) @ latch.axes_in_first
                b = frames[latch.second].reshape(3, 3) @ latch.axes_in_second
                if np.trace(a.T @ b) < 1.0:  # 1 + 2 cos: more than a quarter turn
                    return float("inf")
        vanishing = self._loops.weighted().independent()[1]
        return float(np.abs(errors - vanishing.T @ (vanishing @ errors)).max())

    def match_rates(self, named: set[str]) -> list[str]:
        """Let rates that are left out follow the others, and stop what is left by the plastic impulse of all rows."""
        data = self._data
        J = self._loops.rows().J
        data.qvel[:] += self._least(self._movable(dict.fromkeys(named)), J, -J @ data.qvel)
        M, before = mass_matrix(self._model, data), data.qvel.copy()
        closing = self._loops.plastic()
        data.qvel[:] += closing.change
        if closing.loss_J <= _LOSS * float(before @ M @ before):
            return []
        changed = ", ".join(
            f"{name} {_numbers(data.qvel[joint.dofs])}"
            for name, joint in self._system.joints.items()
            if np.abs(data.qvel[joint.dofs] - before[joint.dofs]).max() > 1e-9
        )
        return [
            f"the initial rates contradict the equality constraints: the plastic impulse that stops them takes "
            f"{closing.loss_J:.6g} J, not in the balance; rates from then on: {changed}"
        ]

    def _worst(self, qpos: FloatArray) -> str:
        """Place of the constraint with the largest error at a state, which is set only for this."""
        now = self._data.qpos.copy()
        self._go_to(qpos)
        errors = self._loops.errors()
        worst = [part.stop for part in self._loops.parts]
        place = int(np.searchsorted(worst, int(np.abs(errors).argmax()), side="right"))
        self._go_to(now)
        return [*self._system.equalities.values()][place]

    def _refuse_open(self, left: float, most: float) -> None:
        """Refuse a state of which larger errors are left than the most.

        Raises:
            ScenarioFaults: It is one.
        """
        if left <= most:
            return
        far = f"{left:.2g} m or rad are left" if np.isfinite(left) else "its bodies are turned by more than a quarter turn"
        text = (
            f"{self._worst(self._data.qpos)} cannot be closed from this state: {far}; "
            "give joints under initial.joints near a state in which it is closed"
        )
        raise ScenarioFaults([Fault(text, ("initial",))])

    def _contradiction(self, named: Mapping[str, str], solved: FloatArray, left: float, fits: bool) -> Fault:
        """Fault of given coordinates, with the nearest ones that fit, within the ranges of joints or, if not, beyond."""
        change = {name: float(np.abs(self._data.qpos[place] - solved[place]).max()) for name, place in self._places(named)}
        path = ("initial", "joints", named[max(change, key=lambda name: change[name])]) if change else ("initial",)
        return Fault(
            f"the initial state is off {self._worst(solved)} by {left:.2g} m or rad; nearest values that fit"
            f"{'' if fits else ', none of which are within the ranges of all joints'}: {self._moved(solved, named)}",
            path,
        )

    def _places(self, names: Iterable[str]) -> Iterator[tuple[str, slice]]:
        yield from ((name, self._system.joints[name].qpos) for name in names)

    def _moved(self, since: FloatArray, names: Iterable[str], least: float = _CLOSED) -> str:
        """Joints that differ from an earlier state by more than a least value, with their coordinates."""
        now = self._data.qpos
        changed = [(name, at) for name, at in self._places(names) if np.abs(now[at] - since[at]).max() > least]
        return ", ".join(f"{name} {_numbers(now[at])}" for name, at in changed)


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{round(float(value), 12) + 0.0:.9g}" for value in values)


_HUGE = 1e10
_UNIT = 1e-15
"""A quaternion is a unit one to rounding if its length differs from one by no more."""
_LEAST_SHARE = 1e-10
"""Least eigenvalue of the mass matrix scaled to a diagonal of ones: below it, accelerations lose six digits to rounding."""


class InitialState(NamedTuple):
    """State at t = 0.

    Attributes:
        data: MuJoCo data with all derived quantities.
        stated: Coordinates and rates as the scenario states them, (nq,) and (nv,): of free joints in ``initial.frame``.
        notes: What a user should know about it, one line each.
    """

    data: Any
    stated: tuple[FloatArray, FloatArray]
    notes: tuple[str, ...]


def initial_state(scenario: ScenarioConfig, system: System) -> InitialState:
    """State at t = 0, with the equality constraints closed.

    Raises:
        ScenarioFaults: An unknown joint, an invalid value, or a state from which no run can start.
    """
    data = mujoco.MjData(system.mj)
    with Faults() as faults:
        for key, target in (("joints", data.qpos), ("rates", data.qvel)):
            for name, value in getattr(scenario.initial, key).items():
                with faults.below("initial", key, name):
                    if fault := _set_joint(system.joint(name), key, value, target):
                        faults.add(fault, "initial", key, name)
    orbit = orbit_of(scenario.environment) if scenario.initial.frame == "lvlh" else None
    relative = data.qpos.copy(), data.qvel.copy()
    if orbit is not None:
        start_in_world(orbit, system, data)
    if fault := fault_of_start(system, data):
        raise ScenarioFaults([Fault(fault, ("initial",))])
    notes = close_loops(system, data, scenario.initial.joints, scenario.initial.rates)
    stated = data.qpos.copy(), data.qvel.copy()
    for joint in system.joints.values():
        if orbit is not None and joint.kind == "free":
            stated[0][joint.qpos], stated[1][joint.dofs] = relative[0][joint.qpos], relative[1][joint.dofs]
    return InitialState(data, stated, notes)


def fault_of_start(system: System, data: Any) -> str:
    """Compute derived quantities; return why no run can start from the state, empty if one can."""
    warnings: list[str] = []
    with collected_warnings(warnings):
        mujoco.mj_forward(system.mj, data)
    dof, share = _weakest_dof(system.mj, data)
    if not share > _LEAST_SHARE:
        joint = system.mj.joint(int(system.mj.dof_jntid[dof])).name
        how = f"singular to {share:.1g}" if share <= _LEAST_SHARE else "not finite"
        return f"the mass matrix is {how} at joint {joint!r}: what it moves here has next to no mass or inertia"
    return f"MuJoCo warns: {' '.join(warnings[0].split())}" if warnings else ""


def _set_joint(joint: Joint, key: str, value: JointValue, target: Any) -> str:
    """Set a joint's coordinates or rates; return what is wrong with them, empty if they are valid."""
    part = joint.qpos if key == "joints" else joint.dofs
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float64))
    size = part.stop - part.start
    if len(numbers) != size:
        return f"{joint.kind} joint {joint.name} takes {plural(size, 'number')}, got {len(numbers)}"
    if np.any(np.abs(numbers) > _HUGE):
        return f"must stay below {_HUGE:g}, the largest value that MuJoCo takes for a state"
    if key == "joints" and joint.kind in ("free", "ball"):
        length = np.linalg.norm(numbers[-4:])
        if abs(length - 1.0) > 1e-3:
            return f"the quaternion (w, x, y, z) must have length 1, it has {length:.6g}"
        # As MuJoCo, which leaves a length within 1e-15 of one: a logged state begins bit for bit as it was.
        if abs(length - 1.0) > _UNIT:
            numbers[-4:] /= length
    target[part] = numbers
    return ""


def _weakest_dof(model: Any, data: Any) -> tuple[int, float]:
    """The degree of freedom with the least effective inertia, and the least eigenvalue of the scaled mass matrix.

    Args:
        model: The scene.
        data: MuJoCo data after ``mj_forward``.

    Returns:
        Index of the degree of freedom, and the eigenvalue: 1 if all are independent, NaN if the matrix is not finite.
    """
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    diagonal = np.diag(mass)
    bad = ~(np.isfinite(mass).all(axis=0) & (diagonal > 0.0))
    if bad.any():
        return int(np.argmax(bad)), float("nan")
    # Scaling removes units and sizes: what remains small is a combination of coordinates with almost no inertia.
    scale = 1.0 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(mass * np.outer(scale, scale))
    return int(np.argmax(np.abs(vectors[:, 0]))), float(values[0])
