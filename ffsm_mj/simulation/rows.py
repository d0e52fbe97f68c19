"""Writes rows of the log at control ticks, from the columns of all parts."""

from __future__ import annotations

from ffsm_mj._core.tick import RowFiller, Sampler
from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.columns import Row


class RowWriter:
    """Writes the columns of all parts to a block of rows: live arrays at each tick, tables once per block.

    Attributes:
        filler: Writes the live arrays.
    """

    def __init__(self, row: Row, sampler: Sampler, block: FloatArray) -> None:
        """Bind the columns of each part.

        Args:
            row: Layout of a row.
            sampler: Copies live arrays.
            block: Rows, (lines, number of signals).
        """
        live = [(part.live, row.stretches(part)) for part in row.columns if part.live is not None]
        sampler.copy([(array[own], block[:, there]) for array, stretches in live for own, there in stretches])
        self.filler = RowFiller(sampler, [part.on_sample for part in row.columns if part.on_sample is not None])
        self._tables = [(part.table, list(row.stretches(part))) for part in row.columns if part.table is not None]

    def fill(self, line: int, time_s: float) -> None:
        """Write the state at a tick and the efforts set at it to a line; derived quantities must be current."""
        self.filler.fill(line, time_s)

    def complete(self, block: FloatArray) -> None:
        """Write the table columns of all rows filled since the last block."""
        for table, stretches in self._tables:
            values = table()[: len(block)]  # a part may have one row more, if an exception came before the row was complete
            for own, there in stretches:
                block[:, there] = values[:, own]
