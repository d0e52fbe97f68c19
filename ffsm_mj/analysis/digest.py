"""Digest of a run's rows for checks and summary, accumulated during the run or from its log with equal results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.analysis.intervals import ContactIntervals, GraspIntervals
from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.recorder import Sink
from ffsm_mj.records.events import OutcomeRecord
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.metadata import LoggedTask, logged_start_s, logged_task
from ffsm_mj.records.run_log import RunHeader, RunLog
from ffsm_mj.records.signals import TIP_RATE, Layout
from ffsm_mj.verification.checks import CheckAccumulator
from ffsm_mj.verification.independent.kept_rows import KeptRows
from ffsm_mj.verification.residuals import norms


@dataclass
class TipDigest:
    """Accumulates the tip error.

    Attributes:
        task: Target of the tip.
        finite: Whether all errors were finite.
        best_m: Smallest error.
        best_s: Time of the smallest error.
        last_m: Error in the last row.
        last_m_s: Speed along the regulated axes in the last row.
    """

    task: LoggedTask
    finite: bool = True
    best_m: float = math.inf
    best_s: float = 0.0
    last_m: float = 0.0
    last_m_s: float = 0.0

    def rows(self, block: FloatArray, layout: Layout) -> None:
        """Process the next rows."""
        rate = layout.places(TIP_RATE)
        error = norms(self.task.errors_m(layout, lambda key: block[:, layout.index[key]]))
        self.finite &= bool(np.all(np.isfinite(error)))
        best = int(np.argmin(error))
        if error[best] < self.best_m:
            self.best_m, self.best_s = float(error[best]), float(block[best, layout.time])
        self.last_m, self.last_m_s = float(error[-1]), math.hypot(*block[-1, rate][self.task.axes])


class Digest(Sink):
    """Digest of one run, from :meth:`open` on; independent of the division of its rows into blocks.

    Attributes:
        check_accumulator: Residuals of the checks.
        kept: Rows for the independent checks.
        contacts: Intervals of persistent contact.
        grasps: Intervals of grasps.
        tip: Tip error; None without a task.
        samples: Number of rows so far.
        end_s: Time of the last row, 0 without any.
    """

    def open(self, header: RunHeader) -> None:
        """Start without rows."""
        self._layout = header.layout
        self.check_accumulator = CheckAccumulator(header.layout, header.metadata)
        self.kept = KeptRows(header.layout, header.metadata)
        goes_on = logged_start_s(header.metadata) > 0.0
        self.contacts, self.grasps = ContactIntervals(header.layout, goes_on=goes_on), GraspIntervals(header.layout)
        task = logged_task(header.metadata)
        self.tip = TipDigest(task) if task is not None else None
        self.samples, self.end_s = 0, 0.0

    def rows(self, block: FloatArray) -> None:
        """Process the next rows."""
        self.samples, self.end_s = self.samples + len(block), float(block[-1, self._layout.time])
        self.check_accumulator.rows(block)
        self.kept.rows(block)
        self.contacts.rows(block)
        self.grasps.rows(block)
        if self.tip is not None:
            self.tip.rows(block, self._layout)

    def event(self, event: Any) -> None:
        """Process records of impacts, contacts and grasps, before the rows after them; all other events are in the log."""
        if kind_of(event).series == "impact":
            self.kept.expect((event.time_s,))
        self.contacts.event(event)
        self.grasps.event(event)

    def close(self, _: OutcomeRecord | None) -> None:
        """Process impacts after the last row."""
        self.kept.finish()


def digest(log: RunLog) -> Digest:
    """Digest the rows of a log."""
    content = Digest()
    content.open(log.header)
    for event in log.events:
        content.event(event)
    for block in log.blocks():
        content.rows(block)
    content.close(log.outcome)
    return content
