"""Springs and dampers of joints and tendons: elastic energy, stiffness, dissipation, and the fastest modes.

MuJoCo's springs and dampers are polynomials: with the displacement x and the rate v, the forces are -(a x + b x^2 + c x^3)
and -(a v + b v |v| + c v^3). The displacement of a hinge or slide is from ``springref``; a ball joint has the rotation angle
from its reference. The spring of a tendon acts beyond a dead band, ``springlength``: x is the length from its nearer end,
negative below the band, and both forces act along the gradient of the length.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.model.system import (
    damping_coefficients,
    stiffness_coefficients,
    tendon_bodies,
    tendon_damping_coefficients,
    tendon_stiffness_coefficients,
)


class Dampers:
    """Dampers with the forces -(a v + b v |v| + c v^3) at rates v, of joints or of tendons, (n,)."""

    _d: FloatArray
    """Coefficients a, b and c, (3, n)."""

    def dissipation(self, rates: FloatArray) -> FloatArray:
        """Power that dampers turn into heat, W, (n,)."""
        (a, b, c), speed = self._d, np.abs(rates)
        dissipation: FloatArray = rates * rates * (a + speed * (b + speed * c))
        return dissipation

    def dissipation_slope(self, rates: FloatArray) -> FloatArray:
        """Slope of that power over the rate, N m or N, (n,)."""
        (a, b, c), speed = self._d, np.abs(rates)
        slope: FloatArray = rates * (2.0 * a + speed * (3.0 * b + 4.0 * speed * c))
        return slope

    def damping(self, rates: FloatArray) -> FloatArray:
        """Slope of the damper force over the rate, N m s/rad or N s/m, (n,)."""
        (a, b, c), speed = self._d, np.abs(rates)
        damping: FloatArray = a + speed * (2.0 * b + 3.0 * speed * c)
        return damping


class TendonSprings(Dampers):
    """Springs and dampers of the tendons of a model; n is the number of tendons that have one.

    Attributes:
        ids: Ids of the tendons, (n,).
        dofs: A degree of freedom of the tree that each is attached to, (n,).
        elastic: Whether a tendon has a spring.
        damped: Whether one has a damper.
    """

    def __init__(self, model: Any) -> None:
        """Read the coefficients of a model."""
        stiffness, damping = tendon_stiffness_coefficients(model), tendon_damping_coefficients(model)
        self._model = model
        self.ids = np.flatnonzero(stiffness.any(axis=1) | damping.any(axis=1))
        self._k, self._d = stiffness[self.ids].T, damping[self.ids].T
        self._low, self._high = model.tendon_lengthspring[self.ids].T
        roots = [model.body_rootid[max(tendon_bodies(model, i))] for i in self.ids.tolist()]
        self.dofs = model.body_dofadr[roots]
        self.elastic, self.damped = bool(self._k.any()), bool(self._d.any())

    def _stretch(self, data: Any) -> FloatArray:
        """Length of each tendon from the nearer end of its dead band, m or rad, negative below it, (n,)."""
        length = data.ten_length[self.ids]
        stretch: FloatArray = np.maximum(length - self._high, 0.0) + np.minimum(length - self._low, 0.0)
        return stretch

    def rates(self, data: Any) -> FloatArray:
        """Rate of each length, (n,)."""
        rates: FloatArray = data.ten_velocity[self.ids]
        return rates

    def lengths(self, data: Any) -> FloatArray:
        """Each length, (n,)."""
        lengths: FloatArray = data.ten_length[self.ids]
        return lengths

    def energy(self, data: Any) -> FloatArray:
        """Elastic energy at the state in ``data``, positions current, J, (n,)."""
        (a, b, c), x = self._k, self._stretch(data)
        energy: FloatArray = x * x * (a / 2.0 + x * (b / 3.0 + x * c / 4.0))
        return energy

    def stiffness(self, data: Any) -> FloatArray:
        """Tangent stiffness at the state in ``data``, zero in the dead band and where it is negative, (n,)."""
        (a, b, c), x = self._k, self._stretch(data)
        # A band of one length is none: the spring acts on both sides of it, and at it.
        acts = (x != 0.0) | (self._low == self._high)
        return np.where(acts, np.maximum(a + x * (2.0 * b + 3.0 * x * c), 0.0), 0.0)

    def rows(self, data: Any) -> FloatArray:
        """Gradients of the lengths, positions in ``data`` current, (n, nv)."""
        return tendon_rows(self._model, data)[self.ids]


def tendon_rows(model: Any, data: Any) -> FloatArray:
    """Gradient of the length of every tendon, positions in ``data`` current, (ntendon, nv)."""
    dense = np.zeros((model.ntendon, model.nv))
    mujoco.mju_sparse2dense(dense, data.ten_J.reshape(-1), model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind)
    return dense


_BALL, _FREE = int(mujoco.mjtJoint.mjJNT_BALL), int(mujoco.mjtJoint.mjJNT_FREE)


class FastestMode(NamedTuple):
    """The fastest of some modes.

    Attributes:
        rate: Its angular frequency, or the decay rate of a damper alone, 1/s; 0 if there is none.
        dof: The degree of freedom that takes the largest part in it.
    """

    rate: float
    dof: int


class JointSprings(Dampers):
    """Springs and dampers of the joints of a model, except those of free joints, and those of its tendons.

    Attributes:
        elastic: Whether a joint or tendon has a spring.
        damped: Whether one has a damper.
        damped_balls: Whether a ball joint has one.
        tendons: Those of tendons, which are none of the values by degree of freedom.
    """

    def __init__(self, model: Any) -> None:
        """Read the coefficients of a model."""
        self._nv, stiffness = model.nv, stiffness_coefficients(model)
        sprung = np.any(stiffness, axis=1) & (model.jnt_type != _FREE)
        self._scalars, self._balls = [], []
        for j in np.flatnonzero(sprung).tolist():
            dof, place, coefficients = int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j]), stiffness[j].tolist()
            if model.jnt_type[j] == _BALL:
                self._balls.append((dof, place, model.qpos_spring[place : place + 4].copy(), coefficients))
            else:
                self._scalars.append((dof, place, float(model.qpos_spring[place]), coefficients))
        kinds = model.jnt_type[model.dof_jntid]
        self._d = np.where((kinds != _FREE)[:, None], damping_coefficients(model), 0.0).T
        self.tendons = TendonSprings(model)
        self.elastic = bool(sprung.any()) or self.tendons.elastic
        self.damped = bool(self._d.any()) or self.tendons.damped
        self.damped_balls = bool(self._d[:, kinds == _BALL].any())
        linear = not stiffness[sprung, 1:].any()
        self._constant = self._stiffness(np.array(model.qpos_spring)) if linear else None
        self._viscous = self._d[0].copy() if not self._d[1:].any() else None

    def _displacements(self, qpos: FloatArray) -> list[tuple[int, int, float, list[float]]]:
        """Springs: first dof, number of dofs, displacement (of a ball joint its angle) in rad or m, coefficients."""
        displacements, turn, places = [], np.empty(3), qpos.tolist()
        for dof, place, zero, coefficients in self._scalars:
            displacements.append((dof, 1, places[place] - zero, coefficients))
        for dof, place, reference, coefficients in self._balls:
            quaternion = qpos[place : place + 4].copy()
            mujoco.mju_normalize4(quaternion)
            mujoco.mju_subQuat(turn, quaternion, reference)
            displacements.append((dof, 3, math.hypot(*turn.tolist()), coefficients))
        return displacements

    def energy(self, qpos: FloatArray) -> FloatArray:
        """Elastic energy at a configuration, J, at the first degree of freedom of each joint, (nv,)."""
        energy = np.zeros(self._nv)
        for dof, _, x, (a, b, c) in self._displacements(qpos):
            energy[dof] = x * x * (a / 2.0 + x * (b / 3.0 + x * c / 4.0))
        return energy

    def stiffness(self, qpos: FloatArray) -> FloatArray:
        """Tangent stiffness at a configuration, N m/rad or N/m, zero where it is negative, (nv,)."""
        return self._constant if self._constant is not None else self._stiffness(qpos)

    def _stiffness(self, qpos: FloatArray) -> FloatArray:
        stiffness = np.zeros(self._nv)
        for dof, size, x, (a, b, c) in self._displacements(qpos):
            stiffness[dof : dof + size] = max(0.0, a + x * (2.0 * b + 3.0 * x * c))
        return stiffness

    def dissipation(self, rates: FloatArray) -> FloatArray:
        """Power that dampers turn into heat, W, (nv,)."""
        return super().dissipation(rates) if self._viscous is None else rates * rates * self._viscous

    def fastest(self, model: Any, data: Any) -> tuple[FastestMode, FastestMode]:
        """Fastest mode of M qddot + K q = 0, and of M qddot + D qdot = 0, at the state in ``data``.

        Constraints such as a grasp or a contact only make the modes slower (Rayleigh).
        """
        M, tendons = mass_matrix(model, data), self.tendons
        rows = tendons.rows(data)
        square, dof = _largest(M, self.stiffness(data.qpos), rows, tendons.stiffness(data))
        decay = np.maximum(self.damping(data.qvel), 0.0), rows, np.maximum(tendons.damping(tendons.rates(data)), 0.0)
        return FastestMode(math.sqrt(square), dof), FastestMode(*_largest(M, *decay))


def _largest(mass: FloatArray, diagonal: FloatArray, rows: FloatArray, along: FloatArray) -> tuple[float, int]:
    """Largest eigenvalue of M^-1 K, and the dof that takes the largest part in it; K is diagonal, plus rows^T along rows."""
    dofs, tendons = np.flatnonzero(diagonal > 0.0), np.flatnonzero(along > 0.0)
    if not len(dofs) + len(tendons):
        return 0.0, -1
    units = np.eye(len(diagonal))[dofs]
    root = np.vstack((units, rows[tendons])) * np.sqrt(np.concatenate((diagonal[dofs], along[tendons])))[:, None]
    values, vectors = np.linalg.eigh(root @ np.linalg.inv(mass) @ root.T)
    return float(values[-1]), int(np.argmax(np.abs(vectors[:, -1] @ root)))
