# cython: boundscheck=False, wraparound=False, cdivision=True
"""How a contact normal turns, and how the contact point moves over both surfaces: six equations in the plane across the normal.

Vectors in that plane are their two coordinates along tangents.
"""

import numpy as np

from libc.math cimport atan2, fabs, hypot, INFINITY

from ffsm_mj._core.memory cimport numbers, room


def along(double x, double y):
    """Projector on a direction of the plane, (2, 2)."""
    cdef double square = x * x + y * y
    return np.array(((x * x / square, x * y / square), (x * y / square, y * y / square)))


def flat(const double[:, :] corners, const double[:] point, const double[:, :] axes, double at_end):
    """Projector on the flat directions at the contact point, (2, 2), of a feature that is a corner, an edge or a face.

    Args:
        corners: Its corners, world axes, (k, 3), m.
        point: The contact point, m, (3,).
        axes: Tangents, (2, 3).
        at_end: Share of the length of the feature within which the contact point is at an end of it.
    """
    cdef Py_ssize_t count = corners.shape[0], i, k
    cdef double reach = 0.0, nearest = INFINITY, x, y, angle, middle_x = 0.0, middle_y = 0.0
    cdef bytearray block = room(3 * count + 3)
    cdef double* places = numbers(block)  # both coordinates, and an angle by which they are in order around the face
    cdef double* place
    for k in range(count):
        place = places + 3 * k
        for i in range(2):
            place[i] = (
                axes[i, 0] * (corners[k, 0] - point[0])
                + axes[i, 1] * (corners[k, 1] - point[1])
                + axes[i, 2] * (corners[k, 2] - point[2])
            )
            reach = max(reach, fabs(place[i]))
        nearest = min(nearest, hypot(place[0], place[1]))
        middle_x, middle_y = middle_x + place[0] / count, middle_y + place[1] / count
    reach *= at_end
    if count < 2 or nearest <= reach:
        return np.zeros((2, 2))  # a single point, or the contact is at a corner
    if count == 2:
        return along(places[3] - places[0], places[4] - places[1])
    for k in range(count):
        x, y = places[3 * k], places[3 * k + 1]
        angle = atan2(y - middle_y, x - middle_x)
        i = k
        while i > 0 and places[3 * i - 1] > angle:
            places[3 * i], places[3 * i + 1], places[3 * i + 2] = places[3 * i - 3], places[3 * i - 2], places[3 * i - 1]
            i -= 1
        places[3 * i], places[3 * i + 1], places[3 * i + 2] = x, y, angle
    for k in range(count):
        place, i = places + 3 * k, 3 * ((k + 1) % count)
        x, y = places[i] - place[0], places[i + 1] - place[1]
        if fabs(place[0] * y - place[1] * x) <= reach * hypot(x, y):
            return along(x, y)  # the contact is on a side of the face
    return np.eye(2)


def turning(const double[:] normal, const double[:, :] axes, double gap, *sides):
    """Rate of the normal, and velocities of the contact point over both surfaces, world axes, (3, 3).

    Two equations per surface, and the condition that the contact points stay opposite. They may be singular (a face on a face
    has no defined contact point); the least-norm solution then serves.

    Args:
        normal: Unit normal from A to B, world axes.
        axes: Tangents, (2, 3).
        gap: The gap, m.
        sides: For A and for B the velocity of the material point there, and its angular velocity, (3,) each; the projector on
            flat directions, (2, 2); radii of curvature, (3, 3), or None for a surface without; and the curvature with which
            the normal tilts over the flat direction as the contact slides along it, 1/m.
    """
    cdef double[:, ::1] system = np.zeros((6, 6))
    cdef double[::1] right = np.zeros(6)
    cdef const double[:] velocity, omega
    cdef const double[:, :] projector, radii
    cdef double[2] turn
    cdef double[4] bound, bent
    cdef double[3] turned
    cdef double rate, across
    cdef int k, i, j, l, m
    for k in range(2):
        velocity, omega, projector, of_radii, tilting = sides[k]
        rate = tilting
        turned[0] = omega[1] * normal[2] - omega[2] * normal[1]
        turned[1] = omega[2] * normal[0] - omega[0] * normal[2]
        turned[2] = omega[0] * normal[1] - omega[1] * normal[0]
        for i in range(2):
            turn[i] = axes[i, 0] * turned[0] + axes[i, 1] * turned[1] + axes[i, 2] * turned[2]
            across = axes[i, 0] * velocity[0] + axes[i, 1] * velocity[1] + axes[i, 2] * velocity[2]
            right[4 + i] += across if k == 0 else -across
        bent[0] = bent[1] = bent[2] = bent[3] = 0.0
        if of_radii is not None:
            radii = of_radii
            for i in range(2):
                for j in range(2):
                    for l in range(3):
                        for m in range(3):
                            bent[2 * i + j] += axes[i, l] * radii[l, m] * axes[j, m]
        for i in range(2):
            for j in range(2):
                bound[2 * i + j] = projector[i, j]
                for l in range(2):
                    # The normal of B is opposite: as it turns, its contact point moves the other way.
                    across = (<double>(i == l) - projector[i, l]) * bent[2 * l + j]
                    bound[2 * i + j] -= across if k == 0 else -across
                system[2 * k + i, j] = bound[2 * i + j]
                system[2 * k + i, 2 + 2 * k + j] = (i == j) - projector[i, j] - rate * projector[i, j]
            right[2 * k + i] = bound[2 * i] * turn[0] + bound[2 * i + 1] * turn[1]
    for i in range(2):
        system[4 + i, i], system[4 + i, 2 + i], system[4 + i, 4 + i] = -gap, -1.0, 1.0
    return np.linalg.lstsq(np.asarray(system), np.asarray(right), rcond=None)[0].reshape(3, 2) @ np.asarray(axes)
