"""The impact as a contact model: touch, resolve at once, fly on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.contact import Contact
from ffsm_mj.contact_models.impact.record import impact_energies, impact_records, impulses_between
from ffsm_mj.contact_models.impact.resolution import Impact, resolve
from ffsm_mj.contact_models.impact.resting import RestingResult, RestRule, resolve_resting
from ffsm_mj.contact_models.impact.time_of_impact import Detector
from ffsm_mj.contact_models.impact.touching import Touching, touching_points
from ffsm_mj.contact_models.interface import EventEffect, EventTime, Scene
from ffsm_mj.dynamics.rigid_body import momentum_matrix
from ffsm_mj.errors import UnsupportedContactError
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.records.signals import Signal

_HEAT = Signal(
    "balance",
    "friction_heat_J",
    "J",
    "heat of friction at impacts: the kinetic energy lost in those with friction, less what the work of the normal impulses "
    "took, as restitution does without friction; where several contacts meet, that split is a convention",
)


@dataclass(frozen=True)
class ImpactRules:
    """What a scenario says of its impacts; see its keys of the same names."""

    law: str
    rest: RestRule
    max_impacts: int
    stop_on_impact: bool


class ImpactModel(Detector):
    """Resolves what its pairs run into; see :class:`~ffsm_mj.contact_models.interface.ContactModel`."""

    kind = "impact"
    struck: frozenset[str] = frozenset()
    """Names of the pairs of the last impact, until somebody has heard of it."""

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], rules: ImpactRules) -> None:
        """Watch pairs from the state in ``scene.data`` on."""
        super().__init__(scene, pairs)
        self._rules = rules
        self._impacts = 0
        self._heat = np.zeros(1)
        if any(pair.mu > 0.0 for pair in pairs):
            self.columns = (*self.columns, Columns((_HEAT,), live=self._heat, resume=self._resume_heat))

    def _resume_heat(self, told: FloatArray) -> None:
        self._heat[:] = told

    def names(self) -> str:
        """The pairs in contact."""
        return "; ".join(str(pair) for pair, _ in self.contacts())

    def act(self, instant: EventTime) -> EventEffect | None:
        """Resolve all contacts at this instant at once.

        Raises:
            RunEnded: A contact is not supported, has no solution, or would last and cannot.
        """
        system, data, time_s = self.scene.system, self.scene.data, instant.time_s
        touching = self.contacts()
        try:
            met = self.resolve(touching)
        except (UnsupportedContactError, ValueError) as error:
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"at t = {time_s:.6g} s: {error} ({self.names()})") from error
        self._refuse_unsolved(met.impact, time_s)
        self._refuse_rest(touching, met, time_s)
        if not any(near.approaches for _, near in touching):
            self.closing.close(touching)  # a root at rounding level, or closed and still: what comes next decides
            self._refuse_corners(touching, met, time_s)
            return None
        impact = self.apply(touching, met.impact)
        energies = impact_energies(system, data, impact)
        met = replace(met, impact=impact)
        records = impact_records(system, data, touching, met, energies, self._impacts, instant)
        self.closing.close(touching)
        self._refuse_unmoved(touching, impact, time_s)
        self._impacts += 1
        self.struck = frozenset(pair.name for pair, _ in touching)
        return EventEffect(records, self.exchange(energies, impact), end=self._end())

    def resolve(self, touching: Touching) -> RestingResult:
        """The impact in the coordinates of what moves, plastic where a contact comes to rest."""
        bodies, model, data = self.motion.bodies, self.motion.model, self.motion.data
        points = touching_points(touching)

        def with_restitution(e: FloatArray) -> Impact:
            contacts = [
                Contact(bodies[pair.body_a], bodies[pair.body_b], point, near.normal, float(each), pair.mu)
                for (pair, near, point), each in zip(points, e, strict=True)
            ]
            return resolve(model, data, contacts, self._rules.law)

        return resolve_resting(
            self.scene.system.mj, self.scene.data, touching, self._rules.rest, with_restitution, self.motion
        )

    def apply(self, touching: Touching, impact: Impact) -> Impact:
        """Give what moves its velocities after; returns the impact in the coordinates of the system."""
        motion, data = self.motion, self.scene.data
        before = np.array(data.qvel)
        motion.data.qvel[:] = impact.after.qvel
        mujoco.mj_forward(motion.model, motion.data)
        motion.path.on_event_located()
        if motion.data is data:
            return impact
        pairs = [pair for pair, _, _ in touching_points(touching)]
        return replace(
            impact,
            contacts=tuple(
                replace(contact, body_a=pair.body_a, body_b=pair.body_b)
                for contact, pair in zip(impact.contacts, pairs, strict=True)
            ),
            before=replace(impact.before, qvel=before),
            after=replace(impact.after, qvel=np.array(data.qvel)),
        )

    def exchange(self, energies: FloatArray, impact: Impact) -> Exchange:
        """What an impact did: its contacts, and what a grip passed on where objects are part of others; counts the heat.

        Args:
            energies: From :func:`~ffsm_mj.contact_models.impact.record.impact_energies`.
            impact: In the coordinates of the system.
        """
        system, data = self.scene.system, self.scene.data
        on_objects, *outside = impulses_between(system, impact)
        if self.motion.data is not data:
            change = impact.after.qvel - impact.before.qvel
            momenta = (momentum_matrix(system.mj, data, tree.root) @ change for tree in system.objects)
            on_objects = sum(momenta, -outside[1])
        if impact.friction is not None:
            self._heat += impact.friction.normal_work.sum() - (energies[1, 0] - energies[0, 0])
        return Exchange(energies[1] - energies[0], on_objects, np.array(outside))

    def _end(self) -> RunEnded | None:
        if self._rules.stop_on_impact:
            return RunEnded(Outcome.COMPLETED)
        if self._impacts >= self._rules.max_impacts:
            return RunEnded(Outcome.EVENT_LIMIT, f"{self._impacts} impacts; raise impact.max_impacts to go on")
        return None

    def _refuse_unsolved(self, impact: Impact, time_s: float) -> None:
        """End the run where friction has no solution: its velocities are none."""
        if impact.status == "unconverged" and impact.friction is not None:
            of = (
                f"the friction of {len(impact.contacts)} contacts"
                if len(impact.contacts) > 1
                else "the friction of a contact"
            )
            message = (
                f"{of} has no solution at t = {time_s:.6g} s, status unconverged, residual {impact.friction.residual:.1e}"
            )
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message} ({self.names()})")

    def _refuse_unmoved(self, touching: Touching, impact: Impact, time_s: float) -> None:
        """End the run where a pair approaches that no impulse stops and nobody holds: it would be asked for ever.

        Its approach is slower than the law resolves: where a light body is between heavy ones, impulses are known to a share
        of rounding that is a velocity for the light one.
        """
        left = [pair for pair, near in touching if near.approaches and not self.closing.holds(pair)]
        if left and not impact.impulses.any():
            speed = float(impact.approach_speeds.max())
            message = (
                f"{left[0]} approaches at {speed:.2g} m/s at t = {time_s:.6g} s, which no impulse in double precision stops"
            )
            raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}: masses of what touches differ too much")

    def _refuse_corners(self, touching: Touching, met: RestingResult, time_s: float) -> None:
        """End the run where a pair that is pressed at rest has no normal of its own: it would be asked again for ever."""
        speeds = met.impact.separation_speeds.tolist()
        for (pair, near, _), b, speed in zip(touching_points(touching), met.pressing.tolist(), speeds, strict=True):
            if b > 0.0 and speed <= near.rate_tolerance and not self.closing.holds(pair):
                message = f"{pair} would stay in contact from t = {time_s:.6g} s by a corner on a corner or on an edge"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, f"{message}, which have no normal of their own")

    def _refuse_rest(self, touching: Touching, met: RestingResult, time_s: float) -> None:
        """End the run where a pair comes to rest, pressed, that nobody can hold."""
        for (pair, _, _), used, b in zip(touching_points(touching), met.used.tolist(), met.pressing.tolist(), strict=True):
            if used == 0.0 and b > 0.0 and (why := self.closing.refusal(pair)):
                message = f"{pair} would stay in contact from t = {time_s:.6g} s, pressed at {b:.3g} m/s^2: {why}"
                raise RunEnded(Outcome.UNSUPPORTED_CONTACT, message)
