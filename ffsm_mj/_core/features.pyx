# cython: boundscheck=False, wraparound=False, cdivision=True
"""Points of one body over a face of another, evaluated together: gaps, their rates, and the rows of the points.

Formulas are those of :mod:`ffsm_mj.dynamics.body_twists`, point by point.
"""

cimport cython

import numpy as np

from ffsm_mj.contact.features.gap_function import FeatureState

from libc.math cimport fabs

from ffsm_mj._core.algebra cimport cross, dot
from ffsm_mj._core.memory cimport numbers, room


cdef enum:
    PLACE = 0  # columns of the table of a state
    LOCAL = 3
    POINT = 6
    POINT_RATE = 9
    NORMAL = 12
    GAP = 15
    LEVEL = 16
    RATE = 17
    BEND = 18
    COLUMNS = 19

cdef inline void minus(const double* a, const double* b, double* out) noexcept nogil:
    out[0], out[1], out[2] = a[0] - b[0], a[1] - b[1], a[2] - b[2]


cdef inline void velocity_at(const Twist* body, const double* arm, double* out) noexcept nogil:
    """Velocity of the material point at an arm from the centre."""
    cross(body.omega, arm, out)
    out[0], out[1], out[2] = body.velocity[0] + out[0], body.velocity[1] + out[1], body.velocity[2] + out[2]


cdef inline void spatial_at(const Twist* body, const double* arm, double* out) noexcept nogil:
    """Rate at qacc = 0 of the velocity of the material points that pass a place fixed in space."""
    cross(body.alpha, arm, out)
    out[0] += body.acceleration[0]
    out[1] += body.acceleration[1]
    out[2] += body.acceleration[2]


cdef class FaceGroup:
    """Points of one body over a face of another; the first body is that of the face, the second that of the points.

    One point over a face is a group too.
    """

    def __init__(self, features, data, *, in_patch):
        """Store the points.

        Args:
            features: The points, see ``contact_points.py``.
            data: Data of the logged system.
            in_patch: See ``contact_points.py``.
        """
        cdef int i
        face, self.count, self.swapped, self.in_patch = features[0].face, len(features), features[0].swapped, in_patch
        self.face = face
        for i in range(3):
            self.normal[i] = face.normal[i]
        self.level = float(np.dot(face.normal, face.centre))
        self.centres = np.array([feature.point.centre for feature in features])
        self.first_radius, self.radius = np.ascontiguousarray(np.array([feature.radii for feature in features]).T)
        self.sides = np.array([(*inwards, level) for inwards, level in face.sides]).reshape(-1, 4)
        first, second = face.body.id, features[0].point.body.id
        self.first_origin, self.first_axes = data.xpos[first], data.xmat[first]
        self.second_origin, self.second_axes = data.xpos[second], data.xmat[second]

    cdef FaceState at_state(self, const Twist* b, const Twist* a):
        """The points at the current state, with the twists of both bodies of the contact there."""
        cdef FaceState state = FaceState.__new__(FaceState)
        state.group, state.count, state.block = self, self.count, room(self.count * COLUMNS)
        # Pairs are ordered by their bodies, features by face and point: where these differ, normals turn round.
        state.values, state.sign = numbers(state.block), -1.0 if self.swapped else 1.0
        state.go_to(b, a)
        return state


@cython.no_gc  # no cycle contains it
cdef class FaceState:
    """Points over a face at one state."""

    cdef void go_to(self, const Twist* b, const Twist* a) noexcept:
        """Take the current state, with the twists of both bodies of the contact there."""
        self.first = b[0] if self.group.swapped else a[0]
        self.second = a[0] if self.group.swapped else b[0]
        if self.group.in_patch:
            # Normals of a flat patch turn with body a for all points, so that second rates are affine in the place
            # (contact_points.py).
            self.place_points(a.omega)
        else:
            self.place_points(self.first.omega)

    cdef void place_points(self, const double* omega) noexcept:
        cdef FaceGroup group = self.group
        cdef Py_ssize_t p
        cdef int i
        cdef double height
        cdef double* row
        cdef double[3] arm, other, w, one
        for i in range(3):
            self.normal[i] = (
                group.first_axes[3 * i] * group.normal[0]
                + group.first_axes[3 * i + 1] * group.normal[1]
                + group.first_axes[3 * i + 2] * group.normal[2]
            )
        minus(self.second.centre, self.first.centre, self.offset)
        # The normal of a point on a face turns with the face, whichever body of the contact that is.
        cross(self.first.omega, self.normal, self.face_turning)
        cross(omega, self.normal, self.turning)
        for p in range(self.count):
            row = self.values + p * COLUMNS
            for i in range(3):
                row[PLACE + i] = group.second_origin[i] + (
                    group.centres[p, 0] * group.second_axes[3 * i]
                    + group.centres[p, 1] * group.second_axes[3 * i + 1]
                    + group.centres[p, 2] * group.second_axes[3 * i + 2]
                )
                one[i] = row[PLACE + i] - group.first_origin[i]
            for i in range(3):
                row[LOCAL + i] = (
                    one[0] * group.first_axes[i] + one[1] * group.first_axes[3 + i] + one[2] * group.first_axes[6 + i]
                )
            # In the frame of the face: positions in world axes far from the origin would round the gap.
            height = dot(row + LOCAL, group.normal) - group.level
            row[GAP] = height - group.radius[p]
            # The force acts in the middle of the gap, at one point of both bodies: the pair of forces has no moment.
            row[LEVEL] = group.first_radius[p] + 0.5 * row[GAP] - height
            minus(row + PLACE, self.second.centre, arm)
            for i in range(3):
                other[i] = arm[i] + self.offset[i]
            velocity_at(&self.second, arm, w)
            velocity_at(&self.first, other, one)
            for i in range(3):
                row[POINT_RATE + i] = w[i]
                w[i] -= one[i]
            # The largest term of the second rate of the gap by the turning normal: its rounding is that of this term.
            row[RATE], row[BEND] = dot(self.normal, w), 2.0 * dot(self.face_turning, w)
            for i in range(3):
                row[POINT + i] = row[PLACE + i] + row[LEVEL] * self.normal[i]
                row[POINT_RATE + i] += row[LEVEL] * self.face_turning[i] - 0.5 * row[RATE] * self.normal[i]
                row[NORMAL + i] = self.sign * self.normal[i]

    cdef const double* centre(self) noexcept:
        """Centre of body b of the contact, about which moments of wrench rows are."""
        return &self.first.centre[0] if self.group.swapped else &self.second.centre[0]

    cdef const double* point(self, Py_ssize_t p) noexcept:
        """Point of application of the force at a point."""
        return self.values + p * COLUMNS + POINT

    cdef void wrench_row(self, const double* axis, const double* place, double* row) noexcept:
        """Moment and force of a unit force along an axis at a place."""
        cdef double[3] arm
        # Moments about a centre near the contact: about the world origin rows of a distant pair would be almost parallel.
        minus(place, self.centre(), arm)
        cross(arm, axis, row)
        row[3], row[4], row[5] = axis[0], axis[1], axis[2]

    cdef double normal_rate(self, const Twist* body, const double* arm) noexcept:
        """Acceleration of a material point along the normal at qacc = 0, and twice its velocity along the normal's rate."""
        cdef double[3] velocity, bent
        velocity_at(body, arm, velocity)
        cross(body.omega, velocity, bent)
        cdef double total = dot(self.normal, bent) + 2.0 * dot(self.turning, velocity)
        spatial_at(body, arm, bent)
        return total + dot(self.normal, bent)

    cdef double normal_gamma(self, Py_ssize_t p) noexcept:
        cdef double[3] arm, other
        minus(self.values + p * COLUMNS + PLACE, self.second.centre, arm)
        minus(self.values + p * COLUMNS + PLACE, self.first.centre, other)
        return self.normal_rate(&self.second, arm) - self.normal_rate(&self.first, other)

    cdef void outward(self, double* normal) noexcept:
        """Normal from a to b."""
        cdef int i
        for i in range(3):
            normal[i] = self.sign * self.normal[i]

    cdef void normal_rows(self, double* rows, double* gamma) noexcept:
        """Write the wrench rows of the normals and the second rates of the gaps at qacc = 0 into rows (n, t1, t2)."""
        cdef Py_ssize_t p
        cdef double[3] normal
        self.outward(normal)
        for p in range(self.count):
            self.wrench_row(normal, self.values + p * COLUMNS + PLACE, rows + 18 * p)
            gamma[3 * p] = self.normal_gamma(p)

    cdef void tangential_rows(self, const double* tangents, double* rows, double* gamma) noexcept:
        """Write the wrench rows of two tangents and the rates along these into rows (n, t1, t2) of each point."""
        cdef Py_ssize_t p
        cdef int j
        cdef double[3] arm, other, acceleration, there, spin
        # Points of application move over both bodies: each adds its spin times their motion relative to it, and only the
        # difference is left.
        minus(self.second.omega, self.first.omega, spin)
        for p in range(self.count):
            minus(self.values + p * COLUMNS + POINT, self.second.centre, arm)
            minus(self.values + p * COLUMNS + POINT, self.first.centre, other)
            spatial_at(&self.second, arm, acceleration)
            spatial_at(&self.first, other, there)
            minus(acceleration, there, acceleration)
            cross(spin, self.values + p * COLUMNS + POINT_RATE, there)
            for j in range(2):
                self.wrench_row(tangents + 3 * j, self.values + p * COLUMNS + POINT, rows + 6 * (3 * p + j + 1))
                # The second body moves along minus a tangent relative to the first one if it is a.
                gamma[3 * p + j + 1] = self.sign * (dot(tangents + 3 * j, acceleration) + dot(tangents + 3 * j, there))

    @property
    def gaps(self):
        """Gaps, m."""
        cdef Py_ssize_t p
        return [self.values[p * COLUMNS + GAP] for p in range(self.count)]

    @property
    def rates(self):
        """Their rates, m/s."""
        cdef Py_ssize_t p
        return [self.values[p * COLUMNS + RATE] for p in range(self.count)]

    @property
    def scales(self):
        """Largest terms of the curvature, m/s^2."""
        cdef Py_ssize_t p
        return [fabs(self.values[p * COLUMNS + BEND]) for p in range(self.count)]

    cdef Py_ssize_t write_scales(self, double* scales) noexcept:
        """Write these; the number of points."""
        cdef Py_ssize_t p
        for p in range(self.count):
            scales[p] = fabs(self.values[p * COLUMNS + BEND])
        return self.count

    @property
    def insides(self):
        """Distances to the bounds of the features, m."""
        cdef Py_ssize_t p
        return [self.inside(p) for p in range(self.count)]

    cdef double inside(self, Py_ssize_t p) except? -1.0:
        """Distance of a point to the bounds of the face."""
        cdef double[:, ::1] sides = self.group.sides
        cdef Py_ssize_t s
        cdef double distance, least = 0.0
        # A disc, which ends at a rim, and a half-space have no straight sides: the face itself knows its bound.
        if not sides.shape[0]:
            return self.group.face.inside(tuple(self.table()[p, LOCAL : LOCAL + 3].tolist()))
        for s in range(sides.shape[0]):
            distance = dot(self.values + p * COLUMNS + LOCAL, &sides[s, 0]) - sides[s, 3]
            least = distance if s == 0 or distance < least else least
        return least

    cdef int find_extremes(self, double* inside, double* gap, double* rate, double* lowest) except -1:
        """Extremes over these points and those before: distance to the bounds, absolute gap and rate, and lowest gap."""
        cdef Py_ssize_t p
        for p in range(self.count):
            lowest[0] = min(lowest[0], self.values[p * COLUMNS + GAP])
            inside[0] = min(inside[0], self.inside(p))
            gap[0], rate[0] = max(gap[0], fabs(self.values[p * COLUMNS + GAP])), max(rate[0], fabs(self.values[p * COLUMNS + RATE]))
        return 0

    cdef void add_resultant(
        self, const double* forces, Py_ssize_t at, double total, Py_ssize_t count, double* out
    ) noexcept:
        """Add these points to the resultant of their pair; see :func:`add_point`."""
        cdef Py_ssize_t p
        for p in range(self.count):
            add_point(self.values + p * COLUMNS + NORMAL, self.values + p * COLUMNS + POINT, forces[at + p], total, count, out)

    cdef object table(self):
        """Numbers of all points, (m, columns)."""
        return np.frombuffer(self.block).reshape(-1, <int>COLUMNS)

    @property
    def normals(self):
        """Normals from a to b, (m, 3)."""
        return self.table()[:, NORMAL : NORMAL + 3]

    @property
    def points(self):
        """Points of application of the forces, (m, 3)."""
        return self.table()[:, POINT : POINT + 3]

    @property
    def states(self):
        """States of the features."""
        places, rates = self.table()[:, PLACE : PLACE + 3], map(tuple, self.table()[:, POINT_RATE : POINT_RATE + 3].tolist())
        bends = self.table()[:, BEND].tolist()
        states = zip(self.gaps, self.rates, self.normals, self.points, places, bends, self.insides, rates, strict=True)
        return [
            FeatureState(gap, rate, normal, point, place, place, bend, abs(bend), inside, point_rate)
            for gap, rate, normal, point, place, bend, inside, point_rate in states
        ]


cdef void add_point(
    const double* normal, const double* point, double force, double total, Py_ssize_t count, double* out
) noexcept:
    """Add a point of a pair to its resultant force, its centre and its mean normal, (3, 3).

    Args:
        normal: Its normal, (3,).
        point: The point, (3,).
        force: Its normal force, N.
        total: Sum of the normal forces of the pair, N.
        count: Number of points of the pair.
        out: The resultant.
    """
    cdef int i
    # Without force there is no centre of pressure: the middle of the points stands for it.
    cdef double weight = force / total if total > 0.0 else 1.0 / count
    for i in range(3):
        out[i] += force * normal[i]
        # The centre of pressure: the point about which the normal forces have no moment across the normal.
        out[3 + i] += weight * point[i]
        # Weighted as the centre is, so that a point without force does not tilt the mean.
        out[6 + i] += weight * normal[i]
