# cython: boundscheck=False, wraparound=False, cdivision=True
"""Forces of points that all stick, by the wrenches that pairs of bodies transmit.

The rows of the points of one pair of bodies are J = W T, with the six rows T of its twist. Three points that are not on a
line hold the whole twist. With W^T W = L L^T, W L^-T is an orthonormal basis of their rows: the forces W L^-T y, and the
accelerations along L^T T, of which there are six, have the same solution of least norm as those of all rows. A single point
is held by its own rows. Other cases are left to the general solution.

Moments are about the middle of the points, in units of their mean distance to it: W^T W is then well conditioned.
"""

from libc.math cimport sqrt
from libc.string cimport memcpy, memset

import numpy as np

from ffsm_mj.tolerances import RANK

from ffsm_mj_fast.contact_acceleration import Active

from ffsm_mj_fast.face_group cimport FaceState
from ffsm_mj_fast.held_rows cimport HeldForces
from ffsm_mj_fast.memory cimport numbers, room
from ffsm_mj_fast.row_memory cimport RowMemory
from ffsm_mj_fast.rows cimport Group, RowEvaluator

cdef double _RANK = RANK
cdef double FLAT = 1e-6  # pivots of W^T W below this share of the largest: the points are almost on a line


cdef bint cholesky(double* A, Py_ssize_t n, double least) noexcept:
    """Factor a symmetric matrix in place, in its lower half; whether all pivots exceed a share of the largest element."""
    cdef Py_ssize_t i, j, l
    cdef double total, largest = 0.0
    for i in range(n):
        largest = max(largest, A[i * (n + 1)])
    for j in range(n):
        total = A[j * (n + 1)]
        for l in range(j):
            total -= A[j * n + l] * A[j * n + l]
        if not total > least * largest:
            return False
        A[j * (n + 1)] = sqrt(total)
        for i in range(j + 1, n):
            total = A[i * n + j]
            for l in range(j):
                total -= A[i * n + l] * A[j * n + l]
            A[i * n + j] = total / A[j * (n + 1)]
    return True


cdef void forward(const double* L, double* b, Py_ssize_t n) noexcept:
    """Solve L x = b in place."""
    cdef Py_ssize_t i, j
    for i in range(n):
        for j in range(i):
            b[i] -= L[i * n + j] * b[j]
        b[i] /= L[i * (n + 1)]


cdef void backward(const double* L, double* b, Py_ssize_t n) noexcept:
    """Solve L^T x = b in place."""
    cdef Py_ssize_t i, j
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            b[i] -= L[j * n + i] * b[j]
        b[i] /= L[i * (n + 1)]


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
            self.possible = self.possible and group.on_face is not None
        for q in range(self.pairs):
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

    cdef bint prepare(self, list states, RowMemory own) except -1:
        """Reduce the rows at the state that the evaluator has evaluated last; False where the general solution is needed.

        Args:
            states: Points at the state.
            own: Their wrench rows and gamma.
        """
        cdef Py_ssize_t q, i, j, d, n = self.reduced, nv = self.nv
        cdef double total
        cdef const double* row
        for q in range(self.pairs):
            if self.counts[q] == 1:
                self.reduce_point(q, own.wrenches + 18 * (<Group>self.evaluator.groups[self.groups_of_pairs[q][0]]).start)
            else:
                self.find_frame(q, states)
                if not self.factor_normal(q, own):
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
        if not self.is_regular:
            self.hold()
        return True

    cdef int hold(self) except -1:
        """Take the matrix where the bodies themselves cannot move along some of the reduced rows."""
        if self.held is None:
            self.held = HeldForces.__new__(HeldForces)
            self.held.set_up(None, self.A, Active(self.reduced, np.arange(self.reduced)))
        else:
            self.held.take(self.A)
        return 0

    cdef int solve(self, RowMemory own, const double* force, double* along, double* generalised) except -1:
        """Find the forces along the rows, N, (m,), and the generalised forces, (nv,).

        Args:
            own: Wrench rows and gamma of the points.
            force: Generalised forces less the bias, (nv,).
            along: The forces.
            generalised: The generalised forces.
        """
        cdef Py_ssize_t i, d, n = self.reduced, nv = self.nv
        self.set_right(force, own)
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
            return self.held.write_forces(self.right, self.forces)
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
        cdef int each, i, j
        cdef const double* given
        cdef double* row
        for each in range(2):
            given = (&self.evaluator.own[6 * q, 0] if each == 0 else &self.evaluator.responses[6 * q, 0])
            row = (self.J if each == 0 else self.response) + at
            for d in range(nv):
                row[d], row[nv + d], row[2 * nv + d] = c[3] * given[d], c[3] * given[nv + d], c[3] * given[2 * nv + d]
                row[3 * nv + d] = given[3 * nv + d] + given[nv + d] * c[2] - given[2 * nv + d] * c[1]
                row[4 * nv + d] = given[4 * nv + d] + given[2 * nv + d] * c[0] - given[d] * c[2]
                row[5 * nv + d] = given[5 * nv + d] + given[d] * c[1] - given[nv + d] * c[0]
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
                    J[d] += wrenches[6 * i + j] * self.evaluator.own[6 * q + j, d]
                    response[d] += wrenches[6 * i + j] * self.evaluator.responses[6 * q + j, d]

    cdef bint factor_normal(self, Py_ssize_t q, RowMemory own) except -1:
        """Shift the wrench rows of the points of a pair to their middle, and factor W^T W."""
        cdef const double* c = self.frames + 4 * q
        cdef double* N = self.N + 36 * q
        cdef const double* given
        cdef double* row
        cdef Py_ssize_t i
        cdef int j, l
        cdef Group group
        if not c[3] > 0.0:
            return False
        memset(N, 0, 36 * sizeof(double))
        for g in self.groups_of_pairs[q]:
            group = self.evaluator.groups[g]
            for i in range(3 * group.start, 3 * (group.start + group.count)):
                given, row = own.wrenches + 6 * i, self.shifted + 6 * i
                row[0] = (given[0] - c[1] * given[5] + c[2] * given[4]) / c[3]
                row[1] = (given[1] - c[2] * given[3] + c[0] * given[5]) / c[3]
                row[2] = (given[2] - c[0] * given[4] + c[1] * given[3]) / c[3]
                row[3], row[4], row[5] = given[3], given[4], given[5]
                for j in range(6):
                    for l in range(j + 1):
                        N[6 * j + l] += row[j] * row[l]
        return cholesky(N, 6, FLAT)

    cdef int set_right(self, const double* force, RowMemory own) except -1:
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
                    self.right[self.starts[q] + j] += own.gamma[3 * group.start + j]
                continue
            memset(part, 0, sizeof(part))
            for g in self.groups_of_pairs[q]:
                group = self.evaluator.groups[g]
                for i in range(3 * group.start, 3 * (group.start + group.count)):
                    for j in range(6):
                        part[j] += self.shifted[6 * i + j] * own.gamma[i]
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
    cdef StuckPatches found = StuckPatches.__new__(StuckPatches)
    found.set_up(evaluator)
    return found if found.possible else None
