"""Check of logged impacts: contacts are detected and resolved again at the logged pre-impact states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.contact import Contact
from ffsm_mj.contact_models.impact.model import ImpactModel
from ffsm_mj.contact_models.impact.record import impact_energies, impact_records
from ffsm_mj.contact_models.impact.resolution import Impact, ImpactState
from ffsm_mj.contact_models.impact.with_friction import Friction
from ffsm_mj.contact_models.interface import EventTime, Scene
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.replay.logged_events import LoggedEvent, LoggedEvents
from ffsm_mj.verification.agreement import Agreement


class ImpactCheck:
    """Compares each logged impact with the one recomputed from its pre-impact state."""

    def __init__(self, scene: Scene, pairs: tuple[ContactPair, ...], impacts: ImpactModel, found: Agreement) -> None:
        """Bind to the scene of the replay; differences are added to ``found``."""
        self._scene, self._impacts, self._found = scene, impacts, found
        self._bodies = {pair.name: (pair.body_a, pair.body_b) for pair in pairs}

    def fault_of(self, event: LoggedEvent) -> str:
        """Why an impact does not fit the models, in one word; empty if it does, and for other events."""
        contacts = [record for record in event.records if isinstance(record, ImpactRecord)]
        vectors = (each for c in contacts for each in (c.point_m, c.normal, c.tangential_impulse_N_s))
        if any(len(vector) != 3 for vector in vectors):
            return "state"
        return "pair" if any(contact.pair not in self._bodies for contact in contacts) else ""

    def compare_event(self, event: LoggedEvent, logged_events: LoggedEvents, balance: Balance) -> None:
        """Compare an impact at the state in ``data`` with its record, and enter the logged impact in the balance."""
        system, impact = self._scene.system, self._logged(event)
        energies = impact_energies(system, self._scene.data, impact)
        balance.book(*self._impacts.exchange(energies, impact))
        again = self._resolved(event)
        if len(again) != len(event.records):
            logged_events.refuse(f"{event.name} contacts", event.time_s)
            return
        for mine, theirs in zip(again, event.records, strict=True):
            known = replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after)
            self._found.record(f"impact {theirs.event + 1}", theirs, known)

    def _resolved(self, event: LoggedEvent) -> tuple[ImpactRecord, ...]:
        """Records recomputed by the functions of the run from the state in ``data``; empty if they refuse it."""
        system, data = self._scene.system, self._scene.data
        try:
            touching = self._impacts.contacts()
            met = self._impacts.resolve(touching)
            met = replace(met, impact=self._impacts.apply(touching, met.impact))
            energies = impact_energies(system, data, met.impact)
            instant = EventTime(event.time_s, event.step)
            records = impact_records(system, data, touching, met, energies, event.number, instant)
            self._impacts.closing.close(touching)
            return records
        except (UnsupportedContactError, ValueError, ArithmeticError):
            return ()

    def _logged(self, event: LoggedEvent) -> Impact:
        """The impact as logged, with energies computed from the logged velocities."""
        model, nq = self._scene.system.mj, self._scene.system.mj.nq
        M = mass_matrix(model, self._scene.data)
        before, after = (
            ImpactState(v, kinetic_energy(M, v), np.zeros(6)) for v in (event.state[nq:], event.state_after[nq:])
        )
        return Impact(
            contacts=tuple(
                Contact(*self._bodies[c.pair], np.array(c.point_m), np.array(c.normal), c.restitution, c.mu)
                for c in event.records
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
