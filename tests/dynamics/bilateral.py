"""An oracle of latches: rows held as equalities, for plastic closing, forces, and projection of what drifts.

With M = L L^T and A = R L^-T = U diag(s) V^T, singular values below 1e-10 of the largest count as zero: dependent rows have
forces of least norm, and the motion is unique.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix, momentum_matrix
from ffsm_mj.tolerances import RANK


@dataclass(frozen=True)
class Closing:
    """Plastic impulse on rows.

    Attributes:
        impulses: Impulse of each row, of least norm, (n,).
        change: Change of the generalised velocity, (nv,).
        loss_J: Kinetic energy lost.
        rank: Number of independent rows.
        least_ratio: Smallest singular value that counts over the largest; small values say that the mechanism is nearly
            singular.
    """

    impulses: FloatArray
    change: FloatArray
    loss_J: float
    rank: int
    least_ratio: float


class HeldEqualities:
    """Rows in mass-weighted coordinates at one state."""

    def __init__(self, model: Any, data: Any, rows: FloatArray) -> None:
        """Factorise rows at the state in ``data``, whose kinematics and mass matrix are current.

        Args:
            model: MuJoCo model.
            data: Its data.
            rows: Rows, (n, nv).
        """
        self.rows, self._L = rows, np.linalg.cholesky(mass_matrix(model, data))
        left, sizes, right = np.linalg.svd(np.linalg.solve(self._L, rows.T).T, full_matrices=False)
        self.rank = int(np.count_nonzero(sizes > RANK * sizes.max(initial=0.0)))
        self._left, self._sizes, self._right = left[:, : self.rank], sizes[: self.rank], right[: self.rank]

    def closing(self, qvel: FloatArray) -> Closing:
        """Plastic impulse that stops the velocities of all rows."""
        taken = (self._left.T @ (self.rows @ qvel)) / self._sizes
        ratio = float(self._sizes[-1] / self._sizes[0]) if self.rank else 1.0
        change = -np.linalg.solve(self._L.T, self._right.T @ taken)
        return Closing(-self._left @ (taken / self._sizes), change, 0.5 * float(taken @ taken), self.rank, ratio)

    def forces(self, acceleration: FloatArray, rates: FloatArray) -> FloatArray:
        """Forces of least norm that keep the rates of the rows at zero, (n,).

        Args:
            acceleration: Accelerations without these forces, (nv,).
            rates: Rates of the rows at zero acceleration, (n,).
        """
        return np.asarray(-self._left @ ((self._left.T @ (self.rows @ acceleration + rates)) / self._sizes**2))

    def response(self, forces: FloatArray) -> FloatArray:
        """Accelerations by forces of the rows, M^-1 R^T f, (nv,)."""
        return np.asarray(np.linalg.solve(self._L @ self._L.T, self.rows.T @ forces))

    def projected(self, directions: FloatArray) -> FloatArray:
        """Other rows less what these hold, J (1 - M^-1 R^T (R M^-1 R^T)^+ R), (m, nv).

        With them and the same M, impacts and contact forces are those of the system in which these rows are held: their
        responses M^-1 J^T are Mc^-1 J^T, and their rates those of J wherever the held rows do not move.

        Args:
            directions: Rows J, (m, nv).
        """
        A = np.linalg.solve(self._L, directions.T).T
        return np.asarray((A - (A @ self._right.T) @ self._right) @ self._L.T)

    def correction(self, errors: FloatArray) -> FloatArray:
        """Least change of the coordinates, in the norm of M, that removes errors of the rows, (nv,)."""
        return np.asarray(-np.linalg.solve(self._L.T, self._right.T @ ((self._left.T @ errors) / self._sizes)))


def projected_velocity(model: Any, data: Any, rows: FloatArray, momentum: FloatArray) -> FloatArray:
    """Velocity next to that in ``data``, in the norm of M, with zero rows and given P and L, (nv,).

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        rows: Rows that are held, (n, nv).
        momentum: P and L about the world origin, (6,).
    """
    H = momentum_matrix(model, data, 0)
    together = HeldEqualities(model, data, np.vstack((rows, H)))
    left = np.concatenate((rows @ data.qvel, H @ data.qvel - momentum))
    return np.asarray(data.qvel + together.correction(left))


def apply_forces(data: Any, rows: FloatArray, forces: FloatArray) -> None:
    """Add generalised forces of rows to ``data.qfrc_applied``."""
    data.qfrc_applied[:] += rows.T @ forces


def unconstrained_acceleration(model: Any, data: Any) -> FloatArray:
    """Accelerations under the forces in ``data``, from current velocities and actuator forces, (nv,)."""
    smooth, found = data.qfrc_passive - data.qfrc_bias + data.qfrc_applied + data.qfrc_actuator, np.empty((1, model.nv))
    mujoco.mj_solveM(model, data, found, smooth[None])
    return np.asarray(found[0])
