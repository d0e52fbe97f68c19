"""Closed pairs and joint limits at an impact, and the interface through which persistent contact takes them over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact.tendon_limit import TendonLimit
from ffsm_mj.contact_models.impact.contact import Contact, LimitContact
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.tolerances import CONTACT_GAP_M

ClosedPairs = Sequence[tuple[UnilateralConstraint, Proximity]]
"""Pairs in contact and joints at a limit at one instant, each with its proximity."""


def contact_points(closed: ClosedPairs) -> list[tuple[UnilateralConstraint, Proximity, FloatArray]]:
    """All contact points with their pairs, world axes, m: the order of resolution, rest rule and records."""
    return [(pair, near, point) for pair, near in closed for point in near.points]


def closed_pairs(broad_phase: BroadPhase, scene: Scene, motion: Motion) -> ClosedPairs:
    """The pairs in contact at the state in ``data``, without those on one rigid body of a motion."""
    model, data, pairs = scene.system.mj, scene.data, broad_phase.pairs
    close = [pairs[i] for i in broad_phase.near(data) if pairs[i].geom_ids not in motion.disabled]
    near = [(pair, pair.proximity(model, data)) for pair in close]
    return [(pair, proximity) for pair, proximity in near if proximity.gap <= CONTACT_GAP_M]


def as_contact(
    pair: UnilateralConstraint, near: Proximity, point: FloatArray, motion: Motion, restitution: float
) -> Contact | LimitContact:
    """A closed pair or joint limit as a contact in the coordinates of a motion."""
    if isinstance(pair, JointLimit):
        row = pair.row(motion.model, motion.data, motion.dofs).tolist() if isinstance(pair, TendonLimit) else ()
        return LimitContact(motion.dofs[pair.dof], pair.sign, restitution, tuple(row))
    return Contact(motion.bodies[pair.body_a], motion.bodies[pair.body_b], point, near.normal, restitution, pair.mu)


class PersistentContacts(Protocol):
    """Keeps pairs closed after an impact; impact detection skips the pairs that it holds."""

    def holds(self, pair: UnilateralConstraint) -> bool:
        """Whether it keeps this pair closed now."""

    def refusal(self, pair: UnilateralConstraint) -> str:
        """Why it cannot keep a pair closed; empty if it can."""

    def close(self, touching: ClosedPairs, *, struck: bool) -> None:
        """Take over the pairs that neither approach nor separate at the velocities in ``data``.

        Args:
            touching: The pairs in contact.
            struck: Whether an impact has just changed the velocities.
        """
