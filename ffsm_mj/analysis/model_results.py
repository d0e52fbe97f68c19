"""What is computed from a log with its models: effort and momenta, and checks by the equations of motion."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from ffsm_mj.analysis.digest import Digest
from ffsm_mj.analysis.effort import Effort
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import Tolerance
from ffsm_mj.verification.impact_checks import Models
from ffsm_mj.verification.model_checks import ModelChecks


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
            tolerance: See :func:`ffsm_mj.verification.checks.evaluate_checks`.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        if self._checks is None:
            self._checks = ModelChecks(self._log, digest.kept, self._compiled, self._stack_momentum)
        return self._checks.all_checks(digest.check_accumulator, tolerance)

    @cached_property
    def effort(self) -> dict[str, Any]:
        """``effort``, ``base_rotation`` and ``angular_momentum`` of ``summary.json``.

        Each is None if the log lacks its columns or its models.
        """
        if self._accumulated is not None:
            return self._accumulated.summary()
        try:
            found = Effort(compile_log(self._log))
            found.open(self._log.header)
        except (InputError, KeyError):  # models that no longer compile, or a part of the columns
            return {"effort": None, "base_rotation": None, "angular_momentum": None}
        for block in self._log.blocks():
            found.rows(block)
        for event in self._log.events():
            found.event(event)
        return found.summary()

    def _stack_momentum(self) -> float:
        """Angular momentum of robot and grasped object at the end without the wheels, N m s; NaN if it is unknown."""
        found = self.effort["angular_momentum"]
        return math.nan if found is None else float(found["stack_without_wheels_N_m_s"])
