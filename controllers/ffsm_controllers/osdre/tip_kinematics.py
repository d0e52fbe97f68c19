"""The tip's Jacobian, its rate, and how forces move the tip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np


class TipKinematics:
    """Quantities of the output y at the state in ``data`` at the last ``update``: ydd = Jdot qdot - W c + W u.

    The part of W on the driven joints is alpha M_c^-1, the elimination of the other dofs (22), done by MuJoCo's
    factorisation of M.

    Attributes:
        J: Jacobian of the output, (p, nv).
        jac_dot: Rate of the Jacobian of the tip in all three world axes, (3, nv).
        W: J M^-1, (p, nv).
        point: Place of the tip in m, (3,).
    """

    def __init__(self, model: Any, data: Any, site: int, axes: Sequence[int]) -> None:
        """Bind to a site and the world axes that count as output."""
        self._model, self._data, self._site = model, data, site
        self._body, self.point = int(model.site_bodyid[site]), data.site_xpos[site]
        self._axes = np.array(axes)
        p, nv = len(self._axes), model.nv
        self._jacp, self.jac_dot, self.W = np.empty((3, nv)), np.empty((3, nv)), np.empty((p, nv))
        # The rows of the output: a view where its axes are contiguous, filled at each tick where they are not.
        first = int(self._axes[0])
        self._contiguous = tuple(axes) == tuple(range(first, first + p))
        self.J = self._jacp[first : first + p] if self._contiguous else np.empty((p, nv))

    def update(self) -> None:
        """Work everything out at the current state; derived quantities must be current."""
        model, data = self._model, self._data
        mujoco.mj_jacSite(model, data, self._jacp, None, self._site)
        mujoco.mj_jacDot(model, data, self.jac_dot, None, self.point, self._body)
        if not self._contiguous:
            self.J[:] = self._jacp[self._axes]
        mujoco.mj_solveM(model, data, self.W, self.J)
