"""Bound on the rate of a hinge or slide joint by the kinetic energy of the system, in any configuration.

The joint connects two rigid groups, a and b, of mass m and inertia I about their centres of mass. A generalised force on the
joint acts on them as a couple along the hinge axis n, or as a pair of forces along the line of a slide. Any further
constraint only reduces the response, so that of the two free groups bounds it:

    hinge:  (M^-1)_jj <= n . (I_a^-1 + I_b^-1) n
    slide:  (M^-1)_jj <= 1 / m_a + 1 / m_b + (r x n) . I_a^-1 (r x n),   r from the centre of a to that of b

If the joint is the only one between the two, n is fixed in both groups, and r x n does not change as b slides along n: the
bound holds in every configuration. Then |rate| <= sqrt((M^-1)_jj) sqrt(2 T).
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray

_INERTIA_ROUNDING = 1e-14
"""Relative error of an eigenvalue of a sum of inertias, against the largest one: about 1e-16, with a margin."""


def rate_per_root_energy(model: Any, data: Any, joint: int) -> float:
    """Bound on |rate| / sqrt(2 T) of a hinge or slide joint; infinite if no energy bounds the rate.

    Args:
        model: MuJoCo model.
        data: Its data, positions current.
        joint: Id of the joint.
    """
    body, armature = int(model.jnt_bodyid[joint]), float(model.dof_armature[model.jnt_dofadr[joint]])
    response = _free_response(model, data, joint) if model.body_jntnum[body] == 1 else math.inf
    # The armature is an inertia of its own that turns with the joint: the kinetic energies add.
    inertia = armature + (1.0 / response if response > 0.0 else math.inf)
    return 1.0 / math.sqrt(inertia) if inertia > 0.0 else math.inf


def _free_response(model: Any, data: Any, joint: int) -> float:
    """Bound on (M^-1)_jj without armature, 1/(kg m^2) or 1/kg; infinite if rounding decides a moment of inertia."""
    body, axis = int(model.jnt_bodyid[joint]), data.xaxis[joint]
    groups = [_group(model, data, int(each)) for each in (model.body_parentid[body], body)]
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
        return sum(_compliance(inertia, axis) for _, _, inertia in groups)
    (mass_a, centre_a, inertia_a), (mass_b, centre_b, _) = groups
    return 1.0 / mass_a + 1.0 / mass_b + _compliance(inertia_a, np.cross(centre_b - centre_a, axis))


def _group(model: Any, data: Any, body: int) -> tuple[float, FloatArray, FloatArray | None]:
    """Mass, centre of mass and inertia of the bodies welded to a body, world axes; infinite and None for the world."""
    weld = model.body_weldid[body]
    if not weld:
        return math.inf, np.zeros(3), None
    members = np.flatnonzero(model.body_weldid == weld)
    masses, centres = model.body_mass[members], data.xipos[members]
    mass = float(masses.sum())
    centre = masses @ centres / mass
    inertia = np.zeros((3, 3))
    for member, m, c in zip(members, masses, centres - centre, strict=True):
        axes = data.ximat[member].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[member]) @ axes.T + m * ((c @ c) * np.eye(3) - np.outer(c, c))
    return mass, centre, inertia


def _compliance(inertia: FloatArray | None, couple: FloatArray) -> float:
    """Angular acceleration along a couple per unit couple, times its square; infinite where rounding decides it."""
    if inertia is None:
        return 0.0
    sizes, axes = np.linalg.eigh(inertia)
    along = axes.T @ couple
    if not sizes[0] > _INERTIA_ROUNDING * sizes[-1]:
        return math.inf
    return float(np.sum(along * along / sizes))
