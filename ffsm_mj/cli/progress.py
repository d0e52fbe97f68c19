"""Progress of a command: a line on a terminal; of many runs also lines on stderr where it is none."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from ffsm_mj.errors import plural

Report = Callable[[float, float], None]
"""Callback (amount done, total amount), called as often as convenient."""
Stage = Callable[..., Report | None]
"""Begins a stage; see :meth:`Progress.stage`."""
_LINE_EVERY_S = 30.0


class Progress:
    """Progress of a command, in stages; this one is not displayed."""

    def stage(self, name: str, unit: str = "", total: float | None = None) -> Report | None:  # noqa: ARG002
        """Begin the next stage.

        Args:
            name: Name of the stage.
            unit: Unit of the reported amounts: ``s``, or what is counted.
            total: Total amount, if it is known in advance.

        Returns:
            Callback for the progress of the stage; None if progress is not displayed.
        """
        return None

    def hidden(self) -> AbstractContextManager[None]:
        """Hide the display while something else is printed."""
        return nullcontext()


def lines_of_runs(name: str, complain: Callable[[str], None]) -> Report:
    """Callback that prints a line every 30 s: runs done, rate and remaining time since its first call."""
    begun = time.monotonic()
    first, due = None, begun + _LINE_EVERY_S

    def report(done: float, total: float) -> None:
        nonlocal first, due
        now = time.monotonic()
        first = done if first is None else first
        if now < due or done >= total:
            return
        due = now + _LINE_EVERY_S
        per_s = (done - first) / (now - begun)
        left = f", {(total - done) / per_s / 60.0:.0f} min left" if per_s > 0.0 else ""
        complain(f"{name}: {done:.0f} of {plural(round(total), 'run')}, {per_s * 60.0:.0f} a minute{left}")

    return report
