"""The kept rows of a log beside its records: what is whole, what is at an event, which efforts act before an instant."""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.independent.finding import Array
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S, KeptRows
from ffsm_mj.verification.independent.scene import LoggedScene


class LoggedRows:
    """Kept rows and the events between them.

    Attributes:
        kept: The kept rows.
        is_whole: Whether nothing of the log is missing, neither rows nor bytes in which a record could have been: only then
            is it known what was closed, and which efforts acted, between two rows.
    """

    def __init__(self, log: RunLog, kept: KeptRows) -> None:
        """Bind to a log."""
        self.kept, self.is_whole = kept, kept.is_regular and not log.damage
        self._changes: list[Any] = [record for record in log.events() if getattr(record, "efforts_after", None)]
        self._changed_s = np.array([record.time_s for record in self._changes])
        self._instants = np.sort(np.array(log.instants_s))

    def time_s(self, number: int) -> float:
        """Time of a kept row."""
        return float(self.kept[number][self.kept.layout.time])

    def is_at_event(self, number: int) -> bool:
        """Whether an event is at the time of a row, so that it is open whether the row is of before or after it."""
        time_s = self.time_s(number)
        near = int(np.searchsorted(self._instants, time_s - SAME_TIME_S))
        return near < len(self._instants) and self._instants[near] <= time_s + SAME_TIME_S

    def has_events(self, start_s: float, end_s: float) -> bool:
        """Whether an event is between two times."""
        first, last = np.searchsorted(self._instants, (start_s, end_s))
        return bool(last > first)

    def efforts_after(self, scene: LoggedScene, number: int, time_s: float) -> Array | None:
        """Efforts that act up to an instant after a row, (nu,): those of the last event between, or of the row; or None.

        An event at the time of the row is of the step that ends there, or of that which begins: its number tells.
        """
        if number not in self.kept or not self.is_whole:
            return None
        row_s = self.time_s(number)
        end = int(np.searchsorted(self._changed_s, time_s - SAME_TIME_S))
        start = int(np.searchsorted(self._changed_s, row_s - SAME_TIME_S))
        first_step = round(row_s / scene.model.opt.timestep)
        changes = [change for change in self._changes[start:end] if change.step >= first_step]
        if not changes:
            return scene.efforts_of(self.kept[number])
        # Records of one instant may state different efforts, and not all are numbered together: then it is not known.
        last = scene.efforts_after(changes[-1])
        at_once = [change for change in changes if change.time_s >= changes[-1].time_s - SAME_TIME_S]
        return last if all(change.efforts_after == changes[-1].efforts_after for change in at_once) else None
