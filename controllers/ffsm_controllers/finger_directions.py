"""Which way the joints of fingers close a gripper, from the places of the fingers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import FloatArray, System

_CLEAR = 0.05
"""Least cosine between the motion of a finger and the way to the others that is clear."""


def closing_signs(system: System, joints: Sequence[str]) -> FloatArray:
    """Sign of the motion of each joint that brings its finger nearer to the others; 0 where that is not clear.

    A finger is a branch of the body that carries all of them; its place is its mass centre, with limited joints in the
    middle of their range. Of a single finger it is not clear.
    """
    model = system.mj
    bodies = [system.joints[name].body for name in joints]
    data = _in_mid_range(model, joints)
    roots = _branches(model, bodies)
    centres = {root: data.subtree_com[root].copy() for root in roots}
    jacobian, signs = np.empty((3, model.nv)), np.zeros(len(joints))
    for i, (name, body, root) in enumerate(zip(joints, bodies, roots, strict=True)):
        others = [centre for other, centre in centres.items() if other != root]
        if not others:
            continue
        mujoco.mj_jacSubtreeCom(model, data, jacobian, body)
        moves = jacobian[:, system.joints[name].dofs.start]
        towards = np.mean(others, axis=0) - data.subtree_com[body]
        along = float(moves @ towards)
        if abs(along) > _CLEAR * float(np.linalg.norm(moves) * np.linalg.norm(towards)):
            signs[i] = np.sign(along)
    return signs


def _in_mid_range(model: Any, joints: Sequence[str]) -> Any:
    data = mujoco.MjData(model)
    for name in joints:
        joint = model.joint(name)
        if model.jnt_limited[joint.id]:
            data.qpos[model.jnt_qposadr[joint.id]] = model.jnt_range[joint.id].mean()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def _branches(model: Any, bodies: Sequence[int]) -> list[int]:
    """For each body the child of the deepest body that carries all of them; a body itself if it carries all."""
    chains = [_chain(model, body) for body in bodies]
    depth = 0
    while all(len(chain) > depth + 1 for chain in chains) and len({chain[depth] for chain in chains}) == 1:
        depth += 1
    return [chain[min(depth, len(chain) - 1)] for chain in chains]


def _chain(model: Any, body: int) -> list[int]:
    """Bodies from the root of a tree to a body."""
    chain = [body]
    while model.body_parentid[chain[0]]:
        chain.insert(0, int(model.body_parentid[chain[0]]))
    return chain
