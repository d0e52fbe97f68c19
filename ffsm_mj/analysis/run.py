"""A finished run as typed arrays by name, from memory or from its log."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.analysis.comparison import Comparison, compare_logs
from ffsm_mj.analysis.contact_intervals import ContactInterval
from ffsm_mj.analysis.digest import Digest, digest
from ffsm_mj.analysis.grasp_intervals import GraspInterval
from ffsm_mj.analysis.summary import failing_checks, summarise, tip_error
from ffsm_mj.analysis.tables import Table, table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import unknown_name
from ffsm_mj.records.events import ImpactRecord, Outcome, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.metadata import is_conservative, why_not_conservative
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Check, Tolerance
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.refined import Refined, explained, refined


class Run:
    """A run. ``run["energy.total_J"]`` is a column; ``run.keys`` lists them, with ``units`` and ``descriptions``.

    Attributes:
        log: Contents of the log.
        path: Path of the log file, absolute if the run was read or written here; None for a run in memory.
    """

    def __init__(self, log: RunLog, path: Path | None = None, digested: Digest | None = None) -> None:
        """Wrap a log.

        Args:
            log: Contents of the log.
            path: Path of the log file.
            digested: Digest of its rows, if it exists already; None: computed on demand.
        """
        self.log, self.path, self._given = log, path, digested

    def __getitem__(self, key: str) -> FloatArray:
        """Column of a signal, one value per control tick.

        Raises:
            KeyError: No such signal; the message lists the names.
        """
        layout = self.log.header.layout
        if key not in layout.index:
            raise KeyError(unknown_name("signal", key, layout.keys))
        return self.log.column(key)

    def _ipython_key_completions_(self) -> list[str]:
        """Names of all columns: IPython and Jupyter complete ``run["`` with them."""
        return list(self.keys)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of all columns."""
        return self.log.header.layout.keys

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {signal.key: signal.unit for signal in self.log.header.layout.signals}

    @property
    def descriptions(self) -> dict[str, str]:
        """Meaning of each column."""
        return {signal.key: signal.description for signal in self.log.header.layout.signals}

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.log.header.scenario_name

    @property
    def time(self) -> FloatArray:
        """Time of each row, s."""
        return self["state.time_s"]

    @property
    def qpos(self) -> FloatArray:
        """Generalised coordinates in MuJoCo's order, (n, nq)."""
        return self._columns("state.q_")

    @property
    def qvel(self) -> FloatArray:
        """Generalised velocities in MuJoCo's order, (n, nv)."""
        return self._columns("state.v_")

    @property
    def tip(self) -> FloatArray:
        """Position of the tip in m, world frame, (n, 3).

        Raises:
            KeyError: The scenario has no task and so no tip.
        """
        return np.column_stack([self[f"state.tip_{axis}_m"] for axis in "xyz"])

    @property
    def tip_velocity(self) -> FloatArray:
        """Velocity of the tip in m/s, world frame, (n, 3).

        Raises:
            KeyError: The scenario has no task and so no tip.
        """
        return np.column_stack([self[f"state.tip_v{axis}_m_s"] for axis in "xyz"])

    def momentum(self, subsystem: str = "total") -> FloatArray:
        """(P in N s, L about the world origin in N m s) of ``total``, ``robot`` or ``objects``, (n, 6).

        Raises:
            KeyError: No such subsystem.
        """
        if subsystem not in SUBSYSTEMS:
            raise KeyError(unknown_name("subsystem", subsystem, SUBSYSTEMS))
        return self._columns(f"momentum.{subsystem}_P_", f"momentum.{subsystem}_L_")

    def _columns(self, *prefixes: str) -> FloatArray:
        return np.asarray(self.log.rows[:, [i for i, key in enumerate(self.keys) if key.startswith(prefixes)]])

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

        If a check of energy or momenta fails, the run is replayed with shorter steps: ``check.truncation`` is the residual
        that remains, ``check.fails_by_truncation`` whether the step alone makes it fail.
        """
        checks = self.digest.check_accumulator.checks(self.log.impact_records, tolerance, self._friction)
        return explained(checks, tolerance, lambda: self._refined)

    @cached_property
    def _refined(self) -> Refined | None:
        return (
            refined(self.log) if self.outcome != Outcome.INTERRUPTED else None
        )  # do not delay an interrupted run by a replay

    @cached_property
    def _friction(self) -> FrictionCheck:
        return FrictionCheck(self.log)

    @property
    def digested(self) -> bool:
        """Whether the digest exists; if not, it costs one pass over the rows."""
        return self._given is not None or "digest" in self.__dict__

    @cached_property
    def digest(self) -> Digest:
        """Digest of the rows for checks and summary, computed in one pass."""
        return self._given or digest(self.log)

    def table(self, name: str = "samples") -> Table:
        """A table of named columns with units: ``samples``, ``contacts``, ``checks``, or records of a kind, as ``impacts``.

        Raises:
            KeyError: No such table.
        """
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
            checks: Include ``checks``, for which a run with failed checks is replayed.
        """
        summary = deepcopy(self._summary)
        return summary | {"checks": failing_checks(self.checks())} if checks else summary

    @cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self.log, self.digest)


def compare(a: Run, b: Run) -> Comparison:
    """Compare two runs: scenario, models, impacts, and every signal at their common times."""
    return compare_logs(a.log, b.log)
