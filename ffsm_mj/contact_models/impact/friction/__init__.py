"""Coulomb friction at impacts, without energy gain: pure mathematics in mass-weighted velocities.

One contact is solved with Stronge's energetic restitution along Routh's impulse path, several contacts with discrete Coulomb
friction and an energy guard.
"""

from __future__ import annotations

from ffsm_mj.contact_models.impact.friction.laws import impact_with_friction
from ffsm_mj.contact_models.impact.friction.result import FrictionResult, tangents
from ffsm_mj.contact_models.impact.friction.routh import stronge

__all__ = ["FrictionResult", "impact_with_friction", "stronge", "tangents"]
