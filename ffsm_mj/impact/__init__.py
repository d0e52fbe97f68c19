"""Exact impacts, usable alone on any MuJoCo model: ``resolve``, ``reflect`` and the paper's own system as the oracle."""

from __future__ import annotations

from ffsm_mj.impact.laws import reflect
from ffsm_mj.impact.paper import PaperSolution, solve_paper_system
from ffsm_mj.impact.resolution import Contact, Impact, ImpactState, compare_laws, contact_jacobian, resolve

__all__ = [
    "Contact",
    "Impact",
    "ImpactState",
    "PaperSolution",
    "compare_laws",
    "contact_jacobian",
    "reflect",
    "resolve",
    "solve_paper_system",
]
