"""Result of an impact law for contacts with friction, and the axes and cones of its contacts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.tolerances import SOLVED

Status = Literal["ok", "energy_guard", "jammed", "wedged", "unconverged"]

WITHIN = 1.0 - 4e-16
"""Additional factor of an impulse scaled onto its friction cone: rounding must not leave it outside, by two EPSILON."""


@dataclass(frozen=True)
class FrictionResult:
    """Result of an impact with friction of k contacts; works in J, impulses in N s.

    Attributes:
        impulses: Impulse on the second body of each contact along (normal, t1, t2), (k, 3); exactly inside its cone.
        w: Mass-weighted velocity after, (n,).
        law: Rule that gave it: for the built-in laws ``stronge`` or ``compliant`` for one contact, ``coulomb`` or
            ``poisson`` for several.
        status: ``ok``; ``energy_guard``: restitution was reduced by ``theta`` so that no energy is gained; ``jammed``: no
            elastic solution, energy was lost; ``wedged``: one contact that locks and comes to rest; ``unconverged``: no
            solution was found, and the velocity after must not be used.
        theta: Factor by which the energy guard reduced the restitution; 1 if it was not needed.
        residual: Several contacts: largest violation of Coulomb's conditions over the largest contact speed before. One
            contact: difference between the works and the change of kinetic energy, over the kinetic energy before.
        paths: Sequence of ``slip``, ``stick`` and ``reverse slip`` of each contact, joined by ", "; empty for a contact
            without impulse.
        normal_work: Work of the normal impulse, (k,). One contact: the integral of u_n dp along the path. Several contacts:
            impulse times the mean of the velocities before and after, for compression and expansion separately.
        friction_work: Work of friction, (k,), likewise; the sum of both works is the change of kinetic energy.
        compression_work: Normal work until the end of compression, (k,), <= 0 for one contact.
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


def result_of_path(
    law: str, status: Status, A: FloatArray, w: FloatArray, impulse: FloatArray, works: FloatArray, modes: Iterable[str]
) -> FrictionResult:
    """Result of one contact that was followed in time; ``unconverged`` if its works are not those of its impulse.

    Args:
        law: The law.
        status: How the path ended.
        A: Rows J L^-T of normal and two tangents, (3, n).
        w: Mass-weighted velocity before, (n,).
        impulse: Impulse along (normal, t1, t2), N s, (3,).
        works: Work of the normal impulse, of friction, and of compression, J, (3,).
        modes: Modes of slip along the path.
    """
    after = w + A.T @ impulse
    normal, friction, compression = works[:, None]
    energy = 0.5 * float(w @ w)
    missed = abs(float(normal[0] + friction[0]) - (0.5 * float(after @ after) - energy)) / energy
    # Both works must give the change of kinetic energy; otherwise the path is not trusted.
    if missed > SOLVED:
        status = "unconverged"
    path = ", ".join(modes)
    return FrictionResult(impulse[None], after, law, status, 1.0, missed, (path,), normal, friction, compression)


def clip_to_cone(impulse: FloatArray, mu: float) -> FloatArray:
    """Clip an impulse (normal, t1, t2) to its friction cone: normal part >= 0, tangential part at most mu times that."""
    normal = max(float(impulse[0]), 0.0)
    length, most = float(np.hypot(impulse[1], impulse[2])), mu * normal
    # Iterations end within SOLVED of the cone; friction beyond mu times the normal impulse is excluded exactly.
    share = 1.0 if length <= most else WITHIN * most / length
    return np.array([normal, share * impulse[1], share * impulse[2]])
