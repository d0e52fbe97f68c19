"""Rotors of reaction wheels: bodies whose rotation stores angular momentum and changes nothing else of the robot."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ffsm_mj.model.system import Joint, System

_BALANCED = 1e-9
"""Relative difference of principal inertias, and offset of the mass centre from the axis in m, that count as rounding."""


def rotors(system: System) -> tuple[Joint, ...]:
    """Joints of the rotors of reaction wheels, in the order of the model.

    A rotor is a body without children that one unlimited hinge joins to the base of the robot, with a driven joint, its mass
    centre on the axis and its inertia symmetric about it. Its momentum is then the spin I_a times the joint rate along the
    axis, in addition to what it has as a part of the base.
    """
    model, driven = system.mj, _driven(system.mj)
    return tuple(joint for joint in system.robot.joints if joint.kind == "hinge" and _is_rotor(model, system, joint, driven))


def _driven(model: Any) -> set[int]:
    """Joints that have an actuator."""
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    return set(model.actuator_trnid[on_joint, 0].tolist())


def _is_rotor(model: Any, system: System, joint: Joint, driven: set[int]) -> bool:
    body, index = joint.body, int(model.joint(joint.name).id)
    alone = model.body_jntnum[body] == 1 and body not in model.body_parentid.tolist()
    if not alone or model.body_parentid[body] != system.robot.root or model.jnt_limited[index] or index not in driven:
        return False
    axis = model.jnt_axis[index]
    offset = np.cross(model.body_ipos[body] - model.jnt_pos[index], axis)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    frame = turn.reshape(3, 3)
    inertia = (frame * model.body_inertia[body]) @ frame.T
    across = np.eye(3) - np.outer(axis, axis)
    # Symmetric about the axis: the axis is principal, and the part across it is a multiple of the identity there.
    rest = across @ inertia @ across - 0.5 * np.trace(across @ inertia @ across) * across
    products = across @ inertia @ axis
    allowed = _BALANCED * float(np.trace(inertia))
    return bool(np.linalg.norm(offset) <= _BALANCED and max(np.abs(rest).max(), np.abs(products).max()) <= allowed)
