"""Columns of a run with the loads of its closed grasps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.closed_grasps import ClosedGrasps
from ffsm_mj.contact_models.grasp.latch import Latch
from ffsm_mj.contact_models.grasp.load import LoadBuffer
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.load_columns import SIGNALS_PER_SET, load_columns


class LoadReport:
    """Writes the loads of closed grasps into their columns, and reads from them what was closed.

    Attributes:
        columns: The columns.
    """

    def __init__(self, latches: Sequence[Latch], closed: ClosedGrasps) -> None:
        """Bind to the grasps of a run.

        Args:
            latches: All grasps, in the order of the scenario.
            closed: The closed ones.
        """
        sets = load_columns([latch.grasp for latch in latches])
        self._latches, self._closed, self._alone = tuple(latches), closed, len(sets) == 1
        self._buffers = [LoadBuffer() for _ in sets]
        self._logged = np.zeros(len(sets))
        signals = tuple(signal for each in sets for signal in each.signals)
        self.columns = Columns(signals, None, self._table, self._write, self._resume, self._at_state, self._at_event)

    def get_state(self) -> list[Any]:
        """The largest loads between rows, by set of columns."""
        return [buffer.get_state() for buffer in self._buffers]

    def set_state(self, state: Any) -> None:
        """Go on with these loads."""
        for buffer, told in zip(self._buffers, state, strict=True):
            buffer.set_state(told)

    def _now(self) -> list[tuple[LoadBuffer, int, Latch | None]]:
        """Each set of columns with what is closed of it."""
        if self._alone:
            latch = self._closed.latches[0] if self._closed.latches else None
            return [(self._buffers[0], latch.number if latch is not None else 0, latch)]
        places = [(latch, self._closed.place(latch)) for latch in self._latches]
        return [
            (buffer, place, latch if place else None) for buffer, (latch, place) in zip(self._buffers, places, strict=True)
        ]

    def after_event(self, time_s: float) -> None:
        """Record the loads after an event, since they may change discontinuously."""
        for buffer, _, latch in self._now():
            if latch is not None:
                buffer.after_event(latch.load, time_s)

    def _write(self, _: float) -> None:
        """Record what is closed, and loads under the efforts of the next step."""
        for buffer, closed, latch in self._now():
            buffer.append(closed, latch.load if latch is not None else None)

    def _table(self) -> FloatArray:
        return np.concatenate([buffer.table() for buffer in self._buffers], axis=1)

    def _at_state(self) -> FloatArray:
        """Loads under the efforts in ``data``, and zeros in the other columns."""
        values = np.zeros((len(self._buffers), SIGNALS_PER_SET))
        for row, (_, _, latch) in zip(values, self._now(), strict=True):
            if latch is not None:
                row[1:7] = latch.load.now()
        return values.reshape(-1)

    def _at_event(self) -> FloatArray:
        """Sizes of these loads in the columns of loads after events, and zeros in the others."""
        values = self._at_state().reshape(-1, SIGNALS_PER_SET)
        sizes = np.linalg.norm(values[:, 1:7].reshape(-1, 2, 3), axis=2)
        values[:, :-3] = 0.0
        values[:, -3:-1] = sizes
        return values.reshape(-1)

    def _resume(self, values: FloatArray) -> None:
        for i, buffer in enumerate(self._buffers):
            part = values[i * SIGNALS_PER_SET : (i + 1) * SIGNALS_PER_SET]
            self._logged[i] = part[0]
            force, torque, at_s = part[-3:].tolist()
            buffer.between = force, torque, at_s if force > 0.0 else math.nan

    def logged_as_closed(self) -> list[Latch]:
        """The grasps that were closed by the values from which a run or a replay goes on, in the order of closing."""
        if self._alone:
            number = float(self._logged[0])
            return [self._latches[int(number) - 1]] if 1.0 <= number <= len(self._latches) else []
        places = [(place, latch) for place, latch in zip(self._logged.tolist(), self._latches, strict=True) if place >= 1.0]
        return [latch for _, latch in sorted(places, key=lambda each: each[0])]
