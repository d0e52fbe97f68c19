"""Outcomes of campaign runs that gave no result, in addition to the outcomes of runs."""

from __future__ import annotations

ERROR, TIMEOUT, CRASHED = "error", "timeout", "crashed"
"""An exception was raised; the run exceeded its wall time; its process ended."""
RETRIED = (ERROR, CRASHED, TIMEOUT)
"""Outcomes that a repetition may change."""
