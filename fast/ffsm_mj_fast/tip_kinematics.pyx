# cython: boundscheck=False, wraparound=False
"""Jacobian of the tip, its rate, and accelerations of the tip due to forces; twin of ffsm_controllers.osdre.tip_kinematics."""

import numpy as np

from ffsm_mj_fast.functions cimport address, mj, mjData, mjModel


cdef class TipKinematics:
    """Quantities of the output y at the state in ``data`` at the last ``update``."""

    def __init__(self, model, data, int site, axes):
        if not 0 <= site < model.nsite or not set(axes) <= {0, 1, 2}:
            raise ValueError(f"no site {site}, or axes {axes} that are none of 0, 1, 2")
        self.m, self.d, self.made_of = <const mjModel*>address(model), <mjData*>address(data), (model, data, site, axes)
        self.site, self.body, self.axes = site, model.site_bodyid[site], np.array(axes, dtype=np.intc)
        count, nv = len(axes), model.nv
        self.J, self.jac_dot, self.W = np.zeros((count, nv)), np.zeros((3, nv)), np.zeros((count, nv))
        self.jacp, self.rows, self.dot, self.w = np.zeros((3, nv)), self.J, self.jac_dot, self.W
        self.point = self.place = data.site_xpos[site]

    def __reduce__(self):
        """How a saved state of a simulation holds it: all quantities are computed anew at each tick."""
        return type(self), self.made_of

    cpdef void update(self) noexcept:
        """Compute all quantities at the current state; derived quantities in ``data`` must be current."""
        cdef Py_ssize_t k, j
        mj.jacSite(self.m, self.d, &self.jacp[0, 0], NULL, self.site)
        mj.jacDot(self.m, self.d, &self.dot[0, 0], NULL, &self.place[0], self.body)
        for k in range(self.rows.shape[0]):
            for j in range(self.rows.shape[1]):
                self.rows[k, j] = self.jacp[self.axes[k], j]
        mj.solveM(self.m, self.d, &self.w[0, 0], &self.rows[0, 0], <int>self.rows.shape[0])
