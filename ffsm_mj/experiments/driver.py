"""Hands out the runs of a campaign to workers, stores their rows, and continues after the loss of workers."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Any

from ffsm_mj.assembly.process import noted
from ffsm_mj.errors import FfsmError, InputError, described
from ffsm_mj.experiments.executors import WorkerLostError, Workers
from ffsm_mj.experiments.file import CampaignFile
from ffsm_mj.experiments.results import Results
from ffsm_mj.experiments.statistics import intervals
from ffsm_mj.experiments.store import CRASHED, TIMEOUT, RunRow
from ffsm_mj.experiments.worker import Job, PlannedRun, execute_runs, probe

FIRST = 50
"""Number of first runs whose failures decide whether the campaign continues.

A mistake in the file makes nearly all fail; of a fraction by chance 50 runs know a half to 14 % (95 %, binomial).
"""


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
        points = intervals(self._results(), stop.metric)
        runs = max(points, default=0)
        if not runs or (width := points[runs].width) is None or width > stop.width:
            return ""
        return f"the 95 % interval of {stop.metric} is narrower than {stop.width:g} after {runs} runs"


_LOOK_S = 0.2
"""Greatest time between two looks for a signal, s: a person who types Ctrl-C sees no delay."""
_BATCH_S, _BATCH_RUNS = 30.0, 100
"""Greatest duration and number of runs of a batch: a lost worker costs at most this."""
_AHEAD = 4
"""Batches per worker that are handed out at once: one runs, and others wait while the driver writes rows to a slow disk."""
_MOST_LOSSES = 20
"""The workers are given up after their executor was lost this many times without a row in between.

A cluster whose nodes are taken away loses it several times in succession, one that cannot work at all each time.
"""


class NoWorkersLeftError(FfsmError):
    """No worker can be reached any more; the rows so far are kept."""


class _LostError(FfsmError):
    """An executor is lost."""


class Driver:
    """Has workers execute runs until none is left.

    Runs whose worker is lost are handed out a second time, alone, after all others and to an idle worker, so that each
    begins at once: if its worker is lost again, the run is given up, as late or as one that ends its worker.
    """

    def __init__(
        self, workers: Workers, job: Job, store: Callable[[Sequence[RunRow]], None], stop: Callable[[], bool]
    ) -> None:
        """Store the arguments.

        Args:
            workers: They execute the runs.
            job: The campaign.
            store: Called with new rows.
            stop: Called after new rows; True ends the campaign.
        """
        self._workers, self._job, self._store, self._stop = workers, job, store, stop
        self._stopped = False
        self._interrupted: Callable[[], bool] = bool  # no signal is looked for before :meth:`drive`: bool() is False
        self._runs, self._suspects = deque[PlannedRun](), deque[PlannedRun]()
        self._total, self._finished, self._spent_s = 0, 0, 0.0
        self._pending: dict[Future[list[RunRow]], tuple[list[PlannedRun], float | None]] = {}
        """Runs that are handed out; with the time at which it began, s, for a suspect, which is handed out alone."""

    def drive(self, runs: Sequence[PlannedRun]) -> None:
        """Execute these runs.

        Raises:
            NoWorkersLeftError: The executor is lost and cannot be opened again.
            InputError: The workers cannot execute runs of this campaign at all.
            KeyboardInterrupt: Ctrl-C or SIGTERM; the rows so far are stored.
        """
        self._runs.extend(runs)
        self._total, lost = len(runs), 0
        # A signal is noted and looked for where no lock is held: raised inside concurrent.futures it would leave one locked,
        # and nobody could end the workers.
        with noted() as self._interrupted:
            while (self._runs or self._suspects) and not self._stopped:
                finished = self._finished
                try:
                    with self._opened(lost) as executor:
                        self._probe(executor)
                        self._execute(executor)
                except _LostError as error:
                    lost = lost + 1 if self._finished == finished else 1
                    if not self._workers.reopens or lost > _MOST_LOSSES:
                        raise NoWorkersLeftError(
                            f"{self._workers.name}: {error}; the rows so far are kept, resume continues the campaign"
                        ) from error

    @contextmanager
    def _opened(self, lost: int) -> Iterator[Executor]:
        """The executor; no worker is left if it cannot be opened again."""
        with ExitStack() as stack:
            try:
                executor = stack.enter_context(self._workers.open())
            except InputError as error:
                if not lost:
                    raise
                raise NoWorkersLeftError(f"{error}; the rows so far are kept, resume continues the campaign") from error
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
            hint = "" if self._workers.reopens else "; a script that creates an executor needs if __name__ == '__main__'"
            raise InputError(f"{self._workers.name}: no worker can execute runs ({described(error)}){hint}") from error

    def _execute(self, executor: Executor) -> None:
        """Execute runs until none is left.

        Raises:
            _LostError: The executor is lost.
        """
        try:
            while not self._stopped and (self._runs or self._suspects or self._pending):
                self._hand_out(executor)
                self._take(executor, self._wait(self._pending))
                self._stopped = self._stop()
            # The executor completes what has begun before it closes.
            begun = [future for future in self._pending if future.running() or not future.cancel()]
            while left := [future for future in begun if future in self._pending]:
                self._take(executor, self._wait(left))
        except (BrokenExecutor, CancelledError, OSError) as error:
            self._runs.extendleft(run for runs, _ in reversed(self._pending.values()) for run in reversed(runs))
            raise _LostError(described(error)) from error
        finally:
            for future in self._pending:
                future.cancel()
            self._pending.clear()

    def _hand_out(self, executor: Executor) -> None:
        """Hand out batches, so that no worker waits, or else suspects, one per worker."""
        most = 1 if self._workers.in_this_thread else _AHEAD * self._workers.count
        while self._runs and len(self._pending) < most:
            batch = [*islice(self._runs, self._size())]
            self._pending[executor.submit(execute_runs, self._job, batch)] = (batch, None)
            for _ in batch:
                self._runs.popleft()
        if all(began is not None for _, began in self._pending.values()):
            while self._suspects and len(self._pending) < self._workers.count:
                began = time.perf_counter()
                future = executor.submit(execute_runs, self._job, [self._suspects[0]])
                self._pending[future] = ([self._suspects.popleft()], began)

    def _size(self) -> int:
        """Number of runs of a batch."""
        if not self._workers.batches:
            return 1
        per_run_s = self._spent_s / self._finished if self._finished else _BATCH_S
        # At most a twentieth of what a worker will execute: at the end none has much more left than the others.
        return max(1, int(min(_BATCH_S / max(per_run_s, 1e-3), _BATCH_RUNS, self._total / (20.0 * self._workers.count))))

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

    def _take(self, executor: Executor, done: Iterable[Future[list[RunRow]]]) -> None:
        """Store the rows of finished batches, in one transaction; runs of them that have none are handed out again.

        Raises:
            KeyboardInterrupt: A run was interrupted.
        """
        rows, interrupted = [], False
        try:
            # Rows first: if the executor is lost, they are kept.
            for future in sorted(done, key=lambda ended: ended.cancelled() or ended.exception() is not None):
                received = self._result(executor, future)
                runs, _ = self._pending.pop(future)
                with_rows = {row.index for row in received}
                left = [run for run in runs if run[0] not in with_rows]
                if future.exception() is not None:
                    self._suspects.extend(left)
                else:
                    self._runs.extendleft(reversed(left))
                    interrupted = interrupted or (self._workers.in_this_thread and bool(left))
                rows += received
        finally:
            self._finished += len(rows)
            self._spent_s += sum(row.wall_s for row in rows)
            self._store(rows)
        if interrupted:
            raise KeyboardInterrupt

    def _result(self, executor: Executor, future: Future[list[RunRow]]) -> list[RunRow]:
        """Rows of a batch; if its worker was lost, that of a suspect, which is given up, and else none."""
        try:
            return future.result()
        except FfsmError as error:
            raise InputError(str(error)) from error
        except Exception as error:
            # distributed, which need not be installed, has a type of its own.
            if not isinstance(error, WorkerLostError) and type(error).__name__ != "KilledWorker":
                raise
            runs, began = self._pending[future]
            if began is None:
                return []
            spent = time.perf_counter() - began
            self._probe(executor)  # that no worker can do anything is not the fault of a run
            limit_s = self._job.timeout_s
            late = limit_s and spent > limit_s
            message = f"took more than {limit_s:g} s and did not stop" if late else described(error.__cause__ or error)
            return [RunRow(runs[0][0], TIMEOUT if late else CRASHED, message, wall_s=round(spent, 6))]
