# cython: boundscheck=False, wraparound=False, cdivision=True
"""External fields in the stages of a step: forces and torques on every body, and their work and impulses.

A field acts on bodies one by one: its force at the mass centre, its torque about it. Generalised forces follow from the sums
over what each degree of freedom moves, in MuJoCo's axes of motion about the mass centre of the whole tree. Work and
impulses are integrals over the stages of a step, by its own weights: their error is that of the step.
"""

import numpy as np

from libc.math cimport cos, fabs, sin, sqrt
from libc.string cimport memset


cdef class Bodies:
    """The moving bodies of a scene at an instant, as an external field sees them; n of them, in the order of the model.

    Attributes:
        names: Their names.
        mass_kg: Their masses, (n,).
        inertia_kg_m2: Principal moments of inertia about the mass centre, (n, 3).
        position_m: Positions of the mass centres in world axes, (n, 3).
        axes: Principal axes of inertia, columns in world axes, (n, 3, 3).
        velocity_m_s: Velocities of the mass centres in world axes, (n, 3).
        angular_velocity_rad_s: Angular velocities in world axes, (n, 3).
        force_N: To this a field adds the forces at the mass centres in world axes, (n, 3).
        torque_N_m: To this it adds the torques about the mass centres in world axes, (n, 3).
    """

    def __init__(self, names, masses, inertias):
        self.names, self.count = tuple(names), len(names)
        self.mass_kg, self.inertia_kg_m2 = np.array(masses, dtype=float), np.array(inertias, dtype=float).reshape(-1, 3)
        if len(self.mass_kg) != self.count or len(self.inertia_kg_m2) != self.count:
            raise ValueError(f"{self.count} names, {len(self.mass_kg)} masses and {len(self.inertia_kg_m2)} inertias")
        self.position_m, self.velocity_m_s, self.angular_velocity_rad_s = (np.zeros((self.count, 3)) for _ in range(3))
        self.axes = np.zeros((self.count, 3, 3))
        self.forces, self.torques = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        self.mass, self.inertia, self.position = self.mass_kg, self.inertia_kg_m2, self.position_m
        self.turn, self.velocity = self.axes.reshape(-1, 9), self.velocity_m_s
        self.spin, self.force, self.torque = self.angular_velocity_rad_s, self.forces, self.torques

    @property
    def force_N(self):
        """Forces at the mass centres, (n, 3)."""
        return self.forces

    @force_N.setter
    def force_N(self, total):
        self.forces[...] = total  # as ``+=`` sets it

    @property
    def torque_N_m(self):
        """Torques about the mass centres, (n, 3)."""
        return self.torques

    @torque_N_m.setter
    def torque_N_m(self, total):
        self.torques[...] = total


cdef class CompiledField:
    """A field of the core."""

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add forces and torques to those of the bodies."""
        raise NotImplementedError


cdef class FieldForces:
    """Forces of external fields on the bodies of a motion.

    Attributes:
        bodies: The bodies with their forces and torques, as evaluated last.
        done: Work, and impulse (P, L about the world origin), in the last step by tree, J, N s and N m s, (trees, 7).
    """

    def __init__(self, model, data, ids, trees, Bodies bodies not None, fields, double[:, ::1] done not None):
        """Bind to a motion.

        Args:
            model: Model of the motion.
            data: Its data.
            ids: Ids of the bodies in this model, (n,).
            trees: Tree in the logged system of each, (n,).
            bodies: The bodies; values of this motion are written into it.
            fields: The fields.
            done: Receives work and impulses in a step, (trees, 7).
        """
        if not len(ids) == len(trees) == bodies.count or done.shape[1] != 7 or max(trees, default=-1) >= len(done):
            raise ValueError(f"{len(ids)} bodies in {len(trees)} trees do not fit")
        self.data, self.bodies, self.fields = data, bodies, tuple(fields)
        self.ids, self.trees = np.array(ids, dtype=np.intp), np.array(trees, dtype=np.intp)
        self.parents, self.roots, self.dof_bodies = model.body_parentid, model.body_rootid, model.dof_bodyid
        self.total, self.rates, self.sums = np.zeros((model.nbody, 6)), np.zeros_like(done), np.zeros_like(done)
        self.done, self.work, self.applied = done.base, done, data.qfrc_applied

    cpdef int push(self, data) except -1:
        """Add the generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""
        cdef double[::1] applied
        self.evaluate(data)
        if data is self.data:
            self.generalise(&self.applied[0])
            self.rate()
        else:
            applied = data.qfrc_applied
            self.generalise(&applied[0])
        return 0

    def add_to(self, data, double[::1] applied not None):
        """Add the generalised forces at the state in ``data``, derived quantities current, to an array, (nv,)."""
        if len(applied) != self.dof_bodies.shape[0]:
            raise ValueError(f"an array of {len(applied)} for {self.dof_bodies.shape[0]} degrees of freedom")
        self.evaluate(data)
        self.generalise(&applied[0])

    def evaluate_now(self):
        """Evaluate the forces and torques on the bodies at the state of the motion."""
        self.evaluate(self.data)

    cdef int evaluate(self, data) except -1:
        """Evaluate the forces and torques on the bodies, and sum them up about the mass centres of the trees."""
        cdef Bodies bodies = self.bodies
        cdef Py_ssize_t k, b, i
        cdef const double* c
        cdef const double* w
        cdef double x, y, z
        # Views of MuJoCo's arrays cost more than the sums over a few bodies: they are taken once for each data.
        if data is not self.bound:
            self.bound, self.centres, self.frames, self.twists = data, data.xipos, data.ximat, data.cvel
            self.subtree_centres, self.axes_of_dofs = data.subtree_com, data.cdof
        for k in range(bodies.count):
            b = self.ids[k]
            c, w = &self.subtree_centres[self.roots[b], 0], &self.twists[b, 0]
            for i in range(3):
                bodies.position[k, i], bodies.spin[k, i] = self.centres[b, i], w[i]
                bodies.force[k, i] = bodies.torque[k, i] = 0.0
            for i in range(9):
                bodies.turn[k, i] = self.frames[b, i]
            # MuJoCo's cvel is the velocity of the point at the tree's mass centre: moved to that of the body, at which a
            # field acts.
            x, y, z = bodies.position[k, 0] - c[0], bodies.position[k, 1] - c[1], bodies.position[k, 2] - c[2]
            bodies.velocity[k, 0] = w[3] + w[1] * z - w[2] * y
            bodies.velocity[k, 1] = w[4] + w[2] * x - w[0] * z
            bodies.velocity[k, 2] = w[5] + w[0] * y - w[1] * x
        now = data.time
        for field in self.fields:
            if isinstance(field, CompiledField):
                (<CompiledField>field).add_wrenches(now, bodies)
            else:
                field.add_wrenches(now, bodies)
        memset(&self.total[0, 0], 0, 6 * self.total.shape[0] * sizeof(double))
        for k in range(bodies.count):
            b = self.ids[k]
            c = &self.subtree_centres[self.roots[b], 0]
            x, y, z = bodies.position[k, 0] - c[0], bodies.position[k, 1] - c[1], bodies.position[k, 2] - c[2]
            # The axes of the degrees of freedom (cdof) are about the mass centre of the tree, so the moments must be too.
            self.total[b, 0] = bodies.torque[k, 0] + y * bodies.force[k, 2] - z * bodies.force[k, 1]
            self.total[b, 1] = bodies.torque[k, 1] + z * bodies.force[k, 0] - x * bodies.force[k, 2]
            self.total[b, 2] = bodies.torque[k, 2] + x * bodies.force[k, 1] - y * bodies.force[k, 0]
            for i in range(3):
                self.total[b, 3 + i] = bodies.force[k, i]
        return 0

    cdef void generalise(self, double* applied) noexcept:
        """Add the generalised forces of what was evaluated last, (nv,)."""
        cdef Py_ssize_t b, d, i
        cdef double sum
        # Children have larger ids than their parents: one pass from the last body adds up what each joint carries.
        for b in range(self.total.shape[0] - 1, 0, -1):
            # The world takes no force.
            if self.parents[b] > 0:
                for i in range(6):
                    self.total[self.parents[b], i] += self.total[b, i]
        for d in range(self.dof_bodies.shape[0]):
            sum = 0.0
            for i in range(6):
                sum += self.axes_of_dofs[d, i] * self.total[self.dof_bodies[d], i]
            applied[d] += sum

    cdef void rate(self) noexcept:
        """Write power, force and moment about the world origin by tree."""
        cdef Bodies bodies = self.bodies
        cdef Py_ssize_t k, i
        cdef double* rate
        cdef const double* f
        cdef const double* t
        cdef const double* p
        memset(&self.rates[0, 0], 0, 7 * self.rates.shape[0] * sizeof(double))
        for k in range(bodies.count):
            rate, f, t, p = &self.rates[self.trees[k], 0], &bodies.force[k, 0], &bodies.torque[k, 0], &bodies.position[k, 0]
            for i in range(3):
                rate[0] += f[i] * bodies.velocity[k, i] + t[i] * bodies.spin[k, i]
                rate[1 + i] += f[i]
            # About the world origin, as all angular momenta of the balance.
            rate[4] += t[0] + p[1] * f[2] - p[2] * f[1]
            rate[5] += t[1] + p[2] * f[0] - p[0] * f[2]
            rate[6] += t[2] + p[0] * f[1] - p[1] * f[0]

    cpdef int begin(self) except -1:
        """Begin the sum over the stages of a step."""
        memset(&self.sums[0, 0], 0, 7 * self.sums.shape[0] * sizeof(double))
        return 0

    cpdef int add(self, double weight) except -1:
        """Add a stage, whose forces were pushed last, with its weight."""
        cdef Py_ssize_t i, j
        for i in range(self.sums.shape[0]):
            for j in range(7):
                self.sums[i, j] += weight * self.rates[i, j]
        return 0

    cpdef int end(self, double duration_s) except -1:
        """End a step of a duration, over which the weights add up to 1."""
        cdef Py_ssize_t i, j
        for i in range(self.sums.shape[0]):
            for j in range(7):
                self.work[i, j] = duration_s * self.sums[i, j]
        return 0


cdef double _NEWTON = 4e-16
"""Relative change at which Newton's method ends: rounding."""


cdef class KeplerOrbit:
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

    cdef void find(self, double time_s, double* R, double* V) noexcept:
        """Write the position, and the velocity unless it is NULL."""
        cdef double a = self.semi_major_axis_m, n = self.rate_rad_s, M = n * time_s, x = M, s, h, versine, change, r
        cdef double F, G, Ft, Gt
        cdef int i
        for i in range(30):
            # 1 - cos x as 2 sin^2 (x / 2): near x = 0 the difference would lose half of the digits.
            s, h = sin(x), sin(0.5 * x)
            versine = 2.0 * h * h
            change = (x - self.c * s + self.d * versine - M) / (1.0 - self.c * (1.0 - versine) + self.d * s)
            x -= change
            # The anomaly grows with time, and its rounding with it.
            if fabs(change) <= _NEWTON * (1.0 + fabs(x)):
                break
        s, h = sin(x), sin(0.5 * x)
        versine = 2.0 * h * h
        # Lagrange's coefficients: the orbit is the combination of its position and velocity at t = 0, in its own plane for
        # ever.
        F = 1.0 - a / self.radius * versine
        G = ((1.0 - self.c) * s + self.d * versine) / n
        r = a * (1.0 - self.c * (1.0 - versine) + self.d * s)
        Ft, Gt = -sqrt(self.mu * a) / (r * self.radius) * s, 1.0 - a / r * versine
        for i in range(3):
            R[i] = F * self.R0[i] + G * self.V0[i]
            if V != NULL:
                V[i] = Ft * self.R0[i] + Gt * self.V0[i]

    def state(self, double time_s):
        """Position in m and velocity in m/s at a time, (3,) each."""
        cdef double[3] R, V
        self.find(time_s, R, V)
        return np.array((R[0], R[1], R[2])), np.array((V[0], V[1], V[2]))

    def states(self, const double[:] times_s not None):
        """The same at several times, (n, 3) each."""
        cdef double[:, ::1] R, V
        cdef Py_ssize_t i
        positions, velocities = np.empty((times_s.shape[0], 3)), np.empty((times_s.shape[0], 3))
        R, V = positions, velocities
        for i in range(times_s.shape[0]):
            self.find(times_s[i], &R[i, 0], &V[i, 0])
        return positions, velocities


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

    cdef readonly object reference
    cdef KeplerOrbit orbit
    cdef double mu, oblateness
    cdef double[3] pole
    cdef double last_s
    cdef double[3] R, at_origin  # position of the origin; acceleration by J2 there
    cdef double distance, inverse_square, rate  # |R|, 1 / R^2 and mu / R^3

    def __init__(self, reference, double mu, double oblateness=0.0, pole=(0.0, 0.0, 1.0)):
        """Act about a reference orbit.

        Args:
            reference: A :class:`KeplerOrbit`, or what has its method ``state``.
            mu: Gravitational parameter, m^3/s^2.
            oblateness: 3/2 J2 mu R_E^2, m^5/s^2; the reference then moves under it too.
            pole: Axis of the central body, world axes, (3,).
        """
        self.reference, self.mu, self.oblateness = reference, mu, oblateness
        self.orbit = reference if isinstance(reference, KeplerOrbit) else None
        self.pole[0], self.pole[1], self.pole[2] = pole
        self.last_s = float("nan")

    cdef int find(self, double time_s) except -1:
        """Find the position of the origin, and what else is the same for all bodies."""
        cdef double square
        # Stages of a step share their times, and every body has the same origin: Kepler's equation is solved once for them.
        if time_s == self.last_s:
            return 0
        if self.orbit is not None:
            self.orbit.find(time_s, self.R, NULL)
        else:
            (self.R[0], self.R[1], self.R[2]), _ = self.reference.state(time_s)
        square = self.R[0] * self.R[0] + self.R[1] * self.R[1] + self.R[2] * self.R[2]
        self.distance, self.inverse_square = sqrt(square), 1.0 / square
        self.rate, self.last_s = self.mu * self.inverse_square / self.distance, time_s
        if self.oblateness != 0.0:
            # The origin falls under J2 too: only the difference to its acceleration acts in the scene.
            self.oblate(self.R, self.at_origin)
        return 0

    cdef double excess(self, const double* r) noexcept nogil:
        """q = |R + r|^2 / R^2 - 1, without a difference of nearly equal numbers."""
        cdef const double* R = self.R
        return self.inverse_square * (
            r[0] * (r[0] + 2.0 * R[0]) + r[1] * (r[1] + 2.0 * R[1]) + r[2] * (r[2] + 2.0 * R[2])
        )

    cdef double tide(self, const double* r, double* a) noexcept:
        """Write the acceleration at a position from the origin; returns the distance from the central body over R."""
        cdef double q = self.excess(r), w = sqrt(1.0 + q), s = (1.0 + q) * w
        # 1 - (R / p)^3 without the difference: at 1 m in 7000 km q is 3e-7, and a direct form would lose seven digits
        # (Battin, sec. 8.4).
        cdef double factor = q * (3.0 + q * (3.0 + q)) / (s * (1.0 + s))
        cdef double[3] p, there
        cdef int i
        for i in range(3):
            p[i] = self.R[i] + r[i]
            a[i] = self.rate * (factor * p[i] - r[i])
        if self.oblateness != 0.0:
            self.oblate(p, there)
            for i in range(3):
                a[i] += there[i] - self.at_origin[i]
        return w

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
        cdef double[3] a
        if len(position) != 3:
            raise ValueError(f"a position of {len(position)} numbers")
        self.find(time_s)
        self.tide(&position[0], a)
        return np.array((a[0], a[1], a[2]))

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add forces and torques to those of the bodies."""
        cdef Py_ssize_t k
        cdef int i
        cdef double[3] a, d, along, Id
        cdef const double* E
        cdef const double* r
        cdef const double* J
        cdef double* f
        cdef double* t
        cdef double w, inverse, dId, trace, gradient, along_d
        self.find(time_s)
        for k in range(bodies.count):
            # A body without mass has no inertia either: nothing acts on it.
            if bodies.mass[k] == 0.0:
                continue
            r, E, J = &bodies.position[k, 0], &bodies.turn[k, 0], &bodies.inertia[k, 0]
            w = self.tide(r, a)
            inverse = 1.0 / (self.distance * w)
            for i in range(3):
                d[i] = inverse * (self.R[i] + r[i])
            trace = dId = 0.0
            for i in range(3):  # components along the principal axes
                along_d = E[i] * d[0] + E[3 + i] * d[1] + E[6 + i] * d[2]
                along[i] = J[i] * along_d
                trace += J[i]
                dId += along[i] * along_d
            for i in range(3):
                Id[i] = E[3 * i] * along[0] + E[3 * i + 1] * along[1] + E[3 * i + 2] * along[2]
            gradient, f, t = 3.0 * self.rate / (w * w * w), &bodies.force[k, 0], &bodies.torque[k, 0]
            t[0] += gradient * (d[1] * Id[2] - d[2] * Id[1])
            t[1] += gradient * (d[2] * Id[0] - d[0] * Id[2])
            t[2] += gradient * (d[0] * Id[1] - d[1] * Id[0])
            for i in range(3):
                # The last term is the reaction to the gradient on an extended body: with it the torque has a potential, and
                # energy a balance.
                f[i] += bodies.mass[k] * a[i] - 0.5 * gradient * inverse * ((trace - 5.0 * dId) * d[i] + 2.0 * Id[i])
        return 0

    def potential(self, double time_s, Bodies bodies not None):
        """Potential of the forces and torques on the bodies at the time and state of their last evaluation, without J2, J."""
        cdef double total = 0.0, q, w, dId, trace, along
        cdef const double* r
        cdef const double* E
        cdef Py_ssize_t k
        cdef int i
        self.find(time_s)
        for k in range(bodies.count):
            r, E = &bodies.position[k, 0], &bodies.turn[k, 0]
            q = self.excess(r)
            w = sqrt(1.0 + q)
            dId = trace = 0.0
            for i in range(3):
                along = E[i] * (self.R[0] + r[0]) + E[3 + i] * (self.R[1] + r[1]) + E[6 + i] * (self.R[2] + r[2])
                along /= self.distance * w
                dId, trace = dId + bodies.inertia[k, i] * along * along, trace + bodies.inertia[k, i]
            total += bodies.mass[k] * self.rate * (
                0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
                # The potential less its value and slope at the origin, in a form in which these do not cancel: only the tide
                # is left.
                - q * q * (2.0 + w) / (2.0 * w * (1.0 + w) * (1.0 + w)) / self.inverse_square
            )
            total += 0.5 * self.rate / (w * w * w) * (3.0 * dId - trace)
        return total
