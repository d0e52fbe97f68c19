"""Fills rows of the log from the plant at control ticks."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.compiled import fastest
from ffsm_mj.model.system import System
from ffsm_mj.plant.actuation import Actuation
from ffsm_mj.plant.ledger import COLUMNS, Ledger
from ffsm_mj.plant.sampler import Sampler
from ffsm_mj.records.signals import OVERLAP, PARTIES, Layout


class Reporter(Protocol):
    """What a row takes from the controller."""

    telemetry: FloatArray
    phase_index: int


class RowWriter:
    """Columns of a layout, bound to the plant that fills them: most at each tick, the rest a block at a time."""

    def __init__(
        self,
        layout: Layout,
        system: System,
        data: Any,
        actuation: Actuation,
        ledger: Ledger,
        controller: Reporter,
        overlap: FloatArray,
        tip_site: int | None,
        block: FloatArray,
    ) -> None:
        """Find each part's columns in a block of rows."""
        self._ledger, self._controller, self._overlap = ledger, controller, overlap
        groups = [key.split(".")[0] for key in layout.keys]
        nq, nv = system.mj.nq, system.mj.nv
        self._books = layout.columns(f"energy.{PARTIES[0]}_J", COLUMNS)
        deepest = layout.columns(f"ledger.{OVERLAP}", 1)
        efforts = slice(deepest.stop, deepest.stop + groups.count("actuators"))
        report = slice(efforts.stop, efforts.stop + groups.count("controller"))
        self._time, self._phase = np.zeros(1), np.zeros(1)
        self._sampler = fastest(Sampler)(system.mj, data, tip=-1 if tip_site is None else tip_site)
        copies = [
            (self._time, block[:, :1]),
            (data.qpos, block[:, 1 : 1 + nq]),
            (data.qvel, block[:, 1 + nq : 1 + nq + nv]),
            (overlap, block[:, deepest]),
            *actuation.copies(block[:, efforts]),
            (controller.telemetry, block[:, report]),
            (self._phase, block[:, -1:]),
        ]
        if tip_site is not None:
            tip = layout.columns("state.tip_x_m", 6).start
            copies += [
                (data.site_xpos[tip_site], block[:, tip : tip + 3]),
                (self._sampler.twist[3:], block[:, tip + 3 : tip + 6]),
            ]
        self._sampler.copy(copies)

    def fill(self, line: int, time_s: float) -> None:
        """Write the state at a tick and the efforts decided at it into a line; derived quantities must be current."""
        self._ledger.note()
        self._time[0], self._phase[0] = time_s, self._controller.phase_index
        self._sampler.take(line)
        self._overlap[0] = 0.0

    def complete(self, block: FloatArray) -> None:
        """Write what follows from the notes of the rows filled since the last block: energies, momenta, ledgers."""
        block[:, self._books] = self._ledger.table()
