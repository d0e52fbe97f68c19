# cython: boundscheck=False, wraparound=False, cdivision=True
"""OSDRE law for any number of outputs; twin of ffsm_controllers.osdre.block_law.

Singular values come from one-sided Jacobi rotations, which make the rows of a matrix orthogonal.
"""

import numpy as np

from ffsm_controllers.osdre import block_law as plain

from libc.math cimport fabs, sqrt

from ffsm_mj_fast.riccati_doubling cimport Doubling
from ffsm_mj_fast.tip_kinematics cimport TipKinematics

cdef double NO_MOTION = plain._NO_MOTION
cdef double ORTHOGONAL = 1e-16
cdef int SWEEPS = 60


cdef void make_orthogonal(double[:, ::1] rows) noexcept:
    """One-sided Jacobi: rotate pairs of rows until they are orthogonal; their norms are the singular values."""
    cdef Py_ssize_t i, j, k
    cdef double a, b, c, t, tangent, cosine, sine
    cdef bint turned = True
    for _ in range(SWEEPS):
        if not turned:
            return
        turned = False
        for i in range(rows.shape[0]):
            for j in range(i + 1, rows.shape[0]):
                a = b = c = 0.0
                for k in range(rows.shape[1]):
                    a += rows[i, k] * rows[i, k]
                    b += rows[j, k] * rows[j, k]
                    c += rows[i, k] * rows[j, k]
                if not fabs(c) > ORTHOGONAL * sqrt(a * b):
                    continue
                turned = True
                t = (b - a) / (2.0 * c)
                tangent = (1.0 if t >= 0.0 else -1.0) / (fabs(t) + sqrt(1.0 + t * t))
                cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for k in range(rows.shape[1]):
                    t = rows[i, k]
                    rows[i, k] = cosine * t - sine * rows[j, k]
                    rows[j, k] = sine * t + cosine * rows[j, k]


cdef class BlockLaw:
    """u = -R^-1 B^T K [y - y_d; ydot]."""

    cdef readonly object effort, report, inputs
    cdef object made_of
    cdef TipKinematics kinematics
    cdef Doubling riccati
    cdef const double[:, ::1] driven
    cdef double[:, ::1] gains, rows
    cdef double[::1] qvel, bias, passive, u, told, lengths, y, y_dot, drift, target
    cdef bint whole_stack

    def __init__(
        self,
        TipKinematics kinematics not None,
        data,
        Doubling riccati not None,
        const double[:, ::1] driven,
        axes,
        target_m,
        bint whole_stack,
    ):
        cdef Py_ssize_t p = riccati.p
        if driven.shape[1] != len(data.qvel) or not kinematics.rows.shape[0] == len(axes) == len(target_m) == p:
            raise ValueError(f"a selection of {driven.shape[1]} dofs or outputs along {axes} do not fit")
        self.kinematics, self.riccati, self.driven, self.whole_stack = kinematics, riccati, driven, whole_stack
        self.made_of = (kinematics, data, riccati, np.asarray(driven), axes, target_m, whole_stack)
        self.qvel, self.bias, self.passive = data.qvel, data.qfrc_bias, data.qfrc_passive
        self.gains, self.inputs = np.zeros((driven.shape[0], p)), np.zeros((p, driven.shape[0] // 2))
        self.lengths, self.y, self.y_dot, self.drift = np.zeros((4, p))
        self.target = np.array(target_m, dtype=np.float64)
        self.effort, self.report = np.zeros(driven.shape[0] // 2), np.full(5, np.nan)
        self.u, self.told, self.rows = self.effort, self.report, self.inputs

    def __reduce__(self):
        """How a saved state of a simulation holds it: it has no memory but that of the Riccati solver."""
        return type(self), self.made_of

    def tick(self):
        """Compute ``effort``, ``report`` and ``inputs`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        cdef Doubling riccati = self.riccati
        cdef Py_ssize_t i, j, k, p = riccati.p, n = self.u.shape[0]
        cdef double square, residual, asked, distance = 0.0, smallest
        self.kinematics.update()
        square = self.reduce()
        for i in range(p):
            for j in range(p):
                riccati.A[p + i, j] = self.drift[i] * self.y[j] if self.whole_stack else 0.0
                riccati.A[p + i, p + j] = self.drift[i] * self.y_dot[j]
                riccati.S[p + i, p + j] = 0.0
                for k in range(n):
                    riccati.S[p + i, p + j] += self.gains[n + k, i] * self.gains[k, j]
        residual = riccati.solution()
        self.u[:] = 0.0
        for i in range(p):
            asked = 0.0
            for j in range(p):
                asked -= riccati.K[p + i, j] * (self.y[j] - self.target[j]) + riccati.K[p + i, p + j] * self.y_dot[j]
            for k in range(n):
                self.u[k] += self.gains[n + k, i] * asked
            distance += (self.y[i] - self.target[i]) ** 2
        smallest = self.decompose()
        self.told[0], self.told[1], self.told[2] = sqrt(distance), residual, riccati.doublings
        self.told[3], self.told[4] = riccati.corrections, smallest

    cdef double reduce(self) noexcept:
        """Gains, output, output rate, and drift over the square of the parameterization vector; returns that square."""
        cdef TipKinematics tip = self.kinematics
        cdef Py_ssize_t i, j, k, p = self.y.shape[0]
        cdef double square = 0.0
        for k in range(self.driven.shape[0]):
            for i in range(p):
                self.gains[k, i] = 0.0
                for j in range(self.qvel.shape[0]):
                    self.gains[k, i] += self.driven[k, j] * tip.w[i, j]
        for i in range(p):
            self.y[i], self.y_dot[i], self.drift[i] = tip.place[tip.axes[i]], 0.0, 0.0
            for j in range(self.qvel.shape[0]):
                self.y_dot[i] += tip.rows[i, j] * self.qvel[j]
                self.drift[i] += tip.dot[tip.axes[i], j] * self.qvel[j] - tip.w[i, j] * (self.bias[j] - self.passive[j])
            square += self.y_dot[i] * self.y_dot[i]
            if self.whole_stack:
                square += self.y[i] * self.y[i]
        if square > 0.0:
            for i in range(p):
                self.drift[i] /= square
        return square

    cdef double decompose(self) noexcept:
        """Compute an orthonormal basis of the rows of alpha M_c^-1; returns the smallest singular value."""
        cdef Py_ssize_t i, k, p = self.y.shape[0], n = self.u.shape[0]
        cdef double smallest, greatest
        for i in range(p):
            for k in range(n):
                self.rows[i, k] = self.gains[k, i]
        make_orthogonal(self.rows)
        for i in range(p):
            self.lengths[i] = 0.0
            for k in range(n):
                self.lengths[i] += self.rows[i, k] * self.rows[i, k]
            self.lengths[i] = sqrt(self.lengths[i])
        smallest = greatest = self.lengths[0]
        for i in range(1, p):
            smallest, greatest = min(smallest, self.lengths[i]), max(greatest, self.lengths[i])
        for i in range(p):
            for k in range(n):
                self.rows[i, k] = self.rows[i, k] / self.lengths[i] if self.lengths[i] > NO_MOTION * greatest else 0.0
        return smallest
