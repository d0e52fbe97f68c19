# cython: boundscheck=False, wraparound=False, cdivision=True
"""Whether points that slide allow an explicit step of a given length: the rule of ``friction/decision.py`` for such steps."""

import numpy as np

from ffsm_mj.contact_models.persistent.friction.decision import DEVIATION_M_S, NEAR_STOP, STIFF
from ffsm_mj.contact_models.persistent.friction.modes import Layers

from libc.float cimport DBL_MIN
from libc.math cimport exp, fabs, hypot

from ffsm_mj._core.contacts cimport ContactEvaluation, slips_along_a_line


cdef double _DEVIATION_M_S = DEVIATION_M_S, _NEAR_STOP = NEAR_STOP, _STIFF = STIFF


cdef bint allows_step(ContactEvaluation evaluation, modes, double left_s, double time_s, efforts) except -1:
    """Whether no point limits a step, which may then be explicit; the layers of the points are then those of its start.

    Args:
        evaluation: The points, of which all with friction slide and go on to.
        modes: Their ``FrictionModes``, with the layers at the start of the step before.
        left_s: Duration of the step, s.
        time_s: Time at its start.
        efforts: Efforts in it, bit by bit.
    """
    cdef const double* G = evaluation.memory.delassus()
    cdef const double* forces = evaluation.present_forces()
    cdef double[:, ::1] layer
    cdef const double[::1] deviations, damping, speeds, strengths
    cdef Py_ssize_t p, i, j, m = evaluation.memory.rows, count = 0
    cdef double largest, k, r, along, across, deviation, left, slip
    cdef double[2] f
    cdef bint continues
    turning = []
    for p in range(evaluation.memory.points):
        # A slip along a line cannot turn: its friction is constant in direction, and not stiff.
        if evaluation.memory.rubs[p] and not slips_along_a_line(G, m, p, &largest):
            turning.append(p)
    if not turning:
        modes.layers = None
        return True
    last, points = modes.layers, tuple([evaluation.contact_points[p] for p in turning])
    # Efforts that jump begin a new layer: the direction that friction would settle to is another one.
    continues = last is not None and last.points == points and last.efforts == efforts
    if continues:
        deviations, damping, speeds, strengths = last.deviations, last.damping, last.speeds, last.strengths
    table = np.empty((4, len(turning)))
    layer = table
    for i, p in enumerate(turning):
        for j in range(2):
            f[j] = product(G + (3 * p + 1 + j) * m, forces, m) + evaluation.b[3 * p + 1 + j]
        slips_along_a_line(G, m, p, &largest)
        r = evaluation.speeds[p]
        k = evaluation.mu[p] * max(forces[3 * p], 0.0) * largest
        along = evaluation.slips[2 * p] * f[0] + evaluation.slips[2 * p + 1] * f[1]
        across = fabs(evaluation.slips[2 * p] * f[1] - evaluation.slips[2 * p + 1] * f[0])
        # How far the slip is from the direction to which friction turns it, at the rate k / |u|: a fast mode that decays.
        deviation = r * min(1.0, across / max(k + fabs(along), DBL_MIN))
        layer[0, i], layer[1, i], layer[2, i], layer[3, i] = deviation, 0.0, r, k
        if continues:
            slip = max(max(r, speeds[i]), DBL_MIN)
            layer[0, i], layer[1, i] = deviations[i], damping[i] + strengths[i] * (time_s - last.time_s) / slip
        # The deviation of the state has a floor of rounding; what is left of the one at the start of the layer falls below
        # it.
        left = min(deviation, layer[0, i] * exp(-layer[1, i]))
        if (
            # A layer that has not settled limits the step, a stop ahead divides it, and a stiff settled point makes it
            # implicit (decision.py).
            not left <= _DEVIATION_M_S
            or (along < 0.0 and _DEVIATION_M_S < r < -_NEAR_STOP * left_s * along)
            or left_s * (k + hypot(f[0], f[1])) > _STIFF * r
        ):
            return False
    modes.layers = Layers(points, efforts, time_s, *table)
    return True


cdef inline double product(const double* row, const double* forces, Py_ssize_t count) noexcept:
    cdef double total = 0.0
    cdef Py_ssize_t j
    for j in range(count):
        total += row[j] * forces[j]
    return total
