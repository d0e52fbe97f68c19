"""Springs and dampers of joints: elastic energy, stiffness and dissipation by degree of freedom, and the fastest modes.

MuJoCo's springs and dampers are polynomials: with the displacement x from ``springref`` and the rate v, the forces are
-(a x + b x^2 + c x^3) and -(a v + b v |v| + c v^3). A ball joint has the rotation angle from its reference for x.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.dynamics.tendon_springs import Dampers, TendonSprings
from ffsm_mj.model.system import damping_coefficients, stiffness_coefficients

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
        found, turn, places = [], np.empty(3), qpos.tolist()
        for dof, place, zero, coefficients in self._scalars:
            found.append((dof, 1, places[place] - zero, coefficients))
        for dof, place, reference, coefficients in self._balls:
            quaternion = qpos[place : place + 4].copy()
            mujoco.mju_normalize4(quaternion)
            mujoco.mju_subQuat(turn, quaternion, reference)
            found.append((dof, 3, math.hypot(*turn.tolist()), coefficients))
        return found

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
