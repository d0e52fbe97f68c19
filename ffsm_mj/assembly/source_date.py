"""``SOURCE_DATE_EPOCH``, as reproducible builds have it: the same run gives the same log, byte for byte.

Where it is set, a log says it was created then, wall times in it are 0, and it is flushed by rows, not by the clock.
"""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta

from ffsm_mj.errors import InputError

VARIABLE = "SOURCE_DATE_EPOCH"


def source_date() -> datetime | None:
    """The time that the environment states, UTC; None where it states none.

    Raises:
        InputError: It is no whole number of seconds since 1970, or beyond the year 9999.
    """
    text = os.environ.get(VARIABLE, "")
    if not text:
        return None
    try:
        if text.isascii() and text.isdigit():
            return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=int(text))
    except (OverflowError, ValueError):  # ValueError: more digits than Python turns into a number
        pass
    raise InputError(f"{VARIABLE}={text}: must be a whole number of seconds since 1970, at most to the year 9999")
