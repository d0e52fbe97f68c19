"""Compilation of MuJoCo specs: errors reach the caller as exceptions only."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import Any

_REDIRECTED = Lock()
"""Descriptors belong to the process: of two threads that redirect one, the second would keep and restore the null device."""


def compile_spec(spec: Any, vfs: Any) -> Any:
    """Compile a spec without output of the libraries that MuJoCo uses.

    Qhull prints a page to the process's standard error for a mesh that is flat, before MuJoCo raises an exception that says
    the same.

    Args:
        spec: MuJoCo spec.
        vfs: MuJoCo's virtual files.

    Raises:
        ValueError: The spec does not compile; the other exceptions of ``MjSpec.compile`` likewise.
    """
    with _REDIRECTED, _standard_error_discarded():
        return spec.compile(vfs=vfs)


@contextmanager
def _standard_error_discarded() -> Iterator[None]:
    """Redirect descriptor 2 to the null device; no effect if it is closed."""
    with suppress(AttributeError, OSError, ValueError):
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)
