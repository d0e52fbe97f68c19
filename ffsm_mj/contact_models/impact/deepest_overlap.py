"""Deepest overlap of the impact pairs, a column of the log."""

from __future__ import annotations

import numpy as np

from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import OVERLAP, Signal


class DeepestOverlap:
    """Largest overlap of any pair at the ends of (sub-)steps since the sample before.

    Attributes:
        columns: Its column.
    """

    def __init__(self) -> None:
        """Start without overlap."""
        self._deepest, self._logged = 0.0, np.zeros(1)
        meaning = "deepest overlap of an impact pair at the ends of the steps and sub-steps since the sample before"
        self.columns = (Columns((Signal("balance", OVERLAP, "m", meaning),), live=self._logged, on_sample=self._write),)

    def add(self, depth: float) -> None:
        """Update it with a depth in m at the end of a (sub-)step."""
        self._deepest = max(self._deepest, depth)

    def _write(self, _: float) -> None:
        self._logged[0], self._deepest = self._deepest, 0.0
