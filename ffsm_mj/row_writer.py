"""Fills one row of the log from the plant at a control tick."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.actuation import Actuation
from ffsm_mj.controller_protocol import TaskController
from ffsm_mj.ledger import Ledger
from ffsm_mj.model import FloatArray, System
from ffsm_mj.signals import COMPONENTS, PARTIES, Layout


class RowWriter:
    """Column slices of a layout, bound to the plant that fills them."""

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
        model, keys = system.mj, layout.keys
        self._q = slice(1, 1 + model.nq)
        self._v = slice(1 + model.nq, 1 + model.nq + model.nv)
        self._tip = layout.columns("state.tip_x_m", 6) if tip_site is not None else slice(0, 0)
        self._energy = layout.columns("energy.total_J", len(PARTIES))
        self._momentum = layout.columns(f"momentum.total_{COMPONENTS[0]}", len(PARTIES) * len(COMPONENTS))
        self._second = layout.columns(f"momentum.robot_by_mass_matrix_{COMPONENTS[0]}", len(COMPONENTS))
        groups = [key.split(".")[0] for key in keys]
        self._books = slice(groups.index("ledger"), groups.index("ledger") + groups.count("ledger"))
        self._efforts = slice(self._books.stop, self._books.stop + groups.count("actuators"))
        self._report = slice(self._efforts.stop, self._efforts.stop + groups.count("controller"))
        self._tip_velocity = np.empty(6)
        # Views of MuJoCo's and the ledger's arrays: looking them up costs as much as copying them.
        self._qpos, self._qvel = data.qpos, data.qvel
        self._tip_position = data.site_xpos[tip_site] if tip_site is not None else None
        self._momenta = ledger.momentum.reshape(-1)

    def fill(self, row: FloatArray, time_s: float) -> None:
        """Write the state at a tick and the efforts decided at it. Derived quantities must be current."""
        data = self._data
        self._ledger.measure()
        row[0] = time_s
        row[self._q] = self._qpos
        row[self._v] = self._qvel
        if self._site is not None:
            mujoco.mj_objectVelocity(
                self._model, data, mujoco.mjtObj.mjOBJ_SITE, self._site, self._tip_velocity, 0
            )  # (angular, linear) in world axes
            tip = row[self._tip]
            tip[:3], tip[3:] = self._tip_position, self._tip_velocity[3:]
        row[self._energy] = self._ledger.energy
        row[self._momentum] = self._momenta
        row[self._second] = self._ledger.robot_by_mass_matrix
        self._ledger.fill(row[self._books])
        self._actuation.fill(row[self._efforts])
        row[self._report] = self._controller.telemetry()
        row[-1] = self._controller.phase_index
