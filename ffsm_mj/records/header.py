"""What must be known of a run before its first row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ffsm_mj.records.signals import Layout


@dataclass(frozen=True)
class RunHeader:
    """All that must be known to make sense of the rows, fixed before the first one.

    Attributes:
        scenario_name: Name of the scenario.
        scenario_yaml: The resolved scenario; its MJCF paths are keys of ``files``.
        layout: The columns of a row.
        files: Content of every model file by its path relative to the scenario.
        facts: Versions, start time, task target, whether the system is conservative; text, for people and ``analysis``.
        kinds: Names of the kinds of records that it may leave beyond those of every run: what its contact models leave.
    """

    scenario_name: str
    scenario_yaml: str
    layout: Layout
    files: Mapping[str, bytes]
    facts: Mapping[str, str]
    kinds: tuple[str, ...] = ()
