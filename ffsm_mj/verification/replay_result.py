"""Result of a log replay; see :mod:`ffsm_mj.replay`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, CheckAccumulator, Tolerance
from ffsm_mj.verification.model_checks import ModelChecks


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
        verified_to_s: Time from which a damaged log does not say enough to be replayed, s; infinite if all of it was.
    """

    worst: Mapping[str, Discrepancy]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    accumulator: CheckAccumulator
    _log: RunLog
    _models: ModelChecks
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
        checks = self._models.all_checks(self.accumulator, tolerance)
        # If what the log says of itself may be damaged, a check that fails says nothing of the run.
        return tuple(each for each in checks if each.passes) if self._log.is_doubtful else checks
