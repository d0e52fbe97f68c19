"""Checks of a run that need its models: impacts with friction, the independent checks, the state at the end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, CheckAccumulator, Tolerance, tolerances
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.independent.kept_rows import KeptRows
from ffsm_mj.verification.terminal_check import terminal_checks

if TYPE_CHECKING:
    from ffsm_mj.verification.independent.finding import Finding

Models = Callable[[], tuple[System, Mapping[str, Any]]]
"""Returns the compiled models of a run, without a closed grasp, and its scenario as plain data."""


class ModelChecks:
    """Checks of one log with its models; these are compiled, and the checks computed, when they are first asked for."""

    def __init__(
        self,
        log: RunLog,
        kept: KeptRows,
        models: Models | None = None,
        stack_momentum: Callable[[], float] | None = None,
    ) -> None:
        """Bind to a log.

        Args:
            log: The log, of which metadata and records suffice.
            kept: Its kept rows.
            models: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
            stack_momentum: See :func:`~ffsm_mj.verification.terminal_check.terminal_checks`.
        """
        self._log, self._kept, self._stack_momentum = log, kept, stack_momentum
        self._models = models or partial(_logged_models, log)
        self._friction = FrictionCheck(log)

    def all_checks(self, rows: CheckAccumulator, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """Results of all checks: those of the rows and records, and those that need the models.

        Args:
            rows: Checks of the rows.
            tolerance: See :func:`ffsm_mj.verification.checks.evaluate_checks`.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        allowed, named = tolerances(tolerance), tolerance if isinstance(tolerance, Mapping) else {}
        of_rows = rows.checks(self._log.impact_records, tolerance, self._friction)
        return (*of_rows, *self._independent(allowed), *terminal_checks(self._log, named, self._stack_momentum))

    def _independent(self, allowed: Mapping[str, float]) -> list[Check]:
        """Checks by other physics than the engine's: see :mod:`ffsm_mj.verification.independent`."""
        return [
            Check(
                name=each.name,
                subsystem="total",
                component=each.component,
                residual=each.residual,
                time_s=each.time_s,
                tolerance=allowed[each.name] * (1.0 + each.scale),
                unit=each.unit,
                drift=each.residual,
            )
            for each in self._findings
        ]

    @cached_property
    def _findings(self) -> list[Finding]:
        from ffsm_mj.verification.independent.findings import independent_findings

        if not self._has_anything():
            return []
        try:
            return independent_findings(self._log, self._kept, *self._models())
        except InputError:  # the log has no models, or they no longer compile
            return []

    def _has_anything(self) -> bool:
        """Whether there is anything to check so; models are not compiled for nothing."""
        columns = ("sensor.", "contact.grasp_", "balance.friction_heat")
        return bool(self._log.impact_records) or any(key.startswith(columns) for key in self._kept.layout.keys)


def _logged_models(log: RunLog) -> tuple[System, Mapping[str, Any]]:
    """The models in a log, compiled, and its scenario.

    Raises:
        InputError: It has none, or they do not compile.
    """
    return compile_log(log), scenario_data(log)
