"""Unilateral constraints: what an impact or a persistent contact can act on.

Both kinds have the same interface: a gap with its rate, second rate and rounding (:class:`.proximity.Proximity`), bounds on
the closing speed, and a coefficient of restitution. Pairs of geoms add a normal, contact points, features and friction.
"""

from __future__ import annotations

from typing import TypeAlias

from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.pairs import ContactPair

UnilateralConstraint: TypeAlias = ContactPair | JointLimit
"""Two geoms that cannot overlap, or a joint that cannot move beyond one end of its range."""
