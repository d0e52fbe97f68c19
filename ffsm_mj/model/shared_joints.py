"""Joints that two systems share: the scene as it begins, and the same with a grasped object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.model.system import System


class SharedJoints(NamedTuple):
    """Places of shared joints in two systems, in the same order in both.

    Attributes:
        qpos: Indices in ``qpos`` of the first system, and of the second, (n,) each.
        dofs: Indices in ``qvel`` of the first system, and of the second, (m,) each.
    """

    qpos: tuple[IntArray, IntArray]
    dofs: tuple[IntArray, IntArray]


def shared_joints(first: System, second: System) -> SharedJoints:
    """Joints that have the same name in both systems."""
    names = [name for name in first.joints if name in second.joints]
    systems = [[system.joints[name] for name in names] for system in (first, second)]
    qpos, dofs = ([_indices([getattr(each, key) for each in joints]) for joints in systems] for key in ("qpos", "dofs"))
    return SharedJoints((qpos[0], qpos[1]), (dofs[0], dofs[1]))


def _indices(parts: list[slice]) -> IntArray:
    return np.array([i for part in parts for i in range(part.start, part.stop)], dtype=np.intp)
