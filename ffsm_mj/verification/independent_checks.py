"""Independent checks of a log as checks of a run: see :mod:`ffsm_mj.verification.independent`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.independent.kept_rows import KeptRows

if TYPE_CHECKING:
    from ffsm_mj.verification.independent.finding import Finding

Models = Callable[[], tuple[System, Mapping[str, Any]]]
"""Returns the compiled models of a run, without a closed grasp, and its scenario as plain data."""


class IndependentChecks:
    """Checks of one log by other physics than the engine's; computed once, when they are first asked for."""

    def __init__(self, log: RunLog, kept: KeptRows, models: Models | None = None) -> None:
        """Bind to a log.

        Args:
            log: The log, of which metadata and records suffice.
            kept: Its kept rows.
            models: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
        """
        self._log, self._kept = log, kept
        self._models = models or (lambda: (compile_log(log), scenario_data(log)))

    @cached_property
    def _findings(self) -> list[Finding]:
        from ffsm_mj.verification.independent.findings import independent_findings

        if not self._has_anything():
            return []
        try:
            return independent_findings(self._log, self._kept, *self._models())
        except InputError:  # the log has no models, or they no longer compile
            return []

    def checks(self, allowed: Mapping[str, float]) -> list[Check]:
        """Results; ``allowed`` has the tolerance of each, relative to 1 + the scale of its residual."""
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

    def _has_anything(self) -> bool:
        """Whether there is anything to check so; models are not compiled for nothing."""
        columns = ("sensor.", "contact.capture_", "balance.friction_heat")
        return bool(self._log.impact_records) or any(key.startswith(columns) for key in self._kept.layout.keys)
