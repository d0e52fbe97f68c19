# cython: boundscheck=False, wraparound=False, cdivision=True
"""Contact Jacobians: gap' = J qdot and gap'' = J qddot + gamma for each contact point and joint limit, at one state.

Rows of two tangents follow each normal: the relative velocity u = v_b(c) - v_a(c) of the two material points at the contact
point c, which moves at c' over both, has the rate

    u' = a_b(c) + omega_b x (c' - v_b(c)) - a_a(c) - omega_a x (c' - v_a(c))

along tangents that are fixed in space, with the accelerations a(c) of the material points. Without friction, and at a joint
limit, these rows are zero, and loops leave them out.

They are in one block of memory, of which arrays are made when Python asks for them; ``row_evaluator.pyx`` evaluates them.
"""

cimport cython

import numpy as np

from ffsm_mj.cached_property import cached_property
from ffsm_mj.contact_models.persistent.contact_points import Extremes
from ffsm_mj.tolerances import ACCELERATION, ACCELERATION_M_S2, RATE

from libc.math cimport fabs, INFINITY, sqrt
from libc.string cimport memset

from ffsm_mj._core.features cimport add_point, FaceState
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
