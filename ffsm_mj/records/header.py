"""Header of a log: everything that is known before the first row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ffsm_mj.cached_property import cached_property
from ffsm_mj.records.signals import Layout
from ffsm_mj.yaml import write_yaml


@dataclass(frozen=True)
class RunHeader:
    """Metadata needed to interpret the rows of a run, fixed before the first one.

    Attributes:
        scenario_name: Name of the scenario.
        scenario: The resolved scenario, as plain data or as YAML text; its MJCF paths are keys of ``files``.
        layout: The columns of a row.
        files: Contents of every model file by its path relative to the scenario.
        metadata: Versions, start time, task target, whether the system is conservative; text by name.
        kinds: Names of the kinds of records of its contact models, in addition to those of every run.
    """

    scenario_name: str
    scenario: Mapping[str, Any] | str
    layout: Layout
    files: Mapping[str, bytes]
    metadata: Mapping[str, str]
    kinds: tuple[str, ...] = ()

    @cached_property
    def scenario_yaml(self) -> str:
        """The resolved scenario as YAML text. Of a run in memory it takes a third of the time of a short run to write."""
        return self.scenario if isinstance(self.scenario, str) else write_yaml(self.scenario)
