"""What the states of a log say, where it was recomputed from them; see :mod:`ffsm_mj.replay`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Check, CheckAccumulator, Tolerance
from ffsm_mj.verification.friction_check import FrictionCheck
from ffsm_mj.verification.refined import Refined, explained


@dataclass(frozen=True)
class ReplayResult:
    """What the states of a log say.

    Attributes:
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: How many samples were recomputed.
        numbers: How many numbers were compared.
        gaps: Where samples do not follow each other by the control period; empty where they all do.
        obstacle: Why nothing could be recomputed; empty where it was.
        audit: The checks by what the states say.
    """

    worst: Mapping[str, Discrepancy]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    audit: CheckAccumulator
    _impacts: tuple[ImpactRecord, ...]
    _friction: FrictionCheck
    _refined: Callable[[], Refined | None] = lambda: None

    @property
    def agrees(self) -> bool:
        """Whether the log says what its states say; False where nothing could be recomputed."""
        return not self.obstacle and all(difference.passes for difference in self.worst.values())

    def checks(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """Every check by what the states say, or by what the log says where nothing could be recomputed.

        Args:
            tolerance: See :func:`ffsm_mj.verification.checks.evaluate_checks`.
        """
        return explained(self.audit.checks(self._impacts, tolerance, self._friction), tolerance, self._refined)
