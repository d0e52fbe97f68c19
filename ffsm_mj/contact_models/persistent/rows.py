"""Contact Jacobians: gap' = J qdot and gap'' = J qddot + gamma for each contact point and joint limit, at one state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.gap_function import Feature, FeatureState
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.dynamics.motion import Motion


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit."""

    pair: UnilateralConstraint
    feature: Feature


class ContactRows(NamedTuple):
    """Contact points at one state, in the coordinates of a motion.

    Attributes:
        states: Gap, rate, normal and contact points of each contact point.
        J: Derivative of each gap rate with respect to the generalised velocity, (k, nv).
        gamma: Part of each gap'' that does not depend on accelerations, m/s^2, (k,).
        response: J M^-1, (k, nv).
        G: Delassus matrix J M^-1 J^T, 1/kg, (k, k): gap'' at one contact per unit force at another.
    """

    states: tuple[FeatureState, ...]
    J: FloatArray
    gamma: FloatArray
    response: FloatArray
    G: FloatArray


def rows(motion: Motion, data: Any, contact_points: Sequence[ContactPoint]) -> ContactRows:
    """Compute the rows of some contact points.

    Args:
        motion: The current motion; positions and velocities current, mass matrix factored.
        data: Data of the logged system, at the same state.
        contact_points: Pairs and features.
    """
    model, moving, bodies = motion.model, motion.data, motion.bodies
    k, nv, qvel = len(contact_points), model.nv, moving.qvel
    J, gamma = np.empty((k, nv)), np.empty(k)
    of_b, of_a, rate_b, rate_a = motion.jacobian_buffers
    states = tuple([contact.feature.at(data) for contact in contact_points])
    for i, (contact, here) in enumerate(zip(contact_points, states, strict=True)):
        if isinstance(contact.pair, JointLimit):
            J[i], gamma[i] = 0.0, 0.0
            J[i, motion.dofs[contact.pair.dof]] = contact.pair.sign
            continue
        a, b = bodies[contact.pair.body_a], bodies[contact.pair.body_b]
        mujoco.mj_jac(model, moving, of_b, None, here.point, b)
        mujoco.mj_jac(model, moving, of_a, None, here.point, a)
        mujoco.mj_jacDot(model, moving, rate_b, None, here.point_b, b)
        mujoco.mj_jacDot(model, moving, rate_a, None, here.point_a, a)
        of_b -= of_a
        rate_b -= rate_a
        J[i] = here.normal.dot(of_b)
        # n . (Jdot qdot) of the material points, and the curvature terms of the moving contact point.
        gamma[i] = here.normal.dot(rate_b).dot(qvel) + here.bend
    response = np.empty((k, nv))
    mujoco.mj_solveM(model, moving, response, J)
    return ContactRows(states, J, gamma, response, response.dot(J.T))
