"""Control laws of tests: one that does nothing, which others extend by what they do."""

from __future__ import annotations

from typing import Any


class Law:
    """A control law that does nothing and reports nothing."""

    telemetry_signals = ()

    def __init__(self, *_: Any) -> None:
        pass

    start = control = telemetry = lambda *_: ()
