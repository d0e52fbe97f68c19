"""Forces of patches whose points all stick, inside a step: they hold the twist of two bodies, and need no points.

The rows of k points of one pair are J = W T, with the six rows T of the twist of b relative to a. Three points that are not
on a line hold the whole twist. Where all three axes of each are held, and moments are about the middle of the points,

    W^T W = diag(S, k),   S = sum(|r|^2 - r r^T) over the arms r

which does not change in axes of b while they stick. With W^T W = L L^T, forces y along the rows L^T T are the forces
W L^-T y, of least norm, at the points.

Bodies that stick have no relative twist. Where stages have one, of the order of the step, its rate is zero all the same: the
motion differs from that with rows of points by less than the error of the method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.persistent.exchange import TwistStage
from ffsm_mj.contact_models.persistent.friction.linear_systems import cholesky_factor, least_norm_forces
from ffsm_mj.contact_models.persistent.point_rows import PointRows
from ffsm_mj.contact_models.persistent.rows import ContactPoint, point_runs
from ffsm_mj.contact_models.persistent.wrench_rows import Wrench
from ffsm_mj.dynamics.body_twists import chain
from ffsm_mj.dynamics.motion import Motion

_UNIT: FloatArray = np.eye(3)
_FLAT = 1e-6
"""Points are on a line where a pivot of S is below this share of the largest."""


class Patch(NamedTuple):
    """Points of one pair that stick.

    Attributes:
        body_b: Body b in the model of the motion.
        body_a: Body a.
        middle: Middle of the points in axes of body b, from its frame, m, (3,).
        turns: Transposed factor of S in these axes, m, (3, 3).
        root: Square root of the number of points.
    """

    body_b: int
    body_a: int
    middle: FloatArray
    turns: FloatArray
    root: float

    @classmethod
    def of(cls, data: Any, bodies: tuple[int, int], points: FloatArray) -> Patch | None:
        """The patch of some points, m, (k, 3), of bodies b and a at the state in ``data``; None if they are on a line."""
        k, R = len(points), data.xmat[bodies[0]].reshape(3, 3)
        places = (points - data.xpos[bodies[0]]).dot(R)
        middle = places.sum(axis=0) / k
        arms = places - middle
        squares = arms.T.dot(arms)
        factor = cholesky_factor((squares[0, 0] + squares[1, 1] + squares[2, 2]) * _UNIT - squares, _FLAT)
        return None if factor is None else cls(*bodies, middle, factor.T, math.sqrt(k))


class HeldTwists:
    """Evaluates the forces of some patches, state by state, if each is the only one of its bodies."""

    def __init__(self, motion: Motion, contact_points: Sequence[ContactPoint]) -> None:
        """Find the patches, and take views of the arrays of the motion, which MuJoCo does not move."""
        self._motion, self._runs, nv = motion, point_runs(contact_points), motion.model.nv
        pairs = [contact_points[run.start].pair for run in self._runs]
        self._bodies = [(motion.bodies[pair.body_b], motion.bodies[pair.body_a]) for pair in pairs]
        self._are_patches = (
            motion.loops is None
            and len(set(self._bodies)) == len(pairs)
            and all(run.stop - run.start > 2 for run in self._runs)
            and not any(isinstance(pair, JointLimit) for pair in pairs)
        )
        self._patches: list[Patch] = []
        self._J, self._response, self._bias = *np.empty((2, 6 * len(pairs), nv)), np.empty(6 * len(pairs))
        self._of_b, self._of_a = np.empty((2, 6, nv))
        bodies = list(dict.fromkeys(body for both in self._bodies for body in both))
        self._chains = np.array([chain(motion.model, body) for body in bodies])
        self._pairs = [(bodies.index(b), bodies.index(a)) for b, a in self._bodies]
        data, roots = motion.data, motion.model.body_rootid
        self._centres = [data.subtree_com[int(roots[body])] for body in bodies]
        self._frames = [(data.xpos[b], data.xmat[b].reshape(3, 3)) for b, _ in self._bodies]
        self._qvel, self._screw_rates = data.qvel, data.cdof_dot

    def begin(self, rows: PointRows) -> bool:
        """Take the places of the points, with their rows at the current state; returns whether they hold the twists."""
        self._patches.clear()
        if not self._are_patches:
            return False
        for run, bodies in zip(self._runs, self._bodies, strict=True):
            patch = Patch.of(self._motion.data, bodies, rows.points[run])
            if patch is None:
                return False
            self._patches.append(patch)
        return True

    def stage(self, force: FloatArray) -> tuple[TwistStage, FloatArray]:
        """The stage at the current state, and the generalised contact forces, (nv,); mass matrix factored.

        Args:
            force: Generalised forces without the contact forces, less the bias, (nv,).
        """
        model, data = self._motion.model, self._motion.data
        rates = (self._chains * self._qvel).dot(self._screw_rates).tolist()
        centres = [centre.tolist() for centre in self._centres]
        turned = []
        for i, (patch, (b, a), (origin, R)) in enumerate(zip(self._patches, self._pairs, self._frames, strict=True)):
            place, turns = origin + R.dot(patch.middle), patch.turns.dot(R.T)
            self._write_rows(6 * i, patch, place, turns)
            at = place.tolist()
            alpha, acceleration = _relative(_rate_at(rates[b], centres[b], at), _rate_at(rates[a], centres[a], at))
            self._bias[6 * i : 6 * i + 3] = turns.dot(alpha)
            self._bias[6 * i + 3 : 6 * i + 6] = [patch.root * each for each in acceleration]
            turned.append((at, turns, patch.root))
        mujoco.mj_solveM(model, data, self._response, self._J)
        forces = least_norm_forces(self._response.dot(self._J.T), self._response.dot(force) + self._bias)
        generalised = forces.dot(self._J)
        wrenches = [_about_origin(forces[6 * i : 6 * i + 6], *each) for i, each in enumerate(turned)]
        return TwistStage(generalised * self._qvel, wrenches), generalised

    def _write_rows(self, start: int, patch: Patch, place: FloatArray, turns: FloatArray) -> None:
        """Write the rows of a patch with its middle at a place."""
        model, data, of_b, of_a = self._motion.model, self._motion.data, self._of_b, self._of_a
        mujoco.mj_jac(model, data, of_b[3:], of_b[:3], place, patch.body_b)
        mujoco.mj_jac(model, data, of_a[3:], of_a[:3], place, patch.body_a)
        np.subtract(of_b, of_a, out=of_b)
        np.dot(turns, of_b[:3], out=self._J[start : start + 3])
        np.multiply(of_b[3:], patch.root, out=self._J[start + 3 : start + 6])


def _rate_at(rate: Sequence[float], centre: Sequence[float], place: Sequence[float]) -> tuple[float, ...]:
    """Rate of a twist at zero joint accelerations about a place fixed in space, of that about the centre of its tree."""
    p, q, r, x, y, z = rate
    i, j, k = place[0] - centre[0], place[1] - centre[1], place[2] - centre[2]
    return p, q, r, x + q * k - r * j, y + r * i - p * k, z + p * j - q * i


def _relative(b: Sequence[float], a: Sequence[float]) -> tuple[list[float], list[float]]:
    """Angular and linear part of the difference of two of these."""
    both = [mine - other for mine, other in zip(b, a, strict=True)]
    return both[:3], both[3:]


def _about_origin(forces: FloatArray, place: Sequence[float], turns: FloatArray, root: float) -> Wrench:
    """Force, and moment about the world origin, of forces along the rows of a patch."""
    a, b, c = forces[:3].dot(turns).tolist()
    x, y, z = (root * each for each in forces[3:].tolist())
    i, j, k = place
    return x, y, z, a + j * z - k * y, b + k * x - i * z, c + i * y - j * x
