# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact Jacobians: gap' = J qdot and gap'' = J qddot + gamma for each contact point and joint limit, at one state.

Rows of two tangents follow each normal: the relative velocity u = v_b(c) - v_a(c) of the two material points at the contact
point c, which moves at c' over both, has the rate

    u' = a_b(c) + omega_b x (c' - v_b(c)) - a_a(c) - omega_a x (c' - v_a(c))

along tangents that are fixed in space, with the accelerations a(c) of the material points. Without friction, and at a joint
limit, these rows are zero, and loops leave them out.

The rows of a point are combinations of the six of the relative twist of its bodies, see ``contact_points.py``. They are in one
block of memory, of which arrays are made when Python asks for them. Points over faces are evaluated here, points of other
features and joint limits one by one (``contact_points.py``).
"""

cimport cython

from collections import Counter

import numpy as np

from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact.features.point_line_gaps import PointOnFace
from ffsm_mj.contact_models.persistent.contact_points import Extremes
from ffsm_mj.contact_models.persistent.contact_points import point_runs
from ffsm_mj.contact_models.persistent.contact_points import SinglePoint
from ffsm_mj.dynamics.body_twists import BodyTwist, chain, PairTwist
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, RATE

from libc.math cimport fabs, INFINITY, sqrt
from libc.string cimport memset

from ffsm_mj._core.features cimport add_point, FaceGroup, FaceState, Twist
from ffsm_mj._core.functions cimport address, mj, mjData, mjModel
from ffsm_mj._core.memory cimport numbers, room, zeros


@cython.no_gc  # no cycle contains it
cdef class RowMemory:
    """Rows of groups of points at one state.

    J and J M^-1, (m, nv), gamma, (m,), the wrench rows, (m, 6), their centres, (g, 3), axes, (k, 3, 3), and rates, (nv,). The
    Delassus matrix J M^-1 J^T, (m, m), is computed when it is needed.
    """

    def __init__(self, tuple counts, bytes rubs, Py_ssize_t nv, block=None):
        cdef Py_ssize_t points = len(rubs), rows = 3 * points, size
        self.points, self.rows, self.nv, self.counts, self.kept_rubs = points, rows, nv, counts, rubs
        self.rubs = <const unsigned char*><const char*>rubs
        size = 2 * rows * nv + 7 * rows + 3 * len(counts) + 9 * points + nv
        self.block = zeros(size + 1) if block is None else bytearray(block)
        self.start = self.J = numbers(self.block)
        self.response, self.gamma = self.J + rows * nv, self.J + 2 * rows * nv
        self.wrenches = self.gamma + rows
        self.centres = self.wrenches + 6 * rows
        self.axes = self.centres + 3 * <Py_ssize_t>len(counts)
        self.qvel = self.axes + 9 * points

    cdef inline bint moves(self, Py_ssize_t i) noexcept:
        """Whether a row is not that of a tangent without friction."""
        return i % 3 == 0 or self.rubs[i // 3]

    cdef int write_resultants(self, const double* forces, double* out) except -1:
        """Write force, and moment about the world origin, on geom b of each group, (g, 6), for forces along the rows."""
        cdef const double* row = self.wrenches
        cdef const double* centre = self.centres
        cdef double[6] wrench
        cdef Py_ssize_t count
        cdef int j
        for count in self.counts:
            for j in range(6):
                wrench[j] = 0.0
            for _ in range(count):
                for j in range(6):
                    wrench[j] += forces[0] * row[j]
                forces, row = forces + 1, row + 6
            for j in range(3):
                out[j] = wrench[3 + j]
            # From the centre of the body to the origin of the world, about which the momenta of the balance are.
            out[3] = wrench[0] + centre[1] * wrench[5] - centre[2] * wrench[4]
            out[4] = wrench[1] + centre[2] * wrench[3] - centre[0] * wrench[5]
            out[5] = wrench[2] + centre[0] * wrench[4] - centre[1] * wrench[3]
            out, centre = out + 6, centre + 3
        return 0

    def resultants(self, const double[:] forces not None):
        """The same as a table, (g, 6)."""
        cdef double[::1] along = np.ascontiguousarray(forces)
        cdef double[:, ::1] resultants
        table = np.empty((len(self.counts), 6))
        resultants = table
        if self.rows:
            self.write_resultants(&along[0], &resultants[0, 0])
        return table

    cdef void renew(self) noexcept:
        """Set all rows to zero, for another state."""
        memset(self.start, 0, (2 * self.rows * self.nv + 7 * self.rows) * sizeof(double))
        self.has_G = False

    cdef double* delassus(self) except NULL:
        cdef Py_ssize_t i, j, d, rows = self.rows, nv = self.nv
        cdef double total
        cdef double* G
        cdef const double* response
        cdef const double* J
        if not self.has_G:
            if self.G == NULL:
                self.G_block = zeros(rows * rows + 1)
                self.G = numbers(self.G_block)
            G, self.has_G = self.G, True
            for i in range(rows):
                if not self.moves(i):
                    continue
                response = self.response + i * nv
                for j in range(i + 1):
                    if not self.moves(j):
                        continue
                    J, total = self.J + j * nv, 0.0
                    for d in range(nv):
                        total += response[d] * J[d]
                    G[i * rows + j] = G[j * rows + i] = total
        return self.G

    cdef void accelerate(self, const double* force, double* out) noexcept:
        """Write the accelerations along the rows under a generalised force, m/s^2, (m,)."""
        cdef Py_ssize_t i, d
        cdef double total
        cdef const double* response
        for i in range(self.rows):
            response, total = self.response + i * self.nv, self.gamma[i]
            if self.moves(i):
                for d in range(self.nv):
                    total += response[d] * force[d]
            out[i] = total

    cdef double velocity(self, Py_ssize_t i) noexcept:
        """Velocity along a row, m/s."""
        cdef Py_ssize_t d
        # The velocity of a row is that of its own state: the evaluator may have moved on since.
        cdef const double* J = self.J + i * self.nv
        cdef double total = 0.0
        for d in range(self.nv):
            total += J[d] * self.qvel[d]
        return total

    cdef double inverse_mass(self, Py_ssize_t i) noexcept:
        """Diagonal element of the Delassus matrix, 1/kg."""
        cdef Py_ssize_t d
        cdef double total = 0.0
        for d in range(i * self.nv, (i + 1) * self.nv):
            total += self.response[d] * self.J[d]
        return total

    def array(self, str name):
        """One of the arrays."""
        cdef Py_ssize_t m = self.rows, nv = self.nv
        if name == "G":
            self.delassus()
            return np.frombuffer(self.G_block)[: m * m].reshape(m, m)
        block = np.frombuffer(self.block)
        if name == "J":
            return block[: m * nv].reshape(m, nv)
        if name == "response":
            return block[m * nv : 2 * m * nv].reshape(m, nv)
        if name == "gamma":
            return block[2 * m * nv : 2 * m * nv + m]
        at = 2 * m * nv + m
        if name == "wrenches":
            return block[at : at + 6 * m].reshape(m, 6)
        at += 6 * m + 3 * len(self.counts)
        if name == "axes":
            return block[at : at + 9 * self.points].reshape(self.points, 3, 3)
        at += 9 * self.points
        return block[at : at + nv]


cdef double _ACCELERATION = ACCELERATION, _ACCELERATION_M_S2 = ACCELERATION_M_S2


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


cdef int write_scales(list groups, double* scales) except -1:
    """Write the largest curvature term of each point of some groups, m/s^2."""
    cdef Py_ssize_t p, at = 0
    for state in groups:
        if isinstance(state, FaceState):
            at += (<FaceState>state).write_scales(scales + at)
        else:
            for scale in state.scales:
                scales[at] = scale
                at += 1
    return 0


cdef int write_rounding(list groups, RowMemory memory, const double* force, double* out) except -1:
    """Write the rounding of the accelerations of each point under a generalised force, m/s^2."""
    cdef Py_ssize_t p, j, d, nv = memory.nv
    cdef const double* responses = memory.response
    cdef const double* response
    cdef const double[:, ::1] unclosed
    cdef double most
    # What loops take out of a row cancels in it: terms before that subtraction are those whose rounding counts.
    if memory.unclosed is not None and memory.rows and nv:
        unclosed = memory.unclosed
        responses = &unclosed[0, 0]
    write_scales(groups, out)
    for p in range(memory.points):
        # Terms of the curvature may be larger than gamma, in which they cancel: its rounding is that of the largest one.
        most = out[p]
        for j in range(3 * p, 3 * p + (3 if memory.rubs[p] else 1)):
            most, response = max(most, fabs(memory.gamma[j])), responses + j * nv
            for d in range(nv):
                # The terms count, not their sum: rounding is that of the largest of those that cancel.
                most = max(most, fabs(response[d] * force[d]))
        out[p] = _ACCELERATION_M_S2 + _ACCELERATION * most
    return 0


cdef int find_extremes(list groups, double* out) except -1:
    """Write the extremes over the points of some groups: inside, gap, rate, lowest; see ``Extremes``."""
    out[0], out[1], out[2], out[3] = INFINITY, 0.0, 0.0, INFINITY
    for state in groups:
        if isinstance(state, FaceState):
            (<FaceState>state).find_extremes(out, out + 1, out + 2, out + 3)
        else:
            out[0], out[3] = min(out[0], <double>min(state.insides)), min(out[3], <double>min(state.gaps))
            out[1] = max(out[1], <double>max(map(abs, state.gaps)))
            out[2] = max(out[2], <double>max(map(abs, state.rates)))
    return 0


cdef object extremes_of(list groups):
    """Extremes over the points of some groups."""
    cdef double[4] extremes
    find_extremes(groups, extremes)
    return Extremes(extremes[0], extremes[1], extremes[2], extremes[3])


cdef int sum_up(list groups, Py_ssize_t start, Py_ssize_t stop, const double* forces, double* out) except -1:
    """Add up the points of one pair: force, centre, and mean normal, which is not normalised; (3, 3) zeros before."""
    cdef Py_ssize_t p, at = 0
    cdef double total = 0.0
    cdef const double[:, :] normals, points
    for p in range(start, stop):
        total += forces[p]
    for state in groups:
        if start <= at < stop:
            if isinstance(state, FaceState):
                (<FaceState>state).add_resultant(forces, at, total, stop - start, out)
            else:
                normals, points = np.array(state.normals), np.array(state.points)
                for p in range(points.shape[0]):
                    add_point(&normals[p, 0], &points[p, 0], forces[at + p], total, stop - start, out)
        at += state.count
    return 0


cdef object resultant_of(list groups, part, const double[:] forces, friction):
    """Resultant force of the points of one pair, its centre, and the mean unit normal."""
    cdef const double[:, :] across
    cdef Py_ssize_t p, start = part.start, stop = part.stop
    cdef int i
    cdef double length
    vectors = np.zeros((3, 3))
    cdef double[:, ::1] sums = vectors  # force, centre, normal
    cdef const double[::1] along = np.ascontiguousarray(forces)
    sum_up(groups, start, stop, &along[0], &sums[0, 0])
    if friction is not None:
        across = friction
        for p in range(start, stop):
            for i in range(3):
                sums[0, i] += across[p, i]
    length = sqrt(sums[2, 0] * sums[2, 0] + sums[2, 1] * sums[2, 1] + sums[2, 2] * sums[2, 2])
    for i in range(3):
        # Normals of several points over a round side differ. A single one is a unit vector already, and a division would
        # round it.
        sums[2, i] /= length if length > 0.0 and stop - start > 1 else 1.0
    return vectors[0], vectors[1], vectors[2]


class PointRows:
    """Contact points at one state, in the coordinates of a motion: rows of normals and tangents.

    Row 3 i + j of J, (3k, nv), is axis j (n, t1, t2) of point i: gap' = J qdot and gap'' = J qddot + gamma along normals. A
    joint limit, and a pair without friction, has zero tangents. Arrays are made when they are needed.

    Attributes:
        groups: The points, by what is evaluated together.
        memory: Their rows.
        active: Linear problems for the forces that hold some of the rows; see ``friction/problem.py``.
        loop_rates: Part of gamma that is due to closed loops, m/s^2; None without any.
        J: Derivative of velocities at the contact points with respect to the generalised velocity, (3k, nv).
        gamma: Part of their accelerations that does not depend on those of the joints, m/s^2, (3k,).
        response: J M^-1, like J; with closed loops J Mc^-1.
        G: Delassus matrix J M^-1 J^T, 1/kg: accelerations per unit force; with closed loops J Mc^-1 J^T.
        axes: Normal and tangents of each point, world axes, (k, 3, 3).
        qvel: Generalised velocity, (nv,).
        states: Gap, rate, normal and contact points of each contact point.
        extremes: Smallest distance to the bounds of a feature, largest gap and largest rate.
        slips: Slip velocities along the tangents, m/s, (k, 2).
        speed_rounding: Rounding of the slip speeds, m/s, (k,).
    """

    loop_rates = None

    def __init__(self, groups, memory):
        """Store the points; see the attributes."""
        self.groups, self.memory, self.active = groups, memory, {}

    J = cached_property(lambda self: self.memory.array("J"))
    gamma = cached_property(lambda self: self.memory.array("gamma"))
    response = cached_property(lambda self: self.memory.array("response"))
    G = cached_property(lambda self: self.memory.array("G"))
    axes = cached_property(lambda self: self.memory.array("axes"))
    qvel = cached_property(lambda self: self.memory.array("qvel"))
    states = cached_property(lambda self: tuple([state for group in self.groups for state in group.states]))
    extremes = cached_property(lambda self: extremes_of(self.groups))
    slips = cached_property(lambda self: self.J.dot(self.qvel).reshape(-1, 3)[:, 1:])

    def close_loops(self, loops):
        """Take the accelerations of the points with closed loops; called before anything else is computed from the rows."""
        # What the loops take cancels against these terms: the rounding of the accelerations is that of the terms before.
        self.memory.unclosed = self.response.copy()
        # A contact force accelerates only what the loops leave free; with M^-1 in place of Mc^-1 it would pull them apart.
        self.response[:] = loops.response(self.J)
        self.loop_rates = self.J.dot(loops.acceleration())
        self.gamma[:] += self.loop_rates

    @property
    def gaps(self):
        """Gap of each contact point, m, (k,)."""
        return [gap for group in self.groups for gap in group.gaps]

    @property
    def rates(self):
        """Rates of the gaps, m/s, (k,)."""
        return [rate for group in self.groups for rate in group.rates]

    @property
    def scales(self):
        """Largest curvature term of the second rate of each gap, m/s^2, (k,)."""
        return [scale for group in self.groups for scale in group.scales]

    @property
    def insides(self):
        """Distance of each contact point to the bounds of its feature, m, (k,)."""
        return [inside for group in self.groups for inside in group.insides]

    @cached_property
    def speed_rounding(self):
        # The terms count, not their sum: on fast bodies a slip of zero is a difference of large numbers.
        terms = np.abs(self.J * self.qvel).reshape(len(self.axes), -1).max(axis=1, initial=0.0)
        return RATE * (1.0 + terms)

    def wrenches(self, forces):
        """Force, and moment about the world origin, on geom b of each group of points, for forces along the rows, (g, 6)."""
        return self.memory.resultants(forces)

    def resultant(self, part, forces, friction):
        """Resultant force of the points of one pair, N, its centre, m, and the mean unit normal, (3,) each.

        Args:
            part: The points.
            forces: Normal forces of all points, N, (k,).
            friction: Friction forces on geom b of all points, world axes, N, (k, 3).
        """
        return resultant_of(self.groups, part, forces, friction)

    def largest_slip(self, which):
        """Largest slip of some points along a tangent, m/s; which, (k,)."""
        cdef RowMemory memory = self.memory
        cdef const unsigned char[::1] chosen = which.view(np.uint8)
        cdef Py_ssize_t p
        cdef double most = 0.0
        for p in range(memory.points):
            if chosen[p] and memory.rubs[p]:
                most = max(most, max(fabs(memory.velocity(3 * p + 1)), fabs(memory.velocity(3 * p + 2))))
        return most

    def across(self, components):
        """Vectors with given components along the tangents of each point, world axes, (k, 3)."""
        cdef const double[:, :] lengths = components
        cdef RowMemory memory = self.memory
        cdef const double* axes
        cdef Py_ssize_t p
        cdef int i
        vectors = np.empty((memory.points, 3))
        cdef double[:, ::1] slips = vectors
        for p in range(memory.points):
            axes = memory.axes + 9 * p
            for i in range(3):
                slips[p, i] = lengths[p, 0] * axes[3 + i] + lengths[p, 1] * axes[6 + i]
        return vectors


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
        groups_of_pairs = Counter(contact_points[places.start].pair for places in runs)
        # Three points of a flat patch hold both bodies parallel: with one normal for all, second rates are affine in the
        # place (contact_points.py).
        patches = {pair for pair in flat if groups_of_pairs[pair] > 1}
        for places in runs:
            alike, pair, group = contact_points[places], contact_points[places.start].pair, Group()
            in_patch, both = pair in patches, (motion.bodies[pair.body_b], motion.bodies[pair.body_a])
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
