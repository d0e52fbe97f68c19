"""Decimation of a long run for figures: extreme values and events are kept as logged.

A run whose rows take more than 64 MiB is divided into 600 slices of equally many rows. Of each slice these rows are kept:
the first and the last; for every column, for the norms of the residuals and for the tip error, those of the least and the
greatest value; those just before and after an event, and those at requested times.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.log.mcap.reader import KEPT_BYTES
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.metadata import logged_task
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.verification.residuals import BalanceColumns, norms

_SLICES = 600
_FARTHEST = 1e12
"""m, rad or s: larger values do not come from a motion, and single-precision drawing cannot show them."""


def thinned(run: Run, times: Iterable[float] = ()) -> Run:
    """The run itself if it is short; else one of far fewer rows, with the digest of the whole run.

    Args:
        run: A run.
        times: The first row at or after each of these times is kept, s.
    """
    log = run.log
    count, width = len(log.rows), len(log.header.layout.signals)
    if 8 * count * width <= KEPT_BYTES:
        return _drawable(run)
    marks = np.array(sorted({*(kind_of(event).time(event) for event in log.events), *times}))
    beside = _Beside(log)
    kept = [
        part[_outstanding(part, part[:, log.header.layout.time], beside.of(part), marks)]
        for part in _slices(log.blocks(), -(-count // _SLICES))
    ]
    return _drawable(run.with_rows(np.concatenate(kept)))


def _drawable(run: Run) -> Run:
    """The run without rows whose time or coordinates cannot be drawn: a log may hold any double."""
    places = np.column_stack((run.time, run.qpos))
    there = (np.abs(places) < _FARTHEST).all(axis=1)
    return run if there.all() else run.with_rows(np.asarray(run.log.rows[there]))


class _Beside:
    """Derived quantities in figures: the tip error, and the norms of the residuals."""

    def __init__(self, log: RunLog) -> None:
        layout, metadata = log.header.layout, log.header.metadata
        self._accounts = [BalanceColumns(layout, metadata, subsystem) for subsystem in SUBSYSTEMS]
        self._first: Sequence[FloatArray] | None = None
        self._task = logged_task(metadata)
        self._layout = layout

    def of(self, part: FloatArray) -> FloatArray:
        momenta = [accounts.momentum(part) for accounts in self._accounts]
        self._first = [momentum[0] for momentum in momenta] if self._first is None else self._first
        changes = [momentum - first for momentum, first in zip(momenta, self._first, strict=True)]
        columns = [norms(change[:, axes]) for change in changes for axes in (slice(3), slice(3, 6))]
        columns += [accounts.energy(part) for accounts in self._accounts]
        if self._task is not None:
            columns.append(norms(self._task.errors_m(self._layout, lambda key: part[:, self._layout.index[key]])))
        return np.column_stack(columns)


def _slices(blocks: Iterable[FloatArray], size: int) -> Iterator[FloatArray]:
    """Regroup rows into blocks of equal size, except the last."""
    waiting: list[FloatArray] = []
    for block in blocks:
        waiting.append(block)
        if sum(map(len, waiting)) >= size:
            rows = np.concatenate(waiting)
            whole = len(rows) // size * size
            yield from (rows[first : first + size] for first in range(0, whole, size))
            waiting = [rows[whole:]]
    rest = np.concatenate(waiting)
    if len(rest):
        yield rest


def _outstanding(part: FloatArray, times: FloatArray, beside: FloatArray, marks: FloatArray) -> FloatArray:
    """Indices of the rows of a slice to keep, in order."""
    values = np.column_stack((part, beside))
    known = np.isfinite(values)
    low, high = (np.where(known, values, bound) for bound in (np.inf, -np.inf))
    inside = marks[(marks > times[0]) & (marks <= times[-1])]
    after = np.searchsorted(times, inside - 1e-9)
    rows = (0, len(part) - 1, *low.argmin(axis=0), *high.argmax(axis=0), *after, *(after - 1))
    return np.unique(np.clip(rows, 0, len(part) - 1))
