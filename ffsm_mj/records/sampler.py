"""Sampling of live arrays into tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


class Sampler:
    """Copies live arrays at each sample, after refreshing quantities that MuJoCo does not keep current.

    Attributes:
        jacp: Jacobian of the base's frame, (3, nv).
        jacr: Its angular part, (3, nv).
        twist: Angular and linear velocity of the tip in world axes, (6,).
    """

    def __init__(self, model: Any, data: Any, *, base: int = -1, tip: int = -1) -> None:
        """Bind to MuJoCo's model and data.

        Args:
            model: MuJoCo model.
            data: MuJoCo data.
            base: Body whose Jacobians, and subtree velocities of all bodies, are refreshed at each sample; -1: none.
            tip: Site whose velocity is refreshed at each sample; -1: none.
        """
        self._model, self._data, self._base, self._tip = model, data, base, tip
        self.jacp, self.jacr, self.twist = np.zeros((3, model.nv)), np.zeros((3, model.nv)), np.zeros(6)
        self._copies: tuple[tuple[FloatArray, FloatArray], ...] = ()

    def copy(self, copies: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """Set what to copy: pairs of a live array and its table, which has one more axis; rows of tables are contiguous."""
        self._copies = tuple(copies)

    def take(self, line: int) -> None:
        """Refresh derived quantities, and copy into a row of the tables."""
        if self._base >= 0:
            mujoco.mj_subtreeVel(self._model, self._data)
            mujoco.mj_jacBody(self._model, self._data, self.jacp, self.jacr, self._base)
        if self._tip >= 0:
            mujoco.mj_objectVelocity(self._model, self._data, _SITE, self._tip, self.twist, 0)
        for live, table in self._copies:
            table[line] = live
