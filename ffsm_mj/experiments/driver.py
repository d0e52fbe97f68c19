"""Executes the runs of a campaign on an engine: hands out batches, stores rows, and continues after the loss of workers."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.errors import FfsmError, InputError, described
from ffsm_mj.experiments.engines import Engine
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.results import Results
from ffsm_mj.experiments.statistics import narrow_enough
from ffsm_mj.experiments.store import CRASHED, TIMEOUT, RunRow
from ffsm_mj.experiments.worker import Job, execute_runs, probe

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


FIRST = 50
"""Number of first runs whose failures decide whether the campaign continues."""


class StoppingRule:
    """Decides from the rows so far whether a campaign ends.

    Attributes:
        failing: Message that too many runs fail; empty if they do not.
        enough: Message that the interval of ``stop`` is narrow enough; empty if it is not.
    """

    def __init__(
        self, config: CampaignFile, runs: int, done: Iterable[int], failed: int, results: Callable[[], Results]
    ) -> None:
        """Start with the rows of a campaign that may have been interrupted.

        Args:
            config: Campaign file with the limits.
            runs: Total number of runs.
            done: Indices of runs that have a row.
            failed: Number of failures among the first ``FIRST`` runs.
            results: Returns all rows so far.
        """
        self._config, self._results = config, results
        self._first, self._failed = min(FIRST, runs), failed
        self._done, self._complete, self._evaluated_at = set(done), 0, 0
        self._advance()
        self.failing, self.enough = "", ""

    def add(self, rows: Iterable[RunRow]) -> None:
        """Count new rows."""
        for row in rows:
            self._done.add(row.index)
            self._failed += row.failed and row.index < self._first
        self._advance()

    def _advance(self) -> None:
        while self._complete in self._done:
            self._complete += 1

    def ends(self) -> bool:
        """Whether the campaign ends now."""
        self.failing, self.enough = self._failing(), self._enough()
        return bool(self.failing or self.enough)

    def _failing(self) -> str:
        share = self._config.max_failed
        if self._failed <= share * self._first:
            return ""
        return f"{self._failed} of the first {self._first} runs failed, more than limits.max_failed = {share:g}"

    def _enough(self) -> str:
        """Evaluated when the first 2^k runs are complete: more frequent evaluation would spoil the confidence."""
        stop, power = self._config.stop, 1 << (self._complete.bit_length() - 1) if self._complete else 0
        if stop is None or power <= self._evaluated_at:
            return ""
        self._evaluated_at = power
        if not narrow_enough(self._results(), stop.metric, stop.width):
            return ""
        return f"the 95 % interval of {stop.metric} is narrower than {stop.width:g} after {power} runs"


_LOOK_S = 0.2
"""Greatest time between two looks for a signal, s."""
_LIVES = 2
"""A run is given up after this many workers were lost with it."""
_LOST_ENGINES = 20
"""An engine is given up after this many losses without a row in between."""


class EngineLostError(FfsmError):
    """The engine is lost; the rows so far are kept."""


class _LostError(FfsmError):
    """An executor is lost."""


class Driver:
    """Executes runs on an engine until none is left."""

    def __init__(
        self, engine: Engine, job: Job, store: Callable[[Sequence[RunRow]], None], stop: Callable[[], bool]
    ) -> None:
        """Store the arguments.

        Args:
            engine: Where runs are executed.
            job: The campaign.
            store: Called with new rows.
            stop: Called after every batch; True ends the campaign.
        """
        self._engine, self._job, self._store, self._stop = engine, job, store, stop
        self._stopped = False
        self._interrupted: Callable[[], bool] = bool
        self._killed: dict[int, int] = {}  # workers lost while a run was the only one, by its index

    def drive(self, runs: Sequence[PlannedRun]) -> None:
        """Execute these runs.

        Raises:
            EngineLostError: The engine is lost and cannot be reopened.
            InputError: The workers cannot execute runs of this campaign at all.
            KeyboardInterrupt: Ctrl-C or SIGTERM; the rows so far are stored.
        """
        # A signal is noted and looked for where no lock is held: raised inside concurrent.futures it would leave one locked,
        # and nobody could end the workers.
        with noted() as self._interrupted:
            self._drive(RunQueue(deque(runs), len(runs), self._engine.workers, self._engine.ahead))

    def _drive(self, queue: RunQueue) -> None:
        lost = 0
        while queue and not self._stopped:
            made = queue.made
            try:
                with self._opened(lost) as executor:
                    self._probe(executor)
                    self._execute(executor, queue)
            except _LostError as error:
                lost = lost + 1 if queue.made == made else 1
                if not self._engine.reopens or lost > _LOST_ENGINES:
                    raise EngineLostError(
                        f"{self._engine.name}: {error}; the rows so far are kept, resume continues the campaign"
                    ) from error

    @contextmanager
    def _opened(self, lost: int) -> Iterator[Executor]:
        """An executor of the engine; if it cannot be opened again, the engine is lost."""
        with ExitStack() as stack:
            try:
                executor = stack.enter_context(self._engine.open())
            except InputError as error:
                if not lost:
                    raise
                raise EngineLostError(f"{error}; the rows so far are kept, resume continues the campaign") from error
            yield executor

    def _probe(self, executor: Executor) -> None:
        """Check that a worker can execute runs, before it gets any."""
        try:
            probed = executor.submit(probe, self._job)
            self._wait([probed])
            probed.result()
        except FfsmError as error:
            raise InputError(str(error)) from error
        except Exception as error:
            hint = "" if self._engine.reopens else "; a script that creates an executor needs if __name__ == '__main__'"
            raise InputError(f"{self._engine.name}: no worker can execute runs ({described(error)}){hint}") from error

    def _execute(self, executor: Executor, queue: RunQueue) -> None:
        """Execute runs until none is left.

        Raises:
            _LostError: The executor is lost.
        """
        pending: dict[Future[list[RunRow]], Batch] = {}
        try:
            while not self._stopped and (queue or pending):
                for batch in queue.batches(list(pending.values())):
                    pending[self._submit(executor, batch, queue)] = batch
                done = self._wait(pending)
                # Finished batches first: after a loss, the batches that had begun are found among those that remain.
                for future in sorted(done, key=lambda each: each.cancelled() or each.exception() is not None):
                    self._take(future, pending, queue)
                self._stopped = self._stop()
            self._store_running(pending)
        except (BrokenExecutor, CancelledError, OSError) as error:
            queue.lost(list(pending.values()))
            raise _LostError(described(error)) from error
        finally:
            for future in pending:
                future.cancel()

    def _wait(self, futures: Iterable[Future[Any]]) -> set[Future[Any]]:
        """Wait until some of these are done; returns them.

        Raises:
            KeyboardInterrupt: A signal was received.
        """
        while True:
            done, _ = wait(futures, timeout=_LOOK_S, return_when=FIRST_COMPLETED)
            if self._interrupted():
                raise KeyboardInterrupt
            if done:
                return done

    def _submit(self, executor: Executor, batch: Batch, queue: RunQueue) -> Future[list[RunRow]]:
        """Hand out a batch; an executor that is lost already refuses it, and its runs go back into the queue."""
        try:
            return executor.submit(execute_runs, self._job, batch.runs)
        except BaseException:
            queue.lost([batch])
            raise

    def _store_running(self, pending: dict[Future[list[RunRow]], Batch]) -> None:
        """Store the rows of batches that began before a stop: the executor completes these before it closes."""
        running = [future for future in pending if not future.cancel()]
        for future in running:
            self._wait([future])
            if future.exception() is None:
                self._store(future.result())
        pending.clear()

    def _take(self, future: Future[list[RunRow]], pending: dict[Future[list[RunRow]], Batch], queue: RunQueue) -> None:
        """Store the rows of a batch."""
        batch = pending[future]
        try:
            rows = future.result()
        except FfsmError as error:
            raise InputError(str(error)) from error
        except BrokenExecutor as error:
            # Batches begin in the order in which they are handed out, one per worker.
            self._lose(list(pending.values())[: queue.workers], error, queue)
            raise
        except Exception as error:
            # distributed, which need not be installed, reports the loss of workers for a single task.
            if type(error).__name__ != "KilledWorker":
                raise
            del pending[future]
            self._lose([batch], error, queue)
            return
        del pending[future]
        self._store(rows)
        queue.take(batch, rows)
        if self._engine.in_this_thread and len(rows) < len(batch.runs):
            raise KeyboardInterrupt  # a run was interrupted

    def _lose(self, begun: list[Batch], error: BaseException, queue: RunQueue) -> None:
        """Hand out again the runs that had begun when a worker was lost, except those that are given up."""
        rows = [row for batch in begun if (row := self._late(batch)) is not None] or self._crashed(begun, error)
        queue.suspect(begun, rows)
        self._store(rows)

    def _late(self, batch: Batch) -> RunRow | None:
        """Row of a single run that took too long; its worker ended itself."""
        spent, limit_s = time.perf_counter() - batch.since, self._job.timeout_s
        if not (batch.single and limit_s and spent > limit_s):
            return None
        return RunRow(batch.runs[0][0], TIMEOUT, f"took more than {limit_s:g} s and did not stop", wall_s=round(spent, 6))

    def _crashed(self, begun: list[Batch], error: BaseException) -> list[RunRow]:
        """Row of a run that has ended too many workers; empty if several runs had begun."""
        if sum(len(batch.runs) for batch in begun) != 1:
            return []
        batch = next(batch for batch in begun if batch.runs)
        index = batch.runs[0][0]
        self._killed[index] = self._killed.get(index, 0) + 1
        if self._killed[index] < _LIVES:
            return []
        return [RunRow(index, CRASHED, described(error), wall_s=round(time.perf_counter() - batch.since, 6))]
