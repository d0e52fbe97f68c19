"""``SOURCE_DATE_EPOCH``, as for reproducible builds: the same run then gives the same log, byte for byte.

If it is set, it is the creation time of logs, wall times are 0, and logs are flushed by rows instead of by the clock.
"""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta

from ffsm_mj.errors import InputError

VARIABLE = "SOURCE_DATE_EPOCH"


def source_date() -> datetime | None:
    """Time in the environment variable, UTC; None if it is not set.

    Raises:
        InputError: It is not an integer number of seconds since 1970, or beyond the year 9999.
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
