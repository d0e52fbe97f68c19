"""Log record of an unexpected exception that ends a run."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from traceback import format_exception

from ffsm_mj.errors import described, raised_in
from ffsm_mj.records.events import InternalErrorRecord

_LONGEST_TRACEBACK = 20_000
_PACKAGE = Path(__file__).parents[1]


def internal_error(error: BaseException, time_s: float, step: int) -> InternalErrorRecord:
    """Describe an exception for the log.

    Args:
        error: The exception, as it was caught.
        time_s: Simulation time.
        step: Integration step, from 0.
    """
    text = "".join(format_exception(error))[-_LONGEST_TRACEBACK:]
    return InternalErrorRecord(time_s, step, described(error), _raised_in(error), _relative(text))


def _raised_in(error: BaseException) -> str:
    """File, line and function of :func:`ffsm_mj.errors.raised_in`."""
    frame = raised_in(error)
    if frame is None:
        return "unknown"
    place = Path(frame.filename)
    return f"{place.relative_to(_PACKAGE) if _PACKAGE in place.parents else place.name}:{frame.lineno} in {frame.name}"


def _relative(text: str) -> str:
    """A traceback with paths relative to ``sys.path``: logs must not contain folders of this machine."""
    for folder in sorted(filter(None, map(os.path.abspath, sys.path)), key=len, reverse=True):
        text = text.replace(f'File "{folder}{os.sep}', 'File "')
    return text
