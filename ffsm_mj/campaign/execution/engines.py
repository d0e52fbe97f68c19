"""Where runs are made: executors of :mod:`concurrent.futures`, and how to get another one when one is lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, TypeVar

from ffsm_mj.errors import InputError, MissingPackageError

Result = TypeVar("Result")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_ANSWER_S = 10
"""A scheduler that does not answer for so long is not there."""


@dataclass(frozen=True)
class Engine:
    """Where runs are made.

    Attributes:
        name: For people.
        workers: How many runs go on at once.
        open: Gives a new executor, and closes it when it is left.
        own_processes: Whether its processes do nothing else, so that a stuck one may be ended.
        lasting: Whether another executor can be had when one is lost.
        here: Whether runs are made by the thread that asks for them, so that an interrupt of one is meant for all.
        ahead: Batches per worker that are handed out at once.
    """

    name: str
    workers: int
    open: Callable[[], Any]
    own_processes: bool = True
    lasting: bool = True
    here: bool = False
    ahead: int = 4


class Loop(Executor):
    """Makes each run at once, in this thread."""

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Call it now; what it raises is in the future, an interrupt comes through."""
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 (the future carries it, as that of any executor)
            future.set_exception(error)
        return future


def loop() -> Engine:
    """Runs one after the other in this process."""
    return Engine("this process", 1, Loop, own_processes=False, here=True, ahead=1)


def pool(workers: int | None = None) -> Engine:
    """Processes of this machine.

    Args:
        workers: How many; None: as many as this process may use processors.
    """
    count = workers or usable_processors()
    return Engine(f"{count} processes", count, lambda: _processes(count))


def usable_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def importable(law: Any) -> bool:
    """Whether a process that knows nothing of this script can have a class of it."""
    module = getattr(law, "__module__", "__main__")
    return module != "__main__" and "<locals>" not in law.__qualname__ and find_spec(module) is not None


def executor(workers: int | None = None) -> Any:
    """Processes of this machine as a context that gives a :class:`concurrent.futures.Executor`."""
    return _processes(workers or usable_processors())


def given(executor: Executor, workers: int | None = None) -> Engine:
    """Somebody's executor, which is theirs to close."""

    @contextmanager
    def same() -> Iterator[Executor]:
        yield executor

    if isinstance(executor, Loop):
        return loop()
    count = workers or getattr(executor, "_max_workers", None) or usable_processors()
    return Engine(type(executor).__name__, int(count), same, own_processes=False, lasting=False)


def dask(address: str) -> Engine:
    """Workers of a dask cluster, one thread each.

    Args:
        address: Of its scheduler, as ``tcp://host:8786``.

    Raises:
        MissingPackageError: ``distributed`` is not installed.
        InputError: Nobody answers there, there are no workers, or one has several threads.
    """
    try:
        import distributed
    except ImportError as error:
        raise MissingPackageError("a campaign on a dask cluster", "distributed", "cluster") from error

    def client() -> Any:
        try:
            client_of: Any = distributed.Client
            return client_of(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"--dask {address}: no scheduler answers there ({error})") from error

    @contextmanager
    def connected() -> Iterator[Executor]:
        with client() as connection:
            # Without pure=False equal calls would be one.
            yield connection.get_executor(pure=False)

    with client() as connection:
        threads = connection.nthreads()
    if not threads:
        raise InputError(f"--dask {address}: the scheduler has no workers; start some: dask worker {address} --nthreads 1")
    several = [name for name, count in threads.items() if count != 1]
    if several:
        raise InputError(
            f"--dask {address}: worker {several[0]} has {threads[several[0]]} threads; start it with --nthreads 1"
        )
    return Engine(f"{len(threads)} dask workers", len(threads), connected)


@contextmanager
def _processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes; left by an exception, it does not wait for runs that nobody wants any more."""
    executor = ProcessPoolExecutor(workers, mp_context=_Spawn(), initializer=_begin_worker)
    try:
        yield executor
    except BaseException:
        for process in multiprocessing.active_children():
            if isinstance(process, _Process):
                process.terminate()
        executor.shutdown(cancel_futures=True)
        raise
    executor.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    """One BLAS thread; Ctrl-C is the driver's to hear; no worker outlives its driver."""
    for variable in _THREADS:
        os.environ.setdefault(variable, "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_driver, name="driver's end", daemon=True).start()


def _end_with_driver() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


_STARTING = threading.Lock()


class _Process(SpawnProcess):
    """A process that does not import the script that is running: it needs nothing of it.

    So a campaign runs from a script without a main guard, from standard input and from a notebook.
    """

    @staticmethod
    def _Popen(process_obj: Any) -> Any:
        with _STARTING:
            main = sys.modules["__main__"]
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                sys.modules["__main__"] = main


class _Spawn(SpawnContext):
    Process = _Process
