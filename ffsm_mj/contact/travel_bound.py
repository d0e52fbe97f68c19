"""Bounds on how far joint motion moves two geoms towards each other.

The point of a geom that is farthest from a hinge moves by at most its distance from the hinge times the angle. That distance
has a bound in all configurations: the sum of the offsets along the kinematic chain. It is constant unless the chain has a
slide joint beyond the hinge, whose displacement lengthens it; such a bound holds up to a stated displacement.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray

_SLIDE, _FREE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE)
_DOFS = {_FREE: 6, int(mujoco.mjtJoint.mjJNT_BALL): 3, _SLIDE: 1, int(mujoco.mjtJoint.mjJNT_HINGE): 1}
_SLIDE_ALLOWANCE_M = 0.5
"""Displacement of a slide joint beyond its present one for which the bounds hold."""


class TravelBound:
    """Bounds on the closing of pairs of geoms per unit of motion of each degree of freedom.

    Attributes:
        rows: Largest closing of each pair per m or rad of motion of each degree of freedom, (n, nv).
        slides: Degrees of freedom of slide joints that lengthen a lever arm, (k,).
    """

    def __init__(self, model: Any, qpos: FloatArray, geoms: Sequence[tuple[int, int]]) -> None:
        """Compute the bounds.

        Args:
            model: MuJoCo model.
            qpos: Configuration from which displacements of slide joints are measured.
            geoms: Ids of the geoms of each pair.
        """
        self._model = model
        ids = np.array(geoms, dtype=np.intp).reshape(-1, 2)
        chains = [_chain(model, int(body)) for body in range(model.nbody)]
        used = sorted({int(model.geom_bodyid[g]) for g in ids.ravel()})
        levers = {joint for body in used for joint in _lengthening(model, chains[body])}
        self._joints = np.array(sorted(levers), dtype=np.intp)
        self.slides: npt.NDArray[np.intp] = np.asarray(model.jnt_dofadr[self._joints], dtype=np.intp)
        self._lengths = np.zeros(model.njnt)
        slides = np.flatnonzero(model.jnt_type == _SLIDE)
        self._lengths[slides] = np.abs(qpos[model.jnt_qposadr[slides]]) + _SLIDE_ALLOWANCE_M
        arms = np.zeros((model.ngeom, model.nv))
        for geom in set(ids.ravel().tolist()):
            self._add_arms(arms[geom], geom, chains[int(model.geom_bodyid[geom])])
        first, second = arms[ids[:, 0]], arms[ids[:, 1]]
        # A degree of freedom that moves both geoms moves them as one rigid body: it does not change their distance.
        self.rows: FloatArray = np.where((first > 0.0) & (second > 0.0), 0.0, first + second)

    def slide_allowance(self, qpos: FloatArray) -> FloatArray:
        """Displacement of each slide joint of ``slides`` for which the bounds still hold, m, (k,)."""
        return np.asarray(self._lengths[self._joints] - np.abs(qpos[self._model.jnt_qposadr[self._joints]]))

    def _add_arms(self, arms: FloatArray, geom: int, chain: Sequence[int]) -> None:
        """Set the lever arms of one geom, walking from its body to the root."""
        model = self._model
        length = float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom])
        for body in reversed(chain):
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            for joint in reversed(range(first, first + count)):
                kind, dof = int(model.jnt_type[joint]), int(model.jnt_dofadr[joint])
                offset = float(np.linalg.norm(model.jnt_pos[joint]))
                arms[dof : dof + _DOFS[kind]] = length + offset
                if kind == _SLIDE:
                    arms[dof] = 1.0
                    length += float(self._lengths[joint])
                elif kind == _FREE:
                    arms[dof : dof + 3] = 1.0
                else:
                    length += 2.0 * offset  # the body's origin circles the anchor
            length += float(np.linalg.norm(model.body_pos[body]))


def _chain(model: Any, body: int) -> list[int]:
    """Bodies from the root to a body, without the world."""
    found: list[int] = []
    while body:
        found.insert(0, body)
        body = int(model.body_parentid[body])
    return found


def _lengthening(model: Any, chain: Sequence[int]) -> list[int]:
    """Slide joints of a chain that follow a joint that rotates."""
    found, rotates = [], False
    for body in chain:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for joint in range(first, first + count):
            if int(model.jnt_type[joint]) != _SLIDE:
                rotates = True
            elif rotates:
                found.append(joint)
    return found
