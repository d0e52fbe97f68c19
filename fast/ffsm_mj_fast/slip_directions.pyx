# cython: boundscheck=False, wraparound=False, cdivision=True
"""Slips of points and their directions within a step; see slip_directions in ffsm_mj.contact_models.persistent.friction."""

from ffsm_mj.tolerances import RANK

from libc.math cimport INFINITY, atan2, cos, sin, sqrt

from ffsm_mj_fast.row_memory cimport RowMemory

cdef double _RANK = RANK


cdef void find_slips(RowMemory own, double* slips) noexcept:
    """Write the slip velocities of all points along the tangents, m/s, (k, 2)."""
    cdef Py_ssize_t p
    for p in range(own.points):
        slips[2 * p], slips[2 * p + 1] = own.velocity(3 * p + 1), own.velocity(3 * p + 2)


cdef inline void make_unit(double* v) noexcept:
    cdef double size = sqrt(v[0] * v[0] + v[1] * v[1])
    if size > 0.0:
        v[0], v[1] = v[0] / size, v[1] / size


cdef bint find_line(RowMemory own, Py_ssize_t p, double* line) noexcept:
    """Whether a point can slip along one line only, and the unit vector along it."""
    cdef double a, b = 0.0, c, largest
    cdef Py_ssize_t d, row = 3 * p + 1
    a, c = own.inverse_mass(row), own.inverse_mass(row + 1)
    for d in range(own.nv):
        b += own.response[row * own.nv + d] * own.J[(row + 1) * own.nv + d]
    largest = 0.5 * (a + c) + sqrt(0.25 * (a - c) * (a - c) + b * b)
    if a * c - b * b > _RANK * largest * largest:
        return False
    a = 0.5 * atan2(2.0 * b, a - c)
    line[0], line[1] = cos(a), sin(a)
    return True


cdef double find_directions(
    RowMemory own,
    const double* slips,
    const double[:, ::1] at_start,
    const unsigned char[::1] slides,
    const unsigned char[::1] straight,
    double* found,
) noexcept:
    """Write unit directions of slip, with the sense that it had at the start of the step, (k, 2); zero for other points.

    Args:
        own: Rows of the points.
        slips: Slip velocities along the tangents, m/s, (k, 2).
        at_start: Directions of slip at the start of the step, world axes, (k, 3).
        slides: Points that slide, (k,).
        straight: Points that keep the direction, (k,).
        found: The directions.

    Returns:
        Least slip along the direction at the start, m/s.
    """
    cdef Py_ssize_t p
    cdef int i
    cdef double[2] start
    cdef double[2] unit
    cdef double forward, least = INFINITY
    cdef const double* axes
    for p in range(own.points):
        found[2 * p] = found[2 * p + 1] = 0.0
        if not slides[p]:
            continue
        axes, start[0], start[1] = own.axes + 9 * p, 0.0, 0.0
        for i in range(3):
            start[0] += axes[3 + i] * at_start[p, i]
            start[1] += axes[6 + i] * at_start[p, i]
        make_unit(start)
        unit[0], unit[1] = slips[2 * p], slips[2 * p + 1]
        forward = unit[0] * start[0] + unit[1] * start[1]
        least = min(least, forward)
        make_unit(unit)
        if find_line(own, p, &found[2 * p]):
            if found[2 * p] * start[0] + found[2 * p + 1] * start[1] < 0.0:
                found[2 * p], found[2 * p + 1] = -found[2 * p], -found[2 * p + 1]
        elif straight[p] or (unit[0] == 0.0 and unit[1] == 0.0):
            found[2 * p], found[2 * p + 1] = start[0], start[1]
        else:
            found[2 * p] = -unit[0] if forward < 0.0 else unit[0]
            found[2 * p + 1] = -unit[1] if forward < 0.0 else unit[1]
    return least
