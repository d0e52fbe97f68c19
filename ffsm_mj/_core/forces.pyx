# cython: boundscheck=False, wraparound=False, cdivision=True
"""Forces of held rows of contact points, and of points that all stick by the wrenches that pairs of bodies transmit.

Systems have a few rows: loops are faster than LAPACK.

The rows of the points of one pair of bodies are J = W T, with the six rows T of its twist. Three points that are not on a
line hold the whole twist. With W^T W = L L^T, W L^-T is an orthonormal basis of their rows: the forces W L^-T y, and the
accelerations along L^T T, of which there are six, have the same solution of least norm as those of all rows. A single point
is held by its own rows. Other cases are left to the general solution.

Moments are about the middle of the points, in units of their mean distance to it: W^T W is then well conditioned.
"""

from typing import NamedTuple

import numpy as np

from ffsm_mj.contact_models.persistent.friction.cones import solved
from ffsm_mj.tolerances import EPSILON, RANK

from libc.math cimport sqrt
from libc.string cimport memcpy, memset

from ffsm_mj._core.algebra cimport backward, cholesky, factored, forward, orthonormal, pivots, reduced, substitute
from ffsm_mj._core.features cimport FaceState
from ffsm_mj._core.memory cimport numbers, room
from ffsm_mj._core.row_evaluator cimport Group, RowEvaluator
from ffsm_mj._core.rows cimport RowMemory


NONE = np.zeros(0, dtype=np.intp)


class Active(NamedTuple):
    """Rows that are all held, as a structure of held rows; see ``friction/problem.py``."""

    count: int
    rows: object
    sliding_points: object = NONE
    columns: object = NONE
    mu: object = np.zeros(0)


cdef double _RANK = RANK
cdef double FLAT = 1e-6  # pivots of W^T W below this share of the largest: the points are almost on a line


cdef class ActiveForces:
    """The linear problem for the forces of held rows, at one state; under several efforts there.

    Sliding points have friction along their slip in proportion to their normal force: with the directions of
    :meth:`turn_to`, a normal force acts along the normal less mu times the direction.
    """

    def __init__(self, problem, structure):
        cdef double[:, ::1] G = problem.G
        self.set_up(problem.G, &G[0, 0] if len(G) else NULL, structure)

    cdef int set_up(self, kept, const double* G, structure) except -1:
        """Take a matrix, which an object keeps in memory, and the rows."""
        cdef Py_ssize_t n = len(structure.rows), m = len(structure.sliding_points)
        cdef double* start
        self.structure, self.kept, self.count = structure, kept, structure.count
        # One block for all work space: stages of a step take it again and again, and must not allocate.
        self.rows, self.sliding_points, self.columns, self.mu = structure.rows, structure.sliding_points, structure.columns, structure.mu
        self.active = n
        size = 4 * n * n + 3 * n + 2 * m + 1
        self.memory = bytearray(<Py_ssize_t>sizeof(double) * size + <Py_ssize_t>sizeof(Py_ssize_t) * n)
        start = <double*><char*>self.memory
        self.square, self.basis, self.system, self.work = start, start + n * n, start + 2 * n * n, start + 3 * n * n
        self.half = start + 4 * n * n
        self.right, self.inner, self.friction = self.half + n, self.half + 2 * n, self.half + 3 * n
        self.order = <Py_ssize_t*>(start + <Py_ssize_t>size)
        self.take(G)
        return 0

    cdef void take(self, const double* G) noexcept:
        """Take the matrix of another state, of the same points in the same modes."""
        cdef Py_ssize_t i, j, n = self.active, count = self.count
        cdef const double* row
        cdef double* square = self.square
        self.G = G
        for i in range(n):
            row = G + self.rows[i] * count
            for j in range(n):
                square[i * n + j] = row[self.rows[j]]
        memcpy(self.work, square, n * n * sizeof(double))
        self.find_range()
        self.find_system()

    cdef void find_system(self) noexcept:
        """Accelerations of the held rows per unit forces of these, which friction of sliding points accompanies."""
        cdef Py_ssize_t c, i, n = self.active
        cdef const double* row
        self.factored = False
        memcpy(self.system, self.square, n * n * sizeof(double))
        for c in range(self.sliding_points.shape[0]):
            for i in range(n):
                row = self.G + self.rows[i] * self.count + 3 * self.sliding_points[c]
                # A normal force of a sliding point brings the friction -mu d with it, so its column is the response to both. The
                # matrix is no longer symmetric, and beyond Painleve's limit no longer regular.
                self.system[i * n + self.columns[c]] += row[1] * self.friction[2 * c] + row[2] * self.friction[2 * c + 1]

    def turn_to(self, slips):
        """Set the directions of slip, (k, 2)."""
        cdef const double[:, ::1] contiguous = np.ascontiguousarray(slips)
        if self.sliding_points.shape[0]:
            self.turn(&contiguous[0, 0])

    cdef void turn(self, const double* slips) noexcept:
        """The same, for slips in memory."""
        cdef Py_ssize_t c, p
        for c in range(self.sliding_points.shape[0]):
            p = self.sliding_points[c]
            self.friction[2 * c], self.friction[2 * c + 1] = -self.mu[p] * slips[2 * p], -self.mu[p] * slips[2 * p + 1]
        self.find_system()

    cdef object delassus(self):
        """The matrix as an array."""
        return self.kept.array("G") if isinstance(self.kept, RowMemory) else self.kept

    cdef void find_range(self) noexcept:
        """Determine the rank of the held rows, and a basis of their range if it is not all."""
        cdef Py_ssize_t j, n = self.active
        # Of the symmetric matrix without friction: which rows depend on each other is a matter of the Jacobian alone.
        self.rank = pivots(self.work, n, _RANK, self.order)
        # Dependent rows, as of four corners of a box: forces are sought in their range, which gives those of least norm.
        if self.rank < n:
            for j in range(self.rank):
                memcpy(self.basis + j * n, self.square + self.order[j] * n, n * sizeof(double))  # symmetric
            orthonormal(self.basis, n, self.rank)

    @property
    def redundant(self):
        """Whether rows depend on each other."""
        return self.rank < self.active

    cdef object matrix(self, const double* values, Py_ssize_t rows, Py_ssize_t columns):
        return np.array([[values[i * columns + j] for j in range(columns)] for i in range(rows)]).reshape(rows, columns)

    cdef object independent(self):
        """A basis of the range of the held rows, (r, rank), and their matrix there, 1/kg."""
        U = self.matrix(self.basis, self.rank, self.active).T if self.rank < self.active else np.eye(self.active)
        return U, U.T @ self.matrix(self.square, self.active, self.active) @ U

    def springs(self, rows, forces):
        """Forces of springs along other rows, under the displacement that gives the held ones theirs, N, (m,)."""
        U, square = self.independent()
        return (rows @ U) @ solved(square, U.T @ forces.ravel()[np.asarray(self.rows)])

    def decide(self, rows, inverse_masses):
        """Whether the held rows decide how each of some other rows moves, as it depends on them, (m,)."""
        U, square = self.independent()
        along = rows @ U
        # What the held rows leave of its inverse mass: nothing, if they decide; RANK is the share to which rows are known.
        return np.sum(along.T * solved(square, along.T), axis=0) >= (1.0 - RANK) * inverse_masses

    def is_regular(self, slips):
        """Whether the determinant of the linear problem has the sign that it has without sliding friction."""
        self.turn_to(slips)
        return self.has_sign()

    cdef bint has_sign(self) noexcept:
        """The same for the present directions of slip."""
        cdef Py_ssize_t j
        cdef bint positive = True
        cdef double pivot
        self.factor()
        # A determinant of zero has no sign: the directions of slip are at Painleve's limit.
        if not self.factored:
            return False
        for j in range(self.rank):
            pivot = self.work[j * (self.rank + 1)]
            # Zero or NaN: no sign.
            if not (pivot > 0.0 or pivot < 0.0):
                return False
            # The sign of the determinant: that of the pivots, and one change for each exchange of rows.
            positive ^= (pivot < 0.0) ^ (self.order[j] != j)
        return positive

    def forces(self, const double[::1] b not None, slips):
        """Forces (n, t1, t2) of each point for given directions of slip, N, (k, 3)."""
        forces = np.zeros((self.count // 3, 3))
        cdef double[:, ::1] view = forces
        if self.count:
            self.turn_to(slips)
            self.write_forces(&b[0], &view[0, 0])
        return forces

    cdef int write_forces(self, const double* b, double* forces) except -1:
        """Add these forces to zeros, (3k,)."""
        cdef Py_ssize_t i
        for i in range(self.active):
            self.right[i] = -b[self.rows[i]]
        self.solve()
        self.add_forces(forces)
        return 0

    cdef void add_forces(self, double* forces) noexcept:
        """Add the forces of the held rows, and the friction that accompanies them."""
        cdef Py_ssize_t c, i, p
        for i in range(self.active):
            forces[self.rows[i]] += self.right[i]
        for c in range(self.sliding_points.shape[0]):
            p, i = self.sliding_points[c], self.columns[c]
            # A sliding point has no row of its own for friction: that follows the normal force.
            forces[3 * p + 1] += self.friction[2 * c] * self.right[i]
            forces[3 * p + 2] += self.friction[2 * c + 1] * self.right[i]

    def responses_to_turns(
        self, const Py_ssize_t[::1] points not None, const double[:, :] across not None, const double[:] normal_forces not None
    ):
        """Changes of all forces per rad by which the directions of slip of some points turn, (3k, m)."""
        cdef Py_ssize_t c, i, p
        cdef double first, second
        cdef const double* row
        changes = np.zeros((len(points), self.count))
        cdef double[:, ::1] view = changes
        for c in range(points.shape[0]):
            p = points[c]
            first, second = (-self.mu[p] * normal_forces[c] * across[c, j] for j in range(2))
            # At a fixed normal force friction turns with its direction; the active rows then answer, so that they keep their
            # accelerations.
            view[c, 3 * p + 1], view[c, 3 * p + 2] = first, second
            for i in range(self.active):
                row = self.G + self.rows[i] * self.count + 3 * p
                self.right[i] = -(row[1] * first + row[2] * second)
            self.solve()
            self.add_forces(&view[c, 0])
        return changes.T

    cdef void reduce(self) noexcept:
        """Put the system in the range of the held rows, (rank, rank), into the work space."""
        if self.rank < self.active:
            reduced(self.system, self.basis, self.active, self.rank, self.half, self.work)
        else:
            memcpy(self.work, self.system, self.active * self.active * sizeof(double))

    cdef void factor(self) noexcept:
        """Factor the system, if it is regular."""
        if not self.factored:
            self.reduce()
            self.factored = factored(self.work, self.rank, self.order)

    cdef void project(self) noexcept:
        """Components of the right side in the range of the held rows."""
        cdef Py_ssize_t i, j, n = self.active
        cdef double total
        cdef const double* column
        if self.rank == n:
            memcpy(self.inner, self.right, n * sizeof(double))
            return
        for j in range(self.rank):
            column, total = self.basis + j * n, 0.0
            for i in range(n):
                total += column[i] * self.right[i]
            self.inner[j] = total

    cdef void expand(self) noexcept:
        """The opposite of :meth:`project`."""
        cdef Py_ssize_t i, j, n = self.active
        cdef double part
        cdef double* right = self.right
        cdef const double* column
        if self.rank == n:
            memcpy(right, self.inner, n * sizeof(double))
            return
        memset(right, 0, n * sizeof(double))
        for j in range(self.rank):
            column, part = self.basis + j * n, self.inner[j]
            for i in range(n):
                right[i] += part * column[i]

    cdef int solve(self) except -1:
        """Replace the right side by the forces of the held rows."""
        self.project()
        self.factor()
        if self.factored:
            substitute(self.work, self.inner, self.rank, self.order)
        else:
            self.solve_singular()
        self.expand()
        return 0

    cdef int solve_singular(self) except -1:
        """Components of forces, large where the system is singular, as at the limit of Painleve's paradox."""
        self.project()
        self.reduce()
        # At the limit itself there is no inverse. Least squares give forces that are finite, and the choice of modes judges
        # them.
        system = self.matrix(self.work, self.rank, self.rank)
        for j, value in enumerate(np.linalg.lstsq(system, self.matrix(self.inner, self.rank, 1)[:, 0], rcond=EPSILON)[0]):
            self.inner[<Py_ssize_t>j] = value
        return 0


cdef ActiveForces of_rows(RowMemory memory, structure):
    """The problem of rows in memory."""
    cdef ActiveForces active = ActiveForces.__new__(ActiveForces)
    active.set_up(memory, memory.delassus(), structure)
    return active


cdef class StuckPatches:
    """Points over faces that all stick, by pairs of bodies; in memory that is used again from state to state."""

    cdef int set_up(self, RowEvaluator evaluator) except -1:
        """Take over the points of an evaluator."""
        cdef Group group
        cdef Py_ssize_t q
        self.evaluator, self.pairs, self.nv = evaluator, evaluator.pairs.shape[0], evaluator.nv
        self.groups_of_pairs = [[] for _ in range(self.pairs)]
        self.counts = np.zeros(self.pairs + 1, dtype=np.intp)
        self.starts = np.zeros(self.pairs + 1, dtype=np.intp)
        self.possible = not evaluator.limits
        for i, group in enumerate(evaluator.groups):
            self.groups_of_pairs[group.pair].append(i)
            self.counts[group.pair] += group.count
            # Without friction a point is held along its normal alone, not in three directions; points of other features are
            # not in memory.
            self.possible = self.possible and group.on_face is not None and group.rubs
        for q in range(self.pairs):
            # Two points leave the rotation about their line free: five of the six rows of the twist are held.
            self.possible = self.possible and self.counts[q] != 2
            self.starts[q + 1] = self.starts[q] + (3 if self.counts[q] == 1 else 6)
        self.reduced, n = self.starts[self.pairs], self.starts[self.pairs]
        self.block = room(2 * n * self.nv + 2 * n * n + 2 * n + self.pairs * 40 + 18 * evaluator.k + 1)
        self.J = numbers(self.block)
        self.response = self.J + self.reduced * self.nv
        self.A = self.response + self.reduced * self.nv
        self.factor = self.A + self.reduced * self.reduced
        self.right = self.factor + self.reduced * self.reduced
        self.forces = self.right + self.reduced
        self.N = self.forces + self.reduced
        self.frames = self.N + 36 * self.pairs
        self.shifted = self.frames + 4 * self.pairs
        return 0

    cdef bint prepare(self, list states, RowMemory memory) except -1:
        """Reduce the rows at the state that the evaluator has evaluated last; False where the general solution is needed.

        Args:
            states: Points at the state.
            memory: Their wrench rows and gamma.
        """
        cdef Py_ssize_t q, i, j, d, n = self.reduced, nv = self.nv
        cdef double total
        cdef const double* row
        for q in range(self.pairs):
            if self.counts[q] == 1:
                self.reduce_point(q, memory.wrenches + 18 * (<Group>self.evaluator.groups[self.groups_of_pairs[q][0]]).start)
            else:
                self.find_frame(q, states)
                # Points that are almost on a line hold the rotation about it so weakly that W^T W loses its digits.
                if not self.factor_normal(q, memory):
                    return False
                self.reduce_patch(q)
        for i in range(n):
            row = self.response + i * nv
            for j in range(i + 1):
                total = 0.0
                for d in range(nv):
                    total += row[d] * self.J[j * nv + d]
                self.A[i * n + j] = self.A[j * n + i] = total
        memcpy(self.factor, self.A, n * n * sizeof(double))
        self.is_regular = cholesky(self.factor, n, _RANK)
        # A planar mechanism cannot move out of its plane: some of the six rows are zero there, and the Cholesky factor does
        # not exist.
        if not self.is_regular:
            self.hold()
        return True

    cdef int hold(self) except -1:
        """Take the matrix where the bodies themselves cannot move along some of the reduced rows."""
        if self.active_forces is None:
            self.active_forces = ActiveForces.__new__(ActiveForces)
            self.active_forces.set_up(None, self.A, Active(self.reduced, np.arange(self.reduced)))
        else:
            self.active_forces.take(self.A)
        return 0

    cdef int solve(self, RowMemory memory, const double* force, double* along, double* generalised) except -1:
        """Find the forces along the rows, N, (m,), and the generalised forces, (nv,).

        Args:
            memory: Wrench rows and gamma of the points.
            force: Generalised forces less the bias, (nv,).
            along: The forces.
            generalised: The generalised forces.
        """
        cdef Py_ssize_t i, d, n = self.reduced, nv = self.nv
        self.set_right(force, memory)
        self.find_forces()
        memset(generalised, 0, nv * sizeof(double))
        for i in range(n):
            for d in range(nv):
                generalised[d] += self.forces[i] * self.J[i * nv + d]
        return self.spread(along)

    cdef int find_forces(self) except -1:
        """Solve for the forces along the reduced rows; of least norm where these depend on each other."""
        cdef Py_ssize_t i, n = self.reduced
        if not self.is_regular:
            memset(self.forces, 0, n * sizeof(double))
            return self.active_forces.write_forces(self.right, self.forces)
        for i in range(n):
            self.forces[i] = -self.right[i]
        forward(self.factor, self.forces, n)
        backward(self.factor, self.forces, n)
        return 0

    cdef void find_frame(self, Py_ssize_t q, list states) noexcept:
        """Find the middle of the points of a pair, from the centre of its body b, and their mean distance to it."""
        cdef double* frame = self.frames + 4 * q
        cdef FaceState state
        cdef Py_ssize_t p
        cdef int i
        cdef double square = 0.0
        cdef const double* point
        frame[0] = frame[1] = frame[2] = 0.0
        for g in self.groups_of_pairs[q]:
            state = states[g]
            for p in range(state.count):
                point = state.point(p)
                for i in range(3):
                    # From the centre of the body, not from the origin of the world: far from that, differences of positions
                    # would lose digits.
                    frame[i] += (point[i] - state.centre()[i]) / self.counts[q]
        for g in self.groups_of_pairs[q]:
            state = states[g]
            for p in range(state.count):
                point = state.point(p)
                for i in range(3):
                    square += (point[i] - state.centre()[i] - frame[i]) ** 2
        frame[3] = sqrt(square / self.counts[q])

    cdef void reduce_patch(self, Py_ssize_t q) noexcept:
        """Rows of the twist about the middle of the points, in units of their distance, times L^T."""
        cdef const double* c = self.frames + 4 * q
        cdef const double* L = self.N + 36 * q
        cdef Py_ssize_t d, nv = self.nv, at = self.starts[q] * self.nv
        cdef int side, i, j
        cdef const double* source
        cdef double* row
        for side in range(2):
            source = (&self.evaluator.jacobian[6 * q, 0] if side == 0 else &self.evaluator.responses[6 * q, 0])
            row = (self.J if side == 0 else self.response) + at
            for d in range(nv):
                # Rotations times the mean distance are velocities, as the other three rows are: one unit for all six.
                row[d], row[nv + d], row[2 * nv + d] = c[3] * source[d], c[3] * source[nv + d], c[3] * source[2 * nv + d]
                row[3 * nv + d] = source[3 * nv + d] + source[nv + d] * c[2] - source[2 * nv + d] * c[1]
                row[4 * nv + d] = source[4 * nv + d] + source[2 * nv + d] * c[0] - source[d] * c[2]
                row[5 * nv + d] = source[5 * nv + d] + source[d] * c[1] - source[nv + d] * c[0]
            for i in range(6):
                for d in range(nv):
                    row[i * nv + d] *= L[7 * i]
                for j in range(i + 1, 6):
                    for d in range(nv):
                        row[i * nv + d] += L[6 * j + i] * row[j * nv + d]

    cdef void reduce_point(self, Py_ssize_t q, const double* wrenches) noexcept:
        """Rows of a single point."""
        cdef Py_ssize_t i, j, d, nv = self.nv, at = self.starts[q]
        cdef double* J
        cdef double* response
        for i in range(3):
            J, response = self.J + (at + i) * nv, self.response + (at + i) * nv
            for d in range(nv):
                J[d] = response[d] = 0.0
            for j in range(6):
                for d in range(nv):
                    J[d] += wrenches[6 * i + j] * self.evaluator.jacobian[6 * q + j, d]
                    response[d] += wrenches[6 * i + j] * self.evaluator.responses[6 * q + j, d]

    cdef bint factor_normal(self, Py_ssize_t q, RowMemory memory) except -1:
        """Shift the wrench rows of the points of a pair to their middle, and factor W^T W."""
        cdef const double* c = self.frames + 4 * q
        cdef double* N = self.N + 36 * q
        cdef const double* source
        cdef double* row
        cdef Py_ssize_t i
        cdef int j, l
        cdef Group group
        # All points at one place have no distance to scale by.
        if not c[3] > 0.0:
            return False
        memset(N, 0, 36 * sizeof(double))
        for g in self.groups_of_pairs[q]:
            group = self.evaluator.groups[g]
            for i in range(3 * group.start, 3 * (group.start + group.count)):
                source, row = memory.wrenches + 6 * i, self.shifted + 6 * i
                row[0] = (source[0] - c[1] * source[5] + c[2] * source[4]) / c[3]
                row[1] = (source[1] - c[2] * source[3] + c[0] * source[5]) / c[3]
                row[2] = (source[2] - c[0] * source[4] + c[1] * source[3]) / c[3]
                row[3], row[4], row[5] = source[3], source[4], source[5]
                for j in range(6):
                    for l in range(j + 1):
                        N[6 * j + l] += row[j] * row[l]
        return cholesky(N, 6, FLAT)

    cdef int set_right(self, const double* force, RowMemory memory) except -1:
        """Accelerations along the reduced rows without contact forces."""
        cdef Py_ssize_t q, i, d, nv = self.nv
        cdef int j
        cdef double total
        cdef double[6] part
        cdef Group group
        for i in range(self.reduced):
            total = 0.0
            for d in range(nv):
                total += self.response[i * nv + d] * force[d]
            self.right[i] = total
        for q in range(self.pairs):
            if self.counts[q] == 1:
                group = self.evaluator.groups[self.groups_of_pairs[q][0]]
                for j in range(3):
                    self.right[self.starts[q] + j] += memory.gamma[3 * group.start + j]
                continue
            memset(part, 0, sizeof(part))
            for g in self.groups_of_pairs[q]:
                group = self.evaluator.groups[g]
                for i in range(3 * group.start, 3 * (group.start + group.count)):
                    for j in range(6):
                        part[j] += self.shifted[6 * i + j] * memory.gamma[i]
            # Rates of the points along L^-1 W^T: the same basis as that of the reduced rows.
            forward(self.N + 36 * q, part, 6)
            for j in range(6):
                self.right[self.starts[q] + j] += part[j]
        return 0

    cdef int spread(self, double* along) except -1:
        """Forces along the rows of the points."""
        cdef Py_ssize_t q, i
        cdef int j
        cdef double[6] part
        cdef Group group
        for q in range(self.pairs):
            memcpy(part, self.forces + self.starts[q], (self.starts[q + 1] - self.starts[q]) * sizeof(double))
            if self.counts[q] > 1:
                # W L^-T y: of all forces with this wrench those of least norm, as the general solution gives them.
                backward(self.N + 36 * q, part, 6)
            for g in self.groups_of_pairs[q]:
                group = self.evaluator.groups[g]
                for i in range(3 * group.start, 3 * (group.start + group.count)):
                    along[i] = 0.0
                    if self.counts[q] == 1:
                        along[i] = part[i - 3 * group.start]
                        continue
                    for j in range(6):
                        along[i] += self.shifted[6 * i + j] * part[j]
        return 0


cdef StuckPatches patches_of(RowEvaluator evaluator):
    """The points of an evaluator, all of which stick; None where they are held by other rows."""
    cdef StuckPatches patches = StuckPatches.__new__(StuckPatches)
    patches.set_up(evaluator)
    return patches if patches.possible else None
