"""The current folder, which may be a stranger's, is on no module path of a process that is started here."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

_SAFE_PATH = "PYTHONSAFEPATH"


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Start no Python process in this context that imports modules from the current folder.

    ``python -c``, with which :mod:`multiprocessing` starts its processes and :mod:`mujoco` looks for a library, has the
    current folder first on its path, and ``multiprocessing`` copies the path of this process, in which an empty entry means
    the current folder.
    """
    before, path = os.environ.get(_SAFE_PATH), sys.path[:]
    os.environ[_SAFE_PATH] = "1"
    sys.path[:] = [entry for entry in path if entry]
    try:
        yield
    finally:
        sys.path[:] = path
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


def importable_elsewhere(module: str) -> bool:
    """Whether a process that was started here can import a module: not one that the empty entry of the path leads to."""
    top = find_spec(module.partition(".")[0])
    if top is None:
        return False
    files = [os.path.dirname(folder) for folder in top.submodule_search_locations or ()]
    files += [os.path.dirname(top.origin)] if not files and top.origin else []
    entries = {os.path.realpath(entry) for entry in sys.path if entry}
    current = os.path.realpath(os.getcwd())
    return current in entries or not any(os.path.realpath(folder) == current for folder in files)
