"""Exact impacts, usable alone on any MuJoCo model: ``resolve``, ``reflect`` and the paper's own system as the oracle.

``linearize`` gives the saltation matrix of an impact, and the changes of its time and impulse with the state before it;
``linearize_grasp`` that of the closing of a grasp.

:class:`ImpactLaw` is the interface of impact laws, ``register_law`` makes one known; see ``docs/impact-laws.md``.
"""

from __future__ import annotations

from ffsm_mj.contact_models.grasp.linearize import GraspSaltation, linearize_grasp
from ffsm_mj.contact_models.impact.law import Coverage, ImpactLaw, ImpactProblem, ImpactSolution
from ffsm_mj.contact_models.impact.law import register as register_law
from ffsm_mj.contact_models.impact.laws import reflect
from ffsm_mj.contact_models.impact.linearize import Saltation, linearize
from ffsm_mj.contact_models.impact.paper import PaperSolution, solve_paper_system
from ffsm_mj.contact_models.impact.resolution import (
    Contact,
    Friction,
    Impact,
    ImpactState,
    LimitContact,
    compare_laws,
    contact_jacobian,
    resolve,
)
from ffsm_mj.records.events import ImpactRecord

__all__ = [
    "Contact",
    "Coverage",
    "Friction",
    "GraspSaltation",
    "Impact",
    "ImpactLaw",
    "ImpactProblem",
    "ImpactRecord",
    "ImpactSolution",
    "ImpactState",
    "LimitContact",
    "PaperSolution",
    "Saltation",
    "compare_laws",
    "contact_jacobian",
    "linearize",
    "linearize_grasp",
    "reflect",
    "register_law",
    "resolve",
    "solve_paper_system",
]
