"""Springs and dampers of tendons: elastic energy, stiffness and dissipation by tendon, and the rows that they act along.

MuJoCo's spring of a tendon acts beyond a dead band, ``springlength``: with the length x from its nearer end, negative below
the band, and the rate v of the length, the forces are -(a x + b x^2 + c x^3) and -(a v + b v |v| + c v^3). Both act along
the gradient of the length.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.model.system import tendon_bodies, tendon_damping_coefficients, tendon_stiffness_coefficients


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
