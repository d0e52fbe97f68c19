"""Rigid-body quantities as pure functions of (model, data): masses, momenta, energies, Jacobians, the reduced model.

All need current kinematics (``mj_forward``). Spatial vectors are about the world origin, linear part first: a twist is
(velocity of the body-fixed point at the origin, angular velocity), a wrench (force, moment about the origin) and a
momentum (P, L about the origin), all in world axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.magnetorquers import magnetorquer_mask
from ffsm_mj.model.system import System, Tree


def mass_matrix(model: Any, data: Any) -> FloatArray:
    """Dense mass matrix M(q), shape (nv, nv), in kg, kg m and kg m^2."""
    M = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return M


def kinetic_energy(M: FloatArray, qvel: FloatArray) -> float:
    """T = qdot^T M qdot / 2 in J."""
    return float(0.5 * qvel @ (M @ qvel))


def momentum_matrix(model: Any, data: Any, body: int) -> FloatArray:
    """Map from qvel to the momentum (P, L about the world origin) of a subtree, shape (6, nv).

    Args:
        model: MuJoCo model.
        data: MuJoCo data with current kinematics.
        body: Root of the subtree; 0 is everything.
    """
    nv = model.nv
    jacobian, angular = np.empty((3, nv)), np.empty((3, nv))
    mujoco.mj_jacSubtreeCom(model, data, jacobian, body)
    mujoco.mj_angmomMat(model, data, angular, body)
    linear = model.body_subtreemass[body] * jacobian
    return np.vstack((linear, angular + skew(data.subtree_com[body]) @ linear))


def subtree_momenta(mass: float, velocity: FloatArray, centre: FloatArray, spin: FloatArray) -> FloatArray:
    """Momentum (P, L about the world origin) of a subtree, summed body by body, shape (..., 6).

    Args:
        mass: Mass of the subtree, kg.
        velocity: Velocity of its mass centre from ``mj_subtreeVel``, (..., 3).
        centre: Its mass centre, (..., 3).
        spin: Angular momentum about that centre from ``mj_subtreeVel``, (..., 3).
    """
    linear = mass * velocity
    return np.concatenate((linear, spin + np.cross(centre, linear)), axis=-1)


def base_jacobian(model: Any, data: Any, tree: Tree) -> FloatArray:
    """Twist of a tree's root about the world origin per unit rate of each base dof, shape (6, number of base dofs)."""
    jacp, jacr = np.empty((3, model.nv)), np.empty((3, model.nv))
    mujoco.mj_jacBody(model, data, jacp, jacr, tree.root)
    linear, angular = jacp[:, tree.base_dofs], jacr[:, tree.base_dofs]
    return np.vstack((linear + skew(data.xpos[tree.root]) @ angular, angular))


def base_wrench(jacobian: FloatArray, generalized: FloatArray) -> FloatArray:
    """Wrench (or momentum) about the world origin that has the given generalised components on the base dofs.

    Components that the base joints do not leave free are zero: the joints carry them.

    Args:
        jacobian: From :func:`base_jacobian`.
        generalized: Forces or momenta on the base dofs.
    """
    return np.asarray(np.linalg.lstsq(jacobian.T, generalized, rcond=None)[0], dtype=np.float64)


class BaseMomentum:
    """Momentum of a tree (P, L about the origin) from the base rows of M qdot, paper (8)-(9), for many states at once.

    If the twists of the base joints are orthonormal at the base frame's origin (a free joint; slides and hinges along
    orthogonal axes through it), their transpose is their inverse; other bases use :func:`base_wrench`.
    """

    def __init__(self, system: System, tree: Tree) -> None:
        """Check in a few configurations whether the twists of the base joints are orthonormal."""
        self._base = tree.base_dofs
        model = system.mj
        jacp, jacr = np.empty((3, model.nv)), np.empty((3, model.nv))
        self._orthonormal = True
        for data in _general_configurations(model):
            mujoco.mj_jacBody(model, data, jacp, jacr, tree.root)
            twists = np.vstack((jacp, jacr))[:, self._base]
            self._orthonormal &= np.allclose(twists.T @ twists, np.eye(twists.shape[1]), rtol=0.0, atol=1e-12)

    def momenta(self, jacp: FloatArray, jacr: FloatArray, position: FloatArray, h: FloatArray) -> FloatArray:
        """(P, L about the origin) on the components that the base leaves free; the others are arbitrary.

        Args:
            jacp: Translational Jacobians of the tree's root body, (n, 3, nv).
            jacr: Rotational Jacobians of it, (n, 3, nv).
            position: Positions of its frame, (n, 3).
            h: Generalised momenta M qdot, (n, nv).

        Returns:
            Momenta, (n, 6).
        """
        linear, angular, momentum = jacp[..., self._base], jacr[..., self._base], h[:, self._base]
        if self._orthonormal:
            P = np.einsum("nij,nj->ni", linear, momentum)
            return np.concatenate((P, np.einsum("nij,nj->ni", angular, momentum) + np.cross(position, P)), axis=1)
        jacobians = (np.vstack((v + skew(x) @ w, w)) for v, w, x in zip(linear, angular, position, strict=True))
        return np.array([base_wrench(jacobian, p) for jacobian, p in zip(jacobians, momentum, strict=True)])


def _general_configurations(model: Any) -> Iterator[Any]:
    """Data at a few pseudo-random configurations, kinematics current; the same ones in every process."""
    data = mujoco.MjData(model)
    for k in range(1, 5):
        # Not numpy.random: importing it takes as long as the rest of the set-up.
        mujoco.mj_integratePos(model, data.qpos, np.sin(k * math.e * np.arange(1.0, model.nv + 1.0)), 1.0)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield data


def free_components(system: System, tree: Tree) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Which of (P_x, P_y, P_z, L_x, L_y, L_z) about the origin a tree's base joints leave free, shape (6,).

    A component is free when the joints allow the matching unit twist in every configuration; a few are tried.
    """
    distances = np.linalg.norm(np.array(free_projectors(system, tree)) - np.eye(6), axis=1)
    return np.asarray((distances <= 1e-9).all(axis=0))


def free_projector(system: System, tree: Tree) -> FloatArray | None:
    """What a tree's base joints leave free of a wrench about the origin, shape (6, 6); None where that turns with them."""
    first, *others = free_projectors(system, tree)
    return first if np.allclose(others, first, rtol=0.0, atol=1e-9) else None


def free_projectors(system: System, tree: Tree) -> tuple[FloatArray, ...]:
    """Projectors onto the wrenches about the origin that a tree's base joints leave free, in a few configurations."""
    if not system.projectors:
        jacobians = [
            [base_jacobian(system.mj, data, other) for other in system.trees] for data in _general_configurations(system.mj)
        ]
        for other, of_tree in zip(system.trees, zip(*jacobians, strict=True), strict=True):
            inverses = np.linalg.pinv(np.array(of_tree))
            system.projectors[other.name] = tuple(map(np.matmul, of_tree, inverses))
    return system.projectors[tree.name]


def external_actuators(system: System) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mask of the motors that exert external forces on robot or objects: on a base joint, or at a site, (nu,)."""
    model = system.mj
    base = {dof for tree in system.trees for dof in range(tree.base_dofs.start, tree.base_dofs.stop)}
    mask = ~servo_mask(model) & ~magnetorquer_mask(model)
    for i in np.flatnonzero(mask).tolist():
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
            mask[i] = model.jnt_dofadr[model.actuator_trnid[i, 0]] in base
    return mask


def site_wrench(model: Any, actuator: int) -> FloatArray:
    """Wrench per unit of force of an actuator at a site, about the origin of its body's frame in its axes, shape (6,)."""
    site = model.actuator_trnid[actuator, 0]
    force, torque = model.actuator_gear[actuator].reshape(2, 3) @ rotation_matrix(model.site_quat[site]).T
    return np.concatenate((force, torque + np.cross(model.site_pos[site], force)))


def site_actuators(model: Any) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Mask of the actuators that exert a force at a site without reference site, (nu,)."""
    at_site = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_SITE)
    return np.asarray(at_site & (model.actuator_trnid[:, 1] < 0) & ~magnetorquer_mask(model))


@dataclass(frozen=True)
class ReducedModel:
    """Dynamics of the driven joints with everything else of the robot floating (paper (22); design section 5).

    Attributes:
        M_c: Reduced mass matrix, (n_a, n_a).
        c_c: Reduced bias, (n_a,): M_c qdd_a + c_c = u.
        alpha: Generalised Jacobian, (p, n_a).
        drift: Output acceleration at u = 0, (p,): ydd = drift + alpha M_c^-1 u.
    """

    M_c: FloatArray
    c_c: FloatArray
    alpha: FloatArray
    drift: FloatArray


def reduced_model(
    M: FloatArray, c: FloatArray, J: FloatArray, Jdot_qdot: FloatArray, a: IntArray, b: IntArray
) -> ReducedModel:
    """Eliminate the undriven dofs b from M qdd + c = (u on a, 0 on b), exactly and for any momentum.

    Args:
        M: Mass matrix of the robot, (n, n).
        c: Bias minus every known force, (n,).
        J: Output Jacobian, (p, n).
        Jdot_qdot: Its rate times qdot, (p,).
        a: Indices of the driven dofs.
        b: Indices of all others.
    """
    M_ba = M[np.ix_(b, a)]
    solved = np.linalg.solve(M[np.ix_(b, b)], np.column_stack((M_ba, c[b])))
    gain, bias_b = solved[:, :-1], solved[:, -1]
    M_c = M[np.ix_(a, a)] - M_ba.T @ gain
    c_c = c[a] - M_ba.T @ bias_b
    alpha = J[:, a] - J[:, b] @ gain
    drift = Jdot_qdot - J[:, b] @ bias_b - alpha @ np.linalg.solve(M_c, c_c)
    return ReducedModel(M_c, c_c, alpha, drift)


def skew(v: FloatArray) -> FloatArray:
    """Matrix of the cross product: ``skew(v) @ w == cross(v, w)``."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def cross(v: FloatArray, w: FloatArray) -> FloatArray:
    """Cross product of two vectors of three, to the bits of ``numpy.cross``, which takes ten times as long."""
    (a, b, c), (x, y, z) = v.tolist(), w.tolist()
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))


def tangents(normal: FloatArray) -> FloatArray:
    """Unit vectors t1, t2 with (n, t1, t2) right-handed and orthonormal, (2, 3).

    A function of the normal alone, so that a run repeats bit for bit. The first is built from the coordinate axis furthest
    from the normal; in a planar scene it is exactly the axis perpendicular to the plane.

    Args:
        normal: Unit vector, (3,).
    """
    x, y, z = normal.tolist()  # plain floats: of three numbers, these are faster than arrays
    sizes = (abs(x), abs(y), abs(z))
    # The axis furthest from the normal has the longest cross product with it, at least sqrt(2/3): no cancellation.
    a, b, c = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))[sizes.index(min(sizes))]
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    return np.array(((a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)))


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix of a unit quaternion (w, x, y, z), (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def rotation_dofs(model: Any) -> list[slice]:
    """The angular part of every free and ball joint in ``qvel``."""
    parts = []
    offsets = {int(mujoco.mjtJoint.mjJNT_FREE): 3, int(mujoco.mjtJoint.mjJNT_BALL): 0}
    for kind, first in zip(model.jnt_type.tolist(), model.jnt_dofadr.tolist(), strict=True):
        if kind in offsets:
            parts.append(slice(first + offsets[kind], first + offsets[kind] + 3))
    return parts


def with_signs_of(model: Any, qpos: FloatArray, other: FloatArray) -> FloatArray:
    """Coordinates, (..., nq), with the sign of each quaternion that is nearer to others: q and -q are one rotation."""
    aligned = qpos.copy()
    for dofs in rotation_dofs(model):
        joint = model.dof_jntid[dofs.start]
        end = int(model.jnt_qposadr[joint]) + (7 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE else 4)
        quaternion = aligned[..., end - 4 : end]
        with np.errstate(invalid="ignore"):  # states of a damaged log may not be finite
            opposite = (quaternion * other[..., end - 4 : end]).sum(axis=-1) < 0.0
        quaternion[opposite] *= -1.0
    return aligned
