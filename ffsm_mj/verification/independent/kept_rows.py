"""Rows of a run that the independent checks look at: few, spread over the run, chosen in one pass while it runs or is read.

A mistake of a program is in most of the rows that it concerns, so that a bounded number of them shows it, at a bounded cost.
Which are kept depends on the rows alone, not on their division into blocks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from ffsm_mj.records.load_columns import logged_load_columns
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import Layout
from ffsm_mj.verification.independent.finding import Array

SAME_TIME_S = 1e-9
"""Times within this are one: a row's time is a product of steps, that of an event or a sample a sum of sub-steps."""
MOST = 64
"""Greatest number that is kept of each kind."""
_RECENT = 1024
"""Rows that are remembered until the samples taken at them are shown; samples with longer delays are not checked."""

_Kept = TypeVar("_Kept")


class Spread(Generic[_Kept]):
    """Every k-th of a sequence of things, where k doubles as often as more than the greatest number would be kept."""

    def __init__(self) -> None:
        """Nothing yet."""
        self._things: list[tuple[int, _Kept]] = []
        self._stride, self._count = 1, 0

    def add(self, count: int, thing_at: Callable[[int], _Kept]) -> None:
        """Take the next things.

        Args:
            count: Their number.
            thing_at: Returns one by its place among them, from 0; called for those that are kept.
        """
        first, self._count = self._count, self._count + count
        number = -(-first // self._stride) * self._stride
        while number < self._count:
            self._things.append((number, thing_at(number - first)))
            if len(self._things) > MOST:
                self._stride *= 2
                self._things = [thing for thing in self._things if thing[0] % self._stride == 0]
            number += self._stride - number % self._stride

    @property
    def kept(self) -> list[_Kept]:
        """Those that are kept, in order."""
        return [thing for _, thing in self._things]


class KeptRows:
    """Chooses rows, block by block.

    Attributes:
        layout: Columns of the rows.
        count: Number of rows so far.
        is_regular: Whether each row follows the one before by one control period or, at the end of a run, less, and the
            first one the start of the run.
        spread: Numbers of rows of the whole run.
        closed: Numbers of rows in which a grasp is closed.
        samples: By the column of a sensor's sample time, the numbers of the row that shows a sample first and of the row at
            which it was taken, -1 if there is none.
        before: Time of an impact, and the number of the last row before it.
    """

    def __init__(self, layout: Layout, metadata: Mapping[str, str]) -> None:
        """Find the columns."""
        self.layout, self.count, self.is_regular = layout, 0, True
        self._period_s, self._start_s = float(metadata.get("control_period_s", "inf")), logged_start_s(metadata)
        self.spread, self.closed = Spread[int](), Spread[int]()
        self.before = Spread[tuple[float, int]]()
        self._closed = [layout.index[columns.closed] for columns in logged_load_columns(layout)]
        ends = [i for key, i in layout.index.items() if key.startswith("sensor.") and key.endswith("_sampled_s")]
        self.samples = {column: Spread[tuple[int, int]]() for column in ends}
        self._shown = dict.fromkeys(ends, np.nan)
        self._recent: deque[tuple[int, Array]] = deque()
        self._rows: dict[int, Array] = {}
        self._expected: deque[float] = deque()
        self._met_s = -np.inf
        self._prune_at = MOST

    def expect(self, times: Iterable[float]) -> None:
        """Give the times of impacts before the rows that follow them."""
        self._expected.extend(sorted(times))

    def finish(self) -> None:
        """Process impacts after the last row."""
        while self._expected:
            self._meet(self._expected.popleft())

    def rows(self, block: Array) -> None:
        """Process the next rows, (n, columns); there may be none."""
        if not len(block):
            return
        first, times = self.count, block[:, self.layout.time]
        self._judge(times)
        self._recent.append((first, block.copy()))
        self.count += len(block)
        self.spread.add(len(block), lambda place: self._keep(first + place))
        if self._closed:
            closed = np.flatnonzero(np.any(block[:, self._closed] > 0.0, axis=1))
            self.closed.add(len(closed), lambda place: self._keep(first + int(closed[place])))
        for column, spread in self.samples.items():
            self._samples(column, spread, first, block[:, column])
        while self._expected and self._expected[0] - SAME_TIME_S <= times[-1]:
            self._meet(self._expected.popleft())
        self._forget()

    def _samples(self, column: int, spread: Spread[tuple[int, int]], first: int, shown: Array) -> None:
        """Keep rows of the samples that a column shows newly."""
        new = np.flatnonzero((shown != np.concatenate(([self._shown[column]], shown[:-1]))) & np.isfinite(shown))
        self._shown[column] = float(shown[-1])
        spread.add(len(new), lambda i: (self._keep(first + int(new[i])), self._sample_row(float(shown[new[i]]))))

    def _meet(self, time_s: float) -> None:
        """Keep the row before an impact."""
        if time_s <= self._met_s:
            return  # another contact of the same impact
        self._met_s = time_s
        for first, rows in reversed(self._recent):
            place = int(np.searchsorted(rows[:, self.layout.time], time_s - SAME_TIME_S)) - 1
            if place >= 0:
                self.before.add(1, partial(self._before, time_s, first + place))
                return

    def _before(self, time_s: float, number: int, _: int) -> tuple[float, int]:
        """Keep the row before an impact; returns the time of the impact and the number of the row."""
        return time_s, self._keep(number)

    def _judge(self, times: Array) -> None:
        """Note whether rows are missing or out of order."""
        # A run begins with a row at its start or, from a state between two ticks, at the next tick.
        last = self._recent[-1][1][-1, self.layout.time] if self._recent else self._start_s - 0.25 * self._period_s
        steps = np.diff(times, prepend=last)
        self.is_regular &= bool(np.all(steps > 0.0) and np.all(steps < 1.5 * self._period_s))

    def _keep(self, number: int) -> int:
        """Keep a recent row; returns its number, -1 if it is not recent."""
        for first, rows in reversed(self._recent):
            if first <= number < first + len(rows):
                if number not in self._rows:
                    self._rows[number] = rows[number - first].copy()
                return number
        return -1

    def _sample_row(self, time_s: float) -> int:
        """Keep the row at the time of a sample, and the one before, whose efforts act there; returns its number, or -1."""
        for first, rows in reversed(self._recent):
            times = rows[:, self.layout.time]
            if times[0] <= time_s + SAME_TIME_S:
                place = int(np.searchsorted(times, time_s - SAME_TIME_S))
                if place == len(times) or abs(times[place] - time_s) > SAME_TIME_S:
                    return -1
                self._keep(first + place - 1)
                return self._keep(first + place)
        return -1

    def _forget(self) -> None:
        """Forget rows that are neither kept nor recent."""
        most = _RECENT if self.samples else 2
        while len(self._recent) > 1 and self.count - self._recent[1][0] >= most:
            self._recent.popleft()
        if len(self._rows) > self._prune_at:
            wanted = {*self.spread.kept, *self.closed.kept, *(number for _, number in self.before.kept)}
            for spread in self.samples.values():
                wanted |= {n for shown, at in spread.kept for n in (shown, at, at - 1)}
            self._rows = {number: row for number, row in self._rows.items() if number in wanted}
            self._prune_at = 2 * len(self._rows) + MOST

    def __getitem__(self, number: int) -> Array:
        """A kept row."""
        return self._rows[number]

    def __contains__(self, number: int) -> bool:
        """Whether a row is kept."""
        return number in self._rows


def kept_rows(log: RunLog) -> KeptRows:
    """Choose rows of a whole log."""
    kept = KeptRows(log.header.layout, log.header.metadata)
    kept.expect(record.time_s for record in log.impact_records)
    for block in log.blocks():
        kept.rows(before_loss(log, block))
    kept.finish()
    return kept


def before_loss(log: RunLog, block: Array) -> Array:
    """Those of some rows that precede the first lost part of a log: of later ones it may not say which grasps are closed."""
    return block[block[:, log.header.layout.time] <= log.lost[0][0]] if log.lost else block
