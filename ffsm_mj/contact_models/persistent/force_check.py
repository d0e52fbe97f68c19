"""Independent check of persistent contact forces, recomputed from logged states and efforts by other functions.

Contact points and gap accelerations come from the support functions of the geoms (:mod:`ffsm_mj.contact.proximity`), not
from contact features. Without friction, all closed pairs enter one complementarity problem.

A state alone cannot distinguish a closed point from one that has lifted off by a picometre and carries no force. Which of
the candidate points are closed is therefore taken from the contact model of the replay, unless another point overlaps by
more than the detection depth.

With friction, accelerations come from the support functions too, and Jacobians from those of impacts. The modes are those
of the replay, except that a point slides where its velocity says so. The forces of redundant points are those of equal
springs, by a singular value decomposition.

The forces found in these modes must satisfy Coulomb's conditions: no normal force pulls, those of sticking points are
inside their cones, friction of sliding points opposes their slip, and no gap of a point without force closes.

Independent of what computes the forces of a run are thus points, normals, gap accelerations, Jacobians, Delassus matrix and
the solution for the forces. Shared are the mass matrix and the smooth forces, which are MuJoCo's, and those of external
fields, whose impulses the check *field impulse* computes again; the choice among candidate points; the modes, and the
directions of slips too slow to have one; the rows of closed loops and of joints that stick; the shares of forces inside
their cones (:func:`~ffsm_mj.contact_models.persistent.friction.internal_forces.least_in_cones`), of which any will do. A
wrong point or mode fails by the forces that it needs, unless these satisfy all conditions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.contact.broad_phase import BroadPhase
from ffsm_mj.contact.features.gap_function import FeatureState
from ffsm_mj.contact.pairs import ContactPair, UnilateralConstraint, by_kind
from ffsm_mj.contact.proximity import Proximity, SecondRate
from ffsm_mj.contact.union_pair import UnionProximity
from ffsm_mj.contact_models.impact.laws import least_norm, project
from ffsm_mj.contact_models.impact.resolution import Contact, LimitContact, as_contact, contact_jacobian, contact_rows
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.contact_models.persistent.closed_contacts import ClosedContacts
from ffsm_mj.contact_models.persistent.closing import closed_and_still, closed_rate_tolerance
from ffsm_mj.contact_models.persistent.columns import force_key, state_key
from ffsm_mj.contact_models.persistent.contact_points import ContactPoint
from ffsm_mj.contact_models.persistent.friction.cones import cone_depth
from ffsm_mj.contact_models.persistent.friction.internal_forces import least_in_cones
from ffsm_mj.contact_models.persistent.friction.modes import PointMode, unit_slips
from ffsm_mj.contact_models.persistent.rule_columns import force_keys, mode_key
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix, tangents
from ffsm_mj.records.signals import Layout
from ffsm_mj.tolerances import (
    CLEARLY_APART_M,
    FLUSH_M,
    LANDING_DEPTH_M,
    PARALLEL,
    RANK,
    SAME_POINT_M,
)

_SLIPS_M_S = 1e-6
"""Slip above this has a direction of its own; below, points may keep that of an earlier state until they stop."""
_ROUNDINGS = 10.0
"""A gap closes, or a force pulls, where it accelerates the gap by more than its rounding times this; a slip has a direction
of its own where it differs from that of the replay by more than the rounding of slips times this."""
_CORNER = 1e-2
"""Normals of a patch and of its contact points differ by less than this, along round sides that lean too; in a corner by
more."""
_FIRST_ROW = np.array((1.0, 0.0, 0.0))
_LIFTS_M_S = 1e-3
"""A closed point without force that lifts off stays listed up to DRIFT_M: at 1000 m/s^2 it has this speed there."""


class PointAgain(NamedTuple):
    """A closed point of a pair, found by other functions."""

    pair: UnilateralConstraint
    near: Proximity
    point: FloatArray
    rate: SecondRate


def resultants_with_friction(
    closed: ClosedContacts,
    points: Sequence[PointAgain],
    contacts: Sequence[Contact | LimitContact],
    motion: Motion,
    data: Any,
    M: FloatArray,
) -> tuple[dict[UnilateralConstraint, FloatArray], float]:
    """Resultant force on geom b of each pair, N; the first component for a joint limit, N or N m.

    The second value is the largest violation of Coulomb's conditions by the forces of single points, N.

    Args:
        closed: The closed contacts of the replay, with their modes.
        points: Closed points.
        contacts: The same in the coordinates of the motion.
        motion: The motion, with accelerations without contact forces in its data, or in a copy.
        data: Its data or the copy.
        M: Its mass matrix.
    """
    axes = [_axes(point) for point in points]
    J = np.stack(
        [contact_rows(motion.model, data, contact, across[1:]) for contact, across in zip(contacts, axes, strict=True)]
    )
    b = np.array(
        [(point.rate.value, *(across[1:] @ point.rate.acceleration)) for point, across in zip(points, axes, strict=True)]
    )
    u, mu = J @ data.qvel, np.array([point.pair.mu for point in points])
    kinds, rounding = _modes(closed, points, u)
    A = _weighted(motion, M, J.reshape(-1, J.shape[2]))
    forces = _in_cones(A, _forces(A, b.ravel(), *_active_rows(closed, points, axes, u, kinds)), mu, kinds)
    rates = (b.ravel() + A @ (A.T @ forces.ravel()))[::3]
    violation = _violation(forces, mu, kinds, rates, np.sum(A[::3] ** 2, axis=1), rounding)
    resultants: dict[UnilateralConstraint, FloatArray] = {}
    for point, across, force in zip(points, axes, forces, strict=True):
        vector = force[0] * _FIRST_ROW if point.pair.is_limit else force @ across
        resultants[point.pair] = resultants.get(point.pair, np.zeros(3)) + vector
    return resultants, violation


def _weighted(motion: Motion, M: FloatArray, J: FloatArray) -> FloatArray:
    """Rows in mass-weighted coordinates, with closed loops and the joints that dry friction keeps at rest held, (n, nv).

    In an impact these joints move: ``motion.constrained`` does not hold them.
    """
    L = np.linalg.cholesky(M)
    free = np.linalg.solve(L, J.T).T
    if motion.loops is None:
        return np.asarray(free)
    # With the projection P = Mc^-1 M of the rows held, P M^-1 P^T = Mc^-1.
    constrained = motion.loops.response(J) @ L
    # Of a row that loops and friction hold altogether rounding is left, by which no force may be divided.
    constrained[np.linalg.norm(constrained, axis=1) <= RANK * np.linalg.norm(free, axis=1)] = 0.0
    return np.asarray(constrained)


def _axes(point: PointAgain) -> FloatArray:
    """Normal and tangents of a point, (3, 3); zero tangents without friction."""
    across = tangents(point.near.normal) if point.pair.mu > 0.0 else np.zeros((2, 3))
    return np.vstack((point.near.normal, across))


def _modes(closed: ClosedContacts, points: Sequence[PointAgain], u: FloatArray) -> tuple[IntArray, float]:
    """Modes of the points, (k,), and the rounding of their accelerations, m/s^2.

    Velocities of points that stick in the replay may drift like the gap rates of closed pairs; faster ones slide.
    """
    decision = closed.decide()
    replayed = dict(zip(decision.contact_points, decision.kinds.tolist(), strict=True))
    kinds = np.full(len(points), PointMode.CLOSED, dtype=np.int64)
    for i, point in enumerate(points):
        contact = _same_point(closed, point)
        # A candidate that the replay does not have carries no force. If it should, its gap closes, which is a violation.
        kinds[i] = replayed[contact] if contact is not None else PointMode.CLOSED
        # The velocity decides, not the replay: a run that takes a sliding point for a sticking one fails by its forces.
        if kinds[i] == PointMode.STICK and math.hypot(*u[i, 1:].tolist()) > closed_rate_tolerance(point.near):
            kinds[i] = PointMode.SLIDE
    return kinds, _ROUNDINGS * float(decision.rounding.max(initial=0.0))


def _forces(A: FloatArray, b: FloatArray, active: Sequence[int], along: FloatArray) -> FloatArray:
    """Forces (n, t1, t2) of equal springs that hold some rows, N, (k, 3).

    Args:
        A: Rows J L^-T, (3k, nv).
        b: Accelerations without contact forces, m/s^2, (3k,).
        active: Indices of the rows held.
        along: Directions along which their forces act, (3k, rows held).
    """
    if not len(active):
        return np.zeros((len(b) // 3, 3))
    U, sizes, _ = np.linalg.svd(A[active], full_matrices=False)
    # Singular values of A are the roots of the eigenvalues of A A^T, of which the run drops those below RANK.
    U = U[:, sizes > math.sqrt(RANK) * sizes[0]]
    system = U.T @ A[active] @ (along.T @ A).T @ U
    shares = U @ np.linalg.lstsq(system, -U.T @ b[active], rcond=None)[0]
    return np.asarray(along @ shares).reshape(-1, 3)


def _in_cones(A: FloatArray, forces: FloatArray, mu: FloatArray, kinds: IntArray) -> FloatArray:
    """Forces with the shares of sticking points inside their cones, if others of the same effect are, (k, 3)."""
    sticks = np.flatnonzero(kinds == PointMode.STICK)
    # Of redundant points any share inside the cones will do: one outside is no violation while another is inside.
    if not len(sticks) or cone_depth(forces[sticks], mu[sticks]) >= 0.0:
        return forces
    rows = A.reshape(len(forces), 3, -1)[sticks].reshape(3 * len(sticks), -1)
    U, sizes, _ = np.linalg.svd(rows)
    free = U[:, int(np.count_nonzero(sizes > math.sqrt(RANK) * sizes[0])) :]
    if not free.shape[1]:
        return forces
    shared = forces.copy()
    shared[sticks] = least_in_cones(forces[sticks], free, mu[sticks])
    return shared


def _violation(
    forces: FloatArray, mu: FloatArray, kinds: IntArray, rates: FloatArray, inverse_mass: FloatArray, rounding: float
) -> float:
    """Largest violation of the inequalities, as a force in N.

    Args:
        forces: Forces (n, t1, t2), N, (k, 3).
        mu: Coefficients of friction, (k,).
        kinds: Modes, (k,).
        rates: Second rates of the gaps, m/s^2, (k,).
        inverse_mass: Inverse mass along each normal, 1/kg, (k,).
        rounding: Rounding of the rates, m/s^2.
    """
    sticks, moves = kinds == PointMode.STICK, inverse_mass > 0.0
    outside = -cone_depth(forces[sticks], mu[sticks]) if sticks.any() else 0.0
    # Normal forces that pull, and gaps that close.
    negative = np.where(kinds == PointMode.CLOSED, rates, forces[:, 0] * inverse_mass)[moves]
    # Compared as accelerations, of which the rounding is known; where no force moves a gap, neither says anything.
    normal = np.maximum(-negative - rounding, 0.0) / inverse_mass[moves]
    return max(outside, float(normal.max(initial=0.0)), 0.0)


def _active_rows(
    closed: ClosedContacts, points: Sequence[PointAgain], axes: Sequence[FloatArray], u: FloatArray, kinds: IntArray
) -> tuple[list[int], FloatArray]:
    """Indices of the rows held in some modes, and the directions along which their forces act, (3k, rows)."""
    decision = closed.decide()
    replayed = zip(decision.directions, decision.rows.speed_rounding.tolist(), strict=True)
    known = dict(zip(decision.contact_points, replayed, strict=True))
    active: list[int] = []
    columns: list[FloatArray] = []
    for i, (point, across) in enumerate(zip(points, axes, strict=True)):
        contact, kind = _same_point(closed, point), int(kinds[i])
        if kind in (PointMode.SLIDE, PointMode.STICK):
            column = np.zeros(3 * len(points))
            column[3 * i] = 1.0
            if kind == PointMode.SLIDE and point.pair.mu > 0.0:
                assert contact is not None
                direction, rounding = known[contact]
                along = _direction(u[i, 1:], across[1:] @ direction, rounding)
                column[3 * i + 1 : 3 * i + 3] = -point.pair.mu * along
            active.append(3 * i)
            columns.append(column)
        if kind == PointMode.STICK:
            for row in (3 * i + 1, 3 * i + 2):
                active.append(row)
                columns.append(np.eye(1, 3 * len(points), row)[0])
    return active, np.array(columns).reshape(-1, 3 * len(points)).T


def _direction(u: FloatArray, replayed: FloatArray, rounding: float) -> FloatArray:
    """Direction of slip along the tangents: that of the slip, or of the replay where the slip says nothing else.

    Friction turns by the rounding of a slip over the slip: by 1e-7 rad at 2e-5 m/s, which is more than forces may differ.
    """
    speed, (slip, unit) = math.hypot(*u.tolist()), unit_slips(np.array((u, replayed)))
    # A point that sticks in the replay has no direction there.
    says_else = speed > _SLIPS_M_S and speed * math.dist(slip, unit) > _ROUNDINGS * rounding
    return np.asarray(slip if says_else or not unit.any() else unit)


def _same_point(closed: ClosedContacts, point: PointAgain) -> ContactPoint | None:
    """The contact point of the replay at the place of a point."""
    if point.pair.is_limit:
        return next(iter(closed.by_pair.get(point.pair, ())), None)
    apart = [
        (math.dist(state.point, point.point), i, contact)
        for i, (contact, state) in enumerate(closed.states_of(point.pair))
        if _is_along(state, point.near)
    ]
    nearest = min(apart, default=None)
    # Support functions and features place the corners of a mesh by different numbers of single precision.
    return nearest[-1] if nearest is not None and nearest[0] <= SAME_POINT_M else None


def _is_along(state: FeatureState, near: Proximity) -> bool:
    """Whether a contact point is of a patch: in a corner of unions points of several normals are at one place."""
    return not isinstance(near, UnionProximity) or math.dist(state.normal, near.normal) <= _CORNER


class ForceCheck:
    """Compares the logged contact forces of rows with those recomputed from the state of the row.

    Attributes:
        places: See :class:`~ffsm_mj.contact_models.interface.LoggedForces`.
    """

    def __init__(self, scene: Scene, pairs: Sequence[UnilateralConstraint], closed: ClosedContacts, layout: Layout) -> None:
        """Bind to the data, which holds the state of the row at each call, and to the closed contacts of the replay."""
        self._scene, self._pairs, self._closed_set = scene, tuple(pairs), closed
        geoms, limits = by_kind(pairs)
        self._limits, self._rules = limits, tuple(dict.fromkeys(pair.rule for pair in geoms))
        self._forces = layout.places(key for rule in self._rules for key in force_keys(rule))
        self._modes = layout.places(mode_key(rule) for rule in self._rules)
        self._limit_forces = layout.places(map(force_key, limits))
        self._limit_states = layout.places(map(state_key, limits))
        self.places = np.concatenate((self._forces, self._modes, self._limit_forces, self._limit_states))
        self._signs = np.array([limit.sign for limit in limits])
        self._names = (*self._rules, *(limit.name for limit in limits))
        self._nothing = np.zeros((len(self._names), 3)), frozenset[str]()
        self._broad_phase = BroadPhase(scene.system.mj, self._pairs)
        self._scratch = mujoco.MjData(scene.system.mj)

    def residual(self, row: FloatArray) -> float:
        """Largest difference between recomputed and logged resultant forces in a row, N; 0 if no pair is closed.

        It includes the forces of joint limits, in N m for a hinge, and with friction the largest violation of Coulomb's
        conditions by the recomputed forces of single points.
        """
        motion = self._closed_set.motion
        # Open contacts have zeros in all these columns, as in most rows of most runs.
        logged, closed = self._logged(row) if row[self.places].any() else self._nothing
        closed_pairs = {pair for pair in self._closed_set.by_pair if pair.rule in closed}
        touching = [
            (pair, near)
            for pair in (self._pairs[i] for i in self._broad_phase.within(self._scene.data, CLEARLY_APART_M))
            # Geoms that a grasp joins to one rigid body touch without any force.
            if pair.geom_ids not in motion.disabled
            for near in self._closed(pair, pair in closed_pairs)
        ]
        if not touching and not logged.any():
            return 0.0
        sums = dict.fromkeys(self._names, np.zeros(3))
        resultants, violation = self._resultants(touching, motion)
        for pair, force in resultants.items():
            sums[pair.rule] = sums[pair.rule] + force
        apart = [float(np.linalg.norm(force - sums[name])) for name, force in zip(self._names, logged, strict=True)]
        return max(violation, *apart)

    def _logged(self, row: FloatArray) -> tuple[FloatArray, frozenset[str]]:
        """Logged force of each rule and joint limit, as in :meth:`_resultants`, (n, 3), and the names of closed ones."""
        at_limits = np.zeros((len(self._limits), 3))
        # One column holds the force of both limits of a joint, positive at the lower one.
        at_limits[:, 0] = np.maximum(self._signs * row[self._limit_forces], 0.0)
        closed = np.concatenate((row[self._modes] > 0.0, self._signs * row[self._limit_states] < 0.0))
        names = frozenset(name for name, is_closed in zip(self._names, closed.tolist(), strict=True) if is_closed)
        return np.concatenate((row[self._forces].reshape(-1, 3), at_limits)), names

    def _closed(self, pair: UnilateralConstraint, lasts: bool) -> Iterator[Proximity]:
        """Patches of a pair that are closed."""
        model, data = self._scene.system.mj, self._scene.data
        if pair.gap(model, data) > CLEARLY_APART_M:
            return
        for near in pair.proximities(model, data):
            # MuJoCo stores mesh vertices in single precision: with several touching, the gap is known no better than that.
            seen = replace(near, gap=near.gap - pair.position_tolerance) if lasts else near
            if closed_and_still(seen, _LIFTS_M_S if lasts else near.rate_tolerance):
                yield near

    def _states_of(self, pair: UnilateralConstraint, near: Proximity) -> list[FeatureState]:
        """States of the contact points of a patch in the replay."""
        return [state for _, state in self._closed_set.states_of(pair) if pair.is_limit or _is_along(state, near)]

    def _resultants(
        self, touching: Sequence[tuple[UnilateralConstraint, Proximity]], motion: Motion
    ) -> tuple[dict[UnilateralConstraint, FloatArray], float]:
        """Resultant force on geom b of each pair, N; the first component for a joint limit, N or N m.

        The second value is the violation of Coulomb's conditions, N; zero without friction.
        """
        points = [
            (pair, proximity, point)
            for pair, near in touching
            for proximity, point in _points_with_normals(pair, near, self._states_of(pair, near))
        ]
        if not points:
            return {}, 0.0
        contacts = [as_contact(pair, near, point, motion, 0.0) for pair, near, point in points]
        with self._free_motion(motion) as (seen, moving):
            model = self._scene.system.mj
            second_rates = [pair.second_rate(model, seen, near, point) for pair, near, point in points]
            rates = np.array([rate.value for rate in second_rates])
            M = mass_matrix(motion.model, moving)
            if any(pair.mu > 0.0 for pair, *_ in points):
                again = [PointAgain(*values, rate) for values, rate in zip(points, second_rates, strict=True)]
                return resultants_with_friction(self._closed_set, again, contacts, motion, moving, M)
            A = _weighted(motion, M, np.stack([contact_jacobian(motion.model, moving, contact) for contact in contacts]))
        # Without friction the problem is convex: one projection gives the accelerations, least norm the shares of the
        # convention.
        forces = least_norm(A, project(A, np.linalg.lstsq(A, rates, rcond=None)[0]))
        resultants: dict[UnilateralConstraint, Any] = {}
        for (pair, near, _), force in zip(points, forces.tolist(), strict=True):
            along = _FIRST_ROW if pair.is_limit else near.normal
            resultants[pair] = resultants.get(pair, np.zeros(3)) + force * along
        return resultants, 0.0

    @contextmanager
    def _free_motion(self, motion: Motion) -> Iterator[tuple[Any, Any]]:
        """Context with data of the system and of the motion, holding the accelerations without contact forces.

        State and efforts are those of the row; forces of other contact models are included.
        """
        model, data, scratch = self._scene.system.mj, self._scene.data, self._scratch
        if motion.data is data and motion.loops is None:
            # In a copy: what the replay has evaluated at this state stays as it is.
            state = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))
            mujoco.mj_getState(model, data, state, WHOLE_STATE)
            mujoco.mj_setState(model, scratch, state, WHOLE_STATE)
            motion.push_without_contacts(scratch)
            yield scratch, scratch
            return
        # Loops and the motion of a grasp are bound to their own data: evaluated there, and put back.
        applied = motion.data.qfrc_applied.copy()
        try:
            motion.data.ctrl[:] = data.ctrl
            motion.push_without_contacts(motion.data)
            motion.path.on_event_located()
            yield data, motion.data
        finally:
            motion.data.qfrc_applied[:] = applied
            mujoco.mj_forward(motion.model, motion.data)
            motion.path.on_event_located()


def _points_with_normals(
    pair: UnilateralConstraint, near: Proximity, states: Sequence[FeatureState]
) -> list[tuple[Proximity, FloatArray]]:
    """Points of a pair that are closed, each with the proximity that has its normal."""
    # Along round sides the normal turns a little from end to end, by more than forces may differ.
    if isinstance(pair, ContactPair) and pair.flush_angle > 0.0:
        ends = _ends_of_side(pair, near, states)
        # A deeper overlap is that of a point that the contact model does not have: then the support functions decide alone.
        if ends and near.gap >= -LANDING_DEPTH_M:
            return ends
    return [(near, point) for point in _closed_points(near, [state.point for state in states])]


def _closed_points(near: Proximity, closed_points: Sequence[FloatArray]) -> list[FloatArray]:
    """Candidate points of a pair that are closed, given its contact points in the contact model.

    All corners of a face that is flat to 1e-6 rad are candidates; corners that open are no longer in contact.
    """
    points = [(point, abs(rate)) for point, rate in zip(near.points, near.rates.tolist(), strict=True)]
    closed = [
        point
        for point, speed in points
        if speed <= _LIFTS_M_S and any(math.dist(point, other) <= SAME_POINT_M for other in closed_points)
    ]
    if closed and near.gap >= -LANDING_DEPTH_M:
        return closed
    # The replay has no point here, or overlaps deeper than a landing is seen: all that is at rest is in contact.
    return [point for point, speed in points if speed <= closed_rate_tolerance(near)]


def _ends_of_side(pair: ContactPair, near: Proximity, states: Sequence[FeatureState]) -> list[tuple[Proximity, FloatArray]]:
    """The same where a round side lies along another one or across a cap: normals at its ends differ by a small angle."""
    # Until the middle of two sides that turn against each other lands, they part by as much at their ends.
    angle = max(PARALLEL, math.sqrt(LANDING_DEPTH_M / FLUSH_M) * pair.flush_angle)
    return [
        (replace(near, normal=state.normal), state.point)
        for state in states
        if math.dist(state.normal, near.normal) <= angle
    ]
