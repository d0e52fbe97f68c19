"""Checks of impacts: energy, and the speeds after an impact.

Impacts without friction are checked independently of the impact law. Records of those with friction are compared with the
impact recomputed from the state before and the models, and the law itself checks its result: built-in laws solve a single
contact again. For several contacts the split of the work between normal and friction impulses is a convention (a contact
that sticks in compression can have positive friction work), so the sum is checked, and that no energy is gained.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.contact_models.impact.law import law_of_record
from ffsm_mj.contact_models.impact.records import LimitImpactRecord
from ffsm_mj.contact_models.impact.replayed_impact import along_row
from ffsm_mj.contact_models.impact.resolution import Contact, LimitContact, contact_rows
from ffsm_mj.dynamics.rigid_body import tangents
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.model.system import System
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.tolerances import MECHANISM_RANK, RANK
from ffsm_mj.verification.check_result import Check, share_of
from ffsm_mj.verification.independent.scene import LoggedScene

Models = Callable[[], tuple[System, Mapping[str, Any]]]
"""Returns the compiled models of a run, without a closed grasp, and its scenario as plain data."""
_GAIN = 1e-3
"""For several contacts energy may grow by this fraction of the tolerance: 1e-12 of T for a tolerance of 1e-9."""
_Record = ImpactRecord | LimitImpactRecord


def impact_checks(
    impacts: Sequence[ImpactRecord | LimitImpactRecord], allowed: Mapping[str, float], friction: FrictionCheck | None
) -> list[Check]:
    """Results of the checks of impacts, with the worst residual of each; empty without impacts.

    Args:
        impacts: Records of the impacts of a run, in order: contacts and joints at their limits.
        allowed: Tolerances by check.
        friction: Checks impacts with friction by the models; None: they are checked by their records alone.
    """
    events = [list(contacts) for _, contacts in groupby(impacts, key=lambda record: record.event)]
    rough = [any(isinstance(c, ImpactRecord) and c.mu > 0.0 for c in event) for event in events]
    checks = _frictionless_checks([event for event, rubs in zip(events, rough, strict=True) if not rubs], allowed)
    if not any(rough):
        return checks
    judged = [_check_with_friction(event, friction, allowed) for event, rubs in zip(events, rough, strict=True) if rubs]
    energy = max((*checks[:1], *judged), key=lambda check: share_of(check.residual, check.tolerance))
    return [energy, *checks[1:]]


def _check_with_friction(event: Sequence[_Record], friction: FrictionCheck | None, allowed: Mapping[str, float]) -> Check:
    """Energy check of an impact with friction; the tolerance is relative to its kinetic energy.

    The residual is infinite where the records are those of no impact: a log may hold any numbers.
    """
    worst = _worst_of_records if friction is None else friction.worst
    record, share = event[0], allowed["impact energy"]
    with np.errstate(all="ignore"):
        try:
            miss = worst(event, share)
        except (UnsupportedContactError, ValueError, ArithmeticError, np.linalg.LinAlgError):
            miss = EnergyDeviation(math.inf, share * abs(record.energy_before_J["total"][0]))
    place = f"impact {record.event + 1}"
    return Check("impact energy", "total", place, miss.size, record.time_s, miss.allowed, "J", miss.size)


def _frictionless_checks(events: Sequence[Sequence[_Record]], allowed: Mapping[str, float]) -> list[Check]:
    """Checks of impacts without friction.

    The work of frictionless impulses is the sum of impulse (separation - approach) / 2, exactly; the energy balance takes
    its change from the record, so it is checked here, for any impact law. The law itself checks the speeds after the impact.
    """
    if not events:
        return []
    works = [sum(p * (after - before) / 2 for p, before, after in map(along_row, event)) for event in events]
    checks = [
        _worst_impact(
            "impact energy",
            "J",
            [(event[0], abs(event[0].energy_change_J - work)) for event, work in zip(events, works, strict=True)],
            max(event[0].energy_before_J["total"][0] for event in events),
            allowed,
        )
    ]
    judged = [(event, _restitution_residual(event)) for event in events]
    misses = [(event[0], miss) for event, miss in judged if miss is not None]
    if misses:
        scale = max(along_row(record)[1] for event, miss in judged if miss is not None for record in event)
        checks.append(_worst_impact("impact restitution", "m/s", misses, scale, allowed))
    return checks


def _restitution_residual(event: Sequence[_Record]) -> float | None:
    """Residual of the speeds after an impact against its law, m/s or rad/s; None if the law makes no statement."""
    if len(event) == 1 and isinstance(event[0], LimitImpactRecord):
        return abs(event[0].separation_rate - event[0].restitution_used * event[0].approach_rate)
    contacts = [record for record in event if isinstance(record, ImpactRecord)]
    # Contacts together with a joint limit are an impact of which the law is told only a part.
    return law_of_record(event[0].law).restitution_residual(contacts) if len(contacts) == len(event) else None


def _worst_impact(
    name: str, unit: str, residuals: list[tuple[_Record, float]], scale: float, allowed: Mapping[str, float]
) -> Check:
    record, residual = max(residuals, key=lambda pair: np.inf if np.isnan(pair[1]) else pair[1])
    limit = allowed[name] * (1.0 + scale)
    return Check(name, "total", f"impact {record.event + 1}", residual, record.time_s, limit, unit, residual)


@dataclass(frozen=True)
class EnergyDeviation:
    """Deviation of an impact from its law as an energy in J, and its tolerance."""

    size: float
    allowed: float

    @property
    def excess(self) -> float:
        """Size over tolerance; infinite if it is not a number."""
        return share_of(self.size, self.allowed)


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
    """Checks the impacts with friction of one log; its models are asked for at the first one."""

    def __init__(self, log: RunLog, models: Models) -> None:
        """Bind to a log and what returns its models."""
        self._log, self._models = log, models

    def worst(self, event: Sequence[_Record], share: float) -> EnergyDeviation:
        """The worst deviation of an impact.

        Args:
            event: Records of the impact.
            share: Tolerance relative to the kinetic energy before.

        Raises:
            UnsupportedContactError, ValueError, ArithmeticError, numpy.linalg.LinAlgError: The records are of no impact.
        """
        met = self._met(event)
        energy = 0.5 * float(met.before @ met.before) if met is not None else 0.0
        if met is not None and self._others_hold and met.unexplained > share * energy:
            met = None  # the equations of motion are known only to a contact model: check the records alone
        if met is None:
            return _worst_of_records(event, share)
        sizes = [*_by_records(event), *_by_states(event, met), *_by_law(event, met)]
        deviations = [EnergyDeviation(size, share * energy) for size in sizes]
        gained = max(0.0, 0.5 * float(met.after @ met.after) - energy)
        deviations.append(EnergyDeviation(gained, _GAIN * share * energy))
        return max(deviations, key=lambda miss: miss.excess)

    @property
    def _others_hold(self) -> bool:
        """Whether the scenario declares contact models, which may constrain bodies."""
        return self._scene is not None and bool(self._scene.scenario.get("contact_models"))

    @cached_property
    def _scene(self) -> LoggedScene | None:
        """The models of the log; None if it has none that compile, or its rows lack a coordinate or an effort."""
        try:
            return LoggedScene(self._log, self._log.header.layout, *self._models())
        except (InputError, LookupError, TypeError, ValueError, AttributeError):
            return None

    @cached_property
    def _closed_grasps(self) -> dict[int, list[str]]:
        """Names of the grasps that are closed at each impact, by its number, as the records of the log say.

        Raises:
            LookupError: The scenario has fewer grasps than the log says.
            ValueError: A number in the log is none.
        """
        scene, closed, named, at_impacts = self._scene, list[str](), set[str](), dict[int, list[str]]()
        grasps = [record for record in self._log.events if isinstance(record, GraspRecord | ReleaseRecord)]
        for record in grasps:  # grasps that are closed since the start of the log: a record ends them before one begins them
            ended = record.replaces if isinstance(record, GraspRecord) else record.grasp
            closed += [ended] if ended and ended not in named else []
            named |= {ended, record.grasp}
        if scene is not None and len(self._log.rows):
            closed += [latch.name for latch in scene.closed_in(self._log.rows[0]) if latch.name not in named]
        for event in self._log.events:
            if isinstance(event, GraspRecord):
                closed = [name for name in closed if name != event.replaces] + [event.grasp]
            elif isinstance(event, ReleaseRecord):
                closed = [name for name in closed if name != event.grasp]
            elif isinstance(event, _Record):
                at_impacts[event.event] = closed
        return at_impacts

    def _met(self, event: Sequence[_Record]) -> _CheckedImpact | None:
        """The impact from its states and models; None without models, or if the states do not match them."""
        from ffsm_mj.dynamics.loops.closed_loops import MassWeightedRows

        scene, first = self._scene, event[0]
        if scene is None:
            return None
        try:
            before, after = (scene.rates(rates) for rates in (first.qvel_before, first.qvel_after))
        except LookupError:
            return None
        model, data = scene.model, scene.data
        if len(first.qpos) != model.nq or any(len(rates) != model.nv for rates in (before, after)):
            return None
        for rates in (after, before):
            scene.put(first.qpos, rates)
        try:
            contacts = [_contact(scene.system, data, record) for record in event]
            stopped = [scene.latch_rows(scene.grasps[name]) for name in self._closed_grasps[first.event]]
        except (LookupError, TypeError, ValueError):  # the models lack an element, or the scenario a grasp
            return None
        J, impulses, speeds = _directions(model, data, event, contacts)
        if model.neq:
            stopped.append(scene.equality_rows())
        M = scene.mass_matrix()
        if stopped:  # latches and equality constraints stop relative motions
            J = MassWeightedRows(M, np.concatenate(stopped), MECHANISM_RANK if model.neq else RANK).projected(J)
        L = np.linalg.cholesky(M)
        return _CheckedImpact(np.linalg.solve(L, J.T).T, L.T @ before, L.T @ after, impulses, speeds)


def _directions(
    model: Any, data: Any, event: Sequence[_Record], contacts: Sequence[Contact | LimitContact]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows along (normal, t1, t2) of each contact, (3k, nv), and its record along them: see :class:`_CheckedImpact`."""
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


def _worst_of_records(event: Sequence[_Record], share: float) -> EnergyDeviation:
    """The worst inconsistency within the records of an impact, where states and models are not known.

    Args:
        event: Records of the impact.
        share: Tolerance relative to the kinetic energy before.
    """
    allowed = share * event[0].energy_before_J["total"][0]
    return max((EnergyDeviation(size, allowed) for size in _by_records(event)), key=lambda miss: miss.excess)


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
        return  # only contacts are passed to the law
    e = np.array([record.restitution_used for record in event])
    ratios = np.array([record.compliance_ratio for record in contacts])
    problem = ImpactProblem.mass_weighted(met.A, met.before, e, _coefficients(event), ratios)
    yield from law_of_record(event[0].law).friction_residuals(contacts, problem, met.impulses)


def _work(record: _Record) -> float:
    """Work of the impulses of a record, J."""
    return record.work_J if isinstance(record, LimitImpactRecord) else record.normal_work_J + record.friction_work_J


def _coefficients(event: Sequence[_Record]) -> FloatArray:
    """Coefficients of friction; zero at joint limits, (k,)."""
    return np.array([record.mu if isinstance(record, ImpactRecord) else 0.0 for record in event])
