# cython: boundscheck=False, wraparound=False
"""OSDRE law for two outputs; twin of ffsm_controllers.osdre.planar_law."""

import numpy as np

from libc.math cimport hypot, sqrt

from ffsm_mj_fast.osdre_planar cimport answer
from ffsm_mj_fast.riccati_planar cimport PlanarRiccati, pair_t, principal_axes
from ffsm_mj_fast.tip_kinematics cimport TipKinematics


cdef class PlanarLaw:
    """u = -R^-1 B^T K [y - y_d; ydot], along the principal axes of S."""

    cdef readonly object effort, report
    cdef object made_of
    cdef TipKinematics kinematics
    cdef PlanarRiccati riccati
    cdef const double[:, ::1] driven
    cdef double[:, ::1] gains
    cdef double[::1] qvel, bias, passive, u, told
    cdef int first, second
    cdef pair_t target
    cdef bint whole_stack

    def __init__(
        self,
        TipKinematics kinematics not None,
        data,
        PlanarRiccati riccati not None,
        const double[:, ::1] driven,
        axes,
        target_m,
        bint whole_stack,
    ):
        if driven.shape[1] != len(data.qvel) or kinematics.rows.shape[0] != 2 or not set(axes) <= {0, 1, 2}:
            raise ValueError(f"a selection of {driven.shape[1]} dofs or outputs along {axes} do not fit")
        self.kinematics, self.riccati, self.driven, self.whole_stack = kinematics, riccati, driven, whole_stack
        self.made_of = (kinematics, data, riccati, np.asarray(driven), axes, target_m, whole_stack)
        self.first, self.second = axes
        self.target = (target_m[0], target_m[1])
        self.qvel, self.bias, self.passive = data.qvel, data.qfrc_bias, data.qfrc_passive
        self.gains = np.zeros((driven.shape[0], 2))
        self.effort, self.report = np.zeros(driven.shape[0] // 2), np.full(4, np.nan)
        self.u, self.told = self.effort, self.report

    def __reduce__(self):
        """How a saved state of a simulation holds it: it has no memory but that of the Riccati solver."""
        return type(self), self.made_of

    def tick(self):
        """Compute ``effort`` and ``report`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        cdef TipKinematics tip = self.kinematics
        cdef double s0 = 0.0, s1 = 0.0, s3 = 0.0, b0 = 0.0, b1 = 0.0, b3 = 0.0
        cdef double v0 = 0.0, v1 = 0.0, d0 = 0.0, d1 = 0.0, y0, y1, force, smallest
        cdef Py_ssize_t i, j, n = self.u.shape[0]
        cdef pair_t values, axes, error, w
        cdef double residual
        cdef bint fallback
        tip.update()
        for i in range(2 * n):
            self.gains[i, 0] = self.gains[i, 1] = 0.0
            for j in range(self.qvel.shape[0]):
                self.gains[i, 0] += self.driven[i, j] * tip.w[0, j]
                self.gains[i, 1] += self.driven[i, j] * tip.w[1, j]
        for i in range(n):
            s0 += self.gains[n + i, 0] * self.gains[i, 0]
            s1 += self.gains[n + i, 0] * self.gains[i, 1]
            s3 += self.gains[n + i, 1] * self.gains[i, 1]
            b0 += self.gains[i, 0] * self.gains[i, 0]
            b1 += self.gains[i, 0] * self.gains[i, 1]
            b3 += self.gains[i, 1] * self.gains[i, 1]
        for j in range(self.qvel.shape[0]):
            force = self.bias[j] - self.passive[j]
            v0 += tip.rows[0, j] * self.qvel[j]
            v1 += tip.rows[1, j] * self.qvel[j]
            d0 += tip.dot[self.first, j] * self.qvel[j] - tip.w[0, j] * force
            d1 += tip.dot[self.second, j] * self.qvel[j] - tip.w[1, j] * force
        values, axes = principal_axes(s0, s1, s3)
        smallest = principal_axes(b0, b1, b3)[0][1]
        y0, y1 = tip.place[self.first], tip.place[self.second]
        error = (y0 - self.target[0], y1 - self.target[1])
        w, error, residual, fallback = answer(
            self.riccati, values, axes, (d0, d1), (y0, y1), error, (v0, v1), self.whole_stack
        )
        for i in range(n):
            self.u[i] = self.gains[n + i, 0] * w[0] + self.gains[n + i, 1] * w[1]
        self.told[0], self.told[1] = hypot(error[0], error[1]), residual
        self.told[2], self.told[3] = fallback, sqrt(smallest if smallest > 0.0 else 0.0)
