"""BLAS kept to one thread while anything runs: the matrices here are tiny, a second thread only spins."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread

from threadpoolctl import ThreadpoolController


class _Limit:
    """The limit for the whole process: set by the first one in, lifted by the last one out.

    threadpoolctl lets only the thread that has set a limit lift it, and the last one out may be another: a thread that does
    nothing else holds it.
    """

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def enter(self) -> ThreadpoolController:
        with self._lock:
            if not self._inside:
                self._libraries, self._over, held = ThreadpoolController(), Event(), Event()
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
    """One thread for every BLAS that is loaded; afterwards, when no other thread is in here, as many as before."""
    libraries = _LIMIT.enter()
    try:
        with libraries.limit(limits=1, user_api="blas"):  # for those that count by thread, as with OpenMP
            yield
    finally:
        _LIMIT.leave()
