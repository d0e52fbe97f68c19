# cython: boundscheck=False, wraparound=False, cdivision=True
"""The orbit of the origin of a scene: its motion, the field about it, and robot and objects relative to its axes."""

from threading import Lock

import numpy as np

from libc.math cimport cos, fabs, floor, NAN, sin, sqrt
from libc.string cimport memcpy, memset

from ffsm_mj._core.algebra cimport cross
from ffsm_mj._core.fields cimport Bodies, CompiledField, FieldForces
from ffsm_mj._core.tick cimport OnSample


cdef double _NEWTON = 4e-16
"""Relative change at which Newton's method ends: rounding."""


cdef class Reference:
    """An orbit: position and velocity at any time."""

    cdef int find(self, double time_s, double* R, double* V) except -1:
        """Write position and velocity."""
        raise NotImplementedError

    def state(self, double time_s):
        """Position in m and velocity in m/s at a time, (3,) each."""
        R, V = self.states(np.array((time_s,)))
        return R[0], V[0]

    def states(self, const double[:] times_s not None):
        """The same at several times, (n, 3) each."""
        cdef double[:, ::1] R, V
        cdef Py_ssize_t i
        positions, velocities = np.empty((times_s.shape[0], 3)), np.empty((times_s.shape[0], 3))
        R, V = positions, velocities
        for i in range(times_s.shape[0]):
            self.find(times_s[i], &R[i, 0], &V[i, 0])
        return positions, velocities


cdef class PiecewiseOrbit(Reference):
    """An orbit as polynomials: pieces of equal duration from t = 0 on, computed as they are asked for."""

    cdef double piece_s
    cdef list pieces
    cdef object lock
    cdef const double[:, ::1] piece  # the one in use, (degree + 1, 6)
    cdef Py_ssize_t number

    def __init__(self, double piece_s):
        self.piece_s, self.pieces, self.number, self.lock = piece_s, [], -1, Lock()

    def next_piece(self):
        """Coefficients of Chebyshev polynomials of position and velocity over the next piece, (degree + 1, 6)."""
        raise NotImplementedError

    cdef int find(self, double time_s, double* R, double* V) except -1:
        """Write position and velocity."""
        cdef Py_ssize_t number = max(0, <Py_ssize_t>floor(time_s / self.piece_s)), k
        cdef double place, low, high
        cdef double[6] state
        cdef int i
        if number != self.number:
            # Runs in several threads share an orbit: two that made the same piece would shift all later ones by a piece.
            with self.lock:
                while len(self.pieces) <= number:
                    self.pieces.append(np.ascontiguousarray(self.next_piece()))
            self.piece, self.number = self.pieces[number], number
        place = 2.0 * (time_s / self.piece_s - number) - 1.0
        for i in range(6):
            # Clenshaw's recurrence, from the highest degree down.
            low = high = 0.0
            for k in range(self.piece.shape[0] - 1, 0, -1):
                low, high = self.piece[k, i] + 2.0 * place * low - high, low
            state[i] = self.piece[0, i] + place * low - high
        memcpy(R, state, 3 * sizeof(double))
        memcpy(V, state + 3, 3 * sizeof(double))
        return 0


cdef class KeplerOrbit(Reference):
    """A Kepler orbit from its state at t = 0: position and velocity at any time, in closed form.

    R = F R0 + G V0 with the difference x of eccentric anomalies, x - c sin x + d (1 - cos x) = n t (Battin, *An Introduction
    to the Mathematics and Methods of Astrodynamics*, sec. 4.3): no division by the eccentricity.

    Attributes:
        mu: Gravitational parameter, m^3/s^2.
        semi_major_axis_m: Semi-major axis.
        rate_rad_s: Mean motion.
    """

    cdef readonly double mu, semi_major_axis_m, rate_rad_s
    cdef double c, d, radius
    cdef double[3] R0, V0

    def __init__(self, double mu, position_m, velocity_m_s):
        cdef int i
        cdef double square = 0.0, along = 0.0, energy
        for i in range(3):
            self.R0[i], self.V0[i] = position_m[i], velocity_m_s[i]
            square, along = square + self.V0[i] * self.V0[i], along + self.R0[i] * self.V0[i]
        self.mu, self.radius = mu, sqrt(self.R0[0] * self.R0[0] + self.R0[1] * self.R0[1] + self.R0[2] * self.R0[2])
        energy = 0.5 * square - mu / self.radius
        # Parabola and hyperbola have no eccentric anomaly: the closed form below is that of the ellipse. NaN is refused too.
        if not (mu > 0.0 and energy < 0.0):
            raise ValueError("the orbit is not closed")
        self.semi_major_axis_m = -0.5 * mu / energy
        self.rate_rad_s = sqrt(mu / self.semi_major_axis_m) / self.semi_major_axis_m
        self.c, self.d = 1.0 - self.radius / self.semi_major_axis_m, along / sqrt(mu * self.semi_major_axis_m)

    cdef int find(self, double time_s, double* R, double* V) except -1:
        """Write position and velocity."""
        cdef double a = self.semi_major_axis_m, n = self.rate_rad_s, M = n * time_s, x = M, s, versine, change, r
        cdef double F, G, Ft, Gt
        cdef int i
        for i in range(30):
            turn(x, &s, &versine)
            change = (x - self.c * s + self.d * versine - M) / (1.0 - self.c * (1.0 - versine) + self.d * s)
            x -= change
            # The anomaly grows with time, and its rounding with it.
            if fabs(change) <= _NEWTON * (1.0 + fabs(x)):
                break
        if change != 0.0:
            turn(x, &s, &versine)
        # Lagrange's coefficients: the orbit is the combination of its position and velocity at t = 0, in its own plane for
        # ever.
        F = 1.0 - a / self.radius * versine
        G = ((1.0 - self.c) * s + self.d * versine) / n
        r = a * (1.0 - self.c * (1.0 - versine) + self.d * s)
        Ft, Gt = -sqrt(self.mu * a) / (r * self.radius) * s, 1.0 - a / r * versine
        for i in range(3):
            R[i], V[i] = F * self.R0[i] + G * self.V0[i], Ft * self.R0[i] + Gt * self.V0[i]
        return 0


cdef inline void turn(double x, double* sine, double* versine) noexcept:
    """Write sin x and 1 - cos x, both of the half angle: the difference would lose half of its digits near x = 0."""
    cdef double s = sin(0.5 * x), c = cos(0.5 * x)
    sine[0], versine[0] = 2.0 * s * c, 2.0 * s * s


cdef class OrbitalField(CompiledField):
    """Tide and gravity-gradient force and torque of a central body, about a reference orbit in non-rotating axes.

    With p = R + r from the central body, q = r . (r + 2 R) / R^2 and s = (1 + q)^(3/2), a mass at r from the origin, which
    is in free fall, is accelerated by

        mu/R^3 (q (3 + 3 q + q^2) / (s (1 + s)) (R + r) - r)

    without a difference of nearly equal numbers (Battin, sec. 8.4). A body of inertia I about its mass centre also has, with
    d = p / |p|, the torque 3 mu / |p|^3 d x I d and the force -(3 mu / (2 |p|^4)) ((tr I - 5 d . I d) d + 2 I d).

    Attributes:
        reference: The reference orbit.
    """

    cdef readonly Reference reference
    cdef double mu, oblateness
    cdef double[3] pole
    cdef double last_s
    cdef double[3] R, V, at_origin  # position and velocity of the origin; acceleration by J2 there
    cdef double inverse, rate  # 1 / |R| and mu / R^3

    def __init__(self, Reference reference not None, double mu, double oblateness=0.0, pole=(0.0, 0.0, 1.0)):
        """Act about a reference orbit.

        Args:
            reference: The orbit.
            mu: Gravitational parameter, m^3/s^2.
            oblateness: 3/2 J2 mu R_E^2, m^5/s^2; the reference then moves under it too.
            pole: Axis of the central body, world axes, (3,).
        """
        self.reference, self.mu, self.oblateness = reference, mu, oblateness
        self.pole[0], self.pole[1], self.pole[2] = pole
        self.last_s = NAN

    cdef int find(self, double time_s) except -1:
        """Find the motion of the origin, and what else is the same for all bodies."""
        # Stages of a step share their times, and every body has the same origin: Kepler's equation is solved once for them.
        if time_s == self.last_s:
            return 0
        self.reference.find(time_s, self.R, self.V)
        self.inverse = 1.0 / sqrt(self.R[0] * self.R[0] + self.R[1] * self.R[1] + self.R[2] * self.R[2])
        self.rate, self.last_s = self.mu * self.inverse * self.inverse * self.inverse, time_s
        if self.oblateness != 0.0:
            # The origin falls under J2 too: only the difference to its acceleration acts in the scene.
            self.oblate(self.R, self.at_origin)
        return 0

    cdef void oblate(self, const double* p, double* a) noexcept:
        """Write the acceleration by J2 at a position from the central body."""
        cdef const double* k = self.pole
        cdef double square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], z = p[0] * k[0] + p[1] * k[1] + p[2] * k[2]
        cdef double factor = -self.oblateness / (square * square * sqrt(square))
        cdef int i
        for i in range(3):
            a[i] = factor * (p[i] * (1.0 - 5.0 * z * z / square) + 2.0 * z * k[i])

    def acceleration(self, double time_s, const double[::1] position not None):
        """Acceleration of a mass at a position from the origin at a time, m/s^2, (3,)."""
        # That of a body of unit mass without extension, whose axes do not matter.
        cdef double[3] inertia, force, torque
        cdef double[9] turn
        if len(position) != 3:
            raise ValueError(f"a position of {len(position)} numbers")
        memset(inertia, 0, sizeof(inertia))
        memset(force, 0, sizeof(force))
        memset(torque, 0, sizeof(torque))
        memset(turn, 0, sizeof(turn))
        self.find(time_s)
        self.add_to_body(1.0, inertia, &position[0], turn, force, torque)
        return np.array((force[0], force[1], force[2]))

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add forces and torques to those of the bodies."""
        cdef Py_ssize_t k
        self.find(time_s)
        for k in range(bodies.count):
            # A body without mass has no inertia either: nothing acts on it.
            if bodies.mass[k] != 0.0:
                self.add_to_body(
                    bodies.mass[k], &bodies.inertia[k, 0], &bodies.position[k, 0], &bodies.turn[k, 0], &bodies.force[k, 0],
                    &bodies.torque[k, 0],
                )
        return 0

    cdef inline void add_to_body(
        self, double m, const double* J, const double* r, const double* E, double* f, double* t
    ) noexcept:
        """Add force and torque of a body: mass, moments of inertia, position and principal axes, columns."""
        # Written out by components: loops over three cost more than what is in them.
        cdef double q = excess(self.R, self.inverse, r), nearer = 1.0 / sqrt(1.0 + q), cube = nearer * nearer * nearer
        cdef double x = self.R[0] + r[0], y = self.R[1] + r[1], z = self.R[2] + r[2], scale = self.inverse * nearer
        cdef double u = scale * x, v = scale * y, w = scale * z, pull = m * self.rate, away = pull * deficit(q, cube)
        cdef double a = E[0] * u + E[3] * v + E[6] * w, b = E[1] * u + E[4] * v + E[7] * w, c = E[2] * u + E[5] * v + E[8] * w
        cdef double A = J[0] * a, B = J[1] * b, C = J[2] * c, gradient = 3.0 * self.rate * cube
        cdef double X = E[0] * A + E[1] * B + E[2] * C, Y = E[3] * A + E[4] * B + E[5] * C, Z = E[6] * A + E[7] * B + E[8] * C
        # The reaction to the gradient on an extended body: with it the torque has a potential, and energy a balance.
        cdef double second = gradient * scale, along = 0.5 * second * (J[0] + J[1] + J[2] - 5.0 * (A * a + B * b + C * c))
        cdef double[3] there
        t[0] += gradient * (v * Z - w * Y)
        t[1] += gradient * (w * X - u * Z)
        t[2] += gradient * (u * Y - v * X)
        f[0] += away * x - pull * r[0] - along * u - second * X
        f[1] += away * y - pull * r[1] - along * v - second * Y
        f[2] += away * z - pull * r[2] - along * w - second * Z
        if self.oblateness != 0.0:
            there[0], there[1], there[2] = x, y, z
            self.oblate(there, there)
            f[0] += m * (there[0] - self.at_origin[0])
            f[1] += m * (there[1] - self.at_origin[1])
            f[2] += m * (there[2] - self.at_origin[2])

    cpdef double potential(self, double time_s, Bodies bodies) except? -1.0:
        """Potential of the forces and torques on the bodies at the time and state of their last evaluation, without J2, J."""
        cdef double total = 0.0, q, w, scale, u, v, z, a, b, c
        cdef const double* r
        cdef const double* E
        cdef const double* J
        cdef Py_ssize_t k
        self.find(time_s)
        for k in range(bodies.count):
            r, E, J = &bodies.position[k, 0], &bodies.turn[k, 0], &bodies.inertia[k, 0]
            q = excess(self.R, self.inverse, r)
            w = sqrt(1.0 + q)
            scale = self.inverse / w
            u, v, z = scale * (self.R[0] + r[0]), scale * (self.R[1] + r[1]), scale * (self.R[2] + r[2])
            a, b, c = E[0] * u + E[3] * v + E[6] * z, E[1] * u + E[4] * v + E[7] * z, E[2] * u + E[5] * v + E[8] * z
            total += bodies.mass[k] * self.rate * (
                0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
                # The potential less its value and slope at the origin, in a form in which these do not cancel: only the tide
                # is left.
                - q * q * (2.0 + w) / (2.0 * w * (1.0 + w) * (1.0 + w) * self.inverse * self.inverse)
            )
            total += (
                0.5 * self.rate / (w * w * w) * (3.0 * (J[0] * a * a + J[1] * b * b + J[2] * c * c) - (J[0] + J[1] + J[2]))
            )
        return total


cdef inline double excess(const double* R, double inverse, const double* r) noexcept:
    """q = |R + r|^2 / R^2 - 1, without a difference of nearly equal numbers."""
    return inverse * inverse * (r[0] * (r[0] + 2.0 * R[0]) + r[1] * (r[1] + 2.0 * R[1]) + r[2] * (r[2] + 2.0 * R[2]))


cdef inline double deficit(double q, double cube) noexcept:
    """1 - (R / p)^3 for q and (R / p)^3 itself, without the difference.

    At 1 m in 7000 km q is 3e-7, and a direct form would lose seven digits (Battin, sec. 8.4, with the inverse of s).
    """
    return q * (3.0 + q * (3.0 + q)) * cube * cube / (1.0 + cube)


cdef void find_axes(const double* R, const double* V, double oblateness, const double* pole, double* A, double* spin) noexcept:
    """Write LVLH axes as columns in world axes, (3, 3), and their angular velocity in world axes, rad/s.

    Args:
        R: Position from the central body, m.
        V: Velocity, m/s.
        oblateness: 3/2 J2 mu R_E^2, m^5/s^2.
        pole: Axis of the central body.
        A: The axes: V-bar, -H-bar and R-bar.
        spin: Their angular velocity.
    """
    cdef double[3] h, x, y, z
    cdef double square = R[0] * R[0] + R[1] * R[1] + R[2] * R[2], distance = sqrt(square), momentum, along, out
    cdef int i
    cross(R, V, h)
    momentum = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
    for i in range(3):
        x[i], z[i] = R[i] / distance, h[i] / momentum
    cross(z, x, y)
    for i in range(3):
        A[3 * i], A[3 * i + 1], A[3 * i + 2], spin[i] = y[i], -z[i], -x[i], h[i] / square
    if oblateness != 0.0:
        # J2 tilts the plane: its acceleration across the plane turns the axes about the radius.
        along = R[0] * pole[0] + R[1] * pole[1] + R[2] * pole[2]
        out = -2.0 * oblateness * along * (z[0] * pole[0] + z[1] * pole[1] + z[2] * pole[2]) / (square * square * momentum)
        for i in range(3):
            spin[i] += out * x[i]


def lvlh_axes(const double[:, ::1] positions not None, const double[:, ::1] velocities not None, double oblateness, pole):
    """LVLH axes at several states of an orbit, (n, 3, 3), and their angular velocities, (n, 3); see :func:`find_axes`."""
    cdef double[3] k
    cdef Py_ssize_t i
    cdef double[:, :, ::1] A
    cdef double[:, ::1] spins
    if positions.shape[1] != 3 or velocities.shape[1] != 3 or positions.shape[0] != velocities.shape[0]:
        raise ValueError(f"positions and velocities of {len(positions)} and {len(velocities)} states")
    k[0], k[1], k[2] = pole
    axes, spin = np.empty((positions.shape[0], 3, 3)), np.empty((positions.shape[0], 3))
    A, spins = axes, spin
    for i in range(positions.shape[0]):
        find_axes(&positions[i, 0], &velocities[i, 0], oblateness, k, &A[i, 0, 0], &spins[i, 0])
    return axes, spin


cdef class OrbitSample(OnSample):
    """Writes the columns of an orbit at each sample: the reference, the potential, and bodies relative to LVLH axes.

    Attributes:
        row: Position and velocity of the origin, the potential, and of each body 13 numbers: position, velocity relative to
            the rotating axes, attitude as a quaternion with w from 0 on, angular velocity relative to them in body axes.
    """

    cdef readonly object row
    cdef object fields
    cdef OrbitalField field
    cdef Py_ssize_t[::1] ids, roots
    cdef const double[:, ::1] places, turns, twists, centres
    cdef double[::1] values

    def __init__(self, OrbitalField field not None, fields, model, data, bodies):
        """Bind to a scene.

        Args:
            field: The field of the orbit.
            fields: What has the forces of all fields in the current motion as ``forces``.
            model: Model of the scene.
            data: Its data, derived quantities current at each sample.
            bodies: Ids of the bodies.
        """
        self.field, self.fields, self.ids = field, fields, np.array(bodies, dtype=np.intp)
        self.roots = np.array(model.body_rootid[bodies], dtype=np.intp)
        self.places, self.turns, self.twists, self.centres = data.xpos, data.xmat, data.cvel, data.subtree_com
        self.row = np.zeros(7 + 13 * len(bodies))
        self.values = self.row

    cdef int sample(self, double time_s) except -1:
        cdef FieldForces forces = self.fields.forces
        cdef double[9] A
        cdef double[3] spin
        cdef Py_ssize_t k
        forces.evaluate_now()
        self.values[6] = self.field.potential(time_s, forces.bodies)
        memcpy(&self.values[0], self.field.R, 3 * sizeof(double))
        memcpy(&self.values[3], self.field.V, 3 * sizeof(double))
        find_axes(self.field.R, self.field.V, self.field.oblateness, self.field.pole, A, spin)
        for k in range(self.ids.shape[0]):
            self.write_relative(k, A, spin, &self.values[7 + 13 * k])
        return 0

    cdef void write_relative(self, Py_ssize_t k, const double* A, const double* spin, double* out) noexcept:
        """Write the 13 numbers of a body for axes and their angular velocity."""
        cdef const double* r = &self.places[self.ids[k], 0]
        cdef const double* C = &self.turns[self.ids[k], 0]
        cdef const double* w = &self.twists[self.ids[k], 0]
        cdef const double* c = &self.centres[self.roots[k], 0]
        cdef double[3] arm, v, turning
        cdef double[9] relative
        cdef int i, j
        for i in range(3):
            arm[i], turning[i] = r[i] - c[i], w[i] - spin[i]
        # MuJoCo's velocity is that of the point at the tree's mass centre.
        cross(w, arm, v)
        cross(spin, r, arm)
        for i in range(3):
            v[i] += w[3 + i] - arm[i]
        for i in range(3):
            out[i] = A[i] * r[0] + A[3 + i] * r[1] + A[6 + i] * r[2]
            out[3 + i] = A[i] * v[0] + A[3 + i] * v[1] + A[6 + i] * v[2]
            out[10 + i] = C[i] * turning[0] + C[3 + i] * turning[1] + C[6 + i] * turning[2]
            for j in range(3):
                relative[3 * i + j] = A[i] * C[j] + A[3 + i] * C[3 + j] + A[6 + i] * C[6 + j]
        find_quaternion(relative, out + 6)


cdef void find_quaternion(const double* C, double* q) noexcept:
    """Write the unit quaternion of a rotation matrix, w from 0 on, by the largest of its four components (Shepperd)."""
    cdef double[4] squares
    cdef int i, largest = 0
    cdef double scale
    squares[0] = 1.0 + C[0] + C[4] + C[8]
    for i in range(3):
        squares[1 + i] = 1.0 + 2.0 * C[4 * i] - C[0] - C[4] - C[8]
    for i in range(1, 4):
        largest = i if squares[i] > squares[largest] else largest
    # Products of two components with the largest one, of which none is small.
    if largest == 0:
        q[0], q[1], q[2], q[3] = squares[0], C[7] - C[5], C[2] - C[6], C[3] - C[1]
    elif largest == 1:
        q[0], q[1], q[2], q[3] = C[7] - C[5], squares[1], C[1] + C[3], C[2] + C[6]
    elif largest == 2:
        q[0], q[1], q[2], q[3] = C[2] - C[6], C[1] + C[3], squares[2], C[5] + C[7]
    else:
        q[0], q[1], q[2], q[3] = C[3] - C[1], C[2] + C[6], C[5] + C[7], squares[3]
    scale = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = -scale if q[0] < 0.0 else scale
    for i in range(4):
        q[i] *= scale
