"""Checks of a run, evaluated from the balances and impacts in its log in one pass over the rows.

Tolerances. P, L and T less work are constants of the exact motion, so errors of steps neither grow nor decay: after N steps
the residual is the sum of N step errors. A check is therefore a bound on the step error, independent of the length of the
run. The error of one step is below rounding, so it is bounded over 100 000 steps: in every window of 100 000 steps the
residual may change by 1e-9 (1 + scale), which is 1e-14 of the scale per step. For a run of one window (100 s at 1 ms) this
is a bound on the residual itself; a run of K windows may drift K times as far, and a sudden error is found in any window.

The scale is the largest magnitude, up to the end of the window, of the terms that cancel in the quantity: each of them has
a rounding error of 1e-16 relative to itself. For T it is the largest of T and the accumulated work, impact energy and work
of gravity; for P the sum of |P| of robot and objects, or an accumulated impulse; for L about the origin |L| + r |P|, where
r is the norm of all coordinates that are lengths, which bounds the terms r x m v. The lever arm is needed for two reasons: L
is spin plus r x P, and an error d of P is an error r d of L. A run that drifts away, or has another origin, thus passes the
same checks. While an object is grasped, the change of its energy and momentum is subtracted in the robot's balance: these
terms cancel there too, and the step error of both bodies' motion appears in the robot's residual.

With joint springs, elastic energy and the heat of dampers count with T. RK4 takes (h w)^6 / 72 of the energy of a mode w in
each step h. The sum of that is logged, and an energy that is lower by at most this sum has no residual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.records import LimitImpactRecord
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.load_columns import logged_load_columns
from ffsm_mj.records.metadata import free_components, is_conservative
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import (
    LIMIT_FORCES,
    LIMIT_OVERRUN,
    OVERLAP,
    PROJECTED,
    SUBSYSTEMS,
    Layout,
    momentum_keys,
)
from ffsm_mj.tolerances import CHECK_TOLERANCE, CONTACT_GAP_M
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.impact_checks import FrictionCheck, impact_checks
from ffsm_mj.verification.independent.finding import TOLERANCES as INDEPENDENT_TOLERANCES
from ffsm_mj.verification.residuals import BalanceColumns, HeatCheck, JacobiCheck, Peak, ResidualDrift, drift_window_s

DEFAULT_TOLERANCE = CHECK_TOLERANCE
"""A check passes if its residual is at most this times (1 + scale), in SI units."""
DEEPEST_M = CONTACT_GAP_M
"""Greatest allowed penetration of a pair of the contact rules, m, and travel of a joint past its limit, rad or m."""
PROJECTED_TOLERANCE = 1e-6
"""Tolerance of the energy that one projection of the state changes, times (1 + energy).

What drifts in one step of a length that resolves the motion is less by far: 1e-8 of the energy in steps of 20 ms of a
linkage that turns at 4 rad/s. A projection onto rows that depend on each other but for the rounding of their numbers takes
4e-3 of the energy.
"""
FORCE_TOLERANCE = 1e-8
"""Tolerance of the complementarity residual of contact forces, times (1 N + force)."""

TERMINAL_CHECKS = {
    "stack_momentum_N_m_s": ("stack momentum at the end", "L"),
    "base_rate_rad_s": ("base rate at the end", "base"),
    "base_speed_m_s": ("base speed at the end", "base"),
    "relative_rate_rad_s": ("relative rate at the end", "object"),
}
"""Checks of the last state by key of the section ``terminal`` of a scenario: name and component."""
RELATIVE_CHECKS = (
    *("energy", "linear momentum", "angular momentum", "momentum two ways"),
    *("impact energy", "impact restitution", "heat of sliding", "Jacobi integral"),
)
"""Checks with a tolerance relative to a scale; those of impacts only in runs with impacts, the heat with friction in
persistent contact, the last one in a circular orbit."""
CHECK_NAMES = (
    *RELATIVE_CHECKS,
    *("no penetration", "no joint past its limit", "contact complementarity", "energy of projections"),
    *INDEPENDENT_TOLERANCES,
    *(name for name, _ in TERMINAL_CHECKS.values()),
)
"""All checks. ``no penetration``, with a tolerance in m, if the log has the depth; ``no joint past its limit``, in rad or m,
in runs with joint limits; ``contact complementarity`` of a replay, with persistent contact; ``energy of projections`` where
a state was projected; then the independent checks, in runs with what they check; the last ones where the scenario asks."""

Tolerance = float | Mapping[str, float]
"""One tolerance for all relative checks, or tolerances by check; other checks keep the default."""

_OVERLAP = f"balance.{OVERLAP}"
_OVERRUN = {unit: f"balance.{name}" for unit, name in LIMIT_OVERRUN.items()}
_DEFAULTS = {
    "no penetration": DEEPEST_M,
    "no joint past its limit": DEEPEST_M,
    "contact complementarity": FORCE_TOLERANCE,
    "energy of projections": PROJECTED_TOLERANCE,
    **INDEPENDENT_TOLERANCES,
}
"""Tolerances of checks that are not relative."""
_AXES = ("P_x", "P_y", "P_z", "L_x", "L_y", "L_z")
_MEASURES = {
    "energy": ("J", ("T",)),
    "linear momentum": ("N s", _AXES[:3]),
    "angular momentum": ("N m s", _AXES[3:]),
    "momentum two ways": ("SI", _AXES),
    "no penetration": ("m", ("gap",)),
    "no joint past its limit": ("rad or m", ("joint",)),
    "contact complementarity": ("N", ("force",)),
    "energy of projections": ("J", ("T",)),
    "heat of sliding": ("J", ("work", "fall")),
    "Jacobi integral": ("J", ("J",)),
}

RESIDUALS = (
    *(
        (name, subsystem, component)
        for subsystem in SUBSYSTEMS
        for name in CHECK_NAMES[:3]
        for component in _MEASURES[name][1]
    ),
    ("heat of sliding", "total", "work"),
)
"""Check, subsystem and component of each residual that truncation changes: energy, P and L of each subsystem, and heat."""


class CheckAccumulator:
    """Evaluates the checks of a run from blocks of rows, without storing them.

    Attributes:
        layout: Columns of the rows.
        samples: Rows so far.
        last: The last one; None before the first.
        has_contact_forces: Whether a row has a force of persistent contact or a joint limit; a replay checks these.
    """

    def __init__(self, layout: Layout, metadata: Mapping[str, str]) -> None:
        """Find the columns of the checks."""
        self.layout, self.samples = layout, 0
        self.last: FloatArray | None = None
        self._conservative = is_conservative(metadata)
        self._accounts = {subsystem: BalanceColumns(layout, metadata, subsystem) for subsystem in SUBSYSTEMS}
        self._changes = {
            (subsystem, name): ResidualDrift(drift_window_s(metadata))
            for subsystem in SUBSYSTEMS
            for name in CHECK_NAMES[:3]
        }
        self._bodies, self._matrix = (layout.places(momentum_keys(way)) for way in ("robot", "robot_by_mass_matrix"))
        self._free, self._two_ways = free_components(metadata, "robot"), Peak()
        self._overlap, self._deepest = layout.index.get(_OVERLAP), Peak()
        self._overruns, self._past = [layout.index[key] for key in _OVERRUN.values() if key in layout.index], Peak()
        self._complementarity, self.has_contact_forces = Peak(), False
        of_pairs = [key.removesuffix("_mode") + "_force_N" for key in layout.keys if key.endswith("_mode")]
        of_limits = [key for key in layout.keys if key.endswith(LIMIT_FORCES) and key.startswith("contact.")]
        self._forces = layout.places((*of_pairs, *of_limits))
        of_projections = [f"balance.{PROJECTED.format(what)}" for what in ("contacts", "loops")]
        self._projections = [layout.index[key] for key in of_projections if key in layout.index]
        self._projected = Peak()
        self._heat, self._jacobi = HeatCheck(layout, drift_window_s(metadata)), JacobiCheck(layout, metadata)
        self._grasps = [layout.index[columns.closed] for columns in logged_load_columns(layout)]

    def rows(self, block: FloatArray, added: FloatArray | None = None, forces_apart: FloatArray | None = None) -> None:
        """Process the next rows.

        Args:
            block: Rows, (n, columns).
            added: What these rows have more of each of ``RESIDUALS``, (n, number of residuals).
            forces_apart: Differences of the logged contact forces from those that a replay finds, N, (n,); None: they are
                not known, and ``contact complementarity`` is not checked.
        """
        increments = np.zeros((len(block), len(RESIDUALS))) if added is None else added
        more = increments[:, :-1].reshape(len(block), len(SUBSYSTEMS), -1)
        self.samples += len(block)
        if len(block):
            self.last = block[-1].copy()
        times = block[:, self.layout.time]
        scales = {subsystem: accounts.scales(block) for subsystem, accounts in self._accounts.items()}
        if self._grasps:
            # What the robot gives to a grasped object enters the balance as the change of the object's energy and momentum.
            scales["robot"] += scales["objects"] * np.any(block[:, self._grasps] > 0.0, axis=1, keepdims=True)
        for i, (subsystem, accounts) in enumerate(self._accounts.items()):
            residual, (of_energy, linear, angular) = accounts.energy(block) + more[:, i, 0], scales[subsystem].T
            momentum = accounts.momentum(block) + more[:, i, 1:]
            self._changes[subsystem, "energy"].add(times, residual[:, None], of_energy, accounts.truncation(block))
            self._changes[subsystem, "linear momentum"].add(times, momentum[:, :3], linear)
            self._changes[subsystem, "angular momentum"].add(times, momentum[:, 3:], angular)
        robot = self._accounts["robot"]
        difference = (block[:, self._matrix] - block[:, self._bodies]) * self._free
        self._two_ways.add(times, difference, robot.linear_scale(block) + robot.angular_scale(block))
        if self._overlap is not None:
            self._deepest.add(times, block[:, [self._overlap]], np.zeros(len(block)))
        if self._overruns:
            self._past.add(times, block[:, self._overruns].max(axis=1, keepdims=True), np.zeros(len(block)))
        self.has_contact_forces |= bool(block[:, self._forces].any())
        if forces_apart is not None and len(self._forces):
            self._complementarity.add(times, forces_apart[:, None], np.abs(block[:, self._forces]).max(axis=1))
        if self._projections:
            self._projected.add(times, block[:, self._projections].max(axis=1, keepdims=True), scales["total"][:, 0])
        self._heat.rows(block, increments[:, -1])
        self._jacobi.rows(block)

    def checks(
        self,
        impacts: Sequence[ImpactRecord | LimitImpactRecord],
        tolerance: Tolerance = DEFAULT_TOLERANCE,
        friction: FrictionCheck | None = None,
    ) -> tuple[Check, ...]:
        """Results of the checks of the rows and records of a run, with the worst residual of each; empty without rows.

        They are arithmetic: those that need the models are added by
        :class:`ffsm_mj.verification.model_checks.ModelChecks`. If the scenario is not conservative, conservation is not
        checked; impacts and penetration are.

        Args:
            impacts: Records of the impacts of the run, in order: contacts and joints at their limits.
            tolerance: See :func:`tolerances`.
            friction: Checks impacts with friction by the models; None: they are checked by their records alone.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        allowed = tolerances(tolerance)
        if not self.samples:
            return ()
        checks: list[Check] = []
        if self._conservative:
            for (subsystem, name), change in self._changes.items():
                checks.append(_check(name, subsystem, change.worst, allowed, change.drift))
            # Paper, Fig. 9b: the FFSM's momentum from its mass matrix, and body by body.
            checks.append(_check("momentum two ways", "robot", self._two_ways, allowed))
        if self._overlap is not None:
            checks.append(_check("no penetration", "total", self._deepest, allowed))
        if self._overruns:
            checks.append(_check("no joint past its limit", "total", self._past, allowed))
        if self._complementarity.scale > 0.0 or self._complementarity.size > 0.0:
            checks.append(_check("contact complementarity", "total", self._complementarity, allowed))
        if self._projected.size > 0.0:
            checks.append(_check("energy of projections", "total", self._projected, allowed))
        if (heat := self._heat.worst) is not None:
            checks.append(_check("heat of sliding", "total", heat, allowed, self._heat.drift))
        if (jacobi := self._jacobi.worst) is not None:
            checks.append(_check("Jacobi integral", "total", jacobi[0], allowed, jacobi[1]))
        return (*checks, *impact_checks(impacts, allowed, friction))


def accumulate_checks(log: RunLog) -> CheckAccumulator:
    """Process all rows of a log."""
    seen = CheckAccumulator(log.header.layout, log.header.metadata)
    for block in log.blocks():
        seen.rows(block)
    return seen


def tolerances(tolerance: Tolerance) -> dict[str, float]:
    """The tolerance of each check.

    Args:
        tolerance: Allowed residual over (1 + scale); for ``no penetration`` a depth in m, by name only.

    Raises:
        KeyError: A tolerance for an unknown check.
    """
    if not isinstance(tolerance, Mapping):
        return dict.fromkeys(RELATIVE_CHECKS, tolerance) | _DEFAULTS
    for name in tolerance:
        if name not in CHECK_NAMES:
            raise KeyError(f"unknown check {name!r}; there are {', '.join(CHECK_NAMES)}")
    return dict.fromkeys(CHECK_NAMES, DEFAULT_TOLERANCE) | _DEFAULTS | dict(tolerance)


def _check(name: str, subsystem: str, worst: Peak, allowed: Mapping[str, float], drift: float | None = None) -> Check:
    unit, components = _MEASURES[name]
    limit = allowed[name] * (1.0 + worst.scale)
    drift = worst.size if drift is None else drift
    return Check(name, subsystem, components[worst.component], worst.size, worst.time_s, limit, unit, drift)
