"""What the states of a log say, where it was recomputed from them; see :mod:`ffsm_mj.recount`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ffsm_mj.analysis.agreement import Difference
from ffsm_mj.analysis.friction_check import FrictionCheck
from ffsm_mj.analysis.refined import Refined, explained
from ffsm_mj.analysis.verdicts import DEFAULT_TOLERANCE, Audit, Law, Tolerance
from ffsm_mj.records.events import ImpactRecord


@dataclass(frozen=True)
class Recount:
    """What the states of a log say.

    Attributes:
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: How many samples were recomputed.
        numbers: How many numbers were compared.
        gaps: Where samples do not follow each other by the control period; empty where they all do.
        obstacle: Why nothing could be recomputed; empty where it was.
        audit: The laws by what the states say.
    """

    worst: Mapping[str, Difference]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    audit: Audit
    _impacts: tuple[ImpactRecord, ...]
    _friction: FrictionCheck
    _refined: Callable[[], Refined | None] = lambda: None

    @property
    def agrees(self) -> bool:
        """Whether the log says what its states say; False where nothing could be recomputed."""
        return not self.obstacle and all(difference.holds for difference in self.worst.values())

    def laws(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
        """Every law by what the states say, or by what the log says where nothing could be recomputed.

        Args:
            tolerance: See :func:`ffsm_mj.analysis.verdicts.check_laws`.
        """
        return explained(self.audit.laws(self._impacts, tolerance, self._friction), tolerance, self._refined)
