"""Result of a check: its worst residual and what is allowed."""

from __future__ import annotations

from dataclasses import dataclass

from ffsm_mj.verification.truncation import Truncation


@dataclass(frozen=True)
class Check:
    """Result of one check over one run.

    Attributes:
        name: Name of the check.
        subsystem: ``total``, ``robot`` or ``objects``.
        component: Component of the worst residual, such as ``T``, ``P_x`` to ``L_z``, ``gap`` or ``impact 1``.
        residual: Largest magnitude of the residual in a stretch of the run.
        time_s: Time of the largest residual.
        tolerance: Allowed magnitude: the relative tolerance times (1 + scale).
        unit: Unit of both.
        drift: Largest magnitude since the first sample; equals ``residual`` in a run of one stretch.
        truncation: Share of truncation in a residual that is too large; None if it was not computed or is unknown.
    """

    name: str
    subsystem: str
    component: str
    residual: float
    time_s: float
    tolerance: float
    unit: str
    drift: float
    truncation: Truncation | None = None

    @property
    def fails_by_truncation(self) -> bool:
        """Whether it fails by the truncation of the step alone: it passes with a shorter step or ``accuracy``."""
        return not self.passes and self.truncation is not None and self.truncation.alone

    @property
    def passes(self) -> bool:
        """Whether the residual is within the tolerance; a residual that is not a number fails."""
        return bool(self.residual <= self.tolerance)
