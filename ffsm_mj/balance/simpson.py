"""Simpson's rule over a step."""

from __future__ import annotations

from ffsm_mj.arrays import FloatArray


def simpson(start: FloatArray, middle: FloatArray, end: FloatArray, duration_s: float) -> FloatArray:
    """Integral of a rate over a step, in units of the rate times s.

    Args:
        start: Rate at the start.
        middle: Rate at the middle, at the state of :func:`ffsm_mj.balance.midpoint.hermite_midpoint`.
        end: Rate at the end.
        duration_s: Length of the step.
    """
    return duration_s / 6.0 * (start + 4.0 * middle + end)
