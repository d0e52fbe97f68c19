"""Coulomb friction at an impact that never creates energy: pure mathematics in mass-weighted velocities.

One contact goes by Stronge's energetic restitution along Routh's path of impulse, several by a law of discrete Coulomb
friction under a guard of the energy.
"""

from __future__ import annotations

from ffsm_mj.contact_models.impact.friction.laws import impact_with_friction
from ffsm_mj.contact_models.impact.friction.result import FrictionResult
from ffsm_mj.contact_models.impact.friction.routh import stronge
from ffsm_mj.contact_models.impact.friction.tangents import tangents

__all__ = ["FrictionResult", "impact_with_friction", "stronge", "tangents"]
