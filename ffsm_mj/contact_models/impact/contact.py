"""A contact point of two bodies, or a joint at its limit, and its rows of the contact Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.loops.mass_weighted import without_rounding


@dataclass(frozen=True)
class Contact:
    """Two bodies in contact at one point.

    Attributes:
        body_a: Body id of the first body; the impulse on it points along ``-normal``.
        body_b: Body id of the second body; the impulse on it points along ``normal``.
        point: Common contact point in world axes, (3,), m.
        normal: Unit normal from the first body to the second in world axes, (3,).
        restitution: Coefficient e: 1 elastic, 0 plastic, above 1 super-elastic (the paper's case c).
        mu: Coefficient of Coulomb friction, >= 0.
    """

    body_a: int
    body_b: int
    point: FloatArray
    normal: FloatArray
    restitution: float = 1.0
    mu: float = 0.0


@dataclass(frozen=True)
class LimitContact:
    """A joint at one end of its range: the impulse acts on the joint alone, without friction.

    Attributes:
        dof: Degree of freedom of the hinge or slide joint.
        sign: 1 at the lower limit, -1 at the upper one: the row of the Jacobian is this times the unit vector of the dof.
        restitution: Coefficient e, 0 to 1.
        row: Row of the Jacobian of a tendon, whose degree of freedom is one of its tree, (nv,); empty for a joint.
    """

    dof: int
    sign: float
    restitution: float = 0.0
    row: tuple[float, ...] = ()
    mu: ClassVar[float] = 0.0


def contact_jacobian(model: Any, data: Any, contact: Contact | LimitContact) -> FloatArray:
    """J_n = n^T (J_b(p) - J_a(p)), shape (nv,): the normal velocity of b relative to a; for a limit, the rate of its gap.

    Both bodies are evaluated at the one common point, so that the pair of impulses has no moment and L is conserved exactly.
    A row in which the two parts cancel to rounding is zero, as for two links whose hinge axis meets the normal.
    """
    if isinstance(contact, LimitContact):
        unit = np.eye(1, model.nv, contact.dof)[0]
        at_limit: FloatArray = np.array(contact.row) if contact.row else contact.sign * unit
        return at_limit
    jac_a, jac_b = _jacobians(model, data, contact)
    return _rows(np.asarray(contact.normal, dtype=np.float64)[None], jac_a, jac_b).reshape(-1)


def contact_rows(model: Any, data: Any, contact: Contact | LimitContact, tangents: FloatArray) -> FloatArray:
    """Velocity of b relative to a along the normal and two tangents, as rows of a Jacobian, (3, nv).

    The tangent rows of a joint limit are zero.

    Args:
        model: MuJoCo model.
        data: Its data, kinematics current.
        contact: The contact; its normal is the first direction.
        tangents: Two unit vectors across the normal in world axes, (2, 3).
    """
    if isinstance(contact, LimitContact):
        return np.stack([contact_jacobian(model, data, contact), *np.zeros((2, model.nv))])
    jac_a, jac_b = _jacobians(model, data, contact)
    return _rows(np.vstack((np.asarray(contact.normal, dtype=np.float64), tangents)), jac_a, jac_b)


def _jacobians(model: Any, data: Any, contact: Contact) -> tuple[FloatArray, FloatArray]:
    """Jacobians of both bodies at the common point, (3, nv) each."""
    jac_a, jac_b = np.empty((3, model.nv)), np.empty((3, model.nv))
    point = np.asarray(contact.point, dtype=np.float64)
    mujoco.mj_jac(model, data, jac_a, None, point, contact.body_a)
    mujoco.mj_jac(model, data, jac_b, None, point, contact.body_b)
    return jac_a, jac_b


def _rows(directions: FloatArray, jac_a: FloatArray, jac_b: FloatArray) -> FloatArray:
    terms = sum(np.linalg.norm(directions @ each, axis=1) for each in (jac_a, jac_b))
    return without_rounding(directions @ (jac_b - jac_a), terms)
