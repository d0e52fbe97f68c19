"""Runs of a campaign that have no row yet: which of them are handed out next, together or one by one."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.campaign.storage.store import RunRow

_BATCH_S, _BATCH_RUNS = 30.0, 100
"""Greatest duration and number of runs of a batch: a lost worker costs at most this."""

PlannedRun = tuple[int, Mapping[str, Any]]
"""Index of a run in the design, and its overrides."""


@dataclass
class Batch:
    """Runs that are handed out together.

    Attributes:
        runs: The runs.
        single: Whether it is one run, handed out to an idle worker: it began at ``since``.
        since: When it was handed out, s.
    """

    runs: list[PlannedRun]
    single: bool = False
    since: float = field(default_factory=time.perf_counter)


@dataclass
class RunQueue:
    """Runs without a row, and an estimate of how long one takes.

    After the loss of a worker the runs that had begun are suspects. Suspects are handed out one per worker. If a worker is
    lost again, the few runs that had begun are handed out alone, so that the one that ends its worker is found.

    Attributes:
        runs: Runs to hand out in batches.
        total: Number of runs at the start.
        workers: Number of workers.
        ahead: Batches per worker that are handed out at once.
        made: Number of rows so far.
        spent_s: Wall time of these rows.
        suspects: Runs to hand out one per worker.
        isolated: Runs to hand out alone.
        single: Whether runs are handed out one by one now.
    """

    runs: deque[PlannedRun]
    total: int
    workers: int
    ahead: int
    made: int = 0
    spent_s: float = 0.0
    suspects: deque[PlannedRun] = field(default_factory=deque)
    isolated: deque[PlannedRun] = field(default_factory=deque)
    single: bool = False

    def __bool__(self) -> bool:
        """Whether runs are left to hand out."""
        return bool(self.runs or self.suspects or self.isolated)

    def batches(self, pending: Sequence[Batch]) -> Iterator[Batch]:
        """Batches to hand out now, so that no worker waits; ``pending`` has those without a result."""
        self.single = bool(self.suspects or self.isolated) or (self.single and bool(pending))
        if not self.single:
            for _ in range(self.ahead * self.workers - len(pending)):
                if self.runs:
                    yield Batch([self.runs.popleft() for _ in range(min(self._size(), len(self.runs)))])
        elif all(batch.single for batch in pending):
            source, places = (self.isolated, 1) if self.isolated else (self.suspects, self.workers)
            for _ in range(min(places - len(pending), len(source))):
                yield Batch([source.popleft()], single=True)

    def _size(self) -> int:
        each_s = self.spent_s / self.made if self.made else _BATCH_S
        return max(1, int(min(_BATCH_S / max(each_s, 1e-3), _BATCH_RUNS, self.total / (20.0 * self.workers))))

    def take(self, batch: Batch, rows: Sequence[RunRow]) -> None:
        """Count the rows of a batch; runs of it that have none are handed out again."""
        self.made += len(rows)
        self.spent_s += sum(row.wall_s for row in rows)
        kept = {row.index for row in rows}
        self.runs.extendleft(reversed([run for run in batch.runs if run[0] not in kept]))

    def suspect(self, begun: Sequence[Batch], rows: Sequence[RunRow]) -> None:
        """Hand out again the runs that had begun when a worker was lost.

        Args:
            begun: Their batches.
            rows: Rows of those that are given up; not empty if these explain the loss.
        """
        self.made += len(rows)
        kept = {row.index for row in rows}
        left = [run for batch in begun for run in batch.runs if run[0] not in kept]
        narrowed = not rows and all(batch.single for batch in begun)
        (self.isolated if narrowed else self.suspects).extend(left)
        for batch in begun:
            batch.runs = []

    def lost(self, batches: Sequence[Batch]) -> None:
        """Hand out again the runs of batches that were lost before they began."""
        for batch in reversed(batches):
            self.runs.extendleft(reversed(batch.runs))
