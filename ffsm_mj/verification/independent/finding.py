"""What an independent check finds: its worst residual, with the scale of the numbers that cancel in it; tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ffsm_mj.tolerances import CHECK_TOLERANCE

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """Worst residual of one check over a run.

    Attributes:
        name: Name of the check.
        component: Where the residual is: a sensor, a grasp, an impact.
        residual: Its magnitude; infinite if a number is none.
        scale: Largest magnitude of the numbers that cancel in it, in the same unit.
        time_s: Its time.
        unit: Unit of both.
    """

    name: str
    component: str
    residual: float
    scale: float
    time_s: float
    unit: str


class Worst:
    """Keeps the residual that is largest relative to 1 + its scale.

    Attributes:
        finding: It; None before the first one.
    """

    def __init__(self, name: str) -> None:
        """Start without residuals of a check."""
        self._name, self._share = name, -1.0
        self.finding: Finding | None = None

    def add(self, component: str, residual: Any, scale: Any, time_s: float, unit: str) -> None:
        """Process the residual of a vector or a number, of the same unit in all its components.

        Args:
            component: Where it is.
            residual: Numbers that should be zero.
            scale: Numbers that cancel in them.
            time_s: Time.
            unit: Unit.
        """
        size, of = (float(np.max(np.abs(part), initial=0.0)) for part in (residual, scale))
        size, of = (size if math.isfinite(size) else math.inf), (of if math.isfinite(of) else 0.0)
        if (share := size / (1.0 + of)) > self._share:
            self._share = share
            self.finding = Finding(self._name, component, size, of, time_s, unit)

    @property
    def findings(self) -> list[Finding]:
        """The finding as a list; empty if there was nothing to check."""
        return [] if self.finding is None else [self.finding]


RESTITUTION_USED = "restitution used"
"""The coefficient of restitution of an impact is that of the rule that names its geoms, or 0 where the rest rule applies."""
HEAT_OF_FRICTION = "heat of friction"
"""The heat of friction is that of sliding at all rules plus that of the impacts, and it does not fall."""
GRASP_LOAD = "grasp load"
"""The load is the rate of momentum of what is grasped, at the row's own state and efforts, less its other forces."""
SENSOR_VALUES = "sensor values"
"""A true value is that of the sensor at the state of the row at the time of its sample."""
SENSOR_TIMES = "sensor times"
"""A row shows the newest sample that has arrived at its time."""
SENSOR_NOISE = "sensor noise"
"""A measured value is the true one with the errors that the scenario states, noise drawn again from its own channel."""
GRASP_TWIST = "grasp twist"
"""After a grasp closes, the relative twist at the object's site is zero in the directions that the latch stops."""
GRASP_IMPULSE = "grasp impulse"
"""The velocities change by the impulse at the object's site, and by those of other closed grasps."""
EQUALITIES = "equality constraints"
"""Impacts and grasps change no rate of an equality constraint."""
GRASP_BOUNDS = "grasp bounds"
"""A grasp closes as soon as its bounds hold; no row is nearer than the closest approach of a near miss."""
CONTACT_GEOMETRY = "contact geometry"
"""Normal and point of an impact are those of the nearest points of both geoms, moved apart along the normal."""
SEVERAL_CONTACTS = "restitution of several contacts"
"""Contacts that meet at one instant, with equal e and without further reflections, separate by (1 + e) plastic impulses."""
FIELD_IMPULSE = "field impulse"
"""Impulses of orbit and uniform fields are integrals of the forces that the scenario states, at the states of rows."""

TOLERANCES = {
    # The coefficient is copied from the scenario: a difference is none or one of coefficients.
    RESTITUTION_USED: 1e-12,
    # A sum of as many terms as the run has steps: in 1e6 steps 1e-10 of the heat.
    HEAT_OF_FRICTION: CHECK_TOLERANCE,
    # Solutions with mass matrices of condition 1e4, known to 1e-12, at states that satisfy the rows of the latch to 1e-11.
    GRASP_LOAD: CHECK_TOLERANCE,
    # Rounding of kinematics, 1e-15; while a grasp is closed that of coordinates which come from those of another model, and
    # for forces that of accelerations, as above.
    SENSOR_VALUES: CHECK_TOLERANCE,
    # Times are sums and products of numbers of up to 1e4 s, known to 1e-12 s.
    SENSOR_TIMES: CHECK_TOLERANCE,
    # A few operations on logged numbers, each with a rounding of 1e-16; walks of biases add up a thousand of them and more.
    SENSOR_NOISE: 1e-12,
    # An impulse is the solution of equations with the mass matrix, as a load is.
    GRASP_TWIST: CHECK_TOLERANCE,
    GRASP_IMPULSE: CHECK_TOLERANCE,
    # As a latch that is closed.
    EQUALITIES: CHECK_TOLERANCE,
    # The instant is a root, known to 1e-14 s, and ratios to bounds change by up to 1e4 a second.
    GRASP_BOUNDS: CHECK_TOLERANCE,
    # Nearest points of ellipsoids and meshes are found to a distance of a few 1e-10 m, which is a few 1e-6 m along a surface
    # with a radius of 0.1 m: over the 0.1 m by which geoms are moved apart an angle of some 1e-5.
    CONTACT_GEOMETRY: 1e-4,
    # As the check "impact restitution": speeds are known to some 1e-13.
    SEVERAL_CONTACTS: CHECK_TOLERANCE,
    # As the checks of energy and momenta, into which these enter; what the quadrature may miss is subtracted.
    FIELD_IMPULSE: CHECK_TOLERANCE,
}
"""Tolerance of each check: allowed is this times (1 + scale), where the scale is that of the numbers that cancel."""
