"""Replay of a logged impact: the impact as logged enters the balance, and is resolved again for comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.contact_models.impact.contact import Contact
from ffsm_mj.contact_models.impact.resolution import Impact, ImpactState
from ffsm_mj.contact_models.impact.with_friction import Friction
from ffsm_mj.contact_models.interface import LoggedEvent, Scene
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.records.events import ImpactRecord


def impact_fault(records: Sequence[ImpactRecord], pairs: Mapping[str, Any]) -> str:
    """Why the records of an impact do not fit the models, in one word; empty if they do."""
    vectors = (each for c in records for each in (c.point_m, c.normal, c.tangential_impulse_N_s))
    if any(len(vector) != 3 for vector in vectors):
        return "state"
    return "pair" if any(contact.pair not in pairs for contact in records) else ""


def logged_impact(scene: Scene, event: LoggedEvent, bodies: Mapping[str, tuple[int, int]]) -> Impact:
    """The impact as logged, with energies computed from the logged velocities.

    Args:
        scene: The system with the logged state before the impact.
        event: The logged impact.
        bodies: Bodies of each pair, by its name.
    """
    model, nq = scene.system.mj, scene.system.mj.nq
    M = mass_matrix(model, scene.data)
    before, after = (ImpactState(v, kinetic_energy(M, v), np.zeros(6)) for v in (event.state[nq:], event.state_after[nq:]))
    return Impact(
        contacts=tuple(
            Contact(*bodies[c.pair], np.array(c.point_m), np.array(c.normal), c.restitution, c.mu) for c in event.records
        ),
        impulses=np.array([c.impulse_N_s for c in event.records]),
        approach_speeds=np.array([c.approach_speed_m_s for c in event.records]),
        separation_speeds=np.array([c.separation_speed_m_s for c in event.records]),
        before=before,
        after=after,
        law=event.records[0].law,
        status=event.records[0].status,
        friction=_friction(event.records),
    )


def _friction(contacts: Sequence[ImpactRecord]) -> Friction | None:
    """Friction data of some records; None if no contact has friction."""
    if not any(contact.mu > 0.0 for contact in contacts):
        return None
    vectors = ("tangential_impulse_N_s", "slip_before_m_s", "slip_after_m_s")
    works = ("normal_work_J", "friction_work_J", "compression_work_J")
    impulses, before, after = (np.array([getattr(contact, name) for contact in contacts]) for name in vectors)
    normal, friction, compression = (np.array([getattr(contact, name) for contact in contacts]) for name in works)
    paths = tuple(contact.path for contact in contacts)
    return Friction(impulses, before, after, paths, contacts[0].theta, 0.0, normal, friction, compression)
