"""Coordinates with dry friction, as a compiled scene has them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.model.system import System


class FrictionCoordinates(NamedTuple):
    """The k hinges and slides with dry friction, in the order of their degrees of freedom.

    Attributes:
        joints: Full names of the joints.
        units: Units of their coordinates, ``rad`` or ``m``.
        dofs: Their degrees of freedom in the logged system, (k,).
        places: Their places in ``qpos`` of the logged system, (k,).
        limits: Greatest friction f: static as kinetic, N m or N, (k,); MuJoCo's ``frictionloss``, URDF's ``friction``.
        of_trees: Whether each is of a tree, the robot first, (number of trees, k).
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    dofs: IntArray
    places: IntArray
    limits: FloatArray
    of_trees: BoolArray


def friction_coordinates(system: System) -> FrictionCoordinates | None:
    """Coordinates of a system that have dry friction; None: there are none."""
    loss = system.mj.dof_frictionloss
    scalar = [each for each in system.joints.values() if each.kind in ("hinge", "slide") and loss[each.dofs.start] > 0.0]
    if not scalar:
        return None
    joints = sorted(scalar, key=lambda joint: joint.dofs.start)
    dofs = np.array([joint.dofs.start for joint in joints], dtype=np.intp)
    return FrictionCoordinates(
        tuple(joint.name for joint in joints),
        tuple("rad" if joint.kind == "hinge" else "m" for joint in joints),
        dofs,
        np.array([joint.qpos.start for joint in joints], dtype=np.intp),
        np.array(loss[dofs], dtype=np.float64),
        np.array([[tree.dofs.start <= dof < tree.dofs.stop for dof in dofs] for tree in system.trees]),
    )
