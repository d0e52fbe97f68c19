"""Limits BLAS to one thread during a run: for small matrices more threads only cost time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread

from threadpoolctl import ThreadpoolController


class _Limit:
    """Limit for the whole process: set at the first entry, lifted at the last exit.

    threadpoolctl lets only the thread that set a limit lift it, and the last exit may be in another thread: a dedicated
    thread holds the limit.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._modules = Lock(), 0, 0

    def enter(self) -> ThreadpoolController:
        with self._lock:
            if not self._inside:
                if self._modules != len(sys.modules):  # only a module that is imported loads a library
                    self._libraries, self._modules = ThreadpoolController(), len(sys.modules)
                self._over, held = Event(), Event()
                self._holder = Thread(target=self._hold, args=(held,), name="BLAS limit", daemon=True)
                self._holder.start()
                held.wait()
            self._inside += 1
            return self._libraries

    def leave(self) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._over.set()
                self._holder.join()

    def _hold(self, held: Event) -> None:
        with self._libraries.limit(limits=1, user_api="blas"):
            held.set()
            self._over.wait()


_LIMIT = _Limit()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context with one thread for every loaded BLAS; the previous limit is restored at the last exit."""
    libraries = _LIMIT.enter()
    try:
        with libraries.limit(limits=1, user_api="blas"):  # for those that count by thread, as with OpenMP
            yield
    finally:
        _LIMIT.leave()
