"""Independent computations on all cores, by processes that end with the one that wants them."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import active_children
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_ENDING = (signal.SIGINT, signal.SIGTERM)


def on_all_cores(
    function: Callable[[_Item], _Result], items: Sequence[_Item], report: Callable[[int, int], None] | None = None
) -> list[_Result]:
    """Results of a function of a module for some items, in their order; begun in this order, so the longest stands first.

    What ends this early ends the processes.

    Args:
        function: The function.
        items: Its arguments.
        report: Told how many of how many are done.
    """
    tell = report or (lambda *_: None)
    tell(0, len(items))
    others = set(active_children())
    with ProcessPoolExecutor(os.cpu_count(), initializer=_left_to_the_parent) as pool:
        try:
            with _signals_wait():  # a worker that is being made when one comes would be nobody's
                running = [pool.submit(function, item) for item in items]
            for done, _ in enumerate(as_completed(running), 1):
                tell(done, len(items))
        except BaseException:
            end_at_once(pool, set(active_children()) - others)
            raise
    return [future.result() for future in running]


def end_at_once(pool: ProcessPoolExecutor, workers: Iterable[BaseProcess]) -> None:
    """Kill the workers of a pool, whatever they are doing, and wait for its thread.

    They are not terminated: a run takes SIGTERM for its own end, and its worker would begin the next one, or wait for ever
    for a lock that another one held when it ended.
    """
    for worker in workers:
        worker.kill()
    # One that was sending a result sends no more of it: the pool's thread, which reads, is told so by the end of the pipe,
    # which does not come while this process could write to it as well.
    results: Any = getattr(pool, "_result_queue")  # noqa: B009 (not public; see tests/test_all_cores.py)
    results._writer.close()
    pool.shutdown(cancel_futures=True)  # waits: the interpreter's exit must not meet the pool's thread still closing


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Ctrl-C and SIGTERM come after this; processes begun here hold them back too, until they say otherwise."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _left_to_the_parent() -> None:
    """Ctrl-C on a terminal reaches the workers too: what it means is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
