"""What an impact law answers where contacts have friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ffsm_mj.arrays import FloatArray

Status = Literal["ok", "energy_guard", "jammed", "wedged", "unconverged"]

WITHIN = 1.0 - 4e-16
"""An impulse scaled onto its cone is scaled by this too: rounding must not leave it outside."""


@dataclass(frozen=True)
class FrictionResult:
    """Outcome of an impact with friction of k contacts; works in J, impulses in N s.

    Attributes:
        impulses: Impulse on the second body of each contact along (normal, t1, t2), (k, 3); inside its cone exactly.
        w: Mass-weighted velocity after, (n,).
        law: Rule that made it; of the built-in laws ``stronge`` for one contact, ``coulomb`` or ``poisson`` for several.
        status: ``ok``; ``energy_guard``: restitution was lowered by ``theta`` so that no energy is gained; ``jammed``: no
            elastic way out, energy was lost; ``wedged``: one contact that locks itself and comes to rest;
            ``unconverged``: no solution was found, and the velocity after is not to be used.
        theta: Share of the restitution that the energy guard left, 1 where it was not needed.
        residual: Several contacts: largest violation of Coulomb's conditions over the largest contact speed before. One
            contact: how far the works miss the change of kinetic energy, over the kinetic energy before.
        paths: What each contact passed through, of ``slip``, ``stick`` and ``reverse slip``, joined by ", "; empty where
            it got no impulse.
        normal_work: Work of the normal impulse, (k,). One contact: the integral of u_n dp, as it was integrated. Several:
            impulse times the mean of the velocity before and after, of compression and expansion each.
        friction_work: Work of friction, (k,), in the same way; the sum of both is the change of kinetic energy.
        compression_work: Normal work up to the end of compression, (k,), <= 0 for one contact.
    """

    impulses: FloatArray
    w: FloatArray
    law: str
    status: Status
    theta: float
    residual: float
    paths: tuple[str, ...]
    normal_work: FloatArray
    friction_work: FloatArray
    compression_work: FloatArray


def on_cone(impulse: FloatArray, mu: float) -> FloatArray:
    """An impulse (normal, t1, t2) whose tangential part is at most mu times its normal part, which is not negative."""
    normal = max(float(impulse[0]), 0.0)
    length, most = float(np.hypot(impulse[1], impulse[2])), mu * normal
    share = 1.0 if length <= most else WITHIN * most / length
    return np.array([normal, share * impulse[1], share * impulse[2]])
