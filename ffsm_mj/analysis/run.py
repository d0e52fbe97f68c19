"""A finished run as typed arrays by name, from memory or from its log; comparison of two."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsm_mj.analysis.digest import Digest, digest
from ffsm_mj.analysis.effort import Effort
from ffsm_mj.analysis.intervals import ContactInterval, GraspInterval
from ffsm_mj.analysis.summary import card_html, card_text, missing, summarise, tip_error
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, LogError, unknown_name
from ffsm_mj.log.mcap.reader import KEPT_BYTES, read_log
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.metadata import is_conservative, why_not_conservative
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import SUBSYSTEMS
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance
from ffsm_mj.verification.impact_checks import Models
from ffsm_mj.verification.model_checks import ModelChecks

if TYPE_CHECKING:
    from ffsm_mj.analysis.comparison import Comparison
    from ffsm_mj.analysis.tables import Table


class ModelResults:
    """What is computed with the models of a run, once, when it is first asked for.

    The models are those that the run was simulated with in this process; otherwise those in its log are compiled.
    """

    def __init__(self, log: RunLog, compiled: Models | None = None, effort: Effort | None = None) -> None:
        """Bind to a run.

        Args:
            log: Its log.
            compiled: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
            effort: Effort in all of its rows; None: computed from those in the log.
        """
        self._log, self._compiled, self._accumulated = log, compiled, effort
        self._checks: ModelChecks | None = None

    def all_checks(self, digest: Digest, tolerance: Tolerance) -> tuple[Check, ...]:
        """Results of all checks of the run.

        Args:
            digest: Digest of its rows, the same at each call.
            tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        if self._checks is None:
            self._checks = ModelChecks(self._log, digest.kept, self._compiled)
        return self._checks.all_checks(digest.check_accumulator, tolerance)

    @cached_property
    def system(self) -> System | None:
        """Its compiled models; None if the log has none, or they no longer compile."""
        try:
            return self._compiled()[0] if self._compiled is not None else compile_log(self._log)
        except (InputError, KeyError):
            return None

    @cached_property
    def effort(self) -> dict[str, Any]:
        """``effort``, ``base_rotation`` and ``angular_momentum`` of ``summary.json``.

        Each is None if the log lacks its columns or its models.
        """
        if self._accumulated is not None:
            return self._accumulated.summary()
        missing: dict[str, Any] = {"effort": None, "base_rotation": None, "angular_momentum": None}
        if self.system is None:
            return missing
        computed = Effort(self.system)
        try:
            computed.open(self._log.header)
        except (InputError, KeyError):  # a part of the columns
            return missing
        for block in self._log.blocks():
            computed.rows(block)
        for event in self._log.events:
            computed.event(event)
        return computed.summary()


class Run:
    """What a log says: ``run["energy.total_J"]`` is a column; ``run.keys`` lists them, with ``units`` and ``descriptions``.

    Figures, films, sensitivities, and all that needs the models or another simulation, are functions of a run: see
    :mod:`ffsm_mj`.

    Attributes:
        log: Contents of the log.
        path: Path of the log file, absolute if the run was read or written here; None for a run in memory.
        models: What is computed with its models, for the functions that need them: see :mod:`ffsm_mj.analysis.run_models`.
    """

    def __init__(
        self, log: RunLog, path: Path | None = None, digest: Digest | None = None, models: ModelResults | None = None
    ) -> None:
        """Wrap a log.

        Args:
            log: Contents of the log.
            path: Path of the log file.
            digest: Digest of its rows, if it exists already; None: computed on demand.
            models: What is computed with its models; None: the models are taken from the log.
        """
        self.log, self.path, self.models = log, path, models or ModelResults(log)
        if digest is not None:
            self.__dict__["digest"] = digest  # the cached property below

    def __repr__(self) -> str:
        """Scenario, outcome, impacts, persistent contacts, the check closest to its tolerance, and the tip."""
        return card_text(self.log, *self._known())

    def _repr_html_(self) -> str:
        return card_html(self.log, *self._known())

    def _known(self) -> tuple[Digest | None, tuple[Check, ...]]:
        """Digest and checks if they are known, or quick to compute from few rows."""
        try:
            if self.has_digest or 8 * len(self.log.rows) * len(self.keys) <= KEPT_BYTES:
                with np.errstate(all="ignore"):  # a log may hold any double
                    return self.digest, self.checks()
        except (LogError, OSError):  # the file is gone; the summary of a run in memory must not fail
            pass
        return None, ()

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

    def with_rows(self, rows: FloatArray) -> Run:
        """The run with a part of its rows, (n, number of signals); checks and summary are those of the whole run."""
        return Run(replace(self.log, rows=rows), self.path, self.digest, self.models)

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
    def grasps(self) -> tuple[GraspInterval, ...]:
        """Grasps, each from closing to release."""
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
    def missing(self) -> str:
        """Damage or incompleteness of the log in one line; empty if it is complete."""
        return missing(self.log)

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
        """Results of the checks of rows and records, with their worst residuals: arithmetic on what is logged.

        Checks that need the models, and whether checks of energy, momenta or heat fail by the truncation of the step alone,
        are found by :func:`ffsm_mj.explain`, which simulates again: ``check.fails_by_truncation`` is None in a check that
        fails here, if that is in question.

        Args:
            tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        return self.digest.check_accumulator.checks(self.log.impact_records, tolerance)

    @property
    def has_digest(self) -> bool:
        """Whether the digest exists; if not, it costs one pass over the rows."""
        return "digest" in self.__dict__

    @cached_property
    def digest(self) -> Digest:
        """Digest of the rows for checks and summary, computed in one pass."""
        return digest(self.log)

    def table(self, name: str = "samples") -> Table:
        """A table of named columns with units: ``samples``, ``contacts``, ``grasps``, ``checks``, or records by kind.

        Raises:
            KeyError: No such table.
        """
        from ffsm_mj.analysis.tables import CHECKS_TABLE, checks_table, table

        return checks_table(self.checks()) if name == CHECKS_TABLE else table(self.log, name, lambda: self.digest)

    def to_pandas(self, name: str = "samples") -> Any:
        """A table (see :meth:`table`) as a ``pandas.DataFrame``; units and descriptions are in its ``attrs``."""
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

    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` says of the log; :func:`ffsm_mj.summary` adds what needs the models: checks and effort."""
        return deepcopy(self._summary)

    @cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self.log, self.digest)


def compare(a: Run, b: Run) -> Comparison:
    """Compare two runs: scenario, models, impacts, and every signal at their common times."""
    from ffsm_mj.analysis.comparison import compare_logs

    return compare_logs(a.log, b.log)


def load_run(path: str | Path) -> Run:
    """Read a run from its folder or its ``.mcap`` or ``.mcap.partial`` file.

    Raises:
        InputError: There is no log at that path.
        LogError: The file is not the log of a run.
    """
    log = find_log(Path(path))
    return Run(read_log(log), log.absolute())
