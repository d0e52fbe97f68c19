"""Result of a log replay; see :mod:`ffsm_mj.replay`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ffsm_mj.contact_models.impact.limit_record import LimitImpactRecord
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, CheckAccumulator, Tolerance, whole_log_checks
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.independent_checks import IndependentChecks
from ffsm_mj.verification.truncation import TruncationAnalysis


@dataclass(frozen=True)
class ReplayResult:
    """Result of the replay of a log from its states.

    Attributes:
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: Number of recomputed samples.
        numbers: Number of compared values.
        gaps: Where samples are not one control period apart; empty if all are.
        obstacle: Why the log could not be replayed; empty if it was.
        accumulator: Checks from the recomputed values.
        truncation: Result of the analysis of the truncation; None if there was none.
        verified_to_s: Time from which a damaged log does not say enough to be replayed, s; infinite if all of it was.
    """

    worst: Mapping[str, Discrepancy]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    accumulator: CheckAccumulator
    _impacts: tuple[ImpactRecord | LimitImpactRecord, ...]
    _friction: FrictionCheck
    _log: RunLog
    _independent: IndependentChecks
    truncation: TruncationAnalysis | None = None
    verified_to_s: float = math.inf

    @property
    def agrees(self) -> bool:
        """Whether the log agrees with its states; False if it could not be replayed."""
        return not self.obstacle and all(difference.passes for difference in self.worst.values())

    def checks(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """All checks from the recomputed values, or from the logged values if the log could not be replayed.

        Args:
            tolerance: See :func:`ffsm_mj.verification.checks.evaluate_checks`.
        """
        checks = self.accumulator.checks(self._impacts, tolerance, self._friction)
        checks = self.truncation.judged(checks, tolerance) if self.truncation is not None else checks
        checks = (*checks, *whole_log_checks(self._log, tolerance, self._independent))
        # If what the log says of itself may be damaged, a check that fails says nothing of the run.
        return tuple(each for each in checks if each.passes) if self._log.is_doubtful else checks
