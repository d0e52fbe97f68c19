"""Conservation laws checked over a whole run, recomputed from the accounts in its log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.model import FloatArray
from ffsm_mj.signals import COMPONENTS, PARTIES

DEFAULT_TOLERANCE = 1e-9
"""A law holds when its residual stays below this times (1 + scale), in SI units."""


@dataclass(frozen=True)
class Law:
    """One conservation law over one run.

    Attributes:
        name: What is conserved.
        party: ``total``, ``robot`` or ``objects``.
        residual: Worst magnitude of what the ledger leaves unexplained.
        time_s: When that was.
        tolerance: What is allowed: the relative tolerance times (1 + scale).
        unit: Unit of both.
    """

    name: str
    party: str
    residual: float
    time_s: float
    tolerance: float
    unit: str

    @property
    def holds(self) -> bool:
        """Within tolerance; a residual that is not a number is not."""
        return bool(self.residual <= self.tolerance)


def column(log: RunLog, key: str) -> FloatArray:
    """One signal over the run, (n,)."""
    return log.rows[:, log.header.layout.index[key]]


def vector(log: RunLog, prefix: str) -> FloatArray:
    """The six components (P, L) of a momentum or impulse over the run, (n, 6)."""
    start = log.header.layout.index[prefix + COMPONENTS[0]]
    return log.rows[:, start : start + len(COMPONENTS)]


def free_components(log: RunLog, party: str) -> FloatArray:
    """1 for each component of (P, L about the origin) that the party's base joints leave free, else 0, (6,)."""
    text = log.header.facts.get(f"free_components_{party}", "1 1 1 1 1 1")
    return np.array([float(x) for x in text.split()])


def residuals(log: RunLog, party: str) -> tuple[FloatArray, FloatArray]:
    """What the accounts do not explain: energy (n,) in J and momentum (n, 6) in N s and N m s."""
    external, contact = vector(log, "ledger.external_"), vector(log, "ledger.contact_")
    booked = {"total": external, "robot": external - contact, "objects": contact}[party]
    work = 0.0 if party == "objects" else column(log, "ledger.work_J")
    energy, momentum = column(log, f"energy.{party}_J"), vector(log, f"momentum.{party}_")
    energy_residual = energy - energy[:1] - work - column(log, f"ledger.{party}_impact_energy_J")
    return energy_residual, (momentum - momentum[:1] - booked) * free_components(log, party)


def check_laws(log: RunLog, tolerance: float = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
    """Every conservation law with its worst residual.

    Args:
        log: A run with at least one row.
        tolerance: A residual may reach this times (1 + largest magnitude of the quantity in the run).
    """
    if not len(log.rows):
        return ()
    laws = []
    for party in PARTIES:
        energy, momentum = residuals(log, party)
        values = vector(log, f"momentum.{party}_")
        laws += [
            _law(log, "energy", party, "J", energy, column(log, f"energy.{party}_J"), tolerance),
            _law(log, "linear momentum", party, "N s", momentum[:, :3], values[:, :3], tolerance),
            _law(log, "angular momentum", party, "N m s", momentum[:, 3:], values[:, 3:], tolerance),
        ]
    # Paper, Fig. 9b: the FFSM's momentum from its mass matrix, and body by body.
    bodies = vector(log, "momentum.robot_")
    difference = (vector(log, "momentum.robot_by_mass_matrix_") - bodies) * free_components(log, "robot")
    laws.append(_law(log, "momentum two ways", "robot", "SI", difference, bodies, tolerance))
    return tuple(laws)


def _law(log: RunLog, name: str, party: str, unit: str, residual: FloatArray, values: FloatArray, tolerance: float) -> Law:
    size, scale = _magnitude(residual), _magnitude(values)
    worst = int(np.argmax(np.where(np.isnan(size), np.inf, size)))
    time = float(column(log, "state.time_s")[worst])
    return Law(name, party, float(size[worst]), time, tolerance * (1.0 + float(np.max(scale))), unit)


def _magnitude(values: FloatArray) -> FloatArray:
    return np.abs(values) if values.ndim == 1 else np.asarray(np.linalg.norm(values, axis=1))
