"""Executes the runs of a campaign on an engine: hands out batches, stores rows, and continues after the loss of workers."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from typing import Any

from ffsm_mj.assembly.interrupts import noted
from ffsm_mj.campaign.execution.engines import Engine
from ffsm_mj.campaign.execution.run_queue import Batch, PlannedRun, RunQueue
from ffsm_mj.campaign.execution.worker import Job, execute_runs, probe
from ffsm_mj.campaign.storage.outcomes import CRASHED, TIMEOUT
from ffsm_mj.campaign.storage.store import RunRow
from ffsm_mj.errors import FfsmError, InputError, described

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
