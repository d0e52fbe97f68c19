"""Header of a log: everything that is known before the first row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ffsm_mj.records.signals import Layout


@dataclass(frozen=True)
class RunHeader:
    """Metadata needed to interpret the rows of a run, fixed before the first one.

    Attributes:
        scenario_name: Name of the scenario.
        scenario_yaml: The resolved scenario; its MJCF paths are keys of ``files``.
        layout: The columns of a row.
        files: Contents of every model file by its path relative to the scenario.
        metadata: Versions, start time, task target, whether the system is conservative; text by name.
        kinds: Names of the kinds of records of its contact models, in addition to those of every run.
    """

    scenario_name: str
    scenario_yaml: str
    layout: Layout
    files: Mapping[str, bytes]
    metadata: Mapping[str, str]
    kinds: tuple[str, ...] = ()
