# cython: boundscheck=False, wraparound=False, cdivision=True
"""Magnetic field of the surroundings, and magnetorquers as an external field: the torque m x B of each dipole on its body."""

import numpy as np

from libc.math cimport atan2, cos, fmod, NAN, pi, sin, sqrt

from ffsm_mj._core.fields cimport Bodies, CompiledField, FieldForces
from ffsm_mj._core.orbit cimport Reference
from ffsm_mj._core.tick cimport OnSample


cdef double _RADIUS_M = 6371.2e3
"""Radius at which the coefficients of IGRF are stated."""
cdef double _DAY_S = 86400.0


cpdef double earth_rotation_angle(double days) noexcept:
    """Angle from the axis x of the inertial axes to the meridian of Greenwich, rad from 0 to 2 pi.

    IERS Conventions (2010), equation 5.15, with UTC for UT1: they differ by less than 0.9 s, 4e-3 degrees.

    Args:
        days: UT1 from 2000-01-01 12:00 on.
    """
    # The whole days are whole turns: without them the angle keeps its digits.
    return 2.0 * pi * fmod(0.7790572732640 + 0.00273781191135448 * days + fmod(days, 1.0), 1.0)


cdef class MagneticField:
    """A magnetic field in the world axes of a scene."""

    cdef int find(self, double time_s, const double* r, double* B) except -1:
        """Write the flux density at a position, T."""
        raise NotImplementedError

    def at(self, double time_s, const double[::1] position_m not None):
        """Flux density at a position in world axes, T, (3,)."""
        cdef double[3] B
        if len(position_m) != 3:
            raise ValueError(f"a position of {len(position_m)} numbers")
        self.find(time_s, &position_m[0], B)
        return np.array((B[0], B[1], B[2]))


cdef class UniformMagneticField(MagneticField):
    """The same everywhere and at any time."""

    cdef double[3] field

    def __init__(self, field_T):
        self.field[0], self.field[1], self.field[2] = field_T

    cdef int find(self, double time_s, const double* r, double* B) except -1:
        """Write the flux density at a position, T."""
        B[0], B[1], B[2] = self.field[0], self.field[1], self.field[2]
        return 0


cdef class Dipole(MagneticField):
    """Field of the tilted dipole of the Earth: the terms of degree 1 of its potential, a (a/r)^2 m . u."""

    cdef Reference reference
    cdef double[9] axes
    cdef double polar, across, longitude, days, last_s
    cdef double[3] origin, moment

    def __init__(self, Reference reference not None, axes, moment_T, double days):
        """Place it.

        Args:
            reference: Orbit of the origin of the world axes.
            axes: World axes as columns in the inertial axes of the Earth, (3, 3).
            moment_T: m in axes of the Earth: g11, h11 and g10, T.
            days: UT1 of t = 0 in days from 2000-01-01 12:00 on.
        """
        cdef int i
        for i in range(9):
            self.axes[i] = axes[i // 3][i % 3]
        x, y, self.polar = moment_T
        self.across, self.longitude = sqrt(x * x + y * y), atan2(y, x)
        self.reference, self.days, self.last_s = reference, days, NAN

    cdef int find(self, double time_s, const double* r, double* B) except -1:
        """Write the flux density at a position, T."""
        cdef double[3] p, V
        cdef double angle, x, y, square, inverse, cubed, along
        cdef int i
        # Bodies and sensors of one instant share the place of the origin and the turn of the Earth.
        if time_s != self.last_s:
            self.reference.find(time_s, self.origin, V)
            angle = self.longitude + earth_rotation_angle(self.days + time_s / _DAY_S)
            x, y = self.across * cos(angle), self.across * sin(angle)
            for i in range(3):
                self.moment[i] = self.axes[i] * x + self.axes[3 + i] * y + self.axes[6 + i] * self.polar
            self.last_s = time_s
        for i in range(3):
            p[i] = self.origin[i] + r[i]
        square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
        inverse = 1.0 / sqrt(square)
        cubed = _RADIUS_M * inverse
        cubed = cubed * cubed * cubed
        along = 3.0 * (self.moment[0] * p[0] + self.moment[1] * p[1] + self.moment[2] * p[2]) / square
        for i in range(3):
            B[i] = cubed * (along * p[i] - self.moment[i])
        return 0


cdef class Magnetorquers(CompiledField):
    """Torques of the magnetorquers of a scene, by the controls of its actuators.

    The dipole is held between two commands; attitude and magnetic field are those of each stage. The field is that at the
    mass centre of the body. The force on a dipole in a field that varies, some 1e-10 N in orbit, is left out.
    """

    cdef MagneticField magnetic
    cdef const Py_ssize_t[::1] actuators, bodies
    cdef const double[:, ::1] axes

    def __init__(self, actuators, bodies, axes, MagneticField magnetic not None):
        """Bind to the bodies of a model.

        Args:
            actuators: Ids of the magnetorquers among the actuators, (n,).
            bodies: Places of their bodies among the moving ones, (n,).
            axes: Their directions in the principal axes of these bodies, (n, 3).
            magnetic: The magnetic field.
        """
        self.actuators, self.bodies = np.array(actuators, dtype=np.intp), np.array(bodies, dtype=np.intp)
        self.axes, self.magnetic, self.by_controls = np.array(axes, dtype=float).reshape(-1, 3), magnetic, True
        if not len(actuators) == len(bodies) == len(self.axes):
            raise ValueError(f"{len(actuators)} magnetorquers at {len(bodies)} places along {len(self.axes)} axes")

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add the torques to those of the bodies."""
        cdef double[3] t
        cdef Py_ssize_t i
        cdef int j
        for i in range(self.actuators.shape[0]):
            self.torque(i, bodies.control[self.actuators[i]], time_s, bodies, t)
            for j in range(3):
                bodies.torque[self.bodies[i], j] += t[j]
        return 0

    cdef int torque(self, Py_ssize_t i, double dipole, double time_s, Bodies bodies, double* t) except -1:
        """Write the torque of one of them with a dipole, world axes, N m."""
        cdef const double* E = &bodies.turn[self.bodies[i], 0]
        cdef const double* e = &self.axes[i, 0]
        cdef double[3] m, B
        cdef int j
        if dipole == 0.0:
            t[0] = t[1] = t[2] = 0.0
            return 0
        self.magnetic.find(time_s, &bodies.position[self.bodies[i], 0], B)
        for j in range(3):
            m[j] = dipole * (E[3 * j] * e[0] + E[3 * j + 1] * e[1] + E[3 * j + 2] * e[2])
        t[0], t[1], t[2] = m[1] * B[2] - m[2] * B[1], m[2] * B[0] - m[0] * B[2], m[0] * B[1] - m[1] * B[0]
        return 0


cdef class TorqueSample(OnSample):
    """Writes the torques of magnetorquers at each sample.

    Attributes:
        row: The torques one after the other, world axes, N m, (3 n,).
    """

    cdef readonly object row
    cdef object fields
    cdef Magnetorquers torquers
    cdef const double[::1] controls
    cdef double[::1] values

    def __init__(self, Magnetorquers torquers not None, fields, const double[::1] controls not None):
        """Bind to a scene.

        Args:
            torquers: The magnetorquers.
            fields: What has the forces of all fields in the current motion as ``forces``.
            controls: Controls of the actuators of the scene, (nu,).
        """
        self.torquers, self.fields, self.controls = torquers, fields, controls
        self.row = np.zeros(3 * torquers.actuators.shape[0])
        self.values = self.row

    cdef int sample(self, double time_s) except -1:
        cdef FieldForces forces = self.fields.forces
        cdef Py_ssize_t i
        forces.evaluate_now()
        for i in range(self.torquers.actuators.shape[0]):
            dipole = self.controls[self.torquers.actuators[i]]
            self.torquers.torque(i, dipole, time_s, forces.bodies, &self.values[3 * i])
        return 0
