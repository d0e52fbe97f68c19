"""Contact Jacobians: gap' = J qdot and gap'' = J qddot + gamma for each contact point and joint limit, at one state.

With friction, rows of two tangents follow each normal: the relative velocity u = v_b(c) - v_a(c) of the two material points
at the contact point c, which moves at c' over both, has the rate

    u' = a_b(c) + omega_b x (c' - v_b(c)) - a_a(c) - omega_a x (c' - v_a(c))

along tangents that are fixed in space, with the accelerations a(c) of the material points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.constraint import UnilateralConstraint
from ffsm_mj.contact.features.gap_function import Feature
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact.features.points_on_face import PointsOnFace
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact_models.impact.friction.tangents import tangents
from ffsm_mj.contact_models.persistent.face_group import FaceGroup
from ffsm_mj.contact_models.persistent.point_groups import GroupState, PointGroup
from ffsm_mj.contact_models.persistent.point_rows import ContactRows, FrictionalRows
from ffsm_mj.contact_models.persistent.single_point import SinglePoint
from ffsm_mj.contact_models.persistent.wrench_rows import WrenchRows
from ffsm_mj.dynamics.body_twists import BodyTwists, PairTwist, PairTwistRows
from ffsm_mj.dynamics.motion import Motion


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit."""

    pair: UnilateralConstraint
    feature: Feature


class _Group(NamedTuple):
    """Points evaluated together, their places among all, which pair of bodies they are of, and whether it has friction."""

    points: PointGroup
    places: slice
    bodies: int
    rubs: bool


class RowEvaluator:
    """Evaluates the rows of some contact points of a motion, state by state.

    The rows of a point are combinations of the six of the relative twist of its bodies, see ``wrench_rows.py``. The mass
    matrix is solved for the rows of the points or for those of the twists, whichever are fewer.

    Attributes:
        data: Data of the logged system.
        at_limits: Indices of the joint limits among the contact points.
    """

    def __init__(
        self,
        motion: Motion,
        data: Any,
        contact_points: Sequence[ContactPoint],
        flat: Collection[UnilateralConstraint] = (),
    ) -> None:
        """Group the contact points.

        Args:
            motion: The motion.
            data: Data of the logged system.
            contact_points: Pairs and features.
            flat: Pairs that are held at three points of a flat patch at least.
        """
        self._motion, self.data, self._shape = motion, data, (len(contact_points), motion.model.nv)
        pairs: dict[tuple[int, int], int] = {}
        self._groups = []
        together = point_runs(contact_points)
        groups_of_pairs = Counter(contact_points[places.start].pair for places in together)
        # Points over one face have one normal anyway.
        patches = {pair for pair in flat if groups_of_pairs[pair] > 1}
        for places in together:
            alike, pair = contact_points[places], contact_points[places.start].pair
            both, points = (motion.bodies[pair.body_b], motion.bodies[pair.body_a]), _points(alike, in_patch=pair in patches)
            self._groups.append(_Group(points, places, pairs.setdefault(both, len(pairs)), pair.mu > 0.0))
        # Rows of each group, for normals only and with two tangents.
        self._parts = {n: [slice(n * run.start, n * run.stop) for run in together] for n in (1, 3)}
        self._bodies = list(dict.fromkeys(body for both in pairs for body in both))
        self._pairs = [(self._bodies.index(b), self._bodies.index(a)) for b, a in pairs]
        self._twists = BodyTwists(motion.model, motion.data, self._bodies)
        limits = {i: each.pair for i, each in enumerate(contact_points) if isinstance(each.pair, JointLimit)}
        self.at_limits = list(limits)
        # Of the twists of all pairs, then of the limits, which are rows of their own.
        self._own_rows, self._end = np.zeros((6 * len(pairs) + len(limits), motion.model.nv)), 6 * len(pairs)
        self._responses = np.zeros_like(self._own_rows)
        self._twist_rows = PairTwistRows(motion.model, motion.data, list(pairs), self._own_rows[: self._end])
        for row, limit in enumerate(limits.values(), self._end):
            self._own_rows[row, motion.dofs[limit.dof]] = limit.sign

    def rows(self) -> ContactRows:
        """Rows of the normals; positions and velocities current, mass matrix factored."""
        groups, k = self._at_state(), self._shape[0]
        wrenches, gamma = np.empty((k, 6)), np.empty(k)
        for group, state in zip(self._groups, groups, strict=True):
            state.normal_rows(wrenches[group.places], gamma[group.places])
        return ContactRows(groups, self._wrenches(wrenches[:, None]), *self._with_responses(wrenches[:, None]), gamma)

    def frictional_rows(self) -> FrictionalRows:
        """Rows of normals and tangents; positions and velocities current, mass matrix factored."""
        groups, k = self._at_state(), self._shape[0]
        wrenches, gamma, axes = np.zeros((k, 3, 6)), np.zeros((k, 3)), np.zeros((k, 3, 3))
        for group, state in zip(self._groups, groups, strict=True):
            places, normals = group.places, state.normals
            axes[places, 0] = normals
            if group.rubs:
                axes[places, 1:] = tangents(normals[0])
                state.frictional_rows(axes[places.start], wrenches[places], gamma[places])
            else:
                state.normal_rows(wrenches[places, 0], gamma[places, 0])
        qvel = np.array(self._motion.data.qvel)
        of_twists = self._wrenches(wrenches), *self._with_responses(wrenches)
        return FrictionalRows(groups, *of_twists, gamma.reshape(-1), axes, qvel)

    def _with_responses(self, wrenches: FloatArray) -> tuple[FloatArray, FloatArray]:
        """J and J M^-1 for n rows of each point, (k, n, 6)."""
        model, data, own = self._motion.model, self._motion.data, self._own_rows
        J = self._combined(wrenches, own)
        if len(J) > len(own):
            mujoco.mj_solveM(model, data, self._responses, own)
            return J, self._combined(wrenches, self._responses)
        response = np.empty(J.shape)
        if len(J):
            mujoco.mj_solveM(model, data, response, J)
        return J, response

    def _combined(self, wrenches: FloatArray, own: FloatArray) -> FloatArray:
        """Rows of the points, (k n, nv), from those of the twists and limits."""
        k, n, _ = wrenches.shape
        combined = np.empty((k * n, self._shape[1]))
        if self._end == len(own) == 6:  # one pair of bodies
            return np.dot(wrenches.reshape(-1, 6), own, out=combined)
        of_points = combined.reshape(k, n, self._shape[1])
        for group in self._groups:
            of_points[group.places] = wrenches[group.places].dot(own[6 * group.bodies : 6 * group.bodies + 6])
        for row, i in enumerate(self.at_limits, self._end):
            of_points[i, 0] = own[row]
        return combined

    def _wrenches(self, wrenches: FloatArray) -> WrenchRows:
        """Wrench rows, (k, n, 6), with the groups and centres that they belong to."""
        return WrenchRows(wrenches.reshape(-1, 6), self._parts[wrenches.shape[1]], self._centres)

    def _at_state(self) -> list[GroupState]:
        twists = self._twists.at_state()
        pairs = [PairTwist.of(twists[b], twists[a]) for b, a in self._pairs]
        self._twist_rows.write()
        states, self._centres = [], []
        for group in self._groups:
            twist = pairs[group.bodies]
            self._centres.append(twist.b.centre)
            states.append(group.points.at_state(self.data, twist))
        return states


def _points(alike: Sequence[ContactPoint], *, in_patch: bool) -> PointGroup:
    """Points that are evaluated together, or a single one."""
    if len(alike) == 1:
        return SinglePoint(alike[0].feature, in_patch=in_patch)
    return FaceGroup([each.feature for each in alike if isinstance(each.feature, PointOnFace)], in_patch=in_patch)


def point_runs(contact_points: Sequence[ContactPoint]) -> list[slice]:
    """Runs of contact points that are evaluated together."""
    starts = [
        i
        for i, each in enumerate(contact_points)
        if i == 0
        or each.pair is not contact_points[i - 1].pair
        or not PointsOnFace.together(contact_points[i - 1].feature, each.feature)
    ]
    return [slice(start, end) for start, end in pairwise([*starts, len(contact_points)])]


def rows(motion: Motion, data: Any, contact_points: Sequence[ContactPoint]) -> ContactRows:
    """Compute the rows of some contact points once; see :class:`RowEvaluator`."""
    return RowEvaluator(motion, data, contact_points).rows()


def frictional_rows(motion: Motion, data: Any, contact_points: Sequence[ContactPoint]) -> FrictionalRows:
    """Compute the rows of normals and tangents of some contact points once; see :class:`RowEvaluator`."""
    return RowEvaluator(motion, data, contact_points).frictional_rows()
