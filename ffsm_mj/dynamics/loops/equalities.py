"""Equality constraints of a compiled scene as sources of rows: connect, weld, couplings of joints and of tendons.

Control laws see the model with them: accelerations by efforts at the independent joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj._core.loops import LoopStage
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.loops.closed_loops import RowSource
from ffsm_mj.dynamics.loops.couplings import JointCoupling, Polynomial, TendonCoupling
from ffsm_mj.dynamics.loops.latch import LatchedBodies, stopped_along_axes
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.tolerances import MECHANISM_RANK

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)
_EYE = np.eye(3)
_STEPS, _LONGEST_STEP, _SETTLED = 200, 0.1, 1e-13
"""Most steps of Newton's method, the longest one in rad or m, and one at which it has converged: see ``closed_start``."""


class Equality(NamedTuple):
    """An equality constraint of a model file.

    Attributes:
        id: Its id in the model.
        source: Its rows, in ids of this model.
    """

    id: int
    source: RowSource


def equalities_of(model: Any) -> tuple[Equality, ...]:
    """All equality constraints that are active from the start; those that cannot be rows were refused.

    Args:
        model: The compiled scene.
    """
    return tuple(Equality(e, _source(model, e)) for e in np.flatnonzero(model.eq_active0).tolist())


class ConstrainedModel:
    """Responses of a model with its equality constraints, at one state after the other: nothing is remembered."""

    def __init__(self, model: Any) -> None:
        """Take the constraints of a model, which may have none."""
        self._model, self._sources = model, [equality.source for equality in equalities_of(model)]
        self._rows: LoopStage | None = None
        self._data: Any = None

    def respond(self, data: Any, forces: FloatArray, answers: FloatArray) -> None:
        """Write the accelerations by some generalised forces with the constraints, M^-1 f less what the rows hold.

        Args:
            data: State of the model, derived quantities current.
            forces: Generalised forces, (m, nv).
            answers: Accelerations by each of them, (m, nv).
        """
        mujoco.mj_solveM(self._model, data, answers, forces)
        if not self._sources:
            return
        if self._rows is None or data is not self._data:
            ids = range(self._model.nbody), range(self._model.nv)
            bound = [source.bind(self._model, data, *ids) for source in self._sources]
            self._rows, self._data = LoopStage(self._model, data, bound, data, MECHANISM_RANK), data
        self._rows.evaluate()
        J = self._rows.J
        self._responses = np.empty_like(J)
        mujoco.mj_solveM(self._model, data, self._responses, J)
        values, vectors = np.linalg.eigh(J @ self._responses.T)
        # Eigenvalues are squares of singular values.
        kept = values > MECHANISM_RANK**2 * values[-1]
        self._inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
        answers -= (answers @ J.T) @ self._inverse @ self._responses

    def acceleration(self) -> FloatArray:
        """Acceleration that the rows ask for without any force, at the state of the last :meth:`respond`, (nv,)."""
        if self._rows is None:
            return np.zeros(self._model.nv)
        return np.asarray(-(self._rows.rates @ self._inverse) @ self._responses)

    def _constraints(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Rows J and errors in position at the state in ``data``, (n, nv) and (n,)."""
        ids = range(self._model.nbody), range(self._model.nv)
        bound = [source.bind(self._model, data, *ids) for source in self._sources]
        J = [np.empty((0, self._model.nv)), *(np.empty((constraint.count, self._model.nv)) for constraint in bound)]
        for constraint, rows in zip(bound, J[1:], strict=True):
            constraint.evaluate(rows, np.empty(constraint.count))
        return np.concatenate(J), np.concatenate([np.empty(0), *(constraint.errors() for constraint in bound)])

    def follow(self, data: Any, dofs: Sequence[int] | IntArray) -> FloatArray:
        """Rates of all coordinates per rate of some joints, which all others follow, (nv, n).

        Args:
            data: State of the model, positions current.
            dofs: Degrees of freedom of the joints.
        """
        J, nv = self._constraints(data)[0], self._model.nv
        N, others = np.eye(nv)[:, dofs], np.delete(np.arange(nv), dofs)
        N[others] = -np.linalg.lstsq(J[:, others], J[:, dofs], rcond=MECHANISM_RANK)[0] if len(J) else 0.0
        return N

    def close(self, data: Any, fixed: Sequence[int] | IntArray) -> bool:
        """Let all other coordinates follow those of some joints; returns whether they can.

        Args:
            data: State of the model near one that is closed; positions are changed and current.
            fixed: Degrees of freedom that stay as they are.
        """
        model, others, left = self._model, np.delete(np.arange(self._model.nv), fixed), 0.0
        for _ in range(_STEPS if self._sources else 0):
            mujoco.mj_fwdPosition(model, data)
            (J, errors), change = self._constraints(data), np.zeros(model.nv)
            change[others] = np.linalg.lstsq(J[:, others], -errors, rcond=MECHANISM_RANK)[0]
            size, left = float(np.abs(change).max()), float(np.abs(errors).max())
            if size <= _SETTLED:
                break
            mujoco.mj_integratePos(model, data.qpos, change * min(1.0, _LONGEST_STEP / size), 1.0)
        mujoco.mj_fwdPosition(model, data)
        return left <= MECHANISM_RANK


def _source(model: Any, e: int) -> RowSource:
    kind, data = mujoco.mjtEq(model.eq_type[e]), np.array(model.eq_data[e])
    one, other = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    if kind == mujoco.mjtEq.mjEQ_JOINT:
        zeros = [0.0 if k < 0 else float(model.qpos0[model.jnt_qposadr[k]]) for k in (one, other)]
        leader = None if other < 0 else int(model.jnt_dofadr[other])
        return JointCoupling(int(model.jnt_dofadr[one]), leader, _polynomial(zeros, data))
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        zeros = [0.0 if k < 0 else float(model.tendon_length0[k]) for k in (one, other)]
        leads = None if other < 0 else str(model.tendon(other).name)
        return TendonCoupling(str(model.tendon(one).name), leads, _polynomial(zeros, data))
    return _latch(model, e, rigid=kind == mujoco.mjtEq.mjEQ_WELD)


def _polynomial(zeros: list[float], data: FloatArray) -> Polynomial:
    a0, a1, a2, a3, a4 = data[:5].tolist()
    return Polynomial(zeros[0], zeros[1], (a0, a1, a2, a3, a4))


def _latch(model: Any, e: int, *, rigid: bool) -> LatchedBodies:
    """A connect is a ball latch, a weld a rigid one; between sites their frames coincide."""
    data, ends = np.array(model.eq_data[e]), [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
    if int(model.eq_objtype[e]) == _SITE:
        bodies = [int(model.site_bodyid[site]) for site in ends]
        points = [np.array(model.site_pos[site]) for site in ends]
        axes = [rotation_matrix(model.site_quat[site]) for site in ends]
    else:
        # eq_data holds the point in body 1, then in body 2; for a weld the other way round, and then the pose of 2 in 1.
        bodies, points = ends, [data[3:6], data[0:3]] if rigid else [data[0:3], data[3:6]]
        axes = [_EYE, rotation_matrix(data[6:10]).T if rigid else _EYE]
    # A weld without torque, torquescale="0", is a connect.
    stopped = stopped_along_axes("rigid" if rigid and data[10] > 0.0 else "ball")
    return LatchedBodies(bodies[0], bodies[1], points[0], points[1], axes[0], axes[1], stopped)
