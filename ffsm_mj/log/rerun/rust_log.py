"""What Rerun's SDK says on stderr. It reads ``RUST_LOG`` when it is imported, and never again."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

_VARIABLE = "RUST_LOG"
_ONE_AT_A_TIME = Lock()


@contextmanager
def rust_log(level: str) -> Iterator[None]:
    """Where Rerun is imported in here it says what a level lets pass, or what the user's environment states.

    The environment is afterwards as it was.
    """
    with _ONE_AT_A_TIME:
        if _VARIABLE in os.environ:
            yield
            return
        os.environ[_VARIABLE] = level
        try:
            yield
        finally:
            del os.environ[_VARIABLE]
