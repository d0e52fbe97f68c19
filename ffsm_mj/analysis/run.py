"""A finished run as typed arrays by name, from memory or from its log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ffsm_mj.analysis.comparison import Comparison, compare_logs
from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.digest import Digest, digest
from ffsm_mj.analysis.effort import Effort
from ffsm_mj.analysis.grasp_intervals import GraspInterval
from ffsm_mj.analysis.logged_signals import LoggedSignals
from ffsm_mj.analysis.summary import failing_checks, summarise, tip_error
from ffsm_mj.analysis.tables import MOMENTUM_TABLE, Table, momentum_table, table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.events import ImpactRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.metadata import is_conservative, why_not_conservative
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance, whole_log_checks
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.independent_checks import IndependentChecks, Models
from ffsm_mj.verification.truncation import TruncationAnalysis


class Run(LoggedSignals):
    """A run. ``run["energy.total_J"]`` is a column; ``run.keys`` lists them, with ``units`` and ``descriptions``.

    Attributes:
        log: Contents of the log.
        path: Path of the log file, absolute if the run was read or written here; None for a run in memory.
        truncation: Result of the analysis of the truncation; None if there was none.
    """

    def __init__(
        self,
        log: RunLog,
        path: Path | None = None,
        digested: Digest | None = None,
        effort: Effort | None = None,
        models: Models | None = None,
    ) -> None:
        """Wrap a log.

        Args:
            log: Contents of the log.
            path: Path of the log file.
            digested: Digest of its rows, if it exists already; None: computed on demand.
            effort: Effort in its rows, likewise.
            models: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
        """
        super().__init__(log)
        self.path, self._given, self._accumulated, self._models = path, digested, effort, models
        self._whole: Run | None = None
        self.truncation: TruncationAnalysis | None = None

    def with_rows(self, rows: FloatArray) -> Run:
        """The run with a part of its rows, (n, number of signals); checks and summary are those of the whole run."""
        part = Run(replace(self.log, rows=rows), self.path, self.digest, models=self._models)
        part._whole, part.truncation = self, self.truncation
        return part

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.log.header.scenario_name

    @property
    def records(self) -> Mapping[str, tuple[Any, ...]]:
        """Event records in order: ``impacts``, ``phases``, ``unhandled_contacts`` and those of contact models."""
        return self.log.records

    @property
    def impacts(self) -> tuple[ImpactRecord, ...]:
        """Contacts of all impacts."""
        return self.log.impacts

    @property
    def contacts(self) -> tuple[ContactInterval, ...]:
        """Intervals of persistent contact."""
        return self.digest.contacts.intervals()

    @property
    def captures(self) -> tuple[GraspInterval, ...]:
        """Grasps, each from capture to release."""
        return self.digest.grasps.intervals()

    @property
    def phases(self) -> tuple[PhaseRecord, ...]:
        """Beginnings of the phases."""
        return self.log.phases

    @property
    def unhandled_contacts(self) -> tuple[UnhandledContactRecord, ...]:
        """Overlaps of geoms that are neither of a contact rule nor ignored."""
        return self.log.unhandled

    @property
    def complete(self) -> bool:
        """Whether the log has the outcome of the run."""
        return self.log.outcome is not None

    @property
    def damage(self) -> str:
        """What of the log could not be read, as text; empty if it is intact up to its end."""
        return self.log.damage

    @property
    def note(self) -> str:
        """What of the log was skipped because its schema is unknown, as text; empty if nothing was."""
        return self.log.note

    @property
    def outcome(self) -> str:
        """Outcome of the run; ``incomplete`` if the log has none."""
        return str(self._summary["outcome"])

    @property
    def message(self) -> str:
        """Details of the outcome."""
        return str(self._summary["message"])

    @property
    def conservative(self) -> bool:
        """Whether nothing in the models breaks conservation."""
        return is_conservative(self.log.header.metadata)

    @property
    def why_not_conservative(self) -> str:
        """What in the models breaks conservation; empty if nothing does."""
        return why_not_conservative(self.log.header.metadata)

    def checks(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """Results of all checks with their worst residuals; see :func:`ffsm_mj.verification.checks.evaluate_checks`.

        This is arithmetic on the rows: nothing is simulated again. Whether a check of energy, momenta or heat fails by the
        truncation of the step alone is known once ``analyze_truncation`` has found it; until then
        ``check.fails_by_truncation`` is None.
        """
        checks = self.digest.check_accumulator.checks(self.log.impact_records, tolerance, self._friction)
        judged = self.truncation.judged(checks, tolerance) if self.truncation is not None else checks
        return (*judged, *whole_log_checks(self.log, tolerance, self._independent, self._stack_momentum))

    def _stack_momentum(self) -> float:
        """Angular momentum of robot and grasped object at the end without the wheels, N m s; NaN if it is unknown."""
        found = self._effort["angular_momentum"]
        return math.nan if found is None else float(found["stack_without_wheels_N_m_s"])

    @cached_property
    def _friction(self) -> FrictionCheck:
        return FrictionCheck(self.log)

    @cached_property
    def _independent(self) -> IndependentChecks:
        return IndependentChecks(self.log, self.digest.kept, self._models)

    @property
    def digested(self) -> bool:
        """Whether the digest exists; if not, it costs one pass over the rows."""
        return self._given is not None or "digest" in self.__dict__

    @cached_property
    def digest(self) -> Digest:
        """Digest of the rows for checks and summary, computed in one pass."""
        return self._given or digest(self.log)

    def table(self, name: str = "samples") -> Table:
        """A table of named columns with units: ``samples``, ``contacts``, ``angular_momentum``, ``checks``, or records.

        Raises:
            KeyError: No such table.
        """
        if name == MOMENTUM_TABLE:
            return momentum_table(self.angular_momentum)
        return table(self.log, name)

    def to_pandas(self, name: str = "samples") -> Any:
        """A table (see :meth:`table`) as a ``pandas.DataFrame``; units and descriptions are in its ``attrs``.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        return self.table(name).to_pandas()

    def to_polars(self, name: str = "samples") -> Any:
        """A table (see :meth:`table`) as a ``polars.DataFrame``.

        Raises:
            MissingPackageError: polars is not installed.
        """
        return self.table(name).to_polars()

    def tip_error(self) -> FloatArray:
        """Distance of the tip from its target along the task's axes at every tick, m.

        Raises:
            ValueError: The scenario has no task.
        """
        return tip_error(self.log)

    def summary(self, *, checks: bool = True) -> dict[str, Any]:
        """Content of ``summary.json``.

        Args:
            checks: Include ``checks``, and ``effort``, ``base_rotation`` and ``angular_momentum``, for which the models of a
                log are compiled.
        """
        summary = deepcopy(self._summary)
        if not checks:
            return summary
        return summary | deepcopy(self._effort) | {"checks": failing_checks(self.checks())}

    @property
    def effort(self) -> dict[str, dict[str, float | None]] | None:
        """Effort by actuator, under its name in the columns; None if the log lacks its columns or its models.

        ``integral_u2`` (N^2 s or (N m)^2 s), ``work_J``, ``peak`` (N or N m) and ``at_bound``, the share of the ticks at
        which the applied effort is at a bound: see :data:`ffsm_mj.analysis.effort.MEASURES`.
        """
        found: dict[str, dict[str, float | None]] | None = deepcopy(self._effort["effort"])
        return found

    @property
    def base_rotation(self) -> dict[str, float] | None:
        """Angle from the first orientation of the base, ``final_rad`` and ``largest_rad``; None: see ``effort``."""
        found: dict[str, float] | None = deepcopy(self._effort["base_rotation"])
        return found

    @property
    def angular_momentum(self) -> dict[str, Any] | None:
        """Angular momentum before and after by subsystem and body, and what each actuator took; None: see ``effort``.

        About the centre of mass of everything that moves, world axes, N m s; the table ``angular_momentum`` has the same
        numbers. See :class:`ffsm_mj.analysis.momentum_exchange.MomentumExchange`.
        """
        found: dict[str, Any] | None = deepcopy(self._effort["angular_momentum"])
        return found

    @cached_property
    def _effort(self) -> dict[str, Any]:
        if self._whole is not None:
            return self._whole._effort
        if self._accumulated is not None:
            return self._accumulated.summary()
        try:
            found = Effort(compile_log(self.log))
            found.open(self.log.header)
        except (InputError, KeyError):  # models that no longer compile, or a part of the columns
            return {"effort": None, "base_rotation": None, "angular_momentum": None}
        for block in self.log.blocks():
            found.rows(block)
        for event in self.log.events():
            found.event(event)
        return found.summary()

    @cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self.log, self.digest)


def compare(a: Run, b: Run) -> Comparison:
    """Compare two runs: scenario, models, impacts, and every signal at their common times."""
    return compare_logs(a.log, b.log)
