"""Contact points with friction at one state, under given forces and in given modes."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.exchange import Stage
from ffsm_mj.contact_models.persistent.friction.cone_depth import own_margin
from ffsm_mj.contact_models.persistent.friction.internal_forces import limit_ratios
from ffsm_mj.contact_models.persistent.friction.point_modes import PointModes
from ffsm_mj.contact_models.persistent.friction.problem import FrictionProblem
from ffsm_mj.contact_models.persistent.friction.solution import Solution
from ffsm_mj.contact_models.persistent.point_rows import FrictionalRows
from ffsm_mj.contact_models.persistent.rows import ContactPoint


class FrictionState:
    """What stages and decisions need of k contact points at one state.

    Attributes:
        contact_points: Pairs and features.
        rows: Their rows.
        force: Generalised forces without the contact forces, less the bias, (nv,).
        modes: Their modes in the current step.
    """

    def __init__(
        self, contact_points: tuple[ContactPoint, ...], rows: FrictionalRows, force: FloatArray, modes: PointModes
    ) -> None:
        """Store the points; see the attributes."""
        self.contact_points, self.rows, self.force, self.modes = contact_points, rows, force, modes

    @cached_property
    def problem(self) -> FrictionProblem:
        """The problem of the accelerations of the points."""
        rows, modes = self.rows, self.modes
        b = rows.response.dot(self.force)
        b += rows.gamma
        return FrictionProblem(rows.G, b, modes.mu, modes.structures, rows.held)

    @cached_property
    def rounding(self) -> FloatArray:
        """Rounding of the accelerations of each point, m/s^2, (k,)."""
        return self.rows.acceleration_rounding(self.force)

    @cached_property
    def _stuck_forces(self) -> FloatArray:
        """Forces (n, t1, t2) in the present modes, in which no point slides with friction, N, (k, 3)."""
        return self.problem.forces(self.modes.kinds, self.modes.no_slips)

    def sticking(self) -> Solution | None:
        """The solution if all points stick and may go on to do so: none slips, and each is inside its own cone."""
        modes, problem = self.modes, self.problem
        if not modes.all_stick or np.hypot(*self.rows.slips.T).max() > modes.drift_m_s:
            return None
        forces = self._stuck_forces
        margin = own_margin(forces, modes.mu, problem.inverse_mass, self.rounding, float(np.abs(forces).max()))
        if margin < 0.0:
            return None
        accelerations = (problem.b + problem.G.dot(forces.ravel())).reshape(-1, 3)
        return Solution(modes.kinds, modes.no_slips, forces, accelerations, margin, margin, False)

    def limit_ratios(self, forces: FloatArray) -> list[float]:
        """Ratios of friction to its limit under forces (n, t1, t2), N, (k, 3); see ``internal_forces.py``."""
        return limit_ratios(forces, self.modes.mu)

    def stuck_stage(self) -> tuple[Stage, FloatArray]:
        """A stage in the present modes, in which no point slides with friction, and the generalised forces, (nv,)."""
        rows, along = self.rows, self._stuck_forces.reshape(-1)
        generalised = along.dot(rows.J)
        return Stage(rows, along, generalised * rows.qvel), generalised
