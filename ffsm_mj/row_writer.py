"""Fills rows of the log from the plant at control ticks."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.actuation import Actuation
from ffsm_mj.controller_protocol import TaskController
from ffsm_mj.ledger import COLUMNS, Ledger
from ffsm_mj.model import FloatArray, System
from ffsm_mj.signals import PARTIES, Layout

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


class RowWriter:
    """Column slices of a layout, bound to the plant that fills them: a few at each tick, the rest a block at a time."""

    def __init__(
        self,
        layout: Layout,
        system: System,
        data: Any,
        actuation: Actuation,
        ledger: Ledger,
        controller: TaskController,
        tip_site: int | None,
    ) -> None:
        """Find each part's columns."""
        self._model, self._data = system.mj, data
        self._actuation, self._ledger, self._controller, self._site = actuation, ledger, controller, tip_site
        model = system.mj
        groups = [key.split(".")[0] for key in layout.keys]
        self._q = slice(1, 1 + model.nq)
        self._v = slice(1 + model.nq, 1 + model.nq + model.nv)
        if tip_site is not None:
            tip = layout.columns("state.tip_x_m", 6)
            self._tip_place, self._tip_motion = slice(tip.start, tip.start + 3), slice(tip.start + 3, tip.stop)
            self._tip_position = data.site_xpos[tip_site]
        self._books = layout.columns(f"energy.{PARTIES[0]}_J", COLUMNS)
        self._efforts = slice(self._books.stop, self._books.stop + groups.count("actuators"))
        self._report = slice(self._efforts.stop, self._efforts.stop + groups.count("controller"))
        self._tip_twist = np.empty(6)
        self._tip_velocity = self._tip_twist[3:]
        # Views of MuJoCo's arrays: looking them up costs as much as copying them.
        self._qpos, self._qvel = data.qpos, data.qvel

    def fill(self, row: FloatArray, time_s: float, h: FloatArray) -> None:
        """Write the state at a tick and the efforts decided at it. Derived quantities must be current, h = M qdot, (nv,)."""
        self._ledger.note(h)
        row[0] = time_s
        row[self._q] = self._qpos
        row[self._v] = self._qvel
        if self._site is not None:
            # (angular, linear) in world axes
            mujoco.mj_objectVelocity(self._model, self._data, _SITE, self._site, self._tip_twist, 0)
            row[self._tip_place] = self._tip_position
            row[self._tip_motion] = self._tip_velocity
        self._actuation.fill(row[self._efforts])
        row[self._report] = self._controller.telemetry()
        row[-1] = self._controller.phase_index

    def complete(self, block: FloatArray) -> None:
        """Write what follows from the notes of the rows filled since the last block: energies, momenta, ledgers."""
        block[:, self._books] = self._ledger.table()
