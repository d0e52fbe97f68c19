"""Velocities of a configuration that arrives at the contact like the robot of the run.

The robot's point at the contact has the velocity of the run, and the robot its linear momentum and its angular momentum
about its centre of mass, as far as its base is free: motors cannot change these. Joints off the arm keep their rates. Of
the velocities that satisfy this, the robot has those of least kinetic energy.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import mass_matrix, momentum_matrix, skew
from ffsm_mj.impact_maps.self_motion import SelfMotion

_RANK = 1e-9
"""Singular values of the conditions below this share of the largest are zero: there the arm is singular."""
_SATISFIED = 1e-9
"""Largest residual of the conditions, over their size, of velocities that satisfy them."""


class ArrivalRates:
    """Velocities with which configurations arrive at a target."""

    def __init__(self, motion: SelfMotion) -> None:
        """Take the momenta from the state of the run."""
        target = motion.target
        self._motion, self._data = motion, target.data()
        self._momentum = self._conditions(target.qpos)[0][3:] @ target.qvel
        self._moving = np.unique(np.concatenate((motion.base_dofs, motion.dofs)))
        self._others = np.setdiff1d(np.arange(target.system.mj.nv), self._moving)

    def velocities(self, qpos: FloatArray) -> FloatArray | None:
        """Velocities of the scene at a configuration, (nv,); None if no rates of the arm satisfy the conditions."""
        target, moving, others = self._motion.target, self._moving, self._others
        A, M = self._conditions(qpos)
        qvel = target.qvel.copy()
        wanted = np.concatenate((target.tip_velocity, self._momentum)) - A[:, others] @ qvel[others]
        L = np.linalg.cholesky(M[np.ix_(moving, moving)])
        # In w = L^T v + L^-1 M_mo v_o the kinetic energy is |w|^2 / 2 and a constant: the shortest w has the least.
        given = np.linalg.solve(L, M[np.ix_(moving, others)] @ qvel[others])
        B = np.linalg.solve(L, A[:, moving].T).T
        w = np.linalg.lstsq(B, wanted + B @ given, rcond=_RANK)[0]
        qvel[moving] = np.linalg.solve(L.T, w - given)
        miss = np.abs(A[:, moving] @ qvel[moving] - wanted).max()
        return qvel if miss <= _SATISFIED * (1.0 + float(np.abs(wanted).max())) else None

    def _conditions(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows that give the velocity of the contact point and the free momenta, (3 + k, nv), and the mass matrix."""
        motion, data = self._motion, self._data
        system = motion.target.system
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(system.mj, data)
        jacp, root = np.empty((3, system.mj.nv)), system.robot.root
        mujoco.mj_jac(system.mj, data, jacp, None, motion.target.contact.point, motion.target.body)
        momenta = momentum_matrix(system.mj, data, root)
        about_com = momenta[3:] - skew(data.subtree_com[root]) @ momenta[:3]
        rows = (jacp, motion.free_directions.T @ momenta[:3], motion.free_axes.T @ about_com)
        return np.vstack(rows), mass_matrix(system.mj, data)
