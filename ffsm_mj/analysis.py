"""A finished run as typed arrays by name. The same object from memory and from the log."""

from __future__ import annotations

from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any

from ffsm_mj.conservation import DEFAULT_TOLERANCE, Law, check_laws
from ffsm_mj.errors import unknown_name
from ffsm_mj.events import ImpactRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.log.mcap_reader import read_log
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.model import FloatArray
from ffsm_mj.run_folder import find_log
from ffsm_mj.summary import summarise, tip_error


class Run:
    """A run. ``run["energy.total_J"]`` is a column, ``run.keys`` lists them, ``run.units`` tells their units.

    Attributes:
        log: Everything that was recorded.
    """

    def __init__(self, log: RunLog) -> None:
        """Wrap a log."""
        self.log = log

    def __getitem__(self, key: str) -> FloatArray:
        """Column of a signal, one value per control tick.

        Raises:
            KeyError: No such signal; the message lists the names.
        """
        layout = self.log.header.layout
        if key not in layout.index:
            raise KeyError(unknown_name("signal", key, layout.keys))
        return self.log.rows[:, layout.index[key]]

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of all columns."""
        return self.log.header.layout.keys

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {signal.key: signal.unit for signal in self.log.header.layout.signals}

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.log.header.scenario_name

    @property
    def time(self) -> FloatArray:
        """Time of each row, s."""
        return self["state.time_s"]

    @property
    def impacts(self) -> tuple[ImpactRecord, ...]:
        """Contacts of all impacts."""
        return self.log.impacts

    @property
    def phases(self) -> tuple[PhaseRecord, ...]:
        """Beginnings of the phases."""
        return self.log.phases

    @property
    def unhandled_contacts(self) -> tuple[UnhandledContactRecord, ...]:
        """Overlaps that nobody resolved."""
        return self.log.unhandled

    @property
    def complete(self) -> bool:
        """Whether the log tells how the run ended."""
        return self.log.outcome is not None

    @property
    def damage(self) -> str:
        """What of the log could not be read, in a sentence; empty where it is whole up to its end."""
        return self.log.damage

    @property
    def outcome(self) -> str:
        """How it ended; ``incomplete`` where the log breaks off."""
        return str(self._summary["outcome"])

    @property
    def message(self) -> str:
        """What there is to say of the outcome."""
        return str(self._summary["message"])

    @property
    def conservative(self) -> bool:
        """Whether nothing in the models breaks conservation."""
        return self.log.header.facts.get("conservative") == "true"

    def laws(self, tolerance: float = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
        """Every conservation law with its worst residual; see :func:`ffsm_mj.conservation.check_laws`."""
        return check_laws(self.log, tolerance)

    def tip_error(self) -> FloatArray:
        """Distance of the tip from its target along the task's axes at every tick, m.

        Raises:
            ValueError: The scenario has no task.
        """
        return tip_error(self.log)

    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``."""
        return deepcopy(self._summary)

    @cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self.log)


def load_run(path: str | Path) -> Run:
    """Read a run from its folder or its ``.mcap`` or ``.mcap.partial`` file.

    Raises:
        InputError: There is no log at that place.
        LogError: The file is no log of a run.
    """
    return Run(read_log(find_log(Path(path))))
