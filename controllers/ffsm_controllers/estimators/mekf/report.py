"""What the filter reports of every call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_controllers.estimators.mekf.estimate import Estimate
from ffsm_controllers.estimators.mekf.layout import Layout
from ffsm_controllers.estimators.mekf.update import Innovation
from ffsm_mj.controller_protocol import FloatArray, Signal, identifier

_GROUP = "estimate"
_OF_BODY = (
    *((f"q_{{}}_{axis}_m", "m") for axis in "xyz"),
    *((f"q_{{}}_turn_{axis}_rad", "rad") for axis in "xyz"),
    *((f"v_{{}}_v{axis}_m_s", "m/s") for axis in "xyz"),
    *((f"v_{{}}_w{axis}_rad_s", "rad/s") for axis in "xyz"),
)
"""Names of the components of the error of a body, as those of ``estimate.error_*``."""


def report_signals(layout: Layout) -> tuple[Signal, ...]:
    """Signals of the report."""
    sigmas = [
        Signal(_GROUP, "sigma_" + name.format(identifier(body.joint)), unit, "1-sigma of the error that the filter expects")
        for body in layout.bodies
        for name, unit in _OF_BODY
    ]
    gyros = [f"{identifier(bias.sensor)}_{axis}_rad_s" for bias in layout.biases for axis in "xyz"]
    return (
        Signal(_GROUP, "nis", "", "normalised innovation squared, summed over the samples that were new; NaN without any"),
        Signal(_GROUP, "nis_dof", "", "its degrees of freedom: three for each sample"),
        Signal(_GROUP, "rejected", "", "new samples that did not pass the gate"),
        *sigmas,
        *(Signal(_GROUP, f"bias_{name}", "rad/s", "estimated bias of a gyro") for name in gyros),
        *(Signal(_GROUP, f"sigma_bias_{name}", "rad/s", "1-sigma of its error that the filter expects") for name in gyros),
    )


def report_values(estimate: Estimate, innovations: Sequence[Innovation]) -> FloatArray:
    """Values of the signals."""
    sigmas = np.sqrt(np.maximum(np.diagonal(estimate.covariance), 0.0))
    used = [innovation.nis for innovation in innovations if innovation.used]
    bodies = 12 * len(estimate.layout.bodies)
    counts = (sum(used) if used else np.nan, 3.0 * len(used), float(len(innovations) - len(used)))
    return np.concatenate((counts, sigmas[:bodies], estimate.biases, sigmas[bodies:]))
