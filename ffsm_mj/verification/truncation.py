"""Share of truncation error in a failing check; it decreases with the fourth power of the step."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Truncation:
    """The residual of a check at the step of the run and at shorter ones, from the same logged states.

    Attributes:
        step_s: Step of the run.
        residual: Residual at that step, in the unit of the check.
        half: The same at half the step.
        left: Residual without truncation.
        alone: Whether truncation alone makes the check fail: without it, it passes.
    """

    step_s: float
    residual: float
    half: float
    left: float
    alone: bool

    def sentence(self, unit: str) -> str:
        """Text such as ``truncation: 6e-09 J at 5 ms, 4e-10 J at 2.5 ms``."""
        step, half = f"{1e3 * self.step_s:g} ms", f"{0.5e3 * self.step_s:g} ms"
        head = "truncation" if self.alone else "not truncation alone"
        rest = "" if self.alone else f", {self.left:.1e} {unit} without"
        return f"{head}: {self.residual:.1e} {unit} at {step}, {self.half:.1e} {unit} at {half}{rest}"
