"""Exact impacts, usable alone on any MuJoCo model: ``resolve``, ``reflect`` and the paper's own system as the oracle."""

from __future__ import annotations

from ffsm_mj.contact_models.impact.contact import Contact, contact_jacobian
from ffsm_mj.contact_models.impact.laws import reflect
from ffsm_mj.contact_models.impact.paper import PaperSolution, solve_paper_system
from ffsm_mj.contact_models.impact.resolution import Impact, ImpactState, compare_laws, resolve
from ffsm_mj.contact_models.impact.with_friction import Friction

__all__ = [
    "Contact",
    "Friction",
    "Impact",
    "ImpactState",
    "PaperSolution",
    "compare_laws",
    "contact_jacobian",
    "reflect",
    "resolve",
    "solve_paper_system",
]
