"""The impacts of a log, found, resolved and booked again at the states at which it says that they happened."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from ffsm_mj.analysis.agreement import AGREES, Agreement, Difference
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.impact.record import contact_wrench, impact_records, party_energies
from ffsm_mj.impact.resolution import Contact, Impact, ImpactState, resolve
from ffsm_mj.impact.time_of_impact import Detector
from ffsm_mj.impact.touching import touching_points
from ffsm_mj.model.dynamics import kinetic_energy, mass_matrix
from ffsm_mj.plant.actuation import Actuation
from ffsm_mj.plant.ledger import Ledger
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.recount.scene import LogScene


@dataclass(frozen=True)
class Encounter:
    """One impact of the log.

    Attributes:
        name: ``impact 1``, for people.
        number: Its place among the impacts, from 0.
        contacts: Its records.
        state: Coordinates and rates before, (nq + nv,).
        state_after: The same after.
        efforts: What acts from there on, (nu,).
    """

    name: str
    number: int
    contacts: tuple[ImpactRecord, ...]
    state: FloatArray
    state_after: FloatArray
    efforts: FloatArray

    @property
    def time_s(self) -> float:
        """When it happened."""
        return self.contacts[0].time_s


class ImpactCheck:
    """Hands out the impacts step by step, and compares each with what the laws of contact make of its state.

    Attributes:
        detector: Watches the pairs at the state that flies.
        pending: Impacts not met yet, in order.
    """

    def __init__(self, scene: LogScene, data: Any, records: Sequence[ImpactRecord], found: Agreement) -> None:
        """Bind to the state that flies; differences go to ``found``."""
        self._scene, self._data, self._found = scene, data, found
        self.detector = Detector(Scene(scene.system, data), scene.pairs)
        self._step_s = scene.scenario.time_step_s
        self._bodies = {pair.name: (pair.body_a, pair.body_b) for pair in scene.pairs}
        groups = [tuple(group) for _, group in groupby(records, key=lambda record: record.event)]
        self.pending = [event for i, group in enumerate(groups) if (event := self._encounter(i, group)) is not None]

    def _encounter(self, number: int, contacts: tuple[ImpactRecord, ...]) -> Encounter | None:
        """An impact of the log; None, and a difference, where its state is not one of these models."""
        system, first, name = self._scene.system, contacts[0], f"impact {number + 1}"
        joints = [*system.joints.values()]
        try:
            before, after = (
                np.concatenate([np.asarray(qvel[joint.name], dtype=np.float64) for joint in joints])
                for qvel in (first.qvel_before, first.qvel_after)
            )
            efforts = np.array([first.efforts_after[actuator][0] for actuator in system.names("actuator")])
        except LookupError:
            before = after = efforts = np.empty(0)
        qpos = np.asarray(first.qpos, dtype=np.float64)
        state, state_after = np.concatenate((qpos, before)), np.concatenate((qpos, after))
        sizes = {(len(contact.point_m), len(contact.normal)) for contact in contacts}
        whole = sizes == {(3, 3)} and (qpos.size, before.size, after.size, efforts.size) == (
            *(system.mj.nq, system.mj.nv),
            *(system.mj.nv, system.mj.nu),
        )
        if not whole or not all(np.isfinite(numbers).all() for numbers in (state, after, efforts)):
            self._refuse(f"{name} state", first.time_s)
            return None
        if any(contact.pair not in self._bodies for contact in contacts):
            self._refuse(f"{name} pair", first.time_s)
            return None
        return Encounter(name, number, contacts, state, state_after, efforts)

    def _refuse(self, what: str, time_s: float) -> None:
        self._found.keep(Difference(what, math.inf, AGREES, "", time_s))

    def skip_to(self, step: int) -> None:
        """Leave out what happened before a step: there is no sample to fly from."""
        while self.pending and self.pending[0].contacts[0].step < step:
            self.pending.pop(0)

    def within(self, step: int) -> Iterator[Encounter]:
        """The next impacts, as far as they happened in this step; one that states another time than its step is refused."""
        start, end, slack = step * self._step_s, (step + 1) * self._step_s, 1e-6 * self._step_s
        while self.pending and self.pending[0].contacts[0].step <= step:
            event = self.pending.pop(0)
            if event.contacts[0].step == step and start - slack <= event.time_s <= end + slack:
                start = event.time_s
                yield event
            else:
                self._refuse(f"{event.name} time_s", event.time_s)

    def meet(self, event: Encounter, flown: FloatArray, ledger: Ledger) -> None:
        """Compare an impact at the state in ``data`` with its record, and book what the record says.

        Args:
            event: The impact.
            flown: State at the end of the flight to it, (nq + nv,).
            ledger: Takes energies and impulse.
        """
        nq, logged = self._scene.system.mj.nq, event.state
        for what, part in (("qpos", slice(None, nq)), ("qvel_before", slice(nq, None))):
            self._found.vector(f"{event.name} {what}", logged[part], flown[part], flown[part], "", event.time_s)
        impact = self._logged(event)
        energies = party_energies(self._scene.system, self._data, impact)
        ledger.book(energies[1] - energies[0], contact_wrench(self._scene.system, impact))
        again = self._resolved(event)
        if len(again) != len(event.contacts):
            self._refuse(f"{event.name} contacts", event.time_s)
            return
        for mine, theirs in zip(again, event.contacts, strict=True):
            self._found.impact(theirs, replace(mine, time_s=theirs.time_s, efforts_after=theirs.efforts_after))

    def efforts(self, event: Encounter, actuation: Actuation) -> None:
        """Let the efforts act that were decided at an impact, and look whether the limits allow them."""
        actuation.hold(event.efforts, self._data, event.time_s)
        name = f"{event.name} efforts_after"
        self._found.vector(name, event.efforts, actuation.applied.copy(), actuation.applied, "", event.time_s)
        self._data.ctrl[:] = event.efforts / actuation.gear

    def _resolved(self, event: Encounter) -> tuple[ImpactRecord, ...]:
        """What the run's own functions make of the state in ``data``; nothing where they refuse it."""
        system, first = self._scene.system, event.contacts[0]
        try:
            touching = self.detector.contacts()
            contacts = [
                Contact(pair.body_a, pair.body_b, point, near.normal, pair.restitution)
                for pair, near, point in touching_points(touching)
            ]
            impact = resolve(system.mj, self._data, contacts, self._scene.scenario.impact.law)
            energies = party_energies(system, self._data, impact)
            return impact_records(system, self._data, touching, impact, energies, event.number, first.step, event.time_s)
        except (UnsupportedContactError, ValueError, ArithmeticError):
            return ()

    def _logged(self, event: Encounter) -> Impact:
        """The impact as its record states it, energies from the rates."""
        model, nq = self._scene.system.mj, self._scene.system.mj.nq
        M = mass_matrix(model, self._data)
        before, after = (
            ImpactState(v, kinetic_energy(M, v), np.zeros(6)) for v in (event.state[nq:], event.state_after[nq:])
        )
        return Impact(
            contacts=tuple(
                Contact(*self._bodies[c.pair], np.array(c.point_m), np.array(c.normal), c.restitution)
                for c in event.contacts
            ),
            impulses=np.array([c.impulse_N_s for c in event.contacts]),
            approach_speeds=np.array([c.approach_speed_m_s for c in event.contacts]),
            separation_speeds=np.array([c.separation_speed_m_s for c in event.contacts]),
            before=before,
            after=after,
            law=event.contacts[0].law,
            jammed=bool(event.contacts[0].jammed),
        )
