# cython: boundscheck=False, wraparound=False, cdivision=True
"""Relative motion of the two sites of an armed grasp, and how near it is to the bounds of the grasp: in every step."""

from math import hypot  # rounds better than the square root of a sum

from libc.math cimport atan2, fabs, INFINITY, isinf, NAN

from ffsm_mj._core.algebra cimport cross, dot
from ffsm_mj._core.functions cimport address, mj, mjData, mjModel, mjOBJ_XBODY
from ffsm_mj.tolerances import CANCELLED


Norms = tuple[float, float, float, float]

cdef double _CANCELLED = CANCELLED
cdef double _MARGIN = 1.1  # relative speeds within a step may exceed those at its ends by this factor


cdef class RelativeMotion:
    """Relative motion of the sites at one state, (object less robot), world axes.

    Attributes:
        norms: Norms of the vectors: distance in m, angle in rad, speed in m/s and rad/s.
    """

    cdef readonly tuple norms
    cdef double[12] values

    @property
    def vectors(self):
        """Offset in m, rotation vector in rad, velocity in m/s and rad/s, (4, 3)."""
        cdef int i
        return [[self.values[3 * i], self.values[3 * i + 1], self.values[3 * i + 2]] for i in range(4)]


cdef class SiteMotion:
    """Evaluates the relative motion of two sites."""

    cdef const mjModel* m
    cdef int link_body, root_body, robot_site, object_site
    cdef double[6] one, other  # twists of the link and of the object's base in the last evaluation, angular first
    cdef const double[:, ::1] sites, bodies, frames
    cdef object model, data

    def __init__(self, model, int link, int root, int robot_site, int object_site):
        """Bind to ids of the bodies and sites: link and object's base, robot's and object's site."""
        self.model, self.m, self.data = model, <const mjModel*>address(model), None
        self.link_body, self.root_body, self.robot_site, self.object_site = link, root, robot_site, object_site

    def at(self, data):
        """Relative motion at the state in ``data``; positions and velocities must be current."""
        cdef RelativeMotion motion = RelativeMotion.__new__(RelativeMotion)
        cdef double* values = motion.values
        cdef const mjData* d = <const mjData*>address(data)
        cdef const double* place
        cdef const double* link
        cdef const double* root
        cdef const double* there
        cdef const double* robot
        cdef double[3] arm, moved
        cdef double[9] turn
        cdef double sine, angle
        cdef int i, k
        if data is not self.data:
            self.data, self.sites, self.frames, self.bodies = data, data.site_xpos, data.site_xmat, data.xpos
        mj.objectVelocity(self.m, d, mjOBJ_XBODY, self.link_body, self.one, 0)
        mj.objectVelocity(self.m, d, mjOBJ_XBODY, self.root_body, self.other, 0)
        place = &self.sites[self.object_site, 0]
        link, root = &self.bodies[self.link_body, 0], &self.bodies[self.root_body, 0]
        # Both at the object's site, as on one rigid body: the velocity of the robot's own site would have a part of the
        # rotation, of the size of the offset.
        for i in range(3):
            values[i], arm[i] = place[i] - self.sites[self.robot_site, i], place[i] - root[i]
        cross(self.other, arm, moved)
        for i in range(3):
            values[6 + i], arm[i] = self.other[3 + i] + moved[i], place[i] - link[i]
        cross(self.one, arm, moved)
        for i in range(3):
            values[6 + i] -= self.one[3 + i] + moved[i]
            values[9 + i] = self.other[i] - self.one[i]
        there, robot = &self.frames[self.object_site, 0], &self.frames[self.robot_site, 0]
        for i in range(3):
            for k in range(3):
                turn[3 * i + k] = dot(there + 3 * i, robot + 3 * k)
        values[3], values[4], values[5] = turn[7] - turn[5], turn[2] - turn[6], turn[3] - turn[1]
        # atan2 keeps the angle accurate near zero, where acos is not.
        sine = hypot(values[3], values[4], values[5])
        angle = atan2(sine, turn[0] + turn[4] + turn[8] - 1.0)
        # Where the sine is zero the axis is not defined; the norm, which the bounds use, still is the angle.
        for i in range(3):
            values[3 + i] = values[3 + i] * angle / sine if sine != 0.0 else angle if i == 0 else 0.0
        motion.norms = tuple([hypot(values[3 * i], values[3 * i + 1], values[3 * i + 2]) for i in range(4)])
        return motion

    def rounding(self):
        """How far the norms of the last evaluation may differ where they are equal in exact arithmetic.

        Distances and velocities are differences, which are known as well as what cancels in them.
        """
        cdef double place = 0.0, turning = 0.0, moving = 0.0
        cdef int i
        for i in range(3):
            place = max(place, fabs(self.sites[self.robot_site, i]), fabs(self.sites[self.object_site, i]))
            turning = max(turning, fabs(self.one[i]), fabs(self.other[i]))
            moving = max(moving, fabs(self.one[3 + i]), fabs(self.other[3 + i]))
        # The angle has no terms that cancel: atan2 of the relative rotation is known to rounding of numbers of 1.
        return (
            _CANCELLED * (1.0 + place), _CANCELLED, _CANCELLED * (1.0 + moving), _CANCELLED * (1.0 + turning)
        )


cdef class ClosingBounds:
    """Bounds on the norms of a relative motion, in their order."""

    cdef double[4] bounds  # infinite where there is none

    def __init__(self, bounds):
        """Take the bounds; None for a value without bound."""
        cdef int i
        for i in range(4):
            self.bounds[i] = INFINITY if bounds[i] is None else bounds[i]

    cpdef double ratio(self, norms) except *:
        """Largest ratio of a value to its bound; all bounds hold if it is at most 1."""
        cdef double largest = -INFINITY
        cdef int i
        for i in range(4):
            if not isinf(self.bounds[i]):
                largest = max(largest, <double>norms[i] / self.bounds[i])
        return largest

    def rate(self, RelativeMotion motion, accelerations):
        """Rate of the largest ratio, 1/s.

        Distance and angle change at the relative velocities along them, speeds at the relative accelerations along them.

        Args:
            motion: Relative motion of the sites.
            accelerations: Rates of the relative velocities, (2, 3).
        """
        cdef double[6] rates
        cdef int i
        for i in range(6):
            rates[i] = accelerations[i // 3][i % 3]
        return self.rate_at(motion, rates)

    cdef double rate_at(self, RelativeMotion motion, const double* accelerations) except *:
        cdef double value, largest = -INFINITY, size, along
        cdef const double* one
        cdef const double* other
        cdef int i, which = 0
        for i in range(4):
            value = <double>motion.norms[i] / self.bounds[i]
            if value > largest:
                largest, which = value, i
        # The rate of a maximum is that of the value that has it.
        size = motion.norms[which]
        one = &motion.values[3 * which]
        other = accelerations + 3 * which - 6
        if which < 2:
            other = &motion.values[3 * which + 6]
        along = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
        # A norm at zero has a corner: it rises at the speed of the vector, in whatever direction that is.
        return (along / size if size != 0.0 else <double>hypot(other[0], other[1], other[2])) / self.bounds[which]

    def lowest_by_tangents(self, RelativeMotion start, RelativeMotion end, double duration_s):
        """Where the tangents of the largest ratio at both ends of a step meet; NaN if it does not fall and then rise.

        At mean accelerations. That is at or below the minimum of a convex function.
        """
        cdef double[6] mean
        cdef double falls, rises, before, after
        cdef int i
        if not duration_s > 0.0:
            return NAN  # a part of a step without length has no mean acceleration
        for i in range(6):
            mean[i] = (end.values[6 + i] - start.values[6 + i]) / duration_s
        falls, rises = self.rate_at(start, mean), self.rate_at(end, mean)
        # Monotone or with a maximum: the least value is at one of the ends.
        if not falls < 0.0 < rises:
            return NAN
        before, after = self.ratio(start.norms), self.ratio(end.norms)
        return (before * rises - after * falls + falls * rises * duration_s) / (rises - falls)

    def may_dip(self, RelativeMotion start, RelativeMotion end, double duration_s):
        """Whether all bounds may hold inside a step although they hold at neither end.

        Distance and angle change no faster than the relative speeds, which gives a lower bound on each; a speed is assumed
        to fall below its smaller end value by at most the difference of the two.
        """
        cdef double least, a, b
        cdef int i
        for i in range(4):
            a, b = start.norms[i], end.norms[i]
            if i < 2:
                # With the largest relative speed v the value is at least start - v t, and at least end - v (T - t): their
                # mean bounds it for every t.
                least = 0.5 * (a + b - _MARGIN * max(<double>start.norms[i + 2], <double>end.norms[i + 2]) * duration_s)
            else:
                # Accelerations inside a step have no bound: a speed is assumed to bend by no more than it changes over the
                # step.
                least = min(a, b) - fabs(a - b)
            if least > self.bounds[i]:
                return False
        return True
