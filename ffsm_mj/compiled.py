"""Compilation of the hottest floating-point functions where numba is installed (the ``fast`` extra), and not otherwise.

The same source runs either way, with the same operations in the same order: results agree to the last bit.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

COMPILED = os.environ.get("FFSM_COMPILED", "1") != "0" and find_spec("numba") is not None
"""Whether functions are compiled: numba is installed and the environment does not say ``FFSM_COMPILED=0``."""


def compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A function of floats and tuples of floats, compiled at its first call (and kept on disk) where numba is installed."""
    if not COMPILED:
        return function
    from numba import njit  # a second to import: only where it was asked for

    fast: Callable[Arguments, Result] = njit(cache=True)(function)
    return fast
