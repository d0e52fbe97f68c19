"""Check of the heat of sliding: it is the energy that persistent contact takes from the bodies, and it never decreases."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import CONTACT_WORK, SLIDING_HEAT, Layout
from ffsm_mj.verification.residuals import Peak, ResidualDrift


class HeatCheck:
    """Residuals of the heat of sliding from blocks of rows.

    There are two. The work of the contact forces and the heat add up to zero: normal forces do no work where gaps stay
    zero, nor does friction where points stick. The heat of a rule does not fall below its largest value so far. Work is
    summed from all generalised contact forces and velocities, heat from friction forces and slip.
    """

    def __init__(self, layout: Layout, stretch_s: float) -> None:
        """Find the columns; there are none in runs without friction."""
        keys = [key for key in layout.keys if key.startswith("contact.") and key.endswith(SLIDING_HEAT)]
        self._heat, self._work = layout.places(keys), layout.index.get(f"balance.{CONTACT_WORK}")
        self._time, self._largest = layout.time, np.full(len(keys), -np.inf)
        self._residual = ResidualDrift(stretch_s)

    def rows(self, block: FloatArray, added: FloatArray) -> None:
        """Process the next rows.

        Args:
            block: Rows, (n, columns).
            added: To the sum of work and heat in these rows, J, (n,).
        """
        if self._work is None or not len(self._heat):
            return
        heat, work = block[:, self._heat], block[:, self._work]
        total = heat.sum(axis=1)
        largest = np.maximum.accumulate(np.vstack((self._largest, heat)))[1:]
        self._largest = largest[-1]
        residual = np.stack((work + total + added, (largest - heat).max(axis=1)), axis=1)
        self._residual.add(block[:, self._time], residual, np.maximum(np.abs(work), np.abs(heat).max(axis=1)))

    @property
    def worst(self) -> Peak | None:
        """The worst residual in J: component 0 is energy without heat, 1 heat that falls; None if there was no contact."""
        worst = self._residual.worst
        return worst if worst.scale > 0.0 or worst.size > 0.0 else None

    @property
    def drift(self) -> float:
        """Largest residual since the first row, J."""
        return self._residual.drift
