# cython: boundscheck=False, wraparound=False, cdivision=True
"""The OSDRE law, paper (32): for two outputs in floats, for any number of them in small arrays.

Singular values of the latter come from one-sided Jacobi rotations, which make the rows of a matrix orthogonal.
"""

cimport cython

import numpy as np

from ffsm_mj._core.riccati_doubling import RiccatiError

from libc.math cimport fabs, hypot, sqrt

from ffsm_mj._core.functions cimport address, mj, mjData, mjModel
from ffsm_mj._core.riccati_doubling cimport Doubling
from ffsm_mj._core.riccati_planar cimport blocks_t, matrix_t, pair_t, PlanarRiccati, principal_axes
from ffsm_mj._core.tick cimport Limits, TickLaw

# Rows of alpha M_c^-1 that are smaller, relative to the largest, do not move the output (numpy's limit for pinv).
cdef double NO_MOTION = 1e-15
cdef double ORTHOGONAL = 1e-16
cdef int SWEEPS = 60


cdef class TipKinematics:
    """Quantities of the output y at the state in ``data`` at the last ``update``."""

    def __init__(self, model, data, int site, axes):
        if not 0 <= site < model.nsite or not set(axes) <= {0, 1, 2}:
            raise ValueError(f"no site {site}, or axes {axes} that are none of 0, 1, 2")
        self.m, self.d, self.kept = <const mjModel*>address(model), <mjData*>address(data), (model, data)
        self.site, self.body, self.axes = site, model.site_bodyid[site], np.array(axes, dtype=np.intc)
        count, nv = len(axes), model.nv
        self.J, self.jac_dot, self.W = np.zeros((count, nv)), np.zeros((3, nv)), np.zeros((count, nv))
        self.jacp, self.rows, self.dot, self.w = np.zeros((3, nv)), self.J, self.jac_dot, self.W
        self.point = self.place = data.site_xpos[site]

    cpdef void update(self) noexcept:
        """Compute all quantities at the current state; derived quantities in ``data`` must be current."""
        cdef Py_ssize_t k, j
        mj.jacSite(self.m, self.d, &self.jacp[0, 0], NULL, self.site)
        # Acceleration of the output is J qddot + dJ/dt qdot: without the second term the drift lacks the centripetal part.
        mj.jacDot(self.m, self.d, &self.dot[0, 0], NULL, &self.place[0], self.body)
        for k in range(self.rows.shape[0]):
            for j in range(self.rows.shape[1]):
                self.rows[k, j] = self.jacp[self.axes[k], j]
        mj.solveM(self.m, self.d, &self.w[0, 0], &self.rows[0, 0], <int>self.rows.shape[0])


cpdef pair_t turned_pair(pair_t x, pair_t axes):
    """A vector by axes at an angle, given as (cosine, sine)."""
    return axes[0] * x[0] + axes[1] * x[1], axes[0] * x[1] - axes[1] * x[0]


@cython.locals(y0=double, y1=double, scale=double)
cpdef blocks_t lower_block(pair_t drift, pair_t y, pair_t y_dot, bint whole_stack):
    """Lower block (A21, A22) of the factorised dynamics, paper (30).

    With v^+ = v^T / |v|^2, zero at zero, it is d z^+ for the whole stack z = [y; ydot] and [0, d ydot^+] otherwise.

    Args:
        drift: Acceleration of the output without torques, d.
        y: Output.
        y_dot: Its rate.
        whole_stack: Which of the two parameterizations.
    """
    y0, y1 = y[0] if whole_stack else 0.0, y[1] if whole_stack else 0.0
    v0, v1 = y_dot
    # Any row r with r z = 1 factorises the drift as (d r) z; the pseudoinverse is the shortest of them.
    square = v0 * v0 + v1 * v1 + y0 * y0 + y1 * y1
    scale = 1.0 / square if square > 0.0 else 0.0
    d0, d1 = drift[0] * scale, drift[1] * scale
    return (d0 * y0, d0 * y1, d1 * y0, d1 * y1), (d0 * v0, d0 * v1, d1 * v0, d1 * v1)


@cython.locals(P2=matrix_t, P3=matrix_t)
cpdef pair_t feedback(blocks_t blocks, pair_t error, pair_t y_dot):
    """-[P2^T, P3] [y - y_d; ydot]."""
    P2, P3 = blocks
    e0, e1 = error
    v0, v1 = y_dot
    return (
        -(P2[0] * e0 + P2[2] * e1 + P3[0] * v0 + P3[1] * v1),
        -(P2[1] * e0 + P2[3] * e1 + P3[2] * v0 + P3[3] * v1),
    )


@cython.locals(A21=matrix_t, A22=matrix_t, blocks=blocks_t, residual=double, fallback=bint)
cpdef (pair_t, pair_t, double, bint) answer(
    PlanarRiccati riccati, pair_t S, pair_t axes, pair_t drift, pair_t y, pair_t error, pair_t y_dot, bint whole_stack
):
    """The law (32) without the gains R^-1 B^T of the torques.

    Args:
        riccati: Solver of the equation.
        S: Its eigenvalues.
        axes: Principal axes of S, as (cosine, sine) in those of the outputs.
        drift: Acceleration of the output without torques.
        y: Output.
        error: Its distance from the target.
        y_dot: Its rate.
        whole_stack: Which of the two parameterizations.

    Returns:
        What the gains take, in the axes of the outputs; the error along the principal axes; residual of the equation, and
        whether the robust method was needed.

    Raises:
        RiccatiError: The equation has no stabilising solution here.
    """
    error, y_dot = turned_pair(error, axes), turned_pair(y_dot, axes)
    A21, A22 = lower_block(turned_pair(drift, axes), turned_pair(y, axes), y_dot, whole_stack)
    blocks, residual, fallback = riccati.solve(A21, A22, S, axes)
    return turned_pair(feedback(blocks, error, y_dot), (axes[0], -axes[1])), error, residual, fallback


cdef void make_orthogonal(double[:, ::1] rows) noexcept:
    """One-sided Jacobi: rotate pairs of rows until they are orthogonal; their norms are the singular values."""
    cdef Py_ssize_t i, j, k
    cdef double a, b, c, t, tangent, cosine, sine
    cdef bint turned = True
    for _ in range(SWEEPS):
        # No pair of rows was rotated in a whole sweep: all are orthogonal to rounding.
        if not turned:
            return
        turned = False
        for i in range(rows.shape[0]):
            for j in range(i + 1, rows.shape[0]):
                a = b = c = 0.0
                for k in range(rows.shape[1]):
                    a += rows[i, k] * rows[i, k]
                    b += rows[j, k] * rows[j, k]
                    c += rows[i, k] * rows[j, k]
                # Relative to both rows: small singular values come out as accurate as large ones, which eigenvalues of the
                # product are not.
                if not fabs(c) > ORTHOGONAL * sqrt(a * b):
                    continue
                turned = True
                t = (b - a) / (2.0 * c)
                # The smaller of both roots: rotations by at most 45 degrees converge (Golub & Van Loan, *Matrix
                # Computations*).
                tangent = (1.0 if t >= 0.0 else -1.0) / (fabs(t) + sqrt(1.0 + t * t))
                cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for k in range(rows.shape[1]):
                    t = rows[i, k]
                    rows[i, k] = cosine * t - sine * rows[j, k]
                    rows[j, k] = sine * t + cosine * rows[j, k]


cpdef void note(double[::1] extremes, const double[::1] report) noexcept:
    """Note the largest of each number of the reports so far that says how the equation was solved, and the sum of the last.

    The last but one of a report is the exception: the fallback of two outputs, whose only such number it is, or corrections.
    """
    extremes[0], extremes[1] = max(extremes[0], report[1]), max(extremes[1], report[2])
    extremes[2] += report[report.shape[0] - 2]


cdef class OutputLaw:
    """u = -R^-1 B^T K [y - y_d; ydot], with K from a Riccati solver, and damping of what the output does not feel.

    The first half of ``driven`` selects the driven dofs, the second is R^-1 times these rows. ``extremes``: see :func:`note`.
    """

    def __init__(
        self,
        TipKinematics kinematics not None,
        data,
        object riccati not None,
        const double[:, ::1] driven,
        axes,
        target_m,
        bint whole_stack,
        double[::1] extremes not None,
        double damping,
        FieldForces field=None,
    ):
        cdef Py_ssize_t p = self.outputs(riccati)
        if driven.shape[1] != len(data.qvel) or not kinematics.rows.shape[0] == len(axes) == len(target_m) == p:
            raise ValueError(f"a selection of {driven.shape[1]} dofs or outputs along {axes} do not fit")
        self.kinematics, self.driven, self.whole_stack = kinematics, driven, whole_stack
        self.extremes, self.damping = extremes, damping
        self.qvel, self.bias, self.passive = data.qvel, data.qfrc_bias, data.qfrc_passive
        self.pushed, self.data, self.field = np.zeros(len(data.qvel)), data, field
        self.gains, self.effort = np.zeros((driven.shape[0], p)), np.zeros(driven.shape[0] // 2)
        self.rows, self.lengths = np.zeros((p, len(self.effort))), np.zeros(p)
        self.damped = np.zeros((2, len(self.effort)))
        self.report = self.begin(axes, target_m)
        self.u, self.figures = self.effort, self.report

    cpdef int tick(self) except -1:
        """Compute ``effort`` and ``report`` at the current state.

        Raises:
            RiccatiError: The equation has no stabilising solution here.
        """
        raise NotImplementedError

    cdef Py_ssize_t outputs(self, riccati) except -1:
        """Take the solver; returns the number of outputs that it is for."""
        raise NotImplementedError

    cdef object begin(self, axes, target_m):
        """Take outputs and target; returns the memory of the report."""
        raise NotImplementedError

    cdef int push(self) except -1:
        """Evaluate the forces of external fields at the current state."""
        if self.field is not None:
            # Forces of the field belong to the state of the last tick; they are added up anew.
            self.pushed[:] = 0.0
            self.field.evaluate(self.data)
            self.field.add_generalised(&self.pushed[0])
        return 0

    cdef void finish(self) noexcept:
        """Take the damping off, except what of it the output feels, which is along ``rows``; note the report."""
        cdef Py_ssize_t i, j, k, n = self.u.shape[0]
        cdef double felt
        if self.damping > 0.0:
            for k in range(n):
                self.damped[0, k] = 0.0
                for j in range(self.qvel.shape[0]):
                    self.damped[0, k] += self.driven[k, j] * self.qvel[j]
                self.damped[0, k] *= self.damping
                self.damped[1, k] = self.damped[0, k]
            for i in range(self.rows.shape[0]):
                felt = 0.0
                for k in range(n):
                    felt += self.rows[i, k] * self.damped[0, k]
                for k in range(n):
                    # What is left is orthogonal to the rows of alpha M_c^-1: a torque that accelerates no output
                    # (docs/derivations.md).
                    self.damped[1, k] -= self.rows[i, k] * felt
            for k in range(n):
                self.u[k] -= self.damped[1, k]
        note(self.extremes, self.figures)

    cdef double decompose(self) noexcept:
        """Compute an orthonormal basis of the rows of alpha M_c^-1; returns the smallest singular value."""
        cdef Py_ssize_t i, k, p = self.rows.shape[0], n = self.u.shape[0]
        cdef double smallest, greatest
        for i in range(p):
            for k in range(n):
                self.rows[i, k] = self.gains[k, i]
        make_orthogonal(self.rows)
        for i in range(p):
            self.lengths[i] = 0.0
            for k in range(n):
                self.lengths[i] += self.rows[i, k] * self.rows[i, k]
            self.lengths[i] = sqrt(self.lengths[i])
        smallest = greatest = self.lengths[0]
        for i in range(1, p):
            smallest, greatest = min(smallest, self.lengths[i]), max(greatest, self.lengths[i])
        for i in range(p):
            for k in range(n):
                # A row of rounding has a random direction; in a basis it would take damping away along it.
                self.rows[i, k] = self.rows[i, k] / self.lengths[i] if self.lengths[i] > NO_MOTION * greatest else 0.0
        return smallest


cdef class PlanarLaw(OutputLaw):
    """The law for two outputs, along the principal axes of S."""

    cdef PlanarRiccati riccati
    cdef int first, second
    cdef pair_t target

    cdef Py_ssize_t outputs(self, riccati) except -1:
        """See :class:`OutputLaw`."""
        self.riccati = riccati
        return 2

    cdef object begin(self, axes, target_m):
        """See :class:`OutputLaw`."""
        if not set(axes) <= {0, 1, 2}:
            raise ValueError(f"outputs along {axes}, which are none of 0, 1, 2")
        self.first, self.second = axes
        self.target = (target_m[0], target_m[1])
        return np.full(4, np.nan)

    cpdef int tick(self) except -1:
        """See :class:`OutputLaw`."""
        cdef TipKinematics tip = self.kinematics
        cdef double s0 = 0.0, s1 = 0.0, s3 = 0.0, b0 = 0.0, b1 = 0.0, b3 = 0.0
        cdef double v0 = 0.0, v1 = 0.0, d0 = 0.0, d1 = 0.0, y0, y1, force, smallest
        cdef Py_ssize_t i, j, n = self.u.shape[0]
        cdef pair_t values, axes, error, w
        cdef double residual
        cdef bint fallback
        tip.update()
        self.push()
        for i in range(2 * n):
            self.gains[i, 0] = self.gains[i, 1] = 0.0
            for j in range(self.qvel.shape[0]):
                self.gains[i, 0] += self.driven[i, j] * tip.w[0, j]
                self.gains[i, 1] += self.driven[i, j] * tip.w[1, j]
        for i in range(n):
            s0 += self.gains[n + i, 0] * self.gains[i, 0]
            s1 += self.gains[n + i, 0] * self.gains[i, 1]
            s3 += self.gains[n + i, 1] * self.gains[i, 1]
            b0 += self.gains[i, 0] * self.gains[i, 0]
            b1 += self.gains[i, 0] * self.gains[i, 1]
            b3 += self.gains[i, 1] * self.gains[i, 1]
        for j in range(self.qvel.shape[0]):
            # Springs, dampers and external fields accelerate the output without torques of the law: they are part of the
            # drift.
            force = self.bias[j] - self.passive[j] - self.pushed[j]
            v0 += tip.rows[0, j] * self.qvel[j]
            v1 += tip.rows[1, j] * self.qvel[j]
            d0 += tip.dot[self.first, j] * self.qvel[j] - tip.w[0, j] * force
            d1 += tip.dot[self.second, j] * self.qvel[j] - tip.w[1, j] * force
        # Along these axes nothing cancels in the equation, however near the pose is to a singular one (riccati_planar.pyx).
        values, axes = principal_axes(s0, s1, s3)
        smallest = principal_axes(b0, b1, b3)[0][1]
        y0, y1 = tip.place[self.first], tip.place[self.second]
        error = (y0 - self.target[0], y1 - self.target[1])
        w, error, residual, fallback = answer(
            self.riccati, values, axes, (d0, d1), (y0, y1), error, (v0, v1), self.whole_stack
        )
        for i in range(n):
            self.u[i] = self.gains[n + i, 0] * w[0] + self.gains[n + i, 1] * w[1]
        self.figures[0], self.figures[1] = hypot(error[0], error[1]), residual
        # B B^T has the squares of the singular values; rounding may leave the smaller one below zero.
        self.figures[2], self.figures[3] = fallback, sqrt(smallest if smallest > 0.0 else 0.0)
        if self.damping > 0.0:
            self.decompose()
        self.finish()
        return 0


cdef class BlockLaw(OutputLaw):
    """The law for any number of outputs."""

    cdef Doubling riccati
    cdef double[::1] y, y_dot, drift, target

    cdef Py_ssize_t outputs(self, riccati) except -1:
        """See :class:`OutputLaw`."""
        self.riccati = riccati
        return self.riccati.p

    cdef object begin(self, axes, target_m):
        """See :class:`OutputLaw`."""
        self.target = np.array(target_m, dtype=np.float64)
        self.y, self.y_dot, self.drift = np.zeros((3, len(axes)))
        return np.full(5, np.nan)

    cpdef int tick(self) except -1:
        """See :class:`OutputLaw`."""
        cdef Doubling riccati = self.riccati
        cdef Py_ssize_t i, j, k, p = riccati.p, n = self.u.shape[0]
        cdef double square, residual, asked, distance = 0.0, smallest
        self.kinematics.update()
        self.push()
        square = self.reduce()
        for i in range(p):
            for j in range(p):
                # Paper (30) factorises the drift along the velocity alone; with the whole stack the printed figures come out
                # (docs/derivations.md).
                riccati.A[p + i, j] = self.drift[i] * self.y[j] if self.whole_stack else 0.0
                riccati.A[p + i, p + j] = self.drift[i] * self.y_dot[j]
                riccati.S[p + i, p + j] = 0.0
                for k in range(n):
                    riccati.S[p + i, p + j] += self.gains[n + k, i] * self.gains[k, j]
        residual = riccati.solution()
        self.u[:] = 0.0
        for i in range(p):
            asked = 0.0
            for j in range(p):
                asked -= riccati.K[p + i, j] * (self.y[j] - self.target[j]) + riccati.K[p + i, p + j] * self.y_dot[j]
            for k in range(n):
                self.u[k] += self.gains[n + k, i] * asked
            distance += (self.y[i] - self.target[i]) ** 2
        smallest = self.decompose()
        self.figures[0], self.figures[1], self.figures[2] = sqrt(distance), residual, riccati.doublings
        self.figures[3], self.figures[4] = riccati.corrections, smallest
        self.finish()
        return 0

    cdef double reduce(self) noexcept:
        """Gains, output, output rate, and drift over the square of the parameterization vector; returns that square."""
        cdef TipKinematics tip = self.kinematics
        cdef Py_ssize_t i, j, k, p = self.y.shape[0]
        cdef double square = 0.0
        for k in range(self.driven.shape[0]):
            for i in range(p):
                self.gains[k, i] = 0.0
                for j in range(self.qvel.shape[0]):
                    self.gains[k, i] += self.driven[k, j] * tip.w[i, j]
        for i in range(p):
            self.y[i], self.y_dot[i], self.drift[i] = tip.place[tip.axes[i]], 0.0, 0.0
            for j in range(self.qvel.shape[0]):
                self.y_dot[i] += tip.rows[i, j] * self.qvel[j]
                self.drift[i] += tip.dot[tip.axes[i], j] * self.qvel[j] - tip.w[i, j] * (self.bias[j] - self.passive[j] - self.pushed[j])
            square += self.y_dot[i] * self.y_dot[i]
            if self.whole_stack:
                square += self.y[i] * self.y[i]
        # At z = 0 the pseudoinverse is zero, and so is the drift that it distributes.
        if square > 0.0:
            for i in range(p):
                self.drift[i] /= square
        return square


cdef class CommandingLaw(TickLaw):
    """A law with the command and the telemetry that it writes, which are those of the whole robot.

    ``before`` is called before each evaluation.
    """

    def __init__(
        self,
        OutputLaw law not None,
        actuators,
        effort,
        powered,
        places,
        telemetry,
        before=None,
    ):
        if not len(actuators) == len(law.u) or not len(places) == len(law.figures) or len(effort) != len(powered):
            raise ValueError(f"{len(actuators)} actuators and {len(places)} places do not fit the law")
        for index, room in ((actuators, effort), (places, telemetry)):
            if len(index) and not 0 <= min(index) <= max(index) < len(room):
                raise ValueError(f"places {index} do not fit an array of {len(room)}")
        self.law, self.actuators, self.effort, self.powered = law, actuators, effort, powered.view(np.uint8)
        self.places, self.telemetry, self.before = places, telemetry, before

    cdef bint command(self, Limits limits) except -1:
        """Command the actuators of the law; all others are off. Its equation may have no stabilising solution here."""
        cdef Py_ssize_t i
        if self.before is not None:
            self.before()
        try:
            self.law.tick()
        # Without a stabilising solution there is no command. The loop evaluates the law again, and reports it with time and
        # phase.
        except RiccatiError:
            return False
        for i in range(self.effort.shape[0]):
            # The law commands the whole robot: what it does not drive must not keep an effort of another phase.
            self.effort[i], self.powered[i] = 0.0, False
        for i in range(self.actuators.shape[0]):
            self.effort[self.actuators[i]], self.powered[self.actuators[i]] = self.law.u[i], True
        for i in range(self.places.shape[0]):
            self.telemetry[self.places[i]] = self.law.figures[i]
        return limits.apply()
