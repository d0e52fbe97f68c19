"""Checks of impacts with friction: records are compared with the impact recomputed from the state before and the models.

The result of the impact law is checked by the law itself: built-in laws solve a single contact again. For several contacts
the split of the work between normal and friction impulses is a convention (a contact that sticks in compression can have
positive friction work), so the sum is checked, and that no energy is gained.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.law import law_of_record
from ffsm_mj.contact_models.impact.records import LimitImpactRecord
from ffsm_mj.contact_models.impact.replayed_impact import along_row
from ffsm_mj.contact_models.impact.resolution import Contact, LimitContact, contact_rows
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.log.scenario import scenario_data
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.tolerances import MECHANISM_RANK, RANK
from ffsm_mj.verification.closed_grasps import closed_grasps, stopped_rows

_GAIN = 1e-3
"""For several contacts energy may grow by this fraction of the tolerance: 1e-12 of T for a tolerance of 1e-9."""
_Record = ImpactRecord | LimitImpactRecord
_HUGE = 1e10
"""Largest number that MuJoCo accepts in a state."""


@dataclass(frozen=True)
class EnergyDeviation:
    """Deviation of an impact from its law as an energy in J, and its tolerance."""

    size: float
    allowed: float

    @property
    def excess(self) -> float:
        """Size over tolerance; infinite if it is not a number."""
        if math.isnan(self.size) or not self.allowed > 0.0:
            return math.inf if self.size != 0.0 else 0.0
        return self.size / self.allowed


@dataclass(frozen=True)
class _CheckedImpact:
    """An impact in mass-weighted velocities: from states and models, and from its records.

    Attributes:
        A: Rows J L^-T of (normal, t1, t2) of each contact, (3k, n).
        before: L^T qdot before, (n,).
        after: L^T qdot after, (n,).
        impulses: Recorded impulses along those directions, N s, (3k,).
        speeds: Recorded velocities along those directions before and after, m/s, (2, 3k).
    """

    A: FloatArray
    before: FloatArray
    after: FloatArray
    impulses: FloatArray
    speeds: FloatArray

    @property
    def unexplained(self) -> float:
        """Residual of the impulse-momentum equation as an energy, J."""
        change = self.after - self.before - self.A.T @ self.impulses
        return float(np.linalg.norm(change) * np.linalg.norm(self.before))


class FrictionCheck:
    """Checks the impacts with friction of one log; its models are compiled at the first one."""

    def __init__(self, log: RunLog) -> None:
        """Bind to a log."""
        self._log = log

    def worst(self, event: Sequence[_Record], share: float) -> EnergyDeviation:
        """The worst deviation of an impact.

        Args:
            event: Records of the impact.
            share: Tolerance relative to the kinetic energy before.
        """
        return _or_infinite(self._worst, event, share)

    def _worst(self, event: Sequence[_Record], share: float) -> EnergyDeviation:
        met = self._met(event)
        if met is not None and self._others_hold and met.unexplained > share * 0.5 * float(met.before @ met.before):
            met = None  # the equations of motion are known only to a contact model: check the records alone
        if met is None:
            return _worst_of_records(event, share)
        energy = 0.5 * float(met.before @ met.before)
        sizes = [*_by_records(event), *_by_states(event, met), *_by_law(event, met)]
        found = [EnergyDeviation(size, share * energy) for size in sizes]
        gained = max(0.0, 0.5 * float(met.after @ met.after) - energy)
        found.append(EnergyDeviation(gained, _GAIN * share * energy))
        return max(found, key=lambda miss: miss.excess)

    @cached_property
    def _others_hold(self) -> bool:
        """Whether the scenario declares contact models, which may constrain bodies."""
        return bool(scenario_data(self._log).get("contact_models"))

    @cached_property
    def _models(self) -> Any:
        """The system of the log and its data; None if the log has no models that compile."""
        import mujoco

        from ffsm_mj.log.scenario import compile_log

        try:
            system = compile_log(self._log)
        except InputError:
            return None
        return system, mujoco.MjData(system.mj)

    def _met(self, event: Sequence[_Record]) -> _CheckedImpact | None:
        """The impact from its states and models; None without models, or if the states do not match them."""
        import mujoco

        from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops, MassWeightedRows
        from ffsm_mj.dynamics.loops.equalities import equalities_of
        from ffsm_mj.dynamics.rigid_body import mass_matrix

        if self._models is None:
            return None
        (system, data), first = self._models, event[0]
        try:
            rates = [np.concatenate([v[joint] for joint in system.joints]) for v in (first.qvel_before, first.qvel_after)]
        except LookupError:
            return None
        if len(first.qpos) != system.mj.nq or any(len(v) != system.mj.nv for v in rates):
            return None
        if not np.all(np.abs(np.concatenate((first.qpos, *rates))) < _HUGE):
            raise ValueError("no state")
        data.qpos[:] = first.qpos
        mujoco.mj_fwdPosition(system.mj, data)
        try:
            contacts = [_contact(system, data, record) for record in event]
        except LookupError:
            return None
        M = mass_matrix(system.mj, data)
        L = np.linalg.cholesky(M)
        J, impulses, speeds = _directions(system.mj, data, event, contacts)
        try:
            held = [stopped_rows(self._log, self._models, grasp) for grasp in closed_grasps(self._log, first)]
        except (LookupError, ValueError, TypeError):  # the scenario in the log has no such grasp
            return None
        equalities = [each.source for each in equalities_of(system.mj)]
        if equalities:
            held.append(ClosedLoops(system.mj, data, equalities).rows().J)
        if held:  # latches and equality constraints stop relative motions
            J = MassWeightedRows(M, np.concatenate(held), MECHANISM_RANK if equalities else RANK).projected(J)
        return _CheckedImpact(np.linalg.solve(L, J.T).T, L.T @ rates[0], L.T @ rates[1], impulses, speeds)


def _directions(
    model: Any, data: Any, event: Sequence[_Record], contacts: Sequence[Contact | LimitContact]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows along (normal, t1, t2) of each contact, (3k, nv), and its record along them: see :class:`_CheckedImpact`."""
    from ffsm_mj.contact_models.impact.friction import tangents

    rows, impulses, speeds = [], [], []
    for record, contact in zip(event, contacts, strict=True):
        if isinstance(record, LimitImpactRecord):
            rows.append(contact_rows(model, data, contact, np.zeros((2, 3))))
            impulses.append(np.array((record.impulse, 0.0, 0.0)))
            speeds.append(np.array(((-record.approach_rate, 0.0, 0.0), (record.separation_rate, 0.0, 0.0))))
            continue
        normal = np.array(record.normal)
        across = tangents(normal)
        rows.append(contact_rows(model, data, contact, across))
        axes = np.vstack((normal, across))
        impulses.append(axes @ (record.impulse_N_s * normal + record.tangential_impulse_N_s))
        before = -record.approach_speed_m_s * normal + record.slip_before_m_s
        after = record.separation_speed_m_s * normal + record.slip_after_m_s
        speeds.append(np.stack((axes @ before, axes @ after)))
    return np.concatenate(rows), np.concatenate(impulses), np.concatenate(speeds, axis=1)


def _contact(system: Any, data: Any, record: _Record) -> Contact | LimitContact:
    """The contact of a record; positions in ``data`` are its.

    Raises:
        LookupError: It names an element that the models do not have.
    """
    if isinstance(record, LimitImpactRecord):
        sign = 1.0 if record.side == "lower" else -1.0
        if record.joint in system.joints:
            return LimitContact(system.joint(record.joint).dofs.start, sign)
        from ffsm_mj.dynamics.springs import tendon_rows

        tendon = system.index("tendon", record.joint)
        return LimitContact(0, sign, row=tuple((sign * tendon_rows(system.mj, data)[tendon]).tolist()))
    a, b = (int(system.mj.geom(name).bodyid[0]) for name in record.geoms)
    return Contact(a, b, np.array(record.point_m), np.array(record.normal))


def worst_of_records(event: Sequence[_Record], share: float) -> EnergyDeviation:
    """The worst inconsistency within the records of an impact, where states and models are not known.

    Args:
        event: Records of the impact.
        share: Tolerance relative to the kinetic energy before.
    """
    return _or_infinite(_worst_of_records, event, share)


def _worst_of_records(event: Sequence[_Record], share: float) -> EnergyDeviation:
    allowed = share * event[0].energy_before_J["total"][0]
    return max((EnergyDeviation(size, allowed) for size in _by_records(event)), key=lambda miss: miss.excess)


def _or_infinite(
    worst: Callable[[Sequence[_Record], float], EnergyDeviation], event: Sequence[_Record], share: float
) -> EnergyDeviation:
    """The worst deviation of an impact; infinite where its records are those of no impact: a log may hold any numbers."""
    with np.errstate(all="ignore"):
        try:
            return worst(event, share)
        except (UnsupportedContactError, ValueError, ArithmeticError, np.linalg.LinAlgError):
            return EnergyDeviation(math.inf, share * abs(event[0].energy_before_J["total"][0]))


def _by_records(event: Sequence[_Record]) -> Iterator[float]:
    """Inconsistencies within records, J: impulses at mean speeds, works and energies must give the same change."""
    first = event[0]
    change = first.energy_change_J
    yield abs(first.energy_after_J["total"][0] - first.energy_before_J["total"][0] - change)
    yield abs(sum(_work(record) for record in event) - change)
    at_mean = 0.0
    for c in event:
        impulse_along, approach, separation = along_row(c)
        at_mean += 0.5 * impulse_along * (separation - approach)
        if isinstance(c, LimitImpactRecord):
            continue
        slips = zip(c.tangential_impulse_N_s, c.slip_before_m_s, c.slip_after_m_s, strict=True)
        at_mean += 0.5 * sum(impulse * (before + after) for impulse, before, after in slips)
    yield abs(at_mean - change)


def _by_states(event: Sequence[_Record], met: _CheckedImpact) -> Iterator[float]:
    """Deviations of records from the states, J; other quantities are multiplied by the conjugate speed or impulse."""
    strength, speed = float(np.abs(met.impulses).max()), float(np.abs(met.A @ met.before).max())
    difference = np.abs(met.speeds - np.stack((met.A @ met.before, met.A @ met.after))).max()
    yield strength * float(difference)
    yield met.unexplained
    energies = [0.5 * float(w @ w) for w in (met.before, met.after)]
    logged = event[0].energy_before_J["total"][0], event[0].energy_after_J["total"][0]
    yield max(abs(one - other) for one, other in zip(energies, logged, strict=True))
    normal, *across = met.impulses.reshape(-1, 3).T
    outside = np.hypot(*across) - _coefficients(event) * normal
    yield speed * float(max(outside.max(), -normal.min(), 0.0))


def _by_law(event: Sequence[_Record], met: _CheckedImpact) -> Iterator[float]:
    """What of the records is not what their impact law makes of the state before, J."""
    from ffsm_mj.contact_models.impact.law import ImpactProblem

    contacts = [record for record in event if isinstance(record, ImpactRecord)]
    if len(contacts) < len(event):
        return  # the law is told of contacts only
    e = np.array([record.restitution_used for record in event])
    problem = ImpactProblem.mass_weighted(met.A, met.before, e, _coefficients(event))
    yield from law_of_record(event[0].law).friction_residuals(contacts, problem, met.impulses)


def _work(record: _Record) -> float:
    """Work of the impulses of a record, J."""
    return record.work_J if isinstance(record, LimitImpactRecord) else record.normal_work_J + record.friction_work_J


def _coefficients(event: Sequence[_Record]) -> FloatArray:
    """Coefficients of friction; zero at joint limits, (k,)."""
    return np.array([record.mu if isinstance(record, ImpactRecord) else 0.0 for record in event])
