"""Writes what happens in a run to its log: rows at control ticks from the columns of all parts, events, phases, overlaps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ffsm_mj._core.tick import RowFiller, Sampler
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.interface import EventTime
from ffsm_mj.log.recorder import Recorder
from ffsm_mj.records.columns import Row
from ffsm_mj.simulation.controller import TaskController
from ffsm_mj.simulation.plant import Plant
from ffsm_mj.simulation.progress import EventDue, Progress
from ffsm_mj.state import to_bytes


class RowWriter:
    """Writes the columns of all parts to a block of rows: live arrays at each tick, what tables compute of them later.

    Attributes:
        block: Rows, and behind each what tables need, (lines, number of signals and of these).
        filler: Writes the live arrays.
    """

    def __init__(self, row: Row, sampler: Sampler, lines: int) -> None:
        """Bind the columns of each part.

        Args:
            row: Layout of a row.
            sampler: Copies live arrays.
            lines: Number of rows of the block.
        """
        self._signals = width = len(row.layout.signals)
        copies: list[tuple[FloatArray, slice]] = []
        self._tables = []
        for part in row.columns:
            if part.table is None:
                copies += [(part.live[source], there) for source, there in row.stretches(part)]
                continue
            needed = slice(width, width + len(part.live))
            copies, width = [*copies, (part.live, needed)], needed.stop
            self._tables.append((part.table, needed, list(row.stretches(part))))
        self.block = np.zeros((lines, width))
        sampler.copy([(array, self.block[:, there]) for array, there in copies])
        self.filler = RowFiller(sampler, [part.on_sample for part in row.columns if part.on_sample is not None])

    def fill(self, line: int, time_s: float) -> None:
        """Write the state at a tick and the efforts set at it to a line; derived quantities must be current."""
        self.filler.fill(line, time_s)

    def complete(self, block: FloatArray) -> FloatArray:
        """Rows of a block or of a copy of one, with what tables compute, (n, number of signals)."""
        rows = block[:, : self._signals].copy()
        for table, needed, stretches in self._tables:
            values = table(block[:, needed])
            for source, there in stretches:
                rows[:, there] = values[:, source]
        return rows


class LogWriter:
    """Writes the rows and records of one run."""

    def __init__(
        self, recorder: Recorder, rows: RowWriter, watch: ContactWatch, controller: TaskController, plant: Plant
    ) -> None:
        """Bind what is written and where; ``watch`` reports overlaps that no contact model handles."""
        self._recorder, self._rows, self._watch, self._controller, self._plant = recorder, rows, watch, controller, plant

    def row(self, time_s: float) -> None:
        """Write a row, and the overlaps that have ended since the last one."""
        self._rows.fill(self._recorder.line, time_s)
        self._recorder.commit()
        self.look(time_s)

    def look(self, time_s: float, *, collided: bool = False) -> None:
        """Write the overlaps that have ended since the last row; see :meth:`ContactWatch.look`."""
        for record in self._watch.look(time_s, collided=collided):
            self._recorder.event(record)

    def event(self, due: EventDue) -> None:
        """Write the records of an event, with the efforts that follow it, and the phases that it has begun."""
        efforts = self._plant.actuation.by_name()
        records = (replace(record, efforts_after=efforts) for record in due.records)
        self._recorder.event(*records, *self._controller.drain_phases())

    def state(self, time_s: float, state: Any) -> None:
        """Write the state of the simulation."""
        self._recorder.state(time_s, to_bytes(state))

    def phases(self) -> bool:
        """Write the phases begun since the last call; returns whether there are any."""
        begun = self._controller.drain_phases()
        for phase in begun:
            self._recorder.event(phase)
        return bool(begun)

    def pass_on(self) -> None:
        """Write the rows that are buffered."""
        self._recorder.pass_on()

    def rest(self, progress: Progress, due: EventDue | None) -> None:
        """Write the remaining records at the end of the run, whatever its outcome."""
        if due is not None:  # stopped at an event: it is recorded with the efforts held
            self.event(due)
        self.phases()  # a phase whose control law failed as it began
        for record in self._watch.finish(progress.time_s):
            self._recorder.event(record)
        for record in self._plant.integrator.finish(EventTime(progress.time_s, progress.steps)):
            self._recorder.event(replace(record, efforts_after=self._plant.actuation.by_name()))
        self.pass_on()
