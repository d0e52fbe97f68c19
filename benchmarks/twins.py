"""Plain Python or the compiled twins: which of the two a benchmark measures."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from ffsm_mj.compiled import is_compiled

Result = TypeVar("Result")


def plain(row: Callable[[], Result]) -> Result:
    """What a row gives without the compiled twins."""
    with _switched("0"):
        return row()


def compiled(row: Callable[[], Result]) -> Result:
    """What it gives with them."""
    with _switched("1"):
        return row()


def ways() -> dict[str, Callable]:
    """By name, the ways that there are here."""
    return {"plain": plain, "compiled": compiled} if is_compiled() else {"plain": plain}


@contextmanager
def _switched(value: str) -> Iterator[None]:
    before = os.environ.get("FFSM_COMPILED", "1")
    os.environ["FFSM_COMPILED"] = value
    try:
        yield
    finally:
        os.environ["FFSM_COMPILED"] = before
