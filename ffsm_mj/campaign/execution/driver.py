"""Gets the rows of a campaign made: keeps workers busy, stores what comes back, and goes on when workers are lost."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.campaign.execution.engines import Engine
from ffsm_mj.campaign.execution.worker import Job, make_rows, probe
from ffsm_mj.campaign.storage.outcomes import CRASHED, TIMEOUT
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.errors import FfsmError, InputError, described

_BATCH_S, _BATCH_RUNS = 30.0, 100
"""How long a batch lasts and how many runs it has, at most: so much is lost with a worker."""
_LIVES = 2
"""A run that ends so many workers is given up."""
_LOST_ENGINES = 20
"""An engine that is lost so often without a row in between is given up."""

Planned = tuple[int, Mapping[str, Any]]


class EngineLostError(FfsmError):
    """No runs can be made here any more; what was made is kept."""


class _LostError(FfsmError):
    """An executor is lost."""


@dataclass
class _Batch:
    """Runs that are handed out together, and since when."""

    runs: list[Planned]
    since: float = field(default_factory=time.perf_counter)


@dataclass
class _Queue:
    """Runs to be made, and what is known of how long one takes.

    Attributes:
        runs: Not handed out.
        total: How many there were.
        workers: How many are busy at once.
        ahead: Batches per worker that are handed out at once.
        made: Rows so far.
        spent_s: Wall time of those.
        suspects: Runs of which one may have ended a worker: each goes alone.
        killed: How many workers were lost while a run was alone, by its number.
        alone: Whether suspects go now.
    """

    runs: deque[Planned]
    total: int
    workers: int
    ahead: int
    made: int = 0
    spent_s: float = 0.0
    suspects: deque[Planned] = field(default_factory=deque)
    killed: dict[int, int] = field(default_factory=dict)
    alone: bool = False

    def batches(self, flying: Sequence[_Batch]) -> Iterator[_Batch]:
        """What to hand out now, so that no worker waits."""
        self.alone = bool(self.suspects) or (self.alone and bool(flying))
        if self.alone:
            if not flying:
                yield _Batch([self.suspects.popleft()])
            return
        for _ in range(self.ahead * self.workers - len(flying)):
            if self.runs:
                yield _Batch([self.runs.popleft() for _ in range(min(self._size(), len(self.runs)))])

    def _size(self) -> int:
        each_s = self.spent_s / self.made if self.made else _BATCH_S
        return max(1, int(min(_BATCH_S / max(each_s, 1e-3), _BATCH_RUNS, self.total / (20.0 * self.workers))))

    def take(self, batch: _Batch, rows: Sequence[RunRow]) -> None:
        """Rows came back; what has none is to be made yet."""
        self.made += len(rows)
        self.spent_s += sum(row.wall_s for row in rows)
        kept = {row.index for row in rows}
        self.runs.extendleft(reversed([run for run in batch.runs if run[0] not in kept]))

    def suspect(self, batches: Sequence[_Batch]) -> None:
        """One of these runs may have ended a worker."""
        for batch in batches:
            self.suspects += batch.runs
            batch.runs = []

    def lost(self, batches: Sequence[_Batch]) -> None:
        """These will never come back."""
        for batch in reversed(batches):
            self.runs.extendleft(reversed(batch.runs))


class Driver:
    """Makes runs on an engine until none is left."""

    def __init__(
        self, engine: Engine, job: Job, store: Callable[[Sequence[RunRow]], None], stop: Callable[[], bool]
    ) -> None:
        """Nothing is begun.

        Args:
            engine: Where runs are made.
            job: The campaign.
            store: Keeps rows.
            stop: Asked after every batch: whether to stop.
        """
        self._engine, self._job, self._store, self._stop = engine, job, store, stop
        self._stopped = False

    def drive(self, runs: Sequence[Planned]) -> None:
        """Make these runs.

        Raises:
            EngineLostError: The engine is lost and no other can be had.
            InputError: Runs cannot be made by these workers at all.
        """
        queue = _Queue(deque(runs), len(runs), self._engine.workers, self._engine.ahead)
        lost = 0
        while (queue.runs or queue.suspects) and not self._stopped:
            made = queue.made
            try:
                with self._opened(lost) as executor:
                    self._probe(executor)
                    self._make(executor, queue)
            except _LostError as error:
                lost = lost + 1 if queue.made == made else 1
                if not self._engine.lasting or lost > _LOST_ENGINES:
                    raise EngineLostError(
                        f"{self._engine.name}: {error}; the rows so far are kept, resume goes on"
                    ) from error

    @contextmanager
    def _opened(self, lost: int) -> Iterator[Executor]:
        """An executor; where there was one before, that there is none any more is a loss."""
        with ExitStack() as stack:
            try:
                executor = stack.enter_context(self._engine.open())
            except InputError as error:
                raise (EngineLostError(f"{error}; the rows so far are kept, resume goes on") if lost else error) from error
            yield executor

    def _probe(self, executor: Executor) -> None:
        """Whether a worker can do this at all, before any run is given to one."""
        try:
            executor.submit(probe, self._job).result()
        except FfsmError as error:
            raise InputError(str(error)) from error
        except Exception as error:
            hint = "" if self._engine.lasting else "; a script that makes an executor needs if __name__ == '__main__'"
            raise InputError(f"{self._engine.name}: no worker can make runs ({described(error)}){hint}") from error

    def _make(self, executor: Executor, queue: _Queue) -> None:
        """Make runs until none is left.

        Raises:
            _LostError: The executor is.
        """
        flying: dict[Future[list[RunRow]], _Batch] = {}
        try:
            while not self._stopped and (queue.runs or queue.suspects or flying):
                for batch in queue.batches(list(flying.values())):
                    flying[executor.submit(make_rows, self._job, batch.runs)] = batch
                done, _ = wait(flying, return_when=FIRST_COMPLETED)
                # Batches that are made first: none of them is one that ended a worker.
                for future in sorted(done, key=lambda each: each.cancelled() or each.exception() is not None):
                    self._take(future, flying, queue)
                self._stopped = self._stop()
            self._keep_what_runs(flying)
        except (BrokenExecutor, CancelledError, OSError) as error:
            queue.lost(list(flying.values()))
            raise _LostError(described(error)) from error
        finally:
            for future in flying:
                future.cancel()

    def _keep_what_runs(self, flying: dict[Future[list[RunRow]], _Batch]) -> None:
        """Store what was begun before a stop: an executor ends that before it closes, so its rows cost nothing more."""
        running = [future for future in flying if not future.cancel()]
        wait(running)
        for future in running:
            if future.exception() is None:
                self._store(future.result())
        flying.clear()

    def _take(self, future: Future[list[RunRow]], flying: dict[Future[list[RunRow]], _Batch], queue: _Queue) -> None:
        """Store what a batch came to."""
        batch = flying[future]
        try:
            rows = future.result()
        except FfsmError as error:
            raise InputError(str(error)) from error
        except Exception as error:
            # The second is of distributed, which need not be installed; it gives a task up by itself.
            if not isinstance(error, BrokenExecutor) and type(error).__name__ != "KilledWorker":
                raise
            # Batches are begun in the order in which they were handed out, one per worker.
            begun = [batch] if not isinstance(error, BrokenExecutor) else list(flying.values())[: queue.workers]
            rows = self._given_up(begun, error, queue)
            for each in begun:
                each.runs = [run for run in each.runs if run[0] not in {row.index for row in rows}]
            queue.suspect(begun)
            self._store(rows)
            if isinstance(error, BrokenExecutor):
                raise
            del flying[future]
            return
        del flying[future]
        self._store(rows)
        queue.take(batch, rows)
        if self._engine.here and len(rows) < len(batch.runs):
            raise KeyboardInterrupt  # a run took it as its own

    def _given_up(self, begun: list[_Batch], error: BaseException, queue: _Queue) -> list[RunRow]:
        """The row of a run that was alone when its worker was lost: late, or for the last time."""
        if sum(len(batch.runs) for batch in begun) != 1:
            return []
        batch = next(batch for batch in begun if batch.runs)
        index, spent = batch.runs[0][0], time.perf_counter() - batch.since
        # Only what nothing went before was begun when it was handed out.
        late = queue.alone and bool(self._job.timeout_s) and spent > self._job.timeout_s
        queue.killed[index] = queue.killed.get(index, 0) + 1
        if not late and queue.killed[index] < _LIVES:
            return []
        message = f"took more than {self._job.timeout_s:g} s and did not stop" if late else described(error)
        queue.made += 1
        return [RunRow(index, TIMEOUT if late else CRASHED, message, wall_s=round(spent, 6))]
