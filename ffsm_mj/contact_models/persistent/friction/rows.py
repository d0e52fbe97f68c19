"""Rows of normals and tangents: relative velocity and acceleration of both bodies at each contact point, at one state.

The velocity u = v_b(c) - v_a(c) is that of the two material points at the contact point c, which moves at c' over both:

    u' = a_b(c) + omega_b x (c' - v_b(c)) - a_a(c) - omega_a x (c' - v_a(c))

with the accelerations a(c) of the material points. Along the normal the second rate of the gap has n' . u in addition. A
joint limit, and a pair without friction, has zero tangents.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.persistent.rows import ContactPoint
from ffsm_mj.dynamics.motion import Motion


class FrictionalRows(NamedTuple):
    """Contact points at one state, in the coordinates of a motion; row 3 i + j is axis j (n, t1, t2) of point i.

    Attributes:
        states: Gap, rate, normal and contact point of each contact point.
        axes: Normal and tangents of each point, world axes, (k, 3, 3).
        J: Derivative of the relative velocities with respect to the generalised velocity, (3k, nv).
        gamma: Part of the relative accelerations that does not depend on accelerations, m/s^2, (3k,).
        response: J M^-1, (3k, nv).
        G: Delassus matrix J M^-1 J^T, 1/kg, (3k, 3k).
    """

    states: tuple[FeatureState, ...]
    axes: FloatArray
    J: FloatArray
    gamma: FloatArray
    response: FloatArray
    G: FloatArray


def frictional_rows(motion: Motion, data: Any, contact_points: Sequence[ContactPoint]) -> FrictionalRows:
    """Compute the rows of some contact points.

    Args:
        motion: The current motion; positions and velocities current, mass matrix factored.
        data: Data of the logged system, at the same state.
        contact_points: Pairs and features.
    """
    model, moving, bodies = motion.model, motion.data, motion.bodies
    k, nv, qvel = len(contact_points), model.nv, moving.qvel
    J, gamma, axes = np.zeros((k, 3, nv)), np.zeros((k, 3)), np.zeros((k, 3, 3))
    states = tuple([contact.feature.at(data) for contact in contact_points])
    for i, (contact, here) in enumerate(zip(contact_points, states, strict=True)):
        if isinstance(contact.pair, JointLimit):
            J[i, 0, motion.dofs[contact.pair.dof]] = contact.pair.sign
            continue
        axes[i, 0] = here.normal
        pair = bodies[contact.pair.body_a], bodies[contact.pair.body_b]
        _normal_row(motion, here, pair, J[i, 0], gamma[i])
        if contact.pair.mu > 0.0:
            axes[i, 1:] = across = tangents(here.normal)
            (of_a, sliding_a), (of_b, sliding_b) = (_at_point(model, moving, body, here, qvel) for body in pair)
            J[i, 1:] = across @ (of_b - of_a)
            gamma[i, 1:] = across @ (sliding_b - sliding_a)
    J = J.reshape(3 * k, nv)
    response = np.empty((3 * k, nv))
    mujoco.mj_solveM(model, moving, response, J)
    return FrictionalRows(states, axes, J, gamma.reshape(-1), response, response.dot(J.T))


def _normal_row(motion: Motion, here: FeatureState, pair: tuple[int, int], row: FloatArray, gamma: FloatArray) -> None:
    """Row of the gap, and the velocity-dependent part of its second rate, as without friction."""
    model, moving, (a, b) = motion.model, motion.data, pair
    of_b, of_a, rate_b, rate_a = motion.jacobian_buffers
    mujoco.mj_jac(model, moving, of_b, None, here.point, b)
    mujoco.mj_jac(model, moving, of_a, None, here.point, a)
    mujoco.mj_jacDot(model, moving, rate_b, None, here.point_b, b)
    mujoco.mj_jacDot(model, moving, rate_a, None, here.point_a, a)
    row[:] = here.normal.dot(of_b - of_a)
    gamma[0] = here.normal.dot(rate_b - rate_a).dot(moving.qvel) + here.bend


def _at_point(model: Any, data: Any, body: int, here: FeatureState, qvel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Jacobian of a body at the contact point, (3, nv), and the part of u' that does not depend on accelerations, (3,)."""
    linear, angular, rate = np.empty((3, 3, model.nv))
    mujoco.mj_jac(model, data, linear, angular, here.point, body)
    mujoco.mj_jacDot(model, data, rate, None, here.point, body)
    over_surface = np.asarray(here.point_rate) - linear @ qvel
    return linear, rate @ qvel + np.cross(angular @ qvel, over_surface)
