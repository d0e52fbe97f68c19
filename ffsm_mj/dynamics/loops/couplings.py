"""Scalar rows: a joint or a tendon that follows another one by a polynomial, or is locked.

With y the coordinate or length that follows and x the one that leads, the row is that of

    y - y0 = p(x - x0),   p(z) = a0 + a1 z + ... + a4 z^4

in the time derivative: J = J_y - p' J_x, gamma = gamma_y - p' gamma_x - p'' xdot^2. Without a leader y - y0 = a0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.loops import JointRow
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.closed_loops import BoundRows
from ffsm_mj.dynamics.springs import tendon_rows

_GEOMS = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))
_DIFFERENCE_S = (1e-3, 5e-4, 2.5e-4)
"""Steps of central differences: their errors of order two and four cancel, which leaves 6e-14 of the second rate."""


@dataclass(frozen=True)
class Polynomial:
    """A scalar that follows another one.

    Attributes:
        follower_zero: y0, in the unit of y.
        leader_zero: x0, in the unit of x.
        coefficients: a0 to a4; without a leader only a0 counts.
    """

    follower_zero: float = 0.0
    leader_zero: float = 0.0
    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def at(self, x: float) -> tuple[float, float, float]:
        """Value of y, slope p' and second derivative p'' for x."""
        z = x - self.leader_zero
        a0, a1, a2, a3, a4 = self.coefficients
        value = self.follower_zero + a0 + z * (a1 + z * (a2 + z * (a3 + z * a4)))
        return value, a1 + z * (2.0 * a2 + z * (3.0 * a3 + z * 4.0 * a4)), 2.0 * a2 + z * (6.0 * a3 + z * 12.0 * a4)


@dataclass(frozen=True)
class JointCoupling:
    """A hinge or slide joint that follows another one, or is locked: one row.

    Attributes:
        follower: Its degree of freedom in the logged system.
        leader: That of the joint which leads; None: the follower is locked.
        law: How it follows.
    """

    follower: int
    leader: int | None = None
    law: Polynomial = Polynomial()
    count = 1

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:  # noqa: ARG002
        """The row in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.RowSource`."""
        leader = -1 if self.leader is None else dofs[self.leader]
        follower, law = dofs[self.follower], self.law
        places = [-1 if dof < 0 else int(model.jnt_qposadr[model.dof_jntid[dof]]) for dof in (follower, leader)]
        zeros = law.follower_zero, law.leader_zero
        row: BoundRows = JointRow(data, (follower, leader), places, zeros, law.coefficients)
        return row


@dataclass(frozen=True)
class RestingJoint:
    """A hinge or slide joint that is kept at rest, wherever it is: the row of its rate.

    Attributes:
        dof: Its degree of freedom in the logged system.
    """

    dof: int
    count = 1

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:  # noqa: ARG002
        """The row in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.RowSource`."""
        row: BoundRows = JointRow(data, (dofs[self.dof], -1), (-1, -1), (0.0, 0.0), Polynomial().coefficients)
        return row


@dataclass(frozen=True)
class RestingCombination:
    """A combination of joints and lengths of tendons that is kept at rest, wherever they are: the row of its rate.

    Attributes:
        dofs: Degrees of freedom in the logged system, of hinges and slides.
        weights: Their weights.
        tendons: Names of tendons.
        tendon_weights: Their weights.
    """

    dofs: tuple[int, ...]
    weights: tuple[float, ...]
    tendons: tuple[str, ...] = ()
    tendon_weights: tuple[float, ...] = ()
    count = 1

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:  # noqa: ARG002
        """The row in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.RowSource`."""
        row = np.zeros(model.nv)
        row[[dofs[dof] for dof in self.dofs]] = self.weights
        return _BoundCombination(row, [TendonRow(model, data, name) for name in self.tendons], self.tendon_weights)


class _BoundCombination:
    """A combination of joints and lengths in a model, without a place to keep."""

    count = 1

    def __init__(self, row: FloatArray, tendons: Sequence[TendonRow], weights: Sequence[float]) -> None:
        self._row, self._tendons, self._weights = row, tendons, weights

    def evaluate(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the row and its rate."""
        J[0], gamma[0] = self._row, 0.0
        for tendon, weight in zip(self._tendons, self._weights, strict=True):
            row, rate = tendon.row()
            J[0] += weight * row
            gamma[0] += weight * rate

    def errors(self) -> FloatArray:
        """Nothing that has a place, (1,)."""
        return np.zeros(1)


@dataclass(frozen=True)
class TendonCoupling:
    """A tendon whose length follows that of another one, or is locked: one row.

    Attributes:
        follower: Its name.
        leader: Name of the tendon that leads; None: the follower is locked.
        law: How it follows.
    """

    follower: str
    leader: str | None = None
    law: Polynomial = Polynomial()
    count = 1

    def bind(self, model: Any, data: Any, bodies: Sequence[int], dofs: Sequence[int]) -> BoundRows:  # noqa: ARG002
        """The row in a model; see :class:`~ffsm_mj.dynamics.loops.closed_loops.RowSource`."""
        return _BoundTendons(model, data, self)


class _BoundTendons:
    """The row of a coupling of tendons in a model."""

    count = 1

    def __init__(self, model: Any, data: Any, coupling: TendonCoupling) -> None:
        self._data, self._law = data, coupling.law
        self._follower = TendonRow(model, data, coupling.follower)
        self._leader = None if coupling.leader is None else TendonRow(model, data, coupling.leader)

    def evaluate(self, J: FloatArray, gamma: FloatArray) -> None:
        """Write the row and its rate."""
        J[0], gamma[0] = self._follower.row()
        if self._leader is not None:
            row, rate = self._leader.row()
            _, slope, bend = self._law.at(self._leader.length)
            J[0] -= slope * row
            gamma[0] -= slope * rate + bend * float(row @ self._data.qvel) ** 2

    def errors(self) -> FloatArray:
        """Error of the length that follows, (1,)."""
        x = self._law.leader_zero if self._leader is None else self._leader.length
        return np.array([self._follower.length - self._law.at(x)[0]])


class TendonRow:
    """Rate of the length of a tendon, as a row.

    A straight segment between two points that move by v and a0 (at zero generalised acceleration) relative to each other
    along its direction u has a second rate of (|v|^2 - (u . v)^2) / length + u . a0. That of a path around geoms is found by
    central differences.

    Attributes:
        data: Data of the model.
    """

    def __init__(self, model: Any, data: Any, name: str) -> None:
        """Bind to a model.

        Args:
            model: MuJoCo model.
            data: Its data.
            name: Name of the tendon.
        """
        self._model, self.data = model, data
        self._id = tendon = int(model.tendon(name).id)
        first = int(model.tendon_adr[tendon])
        path = slice(first, first + int(model.tendon_num[tendon]))
        kinds, ids = model.wrap_type[path].tolist(), model.wrap_objid[path].tolist()
        self._fixed = np.zeros(model.nv)
        self._segments: list[tuple[int, int, float]] = []
        self._wraps = any(kind in _GEOMS for kind in kinds)
        self._scratch: Any = None
        divisor, last = 1.0, -1
        for kind, place, parameter in zip(kinds, ids, model.wrap_prm[path].tolist(), strict=True):
            if kind == mujoco.mjtWrap.mjWRAP_JOINT:
                self._fixed[model.jnt_dofadr[place]] += parameter
            elif kind == mujoco.mjtWrap.mjWRAP_PULLEY:
                divisor, last = parameter, -1
            else:  # a site
                if last >= 0:
                    self._segments.append((last, place, divisor))
                last = place
        self._jacobians = np.empty((4, 3, model.nv))

    @property
    def length(self) -> float:
        """Its length, m, or of a fixed tendon the weighted sum of its joints."""
        return float(self.data.ten_length[self._id])

    def row(self) -> tuple[FloatArray, float]:
        """Row of its rate, (nv,), and its second rate at zero generalised acceleration."""
        if self._wraps:
            return tendon_rows(self._model, self.data)[self._id], self.bend_by_differences()
        model, data, total, gamma = self._model, self.data, self._fixed.copy(), 0.0
        J, other, rate, other_rate = self._jacobians
        for first, last, divisor in self._segments:
            for site, at, rates in ((last, J, rate), (first, other, other_rate)):
                point, body = data.site_xpos[site], int(model.site_bodyid[site])
                mujoco.mj_jac(model, data, at, None, point, body)
                mujoco.mj_jacDot(model, data, rates, None, point, body)
            span = data.site_xpos[last] - data.site_xpos[first]
            size = float(np.linalg.norm(span))
            if size == 0.0:
                continue  # no direction: the rate of the length is not defined
            along, v, a = span / size, (J - other) @ data.qvel, (rate - other_rate) @ data.qvel
            total += along @ (J - other) / divisor
            speed = float(along @ v)
            gamma += ((float(v @ v) - speed * speed) / size + float(along @ a)) / divisor
        return total, gamma

    def bend_by_differences(self) -> float:
        """Second rate by central differences of MuJoCo's own row along the motion, for any path.

        With Richardson's extrapolation over three steps the error is of rounding, but where a wrap begins or ends: there the
        row has a kink, and the second rate jumps.
        """
        self._scratch = self._scratch or mujoco.MjData(self._model)
        model, scratch, bends = self._model, self._scratch, []
        for step in _DIFFERENCE_S:
            ends = []
            for time_s in (step, -step):
                scratch.qpos[:] = self.data.qpos
                mujoco.mj_integratePos(model, scratch.qpos, self.data.qvel, time_s)
                mujoco.mj_fwdPosition(model, scratch)
                ends.append(float(tendon_rows(model, scratch)[self._id] @ self.data.qvel))
            bends.append((ends[0] - ends[1]) / (2.0 * step))
        first, second = ((4.0 * finer - coarse) / 3.0 for coarse, finer in pairwise(bends))
        return (16.0 * second - first) / 15.0
