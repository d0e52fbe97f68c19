"""The gaps of touching features as functions of the motion: gap' = J qdot and gap'' = J qddot + gamma, at one state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.feature import Feature, FeatureState
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.dynamics.motion import Motion


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """A pair, and one feature by which it touches."""

    pair: ContactPair
    feature: Feature


class ContactRows(NamedTuple):
    """Touches at one state, in the coordinates of what moves.

    Attributes:
        held: Where they are.
        J: Rate of each gap by generalised velocity, (k, nv).
        gamma: What of each gap'' is not J qddot, m/s^2, (k,).
        response: J M^-1, (k, nv).
        G: What a force at one contact does to the gap'' of another, J M^-1 J^T, 1/kg, (k, k).
    """

    held: tuple[FeatureState, ...]
    J: FloatArray
    gamma: FloatArray
    response: FloatArray
    G: FloatArray


def rows(motion: Motion, data: Any, touches: Sequence[ContactPoint]) -> ContactRows:
    """Rows of some touches.

    Args:
        motion: What moves; positions and velocities current, the mass matrix factored.
        data: The data of the system that is logged, at the same state.
        touches: Pairs and features.
    """
    model, moving, bodies = motion.model, motion.data, motion.bodies
    k, nv, qvel = len(touches), model.nv, moving.qvel
    J, gamma = np.empty((k, nv)), np.empty(k)
    of_b, of_a, rate_b, rate_a = motion.room
    held = tuple([touch.feature.at(data) for touch in touches])
    for i, (touch, here) in enumerate(zip(touches, held, strict=True)):
        a, b = bodies[touch.pair.body_a], bodies[touch.pair.body_b]
        mujoco.mj_jac(model, moving, of_b, None, here.point, b)
        mujoco.mj_jac(model, moving, of_a, None, here.point, a)
        mujoco.mj_jacDot(model, moving, rate_b, None, here.point_b, b)
        mujoco.mj_jacDot(model, moving, rate_a, None, here.point_a, a)
        of_b -= of_a
        rate_b -= rate_a
        J[i] = here.normal.dot(of_b)
        gamma[i] = here.normal.dot(rate_b).dot(qvel) + here.bend
    response = np.empty((k, nv))
    mujoco.mj_solveM(model, moving, response, J)
    return ContactRows(held, J, gamma, response, response.dot(J.T))
