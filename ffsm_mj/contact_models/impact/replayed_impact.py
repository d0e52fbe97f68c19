"""Replay of a logged impact: the impact as logged enters the balance, and is resolved again for comparison.

It is also resolved with the points that rounding of the state moves far: the contact point of a rim that lies almost flat
travels at the rate of its tilt over the tilt, and so does the point at which two sides at a small angle cross. Where several
points slip, rounding of the velocities may decide which path one of them takes: an impact that differs from the logged one
is resolved at velocities next to those logged, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.gap_function import tilt_rounding
from ffsm_mj.contact.features.search import features
from ffsm_mj.contact.joint_limit import TendonLimit
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint
from ffsm_mj.contact_models.impact.records import LimitImpactRecord
from ffsm_mj.contact_models.impact.resolution import ClosedPairs, Contact, Friction, Impact, ImpactState, LimitContact
from ffsm_mj.contact_models.interface import LoggedEvent, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, tangents
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.tolerances import MERGED_M, RATE

_Record = ImpactRecord | LimitImpactRecord
_NEAR = 8
"""Number of velocities next to those logged at which an impact is resolved that differs from the logged one."""
APART = 1e-9
"""An impact differs from the logged one by more than this share: ten times what another order of summation makes of it."""
_LEAST = 1e-12
"""Least N s or s of which a share is taken."""


def impact_fault(records: Sequence[_Record], pairs: Mapping[str, UnilateralConstraint]) -> str:
    """Why the records of an impact do not fit the models, in one word; empty if they do."""
    contacts = [record for record in records if isinstance(record, ImpactRecord)]
    vectors = (v for c in contacts for v in (c.point_m, c.normal, c.tangential_impulse_N_s))
    # Records come from a file that anybody may have changed: a vector of another length would fail deep in the replay.
    if any(len(vector) != 3 for vector in vectors):
        return "state"
    return "pair" if any(_name(record) not in pairs for record in records) else ""


def _name(record: _Record) -> str:
    """Name of the pair or joint limit of a record."""
    return record.pair if isinstance(record, ImpactRecord) else f"{record.joint} {record.side} limit"


def logged_impact(scene: Scene, event: LoggedEvent, pairs: Mapping[str, UnilateralConstraint]) -> Impact:
    """The impact as logged, with energies computed from the logged velocities.

    Args:
        scene: The system with the logged state before the impact.
        event: The logged impact.
        pairs: Pairs and joint limits by name.
    """
    model, nq = scene.system.mj, scene.system.mj.nq
    M = mass_matrix(model, scene.data)
    before, after = (ImpactState(v, kinetic_energy(M, v), np.zeros(6)) for v in (event.state[nq:], event.state_after[nq:]))
    along = np.array([along_row(record) for record in event.records])
    return Impact(
        contacts=tuple(_contact(record, pairs[_name(record)], scene) for record in event.records),
        impulses=along[:, 0],
        approach_speeds=along[:, 1],
        separation_speeds=along[:, 2],
        before=before,
        after=after,
        law=event.records[0].law,
        status=event.records[0].status,
        friction=_friction(event.records),
    )


def along_row(record: _Record) -> tuple[float, float, float]:
    """Impulse, approach speed and separation speed of a record along its row of the contact Jacobian."""
    if isinstance(record, ImpactRecord):
        return record.impulse_N_s, record.approach_speed_m_s, record.separation_speed_m_s
    return record.impulse, record.approach_rate, record.separation_rate


def _contact(record: _Record, pair: UnilateralConstraint, scene: Scene) -> Contact | LimitContact:
    """Contact of a record."""
    if isinstance(record, ImpactRecord):
        point, normal = np.array(record.point_m), np.array(record.normal)
        of_pair = (record.restitution, record.mu, record.compliance_ratio)
        return Contact(pair.body_a, pair.body_b, point, normal, *of_pair)
    assert pair.is_limit  # by its name
    row = pair.row(scene.system.mj, scene.data).tolist() if isinstance(pair, TendonLimit) else ()
    return LimitContact(pair.dof, pair.sign, record.restitution, tuple(row))


def _friction(contacts: Sequence[_Record]) -> Friction | None:
    """Friction data of some records; None if no contact has friction."""
    if not any(isinstance(contact, ImpactRecord) and contact.mu > 0.0 for contact in contacts):
        return None
    vectors = ("tangential_impulse_N_s", "slip_before_m_s", "slip_after_m_s")
    works = ("friction_work_J", "compression_work_J")
    # A joint limit has no friction: its work is that of its impulse.
    impulses, before, after = (
        np.array([getattr(contact, name, (0.0, 0.0, 0.0)) for contact in contacts]) for name in vectors
    )
    friction, compression = (np.array([getattr(contact, name, 0.0) for contact in contacts]) for name in works)
    normal = np.array([c.normal_work_J if isinstance(c, ImpactRecord) else c.work_J for c in contacts])
    paths = tuple(getattr(contact, "path", "") for contact in contacts)
    return Friction(impulses, before, after, paths, contacts[0].theta, 0.0, normal, friction, compression)


def moved_points(touching: ClosedPairs, scene: Scene, motion: Motion) -> Iterator[ClosedPairs]:
    """Pairs in contact at the state in ``data``, with one point after the other moved by its rounding along two tangents.

    There are none in the motion of the logged system itself: its state is that of a log bit by bit.
    """
    model, data = scene.system.mj, scene.data
    for i, (pair, near) in enumerate(touching if motion.data is not data else ()):
        if not isinstance(pair, ContactPair) or len(near.points) > 1:
            continue
        share = max((tilt_rounding(feature, data, moves=True) for feature in features(pair, model, data, near)), default=0.0)
        # No rim is larger, and no side much longer, than the distance of the point from the middle of its geom.
        reach = share * float(np.linalg.norm(data.geom_xpos[list(pair.ids)] - near.points[0], axis=1).max())
        if reach > MERGED_M:
            for along in tangents(near.normal):
                moved = pair.at_velocities(data, replace(near, points=near.points + reach * along))
                yield [*touching[:i], (pair, moved), *touching[i + 1 :]]


def apart(records: Sequence[_Record], logged: Sequence[_Record]) -> float:
    """How far an impact differs from the logged one: infinite for other paths, else the largest share of a number."""
    # Another path of slip, or another pair, is no rounding of the same impact: no number measures the difference.
    if [*map(_texts, records)] != [*map(_texts, logged)]:
        return math.inf
    numbers = np.array([(along_row(record)[0], record.dropped_flights_s) for record in (*records, *logged)])
    again, values = np.split(numbers.reshape(2, -1, 2), 2)
    return float(np.max(np.abs(again - values) / np.maximum(np.abs(values).max(axis=1, keepdims=True), _LEAST), initial=0.0))


def _texts(record: _Record) -> tuple[str, str]:
    return _name(record), getattr(record, "path", "")


def rounded_rates(qvel: FloatArray) -> FloatArray:
    """Velocities that differ from some by their rounding, in random directions, always the same ones, (n, nv)."""
    # In which direction the path changes is not known. The generator is fixed, so that a replay gives the same result twice.
    shares = np.random.default_rng(0).uniform(-RATE, RATE, (_NEAR, len(qvel)))
    return np.asarray(qvel + shares * (1.0 + np.abs(qvel)))
