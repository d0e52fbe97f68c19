# cython: boundscheck=False, wraparound=False, cdivision=True
"""Closed loops in the stages of a step: their rows."""

import numpy as np

from ffsm_mj.dynamics.body_twists import chain
from ffsm_mj.dynamics.loops.latch import BoundLatch, LENGTH_M

from libc.math cimport fabs, sqrt
from libc.string cimport memcmp, memcpy, memset

from ffsm_mj._core.algebra cimport cross
from ffsm_mj._core.functions cimport address, mj, mjData, mjModel


# Bounds of the Cholesky pivots of R M^-1 R^T, which is 1 where T is found, within which T is kept: their ratio squared, 256,
# is about the condition number, so that forces lose less than three of sixteen digits.
cdef double LEAST_PIVOT = 0.25, LARGEST_PIVOT = 4.0
# Combinations of rows vanish still below this multiple of the share at which the rank was decided.
cdef double VANISHES = 10.0


cdef inline void turned(const double* matrix, const double* v, double* out) noexcept nogil:
    """Product of a matrix and a vector."""
    cdef int i
    for i in range(3):
        out[i] = matrix[3 * i] * v[0] + matrix[3 * i + 1] * v[1] + matrix[3 * i + 2] * v[2]


cdef class Latch:
    """One latch in a model."""

    def __init__(self, model, bound, start):
        latch = bound.latch
        self.first, self.second = bound.first, bound.second
        self.start, self.count = start, latch.count
        self.together = model.body_rootid[self.first] == model.body_rootid[self.second]
        self.about_axis = not latch.stopped[:, 5].any() and latch.stopped[:, 3].any()
        self.on_first, self.on_second = first, second = chain(model, self.first), chain(model, self.second)
        # A degree of freedom that carries both bodies changes no relative motion: its elements cancel exactly, and are left
        # zero.
        moves = first != second
        self.of_first, self.of_second, self.dofs = (np.flatnonzero(flags) for flags in (first, second, moves))
        self.point_in_first, self.point_in_second = latch.point_in_first.copy(), latch.point_in_second.copy()
        # A length makes velocities of rotations, so that one share decides on the rank of both.
        stopped = np.concatenate((latch.stopped[:, :3], LENGTH_M * latch.stopped[:, 3:]))
        self.components = np.ascontiguousarray(stopped @ latch.axes_in_first.T)
        self.axes_in_first, self.axes_in_second = (
            np.ascontiguousarray(axes.T) for axes in (latch.axes_in_first, latch.axes_in_second)
        )


cdef class JointRow:
    """Row of a joint that follows another one by a polynomial, or is locked."""

    cdef readonly Py_ssize_t count
    cdef Py_ssize_t start, follower, leader, follower_at, leader_at
    cdef double follower_zero, leader_zero
    cdef double[5] a
    cdef double[::1] qpos, qvel

    def __init__(self, data, dofs, places, zeros, coefficients):
        """Take views of the state.

        Degrees of freedom and places in qpos of follower and leader; -1 without a leader, and for the place of a joint that is
        kept at rest wherever it is.
        """
        self.count, self.qpos, self.qvel = 1, data.qpos, data.qvel
        (self.follower, self.leader), (self.follower_at, self.leader_at) = dofs, places
        self.follower_zero, self.leader_zero = zeros
        for i in range(5):
            self.a[i] = coefficients[i]

    cdef void write(self, double* row, double* gamma) noexcept:
        """Write the elements of the row, the others of which are zero, and its rate at zero acceleration."""
        cdef double z, rate
        cdef double* a = self.a
        gamma[0], row[self.follower] = 0.0, 1.0
        if self.leader >= 0:
            z, rate = self.qpos[self.leader_at] - self.leader_zero, self.qvel[self.leader]
            row[self.leader] = -(a[1] + z * (2.0 * a[2] + z * (3.0 * a[3] + z * 4.0 * a[4])))
            # Second derivative of the polynomial times the squared rate: without it the coupling drifts with the square of
            # the speed.
            gamma[0] = -(2.0 * a[2] + z * (6.0 * a[3] + z * 12.0 * a[4])) * rate * rate

    cdef double error(self) noexcept:
        cdef double z = self.qpos[self.leader_at] - self.leader_zero if self.leader >= 0 else 0.0
        cdef double* a = self.a
        cdef double value
        # A coordinate that friction keeps at rest has no place to go back to: only its rate is zero.
        if self.follower_at < 0:
            return 0.0
        value = self.follower_zero + a[0] + z * (a[1] + z * (a[2] + z * (a[3] + z * a[4])))
        return self.qpos[self.follower_at] - value

    def evaluate(self, double[:, ::1] J not None, double[::1] gamma not None):
        """Write the row, (1, nv), and its rate, (1,)."""
        J[0, :] = 0.0
        self.write(&J[0, 0], &gamma[0])

    def errors(self):
        """Error of the coordinate that follows, (1,)."""
        return np.array([self.error()])


cdef class LoopStage:
    """Rows R = T B of some sources in the stages of a step."""

    def __init__(self, model, data, bound, seen, rank):
        """Take the rows of bound sources; ``rank`` is the share of the largest singular value below which others vanish."""
        cdef Latch latch
        self.model, self.data, self.seen = model, data, seen
        self.m, self.d, self.nv = <const mjModel*>address(model), <mjData*>address(data), model.nv
        self.places, self.n, self.vanishes = [], 0, VANISHES * rank
        columns = set()
        for source in bound:
            if isinstance(source, BoundLatch):
                latch = Latch(model, source, self.n)
                self.places.append(latch)
                columns.update(latch.dofs)
            elif isinstance(source, JointRow):
                (<JointRow>source).start = self.n
                self.places.append(source)
                columns.update(dof for dof in ((<JointRow>source).follower, (<JointRow>source).leader) if dof >= 0)
            else:
                self.places.append((source, self.n))
                columns.update(range(self.nv))
            self.n += source.count
        self.columns = np.array(sorted(columns), dtype=np.intp)
        self.cdof, self.cdof_dot, self.cvel = data.cdof, data.cdof_dot, data.cvel
        self.centres, self.xpos, self.xmat = data.subtree_com, data.xpos, data.xmat
        self.roots = np.array(model.body_rootid, dtype=np.intc)
        self.qpos, self.qvel, self.applied = data.qpos, data.qvel, data.qfrc_applied
        self.passive, self.bias, self.actuator = data.qfrc_passive, data.qfrc_bias, data.qfrc_actuator
        self.ctrl, self.seen_ctrl = data.ctrl, seen.ctrl
        self.last_qpos, self.last_qvel = np.empty(model.nq), np.empty(model.nv)
        self.J, self.force, self.all_gamma = np.zeros((self.n, self.nv)), np.empty(self.nv), np.empty(self.n)
        self.every_error = np.empty(self.n)
        self.rows = self.J
        self.combine(np.empty((0, self.n)), np.empty((0, self.n)))

    @property
    def rates(self):
        """Rates of the rows J at zero acceleration, (n,), at the state last evaluated."""
        return np.asarray(self.all_gamma)

    def combine(self, T, others):
        """Use some combinations of the rows, (r, n), and others that vanish, (n - r, n)."""
        self.T, self.others, self.r, self.current, self.begun = T, others, len(T), False, False
        self.R, self.response = np.zeros((self.r, self.nv)), np.zeros((self.r, self.nv))
        self.factor, self.gamma, self.y = np.zeros((self.r, self.r)), np.zeros(self.r), np.zeros(self.r)
        self.R_view, self.response_view, self.factor_view = self.R, self.response, self.factor
        self.gamma_view, self.y_view = self.gamma, self.y
        self.start_response, self.turn = np.zeros((self.r, self.nv)), np.zeros((self.r, self.r))

    cdef void body(self, Py_ssize_t number, const Py_ssize_t[::1] moves, Body* out) noexcept:
        cdef const double* velocity = &self.cvel[number, 0]
        cdef const double* centre = &self.centres[self.roots[number], 0]
        cdef Py_ssize_t k, dof
        cdef int i
        cdef double rate
        for i in range(3):
            out.centre[i], out.omega[i], out.velocity[i] = centre[i], velocity[i], velocity[3 + i]
            out.alpha[i], out.acceleration[i] = 0.0, 0.0
        for k in range(moves.shape[0]):
            dof = moves[k]
            rate = self.qvel[dof]
            for i in range(3):
                out.alpha[i] += rate * self.cdof_dot[dof, i]
                out.acceleration[i] += rate * self.cdof_dot[dof, 3 + i]

    cdef void point(self, Latch latch, double* out) noexcept:
        """The point of the second body, world axes."""
        cdef int i
        turned(&self.xmat[latch.second, 0], &latch.point_in_second[0], out)
        for i in range(3):
            out[i] += self.xpos[latch.second, i]

    cdef void evaluate_latch(self, Latch latch) noexcept:
        """Rows of a latch, and their rates at zero acceleration."""
        cdef Body a, b
        cdef double[3] place, arm_a, arm_b, of_b, other, along, turning, linear, angular, moment, cross_product
        cdef Py_ssize_t i, j, dof, k, n = latch.count
        cdef int c
        cdef double total
        self.body(latch.first, latch.of_first, &a)
        self.body(latch.second, latch.of_second, &b)
        self.point(latch, place)
        for c in range(3):
            arm_a[c], arm_b[c] = place[c] - a.centre[c], place[c] - b.centre[c]
        # Accelerations of the material points at the place, relative to axes fixed in the first body.
        cross(b.omega, arm_b, of_b)
        cross(a.omega, arm_a, other)
        for c in range(3):
            of_b[c] += b.velocity[c]
            other[c] += a.velocity[c]
        cross(b.alpha, arm_b, along)
        cross(b.omega, of_b, cross_product)
        for c in range(3):
            along[c] += b.acceleration[c] + cross_product[c]
        cross(a.alpha, arm_a, moment)
        cross(a.omega, other, cross_product)
        for c in range(3):
            along[c] -= moment[c] + a.acceleration[c] + cross_product[c]
            # The second derivative of the components of r = p_b - p_a along axes of a is r'' - 2 omega_a x r', as r is zero here.
            of_b[c] = 2.0 * (of_b[c] - other[c])
        cross(a.omega, of_b, cross_product)
        cross(a.omega, b.omega, moment)
        for c in range(3):
            along[c] -= cross_product[c]
            # That of the relative angular velocity along these axes: omega_a x (omega_b - omega_a) is omega_a x omega_b.
            turning[c] = b.alpha[c] - a.alpha[c] - moment[c]
        for i in range(n):
            k = latch.start + i
            turned(&self.xmat[latch.first, 0], &latch.components[i, 0], linear)
            turned(&self.xmat[latch.first, 0], &latch.components[n + i, 0], angular)
            total = 0.0
            for c in range(3):
                total += linear[c] * along[c] + angular[c] * turning[c]
            self.all_gamma[k] = total
            cross(arm_a, linear, moment)
            cross(arm_b, linear, cross_product)
            for j in range(latch.dofs.shape[0]):
                dof, total = latch.dofs[j], 0.0
                if latch.on_second[dof] != 0.0:
                    for c in range(3):
                        total += (angular[c] + cross_product[c]) * self.cdof[dof, c] + linear[c] * self.cdof[dof, 3 + c]
                if latch.on_first[dof] != 0.0:
                    for c in range(3):
                        total -= (angular[c] + moment[c]) * self.cdof[dof, c] + linear[c] * self.cdof[dof, 3 + c]
                self.rows[k, dof] = total

    cpdef int evaluate(self) except -1:
        """Update the attributes for the state in ``data``."""
        cdef size_t positions = self.qpos.shape[0] * sizeof(double), rates = self.nv * sizeof(double)
        cdef Py_ssize_t i, j, k
        cdef double total
        if (
            self.current
            and memcmp(&self.qpos[0], &self.last_qpos[0], positions) == 0
            and memcmp(&self.qvel[0], &self.last_qvel[0], rates) == 0
        ):
            return 0
        self.current = False
        for place in self.places:
            if isinstance(place, Latch):
                self.evaluate_latch(<Latch>place)
            elif isinstance(place, JointRow):
                k = (<JointRow>place).start
                (<JointRow>place).write(&self.rows[k, 0], &self.all_gamma[k])
            else:
                other, k = place
                other.evaluate(self.J[k : k + other.count], self.all_gamma.base[k : k + other.count])
        for i in range(self.r):
            total = 0.0
            for k in range(self.n):
                total += self.T[i, k] * self.all_gamma[k]
            self.gamma_view[i] = total
            self.combined_row(&self.T[i, 0], &self.R_view[i, 0])
        if self.r:
            mj.solveM(self.m, self.d, &self.response_view[0, 0], &self.R_view[0, 0], <int>self.r)
            self.factorise()
        memcpy(&self.last_qpos[0], &self.qpos[0], positions)
        memcpy(&self.last_qvel[0], &self.qvel[0], rates)
        self.current = True
        return 0

    cdef void combined_row(self, const double* share, double* row) noexcept:
        """Write a combination of the rows; elements that are zero in all of them are left as they are."""
        cdef Py_ssize_t i, k, column, columns = self.columns.shape[0]
        cdef const double* source_row
        for i in range(columns):
            row[self.columns[i]] = 0.0
        for k in range(self.n):
            # Combinations of independent rows are mostly these rows themselves.
            if share[k] != 0.0:
                source_row = &self.rows[k, 0]
                for i in range(columns):
                    column = self.columns[i]
                    row[column] += share[k] * source_row[column]

    cdef double product(self, const double* full, const double* row) noexcept:
        """Product of a vector and a row or a combination of rows."""
        cdef Py_ssize_t i
        cdef double total = 0.0
        for i in range(self.columns.shape[0]):
            total += full[self.columns[i]] * row[self.columns[i]]
        return total

    cdef int factorise(self) except -1:
        """Cholesky factor of R M^-1 R^T."""
        cdef Py_ssize_t i, j, k
        cdef double total
        for i in range(self.r):
            for j in range(i + 1):
                total = self.product(&self.response_view[i, 0], &self.R_view[j, 0])
                for k in range(j):
                    # Row by row, without LAPACK: loops have a few rows, and the call would cost more.
                    total -= self.factor_view[i, k] * self.factor_view[j, k]
                if i > j:
                    self.factor_view[i, j] = total / self.factor_view[j, j]
                # T leaves independent rows, for which the matrix is positive definite: another pivot means that they lost rank.
                elif total > 0.0:
                    self.factor_view[i, i] = sqrt(total)
                else:
                    # Going on would divide by rounding: forces of any size.
                    raise np.linalg.LinAlgError("rows of closed loops depend on each other within a step")
        return 0

    cpdef bint fits(self) except -1:
        """Whether the combinations T are independent here, and the others vanish."""
        cdef Py_ssize_t i, j, k, column
        cdef double total, most = 0.0, left = 0.0
        self.evaluate()
        for i in range(self.r):
            # The combinations were chosen orthonormal in M^-1: pivots far from 1 say that they no longer are, and lose
            # digits.
            if self.factor_view[i, i] < LEAST_PIVOT or self.factor_view[i, i] > LARGEST_PIVOT:
                return False
        for j in range(self.columns.shape[0]):
            column = self.columns[j]
            for k in range(self.n):
                most = max(most, fabs(self.rows[k, column]))
            for i in range(self.others.shape[0]):
                total = 0.0
                for k in range(self.n):
                    total += self.others[i, k] * self.rows[k, column]
                left = max(left, fabs(total))
        # A combination that no longer vanishes is one more row to hold: left out, the loop would open along it.
        return left <= self.vanishes * most

    cpdef int begin(self) except -1:
        """Keep the rows at the state in ``data`` for :meth:`turns_over`: a step begins there."""
        self.evaluate()
        if self.r:
            memcpy(&self.start_response[0, 0], &self.response_view[0, 0], self.r * self.nv * sizeof(double))
        self.begun = True
        return 0

    cpdef bint turns_over(self) except -1:
        """Whether the rows have lost rank since the step began: the determinant of R_0 M^-1 R^T, 1 at first, changes sign.

        A singular value that passes zero within a step may be as large at its end as at its start.
        """
        cdef Py_ssize_t i, j, k, best
        cdef double total, sign = 1.0
        # Rows have been chosen anew since: there is no start to compare with.
        if not self.begun:
            return False
        self.evaluate()
        for i in range(self.r):
            for j in range(self.r):
                self.turn[i, j] = self.product(&self.start_response[i, 0], &self.R_view[j, 0])
        for i in range(self.r):  # Gaussian elimination
            best = i
            for k in range(i + 1, self.r):
                if fabs(self.turn[k, i]) > fabs(self.turn[best, i]):
                    best = k
            if best != i:
                sign = -sign
                for j in range(self.r):
                    total = self.turn[i, j]
                    self.turn[i, j], self.turn[best, j] = self.turn[best, j], total
            # A determinant of exactly zero has lost rank too.
            if self.turn[i, i] == 0.0:
                return True
            if self.turn[i, i] < 0.0:
                sign = -sign
            for k in range(i + 1, self.r):
                total = self.turn[k, i] / self.turn[i, i]
                for j in range(i, self.r):
                    self.turn[k, j] -= total * self.turn[i, j]
        # A product over all pivots is not needed, only its sign, which cannot overflow.
        return sign < 0.0

    def errors(self):
        """Errors in position of the rows R, (r,)."""
        cdef Py_ssize_t i
        errors = np.empty(self.r)
        cdef double[::1] view = errors
        self.write_errors()
        for i in range(self.r):
            view[i] = self.error(i)
        return errors

    cdef double error(self, Py_ssize_t i) noexcept:
        """Error in position of a row of R, after :meth:`write_errors`."""
        cdef Py_ssize_t k
        cdef double total = 0.0
        for k in range(self.n):
            total += self.T[i, k] * self.every_error[k]
        return total

    cdef int write_errors(self) except -1:
        """Write the errors in position of all rows."""
        cdef double[3] place, offset, rotation, one, other, part, row
        cdef Py_ssize_t i, k, n
        cdef int c
        cdef Latch latch
        cdef double[::1] every = self.every_error
        for source in self.places:
            if isinstance(source, JointRow):
                every[(<JointRow>source).start] = (<JointRow>source).error()
                continue
            if not isinstance(source, Latch):
                of_source, k = source
                every.base[k : k + of_source.count] = of_source.errors()
                continue
            latch = <Latch>source
            n = latch.count
            self.point(latch, place)
            turned(&self.xmat[latch.first, 0], &latch.point_in_first[0], offset)
            for c in range(3):
                offset[c] = place[c] - self.xpos[latch.first, c] - offset[c]
                rotation[c] = 0.0
            # A rotation about the axis is free, so only the axes themselves are compared; else all three directions are.
            for k in range(2 if latch.about_axis else 0, 3):
                turned(&self.xmat[latch.first, 0], &latch.axes_in_first[k, 0], one)
                turned(&self.xmat[latch.second, 0], &latch.axes_in_second[k, 0], other)
                cross(one, other, part)
                for c in range(3):
                    # The sum of e_i x e_i' over three axes is twice the sine of a small rotation.
                    rotation[c] += part[c] if latch.about_axis else 0.5 * part[c]
            for i in range(n):
                turned(&self.xmat[latch.first, 0], &latch.components[i, 0], row)
                every[latch.start + i] = row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]
                turned(&self.xmat[latch.first, 0], &latch.components[n + i, 0], row)
                every[latch.start + i] += row[0] * rotation[0] + row[1] * rotation[1] + row[2] * rotation[2]
        return 0

    def drift(self):
        """Largest error in position, and largest velocity, of the rows R."""
        cdef double gap, rate
        self.find_drift(&gap, &rate)
        return gap, rate

    cdef int find_drift(self, double* gap, double* rate) except -1:
        cdef Py_ssize_t i
        gap[0] = rate[0] = 0.0
        self.write_errors()
        self.evaluate()
        for i in range(self.r):
            rate[0] = max(rate[0], fabs(self.product(&self.qvel[0], &self.R_view[i, 0])))
            gap[0] = max(gap[0], fabs(self.error(i)))
        return 0

    cdef int solve(self, const double* force) except -1:
        """Forces y of the rows R."""
        cdef Py_ssize_t i, j
        cdef double total
        self.evaluate()
        for i in range(self.r):
            total = self.gamma_view[i]
            for j in range(self.nv):
                total += self.response_view[i, j] * force[j]
            for j in range(i):
                total -= self.factor_view[i, j] * self.y_view[j]
            self.y_view[i] = total / self.factor_view[i, i]
        for i in range(self.r - 1, -1, -1):
            total = self.y_view[i]
            for j in range(i + 1, self.r):
                total -= self.factor_view[j, i] * self.y_view[j]
            self.y_view[i] = total / self.factor_view[i, i]
        for i in range(self.r):
            self.y_view[i] = -self.y_view[i]
        return 0

    cdef double force_along(self, Py_ssize_t k) noexcept:
        """Force of one of all rows, of least norm, after :meth:`solve`."""
        cdef Py_ssize_t i
        cdef double total = 0.0
        for i in range(self.r):
            total += self.y_view[i] * self.T[i, k]
        return total

    cdef int write_loads(self, const Py_ssize_t[::1] counts, double* loads) except -1:
        """Write the loads of the first sources after :meth:`solve`, so many numbers of each.

        They are force, and torque about the point, of a latch on its second body, world axes, or the force along one row.
        """
        cdef double[6] wrench
        cdef double force
        cdef Py_ssize_t which, i, at = 0
        cdef int c
        cdef Latch latch
        for which in range(counts.shape[0]):
            place = self.places[which]
            if isinstance(place, Latch):
                latch = <Latch>place
                memset(wrench, 0, sizeof(wrench))
                for i in range(latch.count):
                    force = self.force_along(latch.start + i)
                    for c in range(3):
                        wrench[c] += force * latch.components[i, c]
                        wrench[3 + c] += force * latch.components[latch.count + i, c]
                # A ``connect`` logs its force only, a ``weld`` its torque too.
                for i in range(0, counts[which], 3):
                    turned(&self.xmat[latch.first, 0], wrench + i, loads + at + i)
            else:
                loads[at] = self.force_along((<JointRow>place).start if isinstance(place, JointRow) else place[1])
            at += counts[which]
        return 0

    cdef void add_to(self, double* generalised) noexcept:
        cdef Py_ssize_t i, j
        for i in range(self.r):
            for j in range(self.columns.shape[0]):
                # Only degrees of freedom that some row moves get a force: zeros elsewhere stay exact.
                generalised[self.columns[j]] += self.y_view[i] * self.R_view[i, self.columns[j]]

    def generalised(self, force):
        """Generalised forces of the rows under all other forces, (nv,)."""
        cdef const double[::1] contiguous = np.ascontiguousarray(force)
        accelerations = np.zeros(self.nv)
        cdef double[::1] generalised = accelerations
        self.solve(&contiguous[0])
        self.add_to(&generalised[0])
        return accelerations

    cpdef int push(self) except -1:
        """Add the generalised forces of the rows to ``data.qfrc_applied``."""
        cdef Py_ssize_t i
        # With a grasped object the efforts are written for the logged system: this model has controls of its own.
        if self.data is not self.seen:
            self.ctrl[:] = self.seen_ctrl
        # Rows answer to all forces, those of the present efforts included; the last evaluation may be of other ones.
        mj.fwdActuation(self.m, self.d)
        for i in range(self.nv):
            self.force[i] = self.passive[i] - self.bias[i] + self.actuator[i] + self.applied[i]
        self.solve(&self.force[0])
        self.add_to(&self.applied[0])
