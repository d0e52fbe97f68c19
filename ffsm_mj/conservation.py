"""Conservation laws checked over a whole run, recomputed from the accounts and the impacts in its log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ffsm_mj.events import ImpactRecord
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.model import FloatArray
from ffsm_mj.signals import COMPONENTS, PARTIES

DEFAULT_TOLERANCE = 1e-9
"""A law holds when its residual stays below this times (1 + scale), in SI units."""

LAW_NAMES = ("energy", "linear momentum", "angular momentum", "momentum two ways", "impact energy", "impact restitution")
"""What is checked. The last two only where something was hit."""

Tolerance = float | Mapping[str, float]
"""One tolerance for all laws, or some laws' own by name; those not named keep the default."""

_AXES = ("P_x", "P_y", "P_z", "L_x", "L_y", "L_z")


@dataclass(frozen=True)
class Law:
    """One conservation law over one run.

    Attributes:
        name: What is conserved.
        party: ``total``, ``robot`` or ``objects``.
        component: Where the residual is worst: ``T``, ``P_x`` to ``L_z``, or ``impact 1``.
        residual: Worst magnitude of what the ledger leaves unexplained.
        time_s: When that was.
        tolerance: What is allowed: the relative tolerance times (1 + scale).
        unit: Unit of both.
    """

    name: str
    party: str
    component: str
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
    energy_residual = energy - work - column(log, f"ledger.{party}_impact_energy_J")
    momentum_residual = (momentum - booked) * free_components(log, party)
    # Since the first sample that there is: the accounts begin at t = 0, a damaged log may not.
    return energy_residual - energy_residual[:1], momentum_residual - momentum_residual[:1]


def check_laws(log: RunLog, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
    """Every conservation law with its worst residual; none for a log without rows.

    Args:
        log: A run.
        tolerance: A residual may reach this times (1 + largest magnitude of the quantity in the run).

    Raises:
        KeyError: A tolerance for a law that there is not.
    """
    if not len(log.rows):
        return ()
    allowed = _tolerances(tolerance)
    laws = []
    for party in PARTIES:
        energy, momentum = residuals(log, party)
        values = vector(log, f"momentum.{party}_")
        kinetic = column(log, f"energy.{party}_J")[:, None]
        laws += [
            _law(log, "energy", party, "J", energy[:, None], kinetic, allowed, ("T",)),
            _law(log, "linear momentum", party, "N s", momentum[:, :3], values[:, :3], allowed, _AXES[:3]),
            _law(log, "angular momentum", party, "N m s", momentum[:, 3:], values[:, 3:], allowed, _AXES[3:]),
        ]
    # Paper, Fig. 9b: the FFSM's momentum from its mass matrix, and body by body.
    bodies = vector(log, "momentum.robot_")
    difference = (vector(log, "momentum.robot_by_mass_matrix_") - bodies) * free_components(log, "robot")
    laws.append(_law(log, "momentum two ways", "robot", "SI", difference, bodies, allowed, _AXES))
    return (*laws, *_impact_laws(log, allowed))


def _tolerances(tolerance: Tolerance) -> dict[str, float]:
    if not isinstance(tolerance, Mapping):
        return dict.fromkeys(LAW_NAMES, tolerance)
    for name in tolerance:
        if name not in LAW_NAMES:
            raise KeyError(f"no law is called {name!r}; there are {', '.join(LAW_NAMES)}")
    return dict.fromkeys(LAW_NAMES, DEFAULT_TOLERANCE) | dict(tolerance)


def _law(
    log: RunLog,
    name: str,
    party: str,
    unit: str,
    residual: FloatArray,
    values: FloatArray,
    allowed: Mapping[str, float],
    components: tuple[str, ...],
) -> Law:
    """Worst of the norms of a residual, (n, number of components), judged by the greatest norm of the values."""
    size, scale = np.linalg.norm(residual, axis=1), np.linalg.norm(values, axis=1)
    worst = int(np.argmax(np.where(np.isnan(size), np.inf, size)))
    place = components[int(np.argmax(np.abs(np.nan_to_num(residual[worst], nan=np.inf))))]
    time, limit = float(column(log, "state.time_s")[worst]), allowed[name] * (1.0 + float(np.max(scale)))
    return Law(name, party, place, float(size[worst]), time, limit, unit)


def _impact_laws(log: RunLog, allowed: Mapping[str, float]) -> list[Law]:
    """What every impact must obey whatever law of contact made it.

    The work of frictionless impulses is the sum of impulse (separation - approach) / 2, exactly; the accounts of energy take
    its change as given, so it is checked here. One contact alone separates at e times its approach.
    """
    events = [list(contacts) for _, contacts in groupby(log.impacts, key=lambda record: record.event)]
    if not events:
        return []
    works = [sum(c.impulse_N_s * (c.separation_speed_m_s - c.approach_speed_m_s) / 2 for c in event) for event in events]
    laws = [
        _worst_impact(
            "impact energy",
            "J",
            [(event[0], abs(event[0].energy_change_J - work)) for event, work in zip(events, works, strict=True)],
            max(event[0].energy_before_J["total"][0] for event in events),
            allowed,
        )
    ]
    alone = [event[0] for event in events if len(event) == 1]
    if alone:
        misses = [(c, abs(c.separation_speed_m_s - c.restitution * c.approach_speed_m_s)) for c in alone]
        scale = max(c.approach_speed_m_s for c in alone)
        laws.append(_worst_impact("impact restitution", "m/s", misses, scale, allowed))
    return laws


def _worst_impact(
    name: str, unit: str, found: list[tuple[ImpactRecord, float]], scale: float, allowed: Mapping[str, float]
) -> Law:
    record, residual = max(found, key=lambda pair: np.inf if np.isnan(pair[1]) else pair[1])
    limit = allowed[name] * (1.0 + scale)
    return Law(name, "total", f"impact {record.event + 1}", residual, record.time_s, limit, unit)
