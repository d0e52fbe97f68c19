# cython: boundscheck=False, wraparound=False, cdivision=True
"""Evaluation of the rows of contact points and joint limits, state by state; see ``rows.pyx`` for what they are.

The rows of a point are combinations of the six of the relative twist of its bodies, see ``contact_points.py``. Points over
faces are evaluated here, points of other features and joint limits one by one (``contact_points.py``).
"""

from collections import Counter

import numpy as np

from ffsm_mj._core.rows import PointRows
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.contact_points import point_runs
from ffsm_mj.contact_models.persistent.contact_points import SinglePoint
from ffsm_mj.dynamics.body_twists import BodyTwist, chain, PairTwist

from libc.math cimport fabs, sqrt

from ffsm_mj._core.features cimport FaceGroup, FaceState, Twist
from ffsm_mj._core.functions cimport address, mj, mjData, mjModel
from ffsm_mj._core.rows cimport RowMemory


cdef void tangents(const double* n, double* out) noexcept:
    """Two tangents of a normal, (2, 3); see ffsm_mj.contact_models.impact.friction.result."""
    cdef double x = n[0], y = n[1], z = n[2], length
    cdef int i
    # Crossed with the axis of the least component, which is at most 1 / sqrt(3): no length below sqrt(2 / 3) is divided by.
    if fabs(x) <= fabs(y) and fabs(x) <= fabs(z):
        out[0], out[1], out[2] = 0.0, -z, y
    elif fabs(y) <= fabs(z):
        out[0], out[1], out[2] = z, 0.0, -x
    else:
        out[0], out[1], out[2] = -y, x, 0.0
    length = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    for i in range(3):
        out[i] /= length
    out[3], out[4], out[5] = y * out[2] - z * out[1], z * out[0] - x * out[2], x * out[1] - y * out[0]


cdef tuple vector(const double* v):
    return v[0], v[1], v[2]


cdef class Group:
    """Points evaluated together: their places among all, their pair of bodies b and a, and whether it has friction."""


cdef class RowEvaluator:
    """Evaluates the rows of some contact points of a motion, state by state.

    The rows of a point are combinations of the six of the relative twist of its bodies: the mass matrix is solved for these.
    """

    def __init__(self, motion, data, contact_points, flat=()):
        cdef Group group
        model, self.motion, self.data = motion.model, motion, data
        self.m, self.d = <const mjModel*>address(model), <mjData*>address(motion.data)
        self.k, self.nv, self.groups = len(contact_points), model.nv, []
        bodies, pairs, runs = {}, {}, point_runs(contact_points)
        groups_of_patches = Counter(contact_points[places.start].flat_on for places in runs)
        # Three points of a flat patch hold both bodies parallel: with one normal for all, second rates are affine in the
        # place (contact_points.py).
        patches = {patch for patch in flat if groups_of_patches[patch] > 1}
        for places in runs:
            alike, pair, group = contact_points[places], contact_points[places.start].pair, Group()
            in_patch, both = contact_points[places.start].flat_on in patches, (motion.bodies[pair.body_b], motion.bodies[pair.body_a])
            features = [contact.feature for contact in alike]
            if len(alike) > 1 or (isinstance(features[0], PointOnFace) and not in_patch):
                group.on_face = FaceGroup(features, data, in_patch=in_patch)
            else:
                group.other = SinglePoint(features[0], in_patch=in_patch)
            group.start, group.count, group.rubs = places.start, len(alike), pair.mu > 0.0
            # The row of a joint is constant; that of a tendon changes with the state, and is written anew.
            group.is_limit = pair.is_limit and not pair.moves
            group.b, group.a = (bodies.setdefault(body, len(bodies)) for body in both)
            group.pair = pairs.setdefault((group.b, group.a), len(pairs))
            self.groups.append(group)
        self.counts = tuple([3 * len(contact_points[run]) for run in runs])
        self.rubs = bytes([contact.pair.mu > 0.0 for contact in contact_points])
        self.pairs = np.array(list(pairs), dtype=np.intp).reshape(-1, 2)
        self.bodies = len(bodies)
        self.memory = np.zeros((len(bodies) + 1, sizeof(Twist) // sizeof(double)))
        self.twists = <Twist*>&self.memory[0, 0]
        self.chains = np.array([chain(model, body) for body in bodies]).reshape(len(bodies), model.nv)
        self.screws, self.screw_rates = motion.data.cdof, motion.data.cdof_dot
        self.rates, self.velocities, self.centres = motion.data.qvel, motion.data.cvel, motion.data.subtree_com
        self.ids = np.array([*bodies], dtype=np.intp)
        self.roots = np.array([int(model.body_rootid[body]) for body in bodies], dtype=np.intp)
        limits = {i: contact.pair for i, contact in enumerate(contact_points) if contact.pair.is_limit}
        self.at_limits = list(limits)
        self.limits = [(i, row) for row, i in enumerate(limits, 6 * len(pairs))]
        jacobian = np.zeros((6 * len(pairs) + len(limits) + 1, self.nv))  # one more: no array is empty
        for (_, row), limit in zip(self.limits, limits.values()):
            # A limit acts on coordinates, not on bodies: its row does not follow from a twist.
            jacobian[row] = limit.row(motion.model, motion.data, motion.dofs)
        self.jacobian, self.responses = jacobian, np.zeros_like(jacobian)
        self.moving = [(jacobian[row], limit, motion) for (_, row), limit in zip(self.limits, limits.values()) if limit.moves]

    cdef int evaluate_twists(self) except -1:
        cdef Py_ssize_t body, dof
        cdef int i
        cdef double rate
        cdef const double* velocity
        cdef const double* centre
        cdef Twist* twist
        for body in range(self.bodies):
            twist = &self.twists[body]
            velocity, centre = &self.velocities[self.ids[body], 0], &self.centres[self.roots[body], 0]
            for i in range(3):
                twist.centre[i], twist.omega[i], twist.velocity[i] = centre[i], velocity[i], velocity[3 + i]
                twist.alpha[i], twist.acceleration[i] = 0.0, 0.0
            for dof in range(self.nv):
                rate = self.chains[body, dof] * self.rates[dof]
                # Degrees of freedom that do not carry the body have no share: the chain is zero there.
                if rate != 0.0:
                    for i in range(3):
                        twist.alpha[i] += rate * self.screw_rates[dof, i]
                        twist.acceleration[i] += rate * self.screw_rates[dof, 3 + i]
        return 0

    cdef int evaluate_pairs(self) except -1:
        """Rows of the twist of b relative to a, about the centre of b, for each pair, and these times M^-1."""
        cdef Py_ssize_t p, dof, n = self.nv
        cdef int i
        cdef double one, other
        cdef double[3] offset
        cdef const double* screw
        cdef double* row
        for p in range(self.pairs.shape[0]):
            for i in range(3):
                # MuJoCo's cdof is about the centre of mass of its own tree: screws of a's tree are moved to the centre of
                # b's.
                offset[i] = self.twists[self.pairs[p, 0]].centre[i] - self.twists[self.pairs[p, 1]].centre[i]
            for dof in range(n):
                one, other = self.chains[self.pairs[p, 0], dof], self.chains[self.pairs[p, 1], dof]
                screw, row = &self.screws[dof, 0], &self.jacobian[6 * p, dof]
                for i in range(6):
                    # A degree of freedom that carries both bodies as one cancels exactly here, not as a difference of two
                    # roundings.
                    row[i * n] = (one - other) * screw[i]
                if other != 0.0:
                    row[3 * n] -= screw[1] * offset[2] - screw[2] * offset[1]
                    row[4 * n] -= screw[2] * offset[0] - screw[0] * offset[2]
                    row[5 * n] -= screw[0] * offset[1] - screw[1] * offset[0]
        for line, limit, motion in self.moving:
            line[:] = limit.row(motion.model, motion.data, motion.dofs)
        if self.jacobian.shape[0] > 1:
            # The mass matrix is solved for six rows of each pair, not for three of each point: points combine the solutions.
            mj.solveM(self.m, self.d, &self.responses[0, 0], &self.jacobian[0, 0], <int>(self.jacobian.shape[0] - 1))
        return 0

    cdef int combine(self, RowMemory memory) except -1:
        """Write J and J M^-1 of all points."""
        cdef Group group
        cdef Py_ssize_t i, d, at, row, n = self.nv
        cdef int j
        cdef double share
        cdef const double* twist
        cdef const double* response
        cdef double* J
        cdef double* answers
        for group in self.groups:
            for i in range(3 * group.start, 3 * (group.start + group.count)):
                if not memory.moves(i):
                    continue
                J, answers = memory.J + i * n, memory.response + i * n
                for j in range(6):
                    share = memory.wrenches[6 * i + j]
                    # The three moments of a tangent or normal along an axis vanish often: rows of zeros are left out.
                    if share != 0.0:
                        twist, response = &self.jacobian[6 * group.pair + j, 0], &self.responses[6 * group.pair + j, 0]
                        for d in range(n):
                            J[d] += share * twist[d]
                        for d in range(n):
                            answers[d] += share * response[d]
        for at, row in self.limits:
            for d in range(n):
                memory.J[3 * at * n + d] = self.jacobian[row, d]
                memory.response[3 * at * n + d] = self.responses[row, d]
        return 0

    cdef object twist(self, Py_ssize_t body):
        cdef Twist* of = &self.twists[body]
        return BodyTwist(
            vector(of.centre), vector(of.omega), vector(of.velocity), vector(of.alpha), vector(of.acceleration)
        )

    cdef list states(self):
        """The points of all groups at the current state."""
        cdef Group group
        self.evaluate_twists()
        self.evaluate_pairs()
        return [self.state(group) for group in self.groups]

    cdef object state(self, Group group):
        """The points of a group at the current state."""
        if group.on_face is not None:
            return group.on_face.at_state(&self.twists[group.b], &self.twists[group.a])
        return group.other.at_state(self.data, PairTwist.of(self.twist(group.b), self.twist(group.a)))

    cdef list groups_in_memory(self):
        """Points of all groups, to be evaluated state by state; None for joint limits, or if other features are among them."""
        cdef Group group
        # Points of other features are evaluated by their own classes in Python, one by one: there is no memory to use again.
        if any([(<Group>group).on_face is None and not (<Group>group).is_limit for group in self.groups]):
            return None
        return [None if group.is_limit else group.on_face.at_state(&self.twists[group.b], &self.twists[group.a]) for group in self.groups]

    cdef RowMemory empty(self):
        """Memory for the rows."""
        return RowMemory(self.counts, self.rubs, self.nv)

    cdef int evaluate(self, list states, RowMemory memory) except -1:
        """Evaluate points of :meth:`groups_in_memory` and their wrench rows at the current state; mass matrix factored.

        :meth:`combine` completes the rows.
        """
        cdef Group group
        self.evaluate_twists()
        self.evaluate_pairs()
        for group, state in zip(self.groups, states):
            if state is not None:
                (<FaceState>state).go_to(&self.twists[group.b], &self.twists[group.a])
        # Rows are added up from shares, so they begin at zero.
        memory.renew()
        return self.write_wrenches(states, memory)

    cdef int write_wrenches(self, list states, RowMemory memory) except -1:
        """Write the wrench rows of the points, their centres and gamma."""
        cdef Group group
        cdef Py_ssize_t g, d
        for g in range(len(states)):
            group, state = self.groups[g], states[g]
            for d in range(3):
                memory.centres[3 * g + d] = self.twists[group.b].centre[d]
            if state is not None:
                self.write_group(group, state, memory)
        for d in range(self.nv):
            memory.qvel[d] = self.rates[d]
        return 0

    cdef int write_group(self, Group group, state, RowMemory memory) except -1:
        cdef Py_ssize_t p
        cdef int i
        cdef double[3] normal
        cdef double[6] across
        cdef double* rows = memory.wrenches + 18 * group.start
        cdef double* gamma = memory.gamma + 3 * group.start
        if group.on_face is None:
            return self.other_rows(group, state, memory.array("axes"), memory.array("wrenches"), memory.array("gamma"))
        (<FaceState>state).normal_rows(rows, gamma)
        (<FaceState>state).outward(normal)
        for i in range(6):
            across[i] = 0.0
        if group.rubs:
            tangents(normal, across)
            (<FaceState>state).tangential_rows(across, rows, gamma)
        for p in range(group.start, group.start + group.count):
            for i in range(3):
                memory.axes[9 * p + i], memory.axes[9 * p + 3 + i], memory.axes[9 * p + 6 + i] = normal[i], across[i], across[3 + i]
        return 0

    def rows(self):
        """Rows of normals and tangents; positions and velocities current, mass matrix factored."""
        cdef RowMemory memory = self.empty()
        cdef list states = self.states()
        self.write_wrenches(states, memory)
        self.combine(memory)
        return PointRows(states, memory)

    cdef int other_rows(self, Group group, state, axes, wrenches, gamma) except -1:
        """Rows of a single point of another feature, or of a joint limit."""
        cdef double[6] across
        cdef double[3] normal
        cdef int i
        p = group.start
        rows, gamma = wrenches.reshape(-1, 3, 6)[p : p + 1], gamma.reshape(-1, 3)[p : p + 1]
        axes[p, 0] = state.normals[0]
        # Without friction the tangent rows stay zero, and loops leave them out.
        if not group.rubs:
            state.normal_rows(rows[:, 0], gamma[:, 0])
            return 0
        for i in range(3):
            normal[i] = axes[p, 0, i]
        tangents(normal, across)
        axes[p, 1:] = [vector(across), vector(&across[3])]
        state.frictional_rows(axes[p], rows, gamma)
        return 0
