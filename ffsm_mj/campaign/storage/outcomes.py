"""How a run of a campaign may end beside the outcomes of any run: it could not be made."""

from __future__ import annotations

ERROR, TIMEOUT, CRASHED = "error", "timeout", "crashed"
"""Something was raised; it took too long; the process that made it ended."""
RETRIED = (ERROR, CRASHED, TIMEOUT)
"""What another try may change."""
