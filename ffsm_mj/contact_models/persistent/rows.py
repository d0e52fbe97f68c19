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
from ffsm_mj.dynamics.body_twists import BodyTwists, RelativeJacobian, RelativeScrews
from ffsm_mj.dynamics.motion import Motion


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """One contact feature of a pair, or a joint limit."""

    pair: UnilateralConstraint
    feature: Feature


class _Group(NamedTuple):
    """Points evaluated together, their places among all, which bodies are b and a, and whether the pair has friction."""

    points: PointGroup
    places: slice
    b: int
    a: int
    rubs: bool


class RowEvaluator:
    """Evaluates the rows of some contact points of a motion, state by state.

    Attributes:
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
        self._motion, self._data, self._shape = motion, data, (len(contact_points), motion.model.nv)
        bodies: dict[int, int] = {}
        self._groups = []
        together = point_runs(contact_points)
        groups_of_pairs = Counter(contact_points[places.start].pair for places in together)
        # Points over one face have one normal anyway.
        patches = {pair for pair in flat if groups_of_pairs[pair] > 1}
        for places in together:
            alike, pair = contact_points[places], contact_points[places.start].pair
            b, a = motion.bodies[pair.body_b], motion.bodies[pair.body_a]
            both = motion.model, motion.data, b, a
            points: PointGroup
            if len(alike) > 1:
                on_face = [each.feature for each in alike if isinstance(each.feature, PointOnFace)]
                points = FaceGroup(on_face, RelativeScrews(*both), in_patch=pair in patches)
            else:
                points = SinglePoint(alike[0].feature, RelativeJacobian(*both), in_patch=pair in patches)
            own, other = (bodies.setdefault(body, len(bodies)) for body in (b, a))
            self._groups.append(_Group(points, places, own, other, pair.mu > 0.0))
        self._twists = BodyTwists(motion.model, motion.data, list(bodies))
        self._still = [None] * len(bodies)
        self._needs_twists = bool(patches) or any(isinstance(group.points, FaceGroup) for group in self._groups)
        limits = {i: each.pair for i, each in enumerate(contact_points) if isinstance(each.pair, JointLimit)}
        self.at_limits = list(limits)
        self._limits = [(i, motion.dofs[limit.dof], limit.sign) for i, limit in limits.items()]

    def rows(self) -> ContactRows:
        """Rows of the normals; positions and velocities current, mass matrix factored."""
        states = self._at_state(with_twists=self._needs_twists)
        J, gamma = np.empty(self._shape), np.empty(self._shape[0])
        for group, state in zip(self._groups, states, strict=True):
            state.normal_rows(J[group.places], gamma[group.places])
        for i, dof, sign in self._limits:
            J[i, dof] = sign
        return ContactRows(states, J, gamma, self._response(J))

    def frictional_rows(self) -> FrictionalRows:
        """Rows of normals and tangents; positions and velocities current, mass matrix factored."""
        groups, (k, nv) = self._at_state(with_twists=True), self._shape
        J, gamma, axes = np.zeros((k, 3, nv)), np.zeros((k, 3)), np.zeros((k, 3, 3))
        for group, state in zip(self._groups, groups, strict=True):
            places, normals = group.places, state.normals
            axes[places, 0] = normals
            if group.rubs:
                axes[places, 1:] = tangents(normals[0])
                state.frictional_rows(axes[places.start], J[places], gamma[places])
            else:
                state.normal_rows(J[places, 0], gamma[places, 0])
        for i, dof, sign in self._limits:
            J[i, 0, dof] = sign
        J = J.reshape(3 * k, nv)
        return FrictionalRows(groups, axes, J, gamma.reshape(-1), self._response(J), np.array(self._motion.data.qvel))

    def _at_state(self, *, with_twists: bool) -> list[GroupState]:
        twists = self._twists.at_state() if with_twists else self._still
        return [group.points.at_state(self._data, twists[group.b], twists[group.a]) for group in self._groups]

    def _response(self, J: FloatArray) -> FloatArray:
        """J M^-1, like J."""
        response = np.empty_like(J)
        mujoco.mj_solveM(self._motion.model, self._motion.data, response, J)
        return response


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
