"""What every destination of a run understands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ffsm_mj.events import Event, OutcomeRecord
from ffsm_mj.model import FloatArray
from ffsm_mj.signals import Layout


@dataclass(frozen=True)
class RunHeader:
    """All that must be known to make sense of the rows, fixed before the first one.

    Attributes:
        scenario_name: Name of the scenario.
        scenario_yaml: The resolved scenario; its MJCF paths are keys of ``files``.
        layout: The columns of a row.
        files: Content of every model file by its path relative to the scenario.
        facts: Versions, start time, task target, whether the system is conservative; text, for people and ``analysis``.
    """

    scenario_name: str
    scenario_yaml: str
    layout: Layout
    files: Mapping[str, bytes]
    facts: Mapping[str, str]


class Sink(Protocol):
    """A destination. Calls come in order: ``open``, then ``rows`` and ``event`` as they happen, then ``close``."""

    def open(self, header: RunHeader) -> None:
        """Begin a run."""

    def rows(self, block: FloatArray) -> None:
        """Take rows, (n, number of signals); the array is reused afterwards."""

    def event(self, event: Event) -> None:
        """Take an event; all earlier rows have been handed over."""

    def flush(self) -> None:
        """Make everything taken so far survive a kill."""

    def close(self, outcome: OutcomeRecord | None) -> None:
        """End the run; ``None`` when its end is not known (an error outside the simulation)."""
