"""The paper's own equations of an elastic impact, as an oracle: momentum (17) and energy (18) with (16) substituted.

The unknowns are the object's twist after the impact (6) and the normal impulse (1). The momentum equations are linear in
all of them, so the twist is expressed through the impulse; the energy equation is then a quadratic with the trivial root
(no impact) and the elastic one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.impact.resolution import Contact
from ffsm_mj.dynamics.rigid_body import base_jacobian, kinetic_energy, mass_matrix, momentum_matrix
from ffsm_mj.model.system import System


@dataclass(frozen=True)
class PaperSolution:
    """Solution of (16)-(18).

    Attributes:
        impulse: Normal impulse on the object along the contact normal, N s (the paper's -I_e,n in the case study).
        robot_qvel: Generalised velocities of the FFSM after the impact, from (16).
        object_qvel: Generalised velocities of the object after the impact.
        slope: M^-1 J^T n of the FFSM, the factors of I_e,n in the paper's (35).
    """

    impulse: float
    robot_qvel: FloatArray
    object_qvel: FloatArray
    slope: FloatArray


def solve_paper_system(system: System, data: Any, contact: Contact) -> PaperSolution:
    """Solve (17) and (18) with (16) for one elastic contact between the robot and one object.

    Unlike :mod:`ffsm_mj.contact_models.impact.resolution`, this forms neither the contact Jacobian of the object nor the
    effective mass: the velocity of the object follows from the momentum that the FFSM loses.

    Args:
        system: Robot and objects.
        data: State before the impact, kinematics current.
        contact: The contact; its restitution is ignored and taken as 1.

    Raises:
        ValueError: The contact is not between the robot (a) and a floating object (b).
    """
    model = system.mj
    tree = system.tree_of_body(contact.body_b)
    if tree not in system.objects or contact.body_a not in system.robot.bodies:
        raise ValueError("the paper's equations are for one contact of the robot (a) on a floating object (b)")
    M = mass_matrix(model, data)
    robot, target = system.robot.dofs, tree.dofs
    v, v_o = np.array(data.qvel[robot]), np.array(data.qvel[target])
    jacobian = np.empty((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, np.asarray(contact.point), contact.body_a)
    slope = _solve(M[robot, robot], jacobian[:, robot].T @ contact.normal)

    # (17): the momentum about the origin that the FFSM loses per unit impulse is the gain of the object.
    lost = momentum_matrix(model, data, system.robot.root)[:, robot] @ slope
    gained = momentum_matrix(model, data, tree.root)[:, target]
    allowed = base_jacobian(model, data, tree)
    # A planar object cannot take all six components of a momentum: the equations count along the motions of its base alone.
    slope_o = _solve(allowed.T @ gained, allowed.T @ lost)

    # (18): T(v - slope I) + T_o(v_o + slope_o I) = T(v) + T_o(v_o), divided by I.
    M_r, M_o = M[robot, robot], M[target, target]
    # The division takes away the root I = 0, of no impact. What is left is linear, and needs no choice of a root.
    linear = float(slope_o @ M_o @ v_o - slope @ M_r @ v)
    quadratic = kinetic_energy(M_r, slope) + kinetic_energy(M_o, slope_o)
    impulse = -linear / quadratic
    return PaperSolution(impulse, v - slope * impulse, v_o + slope_o * impulse, slope)


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
