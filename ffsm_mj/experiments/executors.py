"""Workers that execute the runs of a campaign, as executors of :mod:`concurrent.futures`: this process, others, Dask."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.context import SpawnContext, SpawnProcess
from queue import SimpleQueue
from types import ModuleType
from typing import Any, TypeVar

from ffsm_mj.all_cores import end_at_once
from ffsm_mj.errors import InputError, MissingPackageError
from ffsm_mj.experiments.metrics import FileMetric
from ffsm_mj.invocation import on_command_line
from ffsm_mj.module_path import importable_elsewhere, without_current_folder

Result = TypeVar("Result")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_ANSWER_S = 10
"""Timeout of the connection to a Dask scheduler, s: one that is busy answers between two tasks of some milliseconds."""


@dataclass(frozen=True)
class Workers:
    """Workers that execute runs, and how to open the executor that calls them.

    Attributes:
        name: Name for messages.
        count: Number of runs at the same time.
        open: Opens an executor as a context.
        exclusive_processes: Whether its processes execute nothing else, so that a process with a stuck run may be ended.
        reopens: Whether it can open another executor after one is lost.
        in_this_thread: Whether runs are executed by the calling thread, so that the interrupt of a run ends the campaign.
        batches: Whether several runs make one task, because a task costs its scheduler some milliseconds.
    """

    name: str
    count: int
    open: Callable[[], Any]
    exclusive_processes: bool = True
    reopens: bool = True
    in_this_thread: bool = False
    batches: bool = False


def choose_workers(
    executor: Executor | None,
    workers: int | None,
    dask_address: str,
    classes: Iterable[Any],
    default_workers: int | None,
) -> Workers:
    """Workers for the arguments of :meth:`ffsm_mj.experiments.campaign.Campaign.run`.

    Args:
        executor: Executor of the caller, if there is one.
        workers: Number of processes asked for.
        dask_address: Address of a Dask scheduler; empty: none.
        classes: Control laws and estimators of a script; other processes cannot import all of them.
        default_workers: Number of processes of the campaign file.

    Raises:
        InputError: The number of workers is less than 1, or see :func:`dask`.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers: {workers} is less than 1")
    if executor is not None:
        return workers_of_caller(executor, workers)
    if dask_address:
        return dask(dask_address)
    if not all(map(importable, classes)):
        return loop()
    return pool(workers or default_workers)


class Loop(Executor):
    """Executor that calls each function immediately, in the calling thread."""

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Call the function; the future holds its result or exception, except that KeyboardInterrupt is raised."""
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (the future holds it, as for any executor)
            future.set_exception(error)
        return future


def loop() -> Workers:
    """This process, which executes runs one after the other."""
    return Workers("this process", 1, Loop, exclusive_processes=False, in_this_thread=True)


def pool(workers: int | None = None) -> Workers:
    """Processes on this machine.

    Args:
        workers: Number of processes; None: one per processor that this process may use.
    """
    count = workers or usable_processors()
    return Workers(f"{count} processes", count, lambda: Processes(count))


def usable_processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def importable(law: Any) -> bool:
    """Whether another process can import a class or function: none of a script, of a function, or of the current folder."""
    if isinstance(law, FileMetric):
        return True
    module, name = getattr(law, "__module__", "__main__"), getattr(law, "__qualname__", "<object>")
    return module != "__main__" and "<" not in name and importable_elsewhere(module)


def workers_of_caller(executor: Executor, workers: int | None = None) -> Workers:
    """Workers of an executor of the caller, who closes it."""

    @contextmanager
    def same() -> Iterator[Executor]:
        yield executor

    if isinstance(executor, Loop):
        return loop()
    count = workers or getattr(executor, "_max_workers", None) or usable_processors()
    return Workers(type(executor).__name__, int(count), same, exclusive_processes=False, reopens=False)


def dask(address: str) -> Workers:
    """Workers of a Dask cluster, one thread each.

    Args:
        address: Address of the scheduler, e.g. ``tcp://host:8786``.

    Raises:
        MissingPackageError: ``distributed`` is not installed.
        InputError: The scheduler does not answer, it has no workers, or a worker has several threads.
    """
    where = f"--dask {address}" if on_command_line() else f"dask={address!r}"
    distributed = _distributed()

    def client() -> Any:
        try:
            client_of: Any = distributed.Client
            return client_of(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"{where}: no scheduler answers there ({error})") from error

    @contextmanager
    def connected() -> Iterator[Executor]:
        with client() as connection:
            # By default, Dask executes calls with equal arguments only once.
            yield connection.get_executor(pure=False)

    with client() as connection:
        threads = connection.nthreads()
    if not threads:
        raise InputError(f"{where}: the scheduler has no workers; start some: dask worker {address} --nthreads 1")
    several = [name for name, count in threads.items() if count != 1]
    if several:
        raise InputError(f"{where}: worker {several[0]} has {threads[several[0]]} threads; start it with --nthreads 1")
    return Workers(f"{len(threads)} Dask workers", len(threads), connected, batches=True)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingPackageError("a campaign on a Dask cluster", "distributed", "cluster") from error
    return distributed


class WorkerLostError(Exception):
    """The process of a run has ended."""


class Processes(ThreadPoolExecutor):
    """Executor whose threads have one process each: one that ends takes its own run with it, and another one begins.

    A context; if an exception leaves it, running processes are killed.
    """

    def __init__(self, workers: int) -> None:
        """Begin no process yet."""
        super().__init__(workers)
        self._idle: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()
        self._pools: list[ProcessPoolExecutor] = []
        for _ in range(workers):
            self._add()

    def _add(self) -> None:
        self._pools.append(ProcessPoolExecutor(1, mp_context=_Spawn(), initializer=_begin_worker))
        self._idle.put(self._pools[-1])

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Call a function in a process; the future has a WorkerLostError if it ends."""
        return super().submit(self._called, fn, *args, **kwargs)

    def _called(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Result:
        pool = self._idle.get()
        try:
            result = pool.submit(fn, *args, **kwargs).result()
        except BrokenProcessPool as error:
            self._pools.remove(pool)
            self._add()
            raise WorkerLostError from error
        except BaseException:  # of the function, or the executor shuts down: the process is fine
            self._idle.put(pool)
            raise
        self._idle.put(pool)
        return result

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes: at once after an exception, else when their functions have returned."""
        pools = list(self._pools)
        if kind is not None:
            super().shutdown(wait=False, cancel_futures=True)
            for pool in pools:
                with _STARTING:
                    mine = [process for process in multiprocessing.active_children() if isinstance(process, _Process)]
                end_at_once(pool, mine)
        self.shutdown(cancel_futures=True)
        for pool in pools:
            pool.shutdown()


def _begin_worker() -> None:
    """Initialise a worker: one BLAS thread, Ctrl-C left to the driver, and the end of the process with the driver."""
    for variable in _THREADS:
        os.environ.setdefault(variable, "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_driver, name="end with driver", daemon=True).start()


def _end_with_driver() -> None:
    # A driver that is killed cannot end its workers, and nothing tells a process that waits for work that nobody is left.
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


_STARTING = threading.Lock()


class _Process(SpawnProcess):
    """Process that imports neither the running script nor anything from the current folder.

    A campaign can therefore run from a script without a main guard, from standard input and from a notebook.
    """

    @staticmethod
    def _Popen(process_obj: Any) -> Any:
        with _STARTING:
            # multiprocessing imports the main module of the parent in a child to find what was pickled from it.
            main = sys.modules["__main__"]
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                with without_current_folder():
                    return SpawnProcess._Popen(process_obj)
            finally:
                sys.modules["__main__"] = main


class _Spawn(SpawnContext):
    Process = _Process
